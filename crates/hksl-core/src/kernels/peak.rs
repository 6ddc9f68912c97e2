//! Measurement of the CPU's peak floating-point rate.

use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::Kernels;

/// Independent sums, enough to hide the latency of fused multiply-adds on current CPUs.
const SUMS: usize = 12;
/// Multiply-adds per sum.
const ROUNDS: usize = 4_000_000;

/// Runs fused multiply-adds on registers in all threads for about 0.02 s and returns the number of floating-point
/// operations, two per multiply-add. Divided by the elapsed time, this is the peak rate of all kernels. Returns None for
/// the portable kernels.
///
/// ```
/// use hksl_core::kernels::{Kernels, multiply_adds};
///
/// assert!(multiply_adds(Kernels::detect()).is_none_or(|operations| operations > 1e8));
/// assert!(multiply_adds(Kernels::portable()).is_none());
/// ```
pub fn multiply_adds(kernels: Kernels) -> Option<f64> {
    let threads = rayon::current_num_threads();
    let lanes: Option<Vec<usize>> =
        (0..threads).into_par_iter().with_max_len(1).map(|_| kernels.run(MultiplyAdds)).collect();
    Some(lanes?.into_iter().map(|lanes| (2 * lanes * SUMS * ROUNDS) as f64).sum())
}

struct MultiplyAdds;

impl WithSimd for MultiplyAdds {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> usize {
        let mut sums = [simd.splat_f32s(1.0); SUMS];
        let (factor, term) = std::hint::black_box((simd.splat_f32s(0.999), simd.splat_f32s(0.001)));
        for _ in 0..ROUNDS {
            for sum in &mut sums {
                *sum = simd.mul_add_e_f32s(*sum, factor, term);
            }
        }
        std::hint::black_box(sums);
        S::F32_LANES
    }
}
