//! Adam's step as operations on tensors, for GPUs.

#[cfg(feature = "cuda")]
use candle_core::CudaStorage;
use candle_core::{CpuStorage, InplaceOp2, InplaceOp3, Layout, Result};

use crate::kernels::{MomentStep, WeightStep};
use crate::on_host::{numbers, numbers_mut};

/// Updates moments `(2, N)` with gradients `(N)` and weights `(N)`.
pub(super) struct MoveMoments(pub(super) MomentStep);

impl InplaceOp3 for MoveMoments {
    fn name(&self) -> &'static str {
        "adam-moments"
    }

    fn cpu_fwd(
        &self,
        moments: &mut CpuStorage,
        moments_layout: &Layout,
        gradients: &CpuStorage,
        gradients_layout: &Layout,
        weights: &CpuStorage,
        weights_layout: &Layout,
    ) -> Result<()> {
        let gradients = numbers(gradients, gradients_layout)?;
        let moments = numbers_mut(moments, moments_layout)?;
        self.0.apply(moments, gradients, numbers(weights, weights_layout)?);
        Ok(())
    }

    #[cfg(feature = "cuda")]
    fn cuda_fwd(
        &self,
        moments: &mut CudaStorage,
        moments_layout: &Layout,
        gradients: &CudaStorage,
        gradients_layout: &Layout,
        weights: &CudaStorage,
        weights_layout: &Layout,
    ) -> Result<()> {
        let read = [(gradients, gradients_layout), (weights, weights_layout)];
        self.0.on_gpu((moments, moments_layout), read)
    }
}

/// Updates weights `(N)` with moments `(2, N)`.
pub(super) struct MoveWeight(pub(super) WeightStep);

impl InplaceOp2 for MoveWeight {
    fn name(&self) -> &'static str {
        "adam-weight"
    }

    fn cpu_fwd(
        &self,
        weights: &mut CpuStorage,
        weights_layout: &Layout,
        moments: &CpuStorage,
        moments_layout: &Layout,
    ) -> Result<()> {
        let moments = numbers(moments, moments_layout)?;
        self.0.apply(numbers_mut(weights, weights_layout)?, moments);
        Ok(())
    }

    #[cfg(feature = "cuda")]
    fn cuda_fwd(
        &self,
        weights: &mut CudaStorage,
        weights_layout: &Layout,
        moments: &CudaStorage,
        moments_layout: &Layout,
    ) -> Result<()> {
        self.0.on_gpu((weights, weights_layout), (moments, moments_layout))
    }
}
