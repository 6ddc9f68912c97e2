//! Forwards MuJoCo's messages to `tracing` instead of a file in the working directory.

use std::collections::BTreeSet;
use std::io::Write;
use std::sync::{Mutex, Once};

use mujoco_rs::prelude::{MjLogMessage, MjtLogLevel, set_log_handler};

/// Redirects MuJoCo's messages. All code of this crate calls this function before using MuJoCo.
#[allow(unsafe_code)]
pub(crate) fn redirect() {
    static REDIRECTED: Once = Once::new();
    REDIRECTED.call_once(|| {
        // SAFETY: the handler must be set while no other thread uses MuJoCo. This crate loads models only after this call,
        // and other threads wait here until the first has finished.
        unsafe { set_log_handler(handle) };
    });
}

/// Whether the message is a repeated deprecation warning. Every environment of a process compiles the same models.
fn is_repeated_deprecation(subject: &str) -> bool {
    static SAID: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
    let deprecation = subject.contains("deprecated");
    deprecation && SAID.lock().is_ok_and(|mut said| !said.insert(subject.to_owned()))
}

fn handle(message: &MjLogMessage) {
    let subject = message.subject();
    match message.level() {
        MjtLogLevel::mjLOG_DEBUG | MjtLogLevel::mjLOG_INFO => tracing::debug!("MuJoCo: {subject}"),
        MjtLogLevel::mjLOG_WARNING if is_repeated_deprecation(subject) => {}
        MjtLogLevel::mjLOG_WARNING => tracing::warn!("MuJoCo: {subject}"),
        // MuJoCo terminates the process when this handler returns, so the message must be printed here, without a panic.
        MjtLogLevel::mjLOG_ERROR => {
            let _ = writeln!(std::io::stderr(), "MuJoCo stopped the program: {subject}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_repeated_deprecations_are_suppressed() {
        let logged = |subject: &str| (0..3).filter(|_| !is_repeated_deprecation(subject)).count();
        assert_eq!(logged("attribute 'settotalmass' is deprecated"), 1);
        assert_eq!(logged("Nan, Inf or huge value in QACC"), 3);
    }
}
