//! The process: its command, and how it uses memory and threads.

use hksl_train::shell::quoted;

/// Sets what can only be set before the first thread.
///
/// The C library's allocator keeps what is freed: a learning step frees and asks again for the same large
/// blocks; handed back to the system in between, each would come back page by page, zeroed. All threads share
/// one arena, for those of other threads are handed back whatever is set. And candle's own
/// threads, which would wait for small operations in a loop on the cores that our kernels use, are not started
/// unless `CANDLE_NUM_THREADS` asks for them.
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

/// Other systems' allocators keep what they need by themselves.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn prepare() {}

/// The command as a shell would take it again.
pub fn command_line() -> String {
    let arguments = std::env::args_os().skip(1).map(|a| quoted(&a.to_string_lossy()));
    std::iter::once("hksl".to_owned()).chain(arguments).collect::<Vec<_>>().join(" ")
}
