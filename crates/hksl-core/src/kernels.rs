//! Compute kernels: convolutions, linear layers and elementwise operations, forward and backward. CPU kernels work on
//! slices; the feature `cuda` adds kernels for NVIDIA GPUs.
//!
//! [`crate::nn`] wraps the kernels in candle's custom operations for autograd. [`Kernels`] selects the CPU's instruction
//! set. [`Kernels::portable`] is plain Rust without vector instructions and the reference for the vector code. Each GPU
//! kernel has a counterpart on slices with the same result, which tests without a GPU use.
//!
//! Large CPU operations are split into tasks of fixed size, and partial sums are added in the order of the tasks, so
//! results do not depend on the number of threads.

pub(crate) mod activation;
mod adam;
mod convolutions;
#[cfg(feature = "cuda")]
mod cuda;
mod gates;
mod im2col;
mod layer_norm;
mod linear;
mod map_convolution;
mod matrices;
mod memory;
mod operations;
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
    Elementwise, elementwise_on_gpu, layer_norm_backward_on_gpu, layer_norm_on_gpu, moving_average,
};
pub(crate) use gates::{apply_gate, apply_gate_backward, gru_update, gru_update_backward};
pub(crate) use im2col::Im2col;
pub(crate) use layer_norm::{layer_norm, layer_norm_backward};
pub(crate) use linear::{LinearGradients, Sizes, linear, linear_gradients};
pub(crate) use map_convolution::{MapConvolution, channel_sums};
pub(crate) use memory::{Block, Pool};
pub(crate) use operations::Counter;
pub use operations::Operations;
pub use peak::multiply_adds;

/// Instruction set of the CPU kernels.
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
    /// The fastest kernels that this CPU supports.
    pub fn detect() -> Self {
        Self::available()[0]
    }

    /// All kernels that this CPU supports, the fastest first and [`Kernels::portable`] last.
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

    /// Kernels in plain Rust without explicit vector instructions.
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

    /// Runs vector code with this instruction set. Returns None for the portable kernels.
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

    /// f32 elements per vector; 1 for the portable kernels.
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

/// Kernels with their buffer pool and their operation count.
#[derive(Debug, Clone, Default)]
pub(crate) struct Engine {
    pub(crate) kernels: Kernels,
    pub(crate) pool: Pool,
    pub(crate) counter: Counter,
}

impl Engine {
    /// Creates an engine with an empty buffer pool and a count of 0.
    pub(crate) fn new(kernels: Kernels) -> Self {
        Self { kernels, ..Self::default() }
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
