//! Process-wide settings: allocator, threads and the command line.

use hksl_train::shell::quoted;

/// Applies settings that must be made before the first thread starts.
///
/// The C library's allocator is told to keep freed memory. A learning step frees and reallocates the same large
/// blocks, and returning them to the system would cost a zeroed page fault for every page. All threads share one
/// arena, because the arenas of other threads are returned to the system regardless of these settings. Candle's
/// thread pool would busy-wait on the cores that our kernels use, so it is disabled unless `CANDLE_NUM_THREADS`
/// is set.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[allow(unsafe_code)]
pub fn prepare() {
    // SAFETY: `mallopt` takes two integers and only sets the allocator's parameters; `setenv` copies two strings
    // that end with a zero and changes the environment, which no other thread reads, for none runs yet.
    unsafe {
        libc::mallopt(libc::M_ARENA_MAX, 1);
        libc::mallopt(libc::M_MMAP_MAX, 0);
        libc::mallopt(libc::M_TRIM_THRESHOLD, libc::c_int::MAX);
        libc::mallopt(libc::M_TOP_PAD, 64 << 20);
        libc::setenv(c"CANDLE_NUM_THREADS".as_ptr(), c"1".as_ptr(), 0);
    }
}

/// Nothing to do on other systems.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn prepare() {}

/// The command line, quoted for a shell.
pub fn command_line() -> String {
    let arguments = std::env::args_os().skip(1).map(|a| quoted(&a.to_string_lossy()));
    std::iter::once("hksl".to_owned()).chain(arguments).collect::<Vec<_>>().join(" ")
}
