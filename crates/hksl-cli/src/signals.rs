//! Graceful shutdown on signals.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::SIGINT;
#[cfg(unix)]
use signal_hook::consts::{SIGHUP, SIGTERM, SIGUSR1, SIGUSR2};

#[cfg(unix)]
use crate::standard::error_line;

/// Signals that request a stop: Ctrl-C, `kill`, a closing terminal, and those that batch systems send before a time
/// limit. Slurm sends the signal that the job requests, or TERM; Grid Engine USR1, USR2 and XCPU; LSF USR2; the kernel
/// XCPU at `ulimit -t`.
#[cfg(unix)]
const STOPPING: [i32; 6] = [SIGINT, SIGTERM, SIGHUP, SIGUSR1, SIGUSR2, libc::SIGXCPU];

/// Returns a flag that is set by the first stop signal. A second Ctrl-C ends the process at once, with the exit code
/// that shells use. If HUP is ignored at the start, as under `nohup`, it stays ignored.
///
/// # Errors
/// Signal handlers that cannot be installed.
#[cfg(unix)]
pub fn stop(quiet: bool) -> std::io::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let handled = STOPPING.into_iter().filter(|signal| *signal != SIGHUP || !is_ignored(SIGHUP));
    let mut signals = signal_hook::iterator::Signals::new(handled)?;
    let flag = Arc::clone(&stop);
    std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
        for signal in signals.forever() {
            let again = flag.swap(true, Ordering::Relaxed);
            if again && signal == SIGINT {
                signal_hook::low_level::exit(128 + SIGINT);
            }
            if !again && !quiet {
                error_line(
                    "\nstopping after this step, then saving; press Ctrl-C again to exit at once",
                );
            }
        }
    })?;
    Ok(stop)
}

/// Whether the process ignores a signal.
#[cfg(unix)]
#[allow(unsafe_code)]
fn is_ignored(signal: i32) -> bool {
    let mut present = std::mem::MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: without a new action, `sigaction` only writes the present one into a place that is large enough for it,
    // and all zeros are a valid `sigaction` where it does not.
    let present = unsafe {
        libc::sigaction(signal, std::ptr::null(), present.as_mut_ptr());
        present.assume_init()
    };
    present.sa_sigaction == libc::SIG_IGN
}

/// Turns exceeding `ulimit -f` into a write error, as for a full disk, instead of ending the process.
#[cfg(unix)]
pub fn survive_file_size_limit() {
    // Where it cannot be handled, the system's default stays.
    let _ = signal_hook::flag::register(libc::SIGXFSZ, Arc::default());
}

/// Other systems have no such signal.
#[cfg(not(unix))]
pub fn survive_file_size_limit() {}

/// Other systems support only Ctrl-C.
#[cfg(not(unix))]
pub fn stop(_quiet: bool) -> std::io::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register_conditional_shutdown(SIGINT, 128 + SIGINT, Arc::clone(&stop))?;
    signal_hook::flag::register(SIGINT, Arc::clone(&stop))?;
    Ok(stop)
}
