//! MuJoCo's messages, as events of `tracing` instead of a file in the user's folder.

use std::sync::Once;

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

fn handle(message: &MjLogMessage) {
    let subject = message.subject();
    match message.level() {
        MjtLogLevel::mjLOG_DEBUG | MjtLogLevel::mjLOG_INFO => tracing::debug!("MuJoCo: {subject}"),
        MjtLogLevel::mjLOG_WARNING => tracing::warn!("MuJoCo: {subject}"),
        // MuJoCo ends the process when this returns, so nobody else can say why.
        MjtLogLevel::mjLOG_ERROR => eprintln!("MuJoCo stopped the program: {subject}"),
    }
}
