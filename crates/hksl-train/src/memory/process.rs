//! The memory of this process.

use super::meminfo;

/// Resident memory in bytes, if the system tells.
pub(crate) fn resident() -> Option<u64> {
    status("VmRSS:")
}

/// Runs `work` and returns the highest resident memory in bytes meanwhile, if the system tells. Where the system keeps
/// the highest value of the whole process, this is an upper bound.
pub(crate) fn peak_of<T>(work: impl FnOnce() -> T) -> (T, Option<u64>) {
    // 5 resets the highest value. Systems may refuse.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
    let result = work();
    (result, status("VmHWM:"))
}

fn status(name: &str) -> Option<u64> {
    meminfo(&std::fs::read_to_string("/proc/self/status").ok()?, name)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn the_peak_includes_what_is_freed_again() {
        let before = resident().unwrap();
        let (pages, peak) = peak_of(|| std::hint::black_box(vec![1u8; 64 << 20]).len());
        assert!(peak.unwrap() > before + (32 << 20), "{before} {pages} {peak:?}");
    }
}
