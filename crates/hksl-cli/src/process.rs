//! Process-wide settings: allocator, threads and the command line.

use std::ffi::OsString;

use hksl_train::shell::quoted;

/// Applies settings that must be made before the first thread starts: [`keep_freed_memory`], and candle's thread pool, which
/// would busy-wait on the cores that our kernels use, is disabled unless `CANDLE_NUM_THREADS` is set.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[allow(unsafe_code)]
pub fn prepare() {
    keep_freed_memory();
    // SAFETY: `setenv` copies two strings that end with a zero and changes the environment, which no other thread
    // reads, for none runs yet.
    unsafe {
        libc::setenv(c"CANDLE_NUM_THREADS".as_ptr(), c"1".as_ptr(), 0);
    }
}

/// Tells the C library's allocator to keep freed memory. A learning step frees and reallocates the same large blocks, and
/// returning them to the system would cost a zeroed page fault for every page. All threads share one arena, because the
/// arenas of other threads are returned to the system regardless of these settings.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[allow(unsafe_code)]
pub fn keep_freed_memory() {
    // SAFETY: `mallopt` takes two integers and, holding the allocator's lock, only sets its parameters.
    unsafe {
        libc::mallopt(libc::M_ARENA_MAX, 1);
        libc::mallopt(libc::M_MMAP_MAX, 0);
        libc::mallopt(libc::M_TRIM_THRESHOLD, libc::c_int::MAX);
        libc::mallopt(libc::M_TOP_PAD, 64 << 20);
    }
}

/// Nothing to do on other systems.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn prepare() {}

/// Nothing to do on other systems.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn keep_freed_memory() {}

/// The command line, quoted for a shell.
pub fn command_line(arguments: &[OsString]) -> String {
    let arguments = arguments.iter().map(|a| quoted(&a.to_string_lossy()));
    std::iter::once("hksl".to_owned()).chain(arguments).collect::<Vec<_>>().join(" ")
}
