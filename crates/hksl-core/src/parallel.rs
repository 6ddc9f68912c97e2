//! Parallel computation of independent networks on the CPU.
//!
//! The kernels distribute large operations over all threads. Small operations and autograd's bookkeeping run on one thread.
//! Computing independent networks in parallel fills those gaps. Results do not depend on it. On other devices all work
//! runs sequentially on one thread.

use candle_core::Device;
use rayon::prelude::*;

/// Runs `work` inside the kernels' thread pool, which avoids the latency of waking threads for each operation.
pub fn inside<T: Send>(device: &Device, work: impl FnOnce() -> T + Send) -> T {
    if device.is_cpu() { rayon::scope(|_| work()) } else { work() }
}

/// Computes two results, in parallel on a CPU.
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

/// Computes the results for all `items` in their order, in parallel on a CPU. Returns the first error if there is one.
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
