//! Independent networks side by side on the CPU's threads.
//!
//! The kernels share every large operation among the threads; what is between them (small operations, autograd's
//! bookkeeping) they leave to one. Two networks that do not need each other fill those gaps for each other. No
//! result depends on it. On other devices everything runs in order, from one thread.

use candle_core::Device;
use rayon::prelude::*;

/// Runs `work` on one of the CPU's threads that share the kernels' work, where each operation starts without
/// waiting for them to wake.
pub fn inside<T: Send>(device: &Device, work: impl FnOnce() -> T + Send) -> T {
    if device.is_cpu() { rayon::scope(|_| work()) } else { work() }
}

/// Both results.
///
/// ```
/// use candle_core::Device;
/// use hksl_core::parallel::both;
///
/// assert_eq!(both(&Device::Cpu, || 1 + 1, || "two"), (2, "two"));
/// ```
pub fn both<A: Send, B: Send>(
    device: &Device,
    first: impl FnOnce() -> A + Send,
    second: impl FnOnce() -> B + Send,
) -> (A, B) {
    if device.is_cpu() { rayon::join(first, second) } else { (first(), second()) }
}

/// The results for all `items`, in their order; the first error if there is one.
pub fn each<I: Sync, T: Send, E: Send>(
    device: &Device,
    items: &[I],
    work: impl Fn(&I) -> Result<T, E> + Sync + Send,
) -> Result<Vec<T>, E> {
    if device.is_cpu() {
        let results: Vec<Result<T, E>> = items.par_iter().map(work).collect();
        results.into_iter().collect()
    } else {
        items.iter().map(work).collect()
    }
}
