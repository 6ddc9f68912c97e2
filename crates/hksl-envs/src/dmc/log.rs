//! MuJoCo's messages, as events of `tracing` instead of a file in the user's folder.

use std::collections::BTreeSet;
use std::io::Write;
use std::sync::{Mutex, Once};

use mujoco_rs::prelude::{MjLogMessage, MjtLogLevel, set_log_handler};

/// Redirects MuJoCo's messages; every path to MuJoCo in this crate begins here.
#[allow(unsafe_code)]
pub(crate) fn redirect() {
    static REDIRECTED: Once = Once::new();
    REDIRECTED.call_once(|| {
        // SAFETY: the handler must be set while no other thread uses MuJoCo. This crate loads every
        // model after this call, and a second thread waits here until the first is through.
        unsafe { set_log_handler(handle) };
    });
}

/// Whether it is a deprecation that was told before: every environment of a process compiles the same models.
fn is_said_before(subject: &str) -> bool {
    static SAID: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
    let deprecation = subject.contains("deprecated");
    deprecation && SAID.lock().is_ok_and(|mut said| !said.insert(subject.to_owned()))
}

fn handle(message: &MjLogMessage) {
    let subject = message.subject();
    match message.level() {
        MjtLogLevel::mjLOG_DEBUG | MjtLogLevel::mjLOG_INFO => tracing::debug!("MuJoCo: {subject}"),
        MjtLogLevel::mjLOG_WARNING if is_said_before(subject) => {}
        MjtLogLevel::mjLOG_WARNING => tracing::warn!("MuJoCo: {subject}"),
        // MuJoCo ends the process when this returns, so nobody else can say why; a panic here would end it sooner.
        MjtLogLevel::mjLOG_ERROR => {
            let _ = writeln!(std::io::stderr(), "MuJoCo stopped the program: {subject}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_deprecation_is_told_once_and_all_else_each_time() {
        let told = |subject: &str| (0..3).filter(|_| !is_said_before(subject)).count();
        assert_eq!(told("attribute 'settotalmass' is deprecated"), 1);
        assert_eq!(told("Nan, Inf or huge value in QACC"), 3);
    }
}
