//! Signals that end a run in good order.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::SIGINT;
#[cfg(unix)]
use signal_hook::consts::{SIGTERM, SIGUSR1};

/// What asks a run to stop: Ctrl-C, `kill`, and the signal that batch systems can send ahead of a time limit.
#[cfg(unix)]
const STOPPING: [i32; 3] = [SIGINT, SIGTERM, SIGUSR1];

/// Set once a signal asks to stop. A second Ctrl-C ends the process at once, with the code that shells give it.
///
/// # Errors
/// A system that does not let signals be handled.
#[cfg(unix)]
pub fn stop(quiet: bool) -> std::io::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let mut signals = signal_hook::iterator::Signals::new(STOPPING)?;
    let flag = Arc::clone(&stop);
    std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
        for signal in signals.forever() {
            let again = flag.swap(true, Ordering::Relaxed);
            if again && signal == SIGINT {
                signal_hook::low_level::exit(128 + SIGINT);
            }
            if !again && !quiet {
                eprintln!("\nstopping after this step, and saving; Ctrl-C again exits at once");
            }
        }
    })?;
    Ok(stop)
}

/// Other systems know Ctrl-C alone.
#[cfg(not(unix))]
pub fn stop(_quiet: bool) -> std::io::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register_conditional_shutdown(SIGINT, 128 + SIGINT, Arc::clone(&stop))?;
    signal_hook::flag::register(SIGINT, Arc::clone(&stop))?;
    Ok(stop)
}
