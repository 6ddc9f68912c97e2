//! The kernels: convolutions, affine maps and what stands between them, forward and backward, on plain slices; and, with
//! the feature `cuda`, on an NVIDIA GPU.
//!
//! No autograd: [`crate::nn`] wraps everything here in candle's custom operations. [`Kernels`] chooses the CPU's
//! instructions; [`Kernels::portable`] is plain Rust, written independently of the vector code, against which that is
//! tested. `cuda` has the GPU's, for each of which there is a function on plain slices that does the same: on those the
//! tests run where there is no GPU, and some serve the CPU too.
//!
//! The CPU's large work is split into tasks of a fixed size, and partial sums are added in the tasks' order, so results do
//! not depend on the number of threads.

pub(crate) mod activation;
mod adam;
mod convolutions;
#[cfg(feature = "cuda")]
mod cuda;
mod gates;
mod layer_norm;
mod linear;
mod map_convolution;
mod matrices;
mod memory;
mod patches;
mod peak;
mod product;
mod simd;
#[cfg(test)]
mod tests;

use std::fmt;

use pulp::WithSimd;

pub(crate) use activation::Activation;
pub(crate) use adam::{MomentStep, WeightStep};
pub(crate) use convolutions::{Convolutions, KERNEL, output_side};
#[cfg(feature = "cuda")]
pub(crate) use cuda::{
    Elementwise, elementwise_on_gpu, layer_norm_back_on_gpu, layer_norm_on_gpu, moving_average,
};
pub(crate) use gates::{blended, blended_back, gated, gated_back};
pub(crate) use layer_norm::{layer_norm, layer_norm_back};
pub(crate) use linear::{LinearGradients, Sizes, linear, linear_gradients};
pub(crate) use map_convolution::{MapConvolution, channel_sums};
pub(crate) use memory::{Block, Pool};
pub(crate) use patches::Places;
pub use peak::multiply_adds;

/// Which instructions the kernels use.
///
/// ```
/// use hksl_core::kernels::Kernels;
///
/// let best = Kernels::detect();
/// assert!(Kernels::available().contains(&best));
/// assert_eq!(Kernels::portable().to_string(), "portable");
/// ```
#[derive(Clone, Copy)]
pub struct Kernels(Set);

#[derive(Clone, Copy)]
enum Set {
    #[cfg(target_arch = "x86_64")]
    Avx512(pulp::x86::V4),
    #[cfg(target_arch = "x86_64")]
    Avx2(pulp::x86::V3),
    #[cfg(target_arch = "aarch64")]
    Neon(pulp::aarch64::Neon),
    Portable,
}

impl Kernels {
    /// The fastest that this CPU has.
    pub fn detect() -> Self {
        Self::available()[0]
    }

    /// All that this CPU has, the fastest first and [`Kernels::portable`] last.
    pub fn available() -> Vec<Self> {
        let mut sets = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            sets.extend(pulp::x86::V4::try_new().map(Set::Avx512));
            sets.extend(pulp::x86::V3::try_new().map(Set::Avx2));
        }
        #[cfg(target_arch = "aarch64")]
        sets.extend(pulp::aarch64::Neon::try_new().map(Set::Neon));
        sets.push(Set::Portable);
        sets.into_iter().map(Self).collect()
    }

    /// Plain Rust without vector instructions of its own.
    pub fn portable() -> Self {
        Self(Set::Portable)
    }

    /// `avx512`, `avx2`, `neon` or `portable`.
    pub fn name(self) -> &'static str {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Set::Avx512(_) => "avx512",
            #[cfg(target_arch = "x86_64")]
            Set::Avx2(_) => "avx2",
            #[cfg(target_arch = "aarch64")]
            Set::Neon(_) => "neon",
            Set::Portable => "portable",
        }
    }

    /// Runs vector code with these instructions; `None` stands for the portable kernels, which have none.
    #[inline]
    fn run<O: WithSimd>(self, operation: O) -> Option<O::Output> {
        use pulp::Simd;
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Set::Avx512(simd) => Some(Simd::vectorize(simd, operation)),
            #[cfg(target_arch = "x86_64")]
            Set::Avx2(simd) => Some(Simd::vectorize(simd, operation)),
            #[cfg(target_arch = "aarch64")]
            Set::Neon(simd) => Some(Simd::vectorize(simd, operation)),
            Set::Portable => None,
        }
    }

    /// Numbers in a vector; 1 for the portable kernels.
    fn lanes(self) -> usize {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Set::Avx512(_) => 16,
            #[cfg(target_arch = "x86_64")]
            Set::Avx2(_) => 8,
            #[cfg(target_arch = "aarch64")]
            Set::Neon(_) => 4,
            Set::Portable => 1,
        }
    }
}

/// Kernels and the memory that they take for a while and give back.
#[derive(Debug, Clone, Default)]
pub(crate) struct Engine {
    pub(crate) kernels: Kernels,
    pub(crate) pool: Pool,
}

impl Engine {
    /// These kernels, and no memory yet.
    pub(crate) fn new(kernels: Kernels) -> Self {
        Self { kernels, pool: Pool::default() }
    }
}

impl Default for Kernels {
    fn default() -> Self {
        Self::detect()
    }
}

impl PartialEq for Kernels {
    fn eq(&self, other: &Self) -> bool {
        self.name() == other.name()
    }
}

impl Eq for Kernels {}

impl fmt::Debug for Kernels {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

impl fmt::Display for Kernels {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}
