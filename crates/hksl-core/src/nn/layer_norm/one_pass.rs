//! Layer normalisation as one operation.

#[cfg(feature = "cuda")]
use candle_core::CudaStorage;
use candle_core::{CpuStorage, CustomOp3, Layout, Result, Shape, Tensor};

use crate::kernels::{layer_norm, layer_norm_backward};
#[cfg(feature = "cuda")]
use crate::kernels::{layer_norm_backward_on_gpu, layer_norm_on_gpu};
use crate::nn::row_sum::row_sum;
use crate::on_host::numbers;

/// Normalises rows (N, size), with weight and bias (size).
pub(super) struct OnePass {
    pub(super) epsilon: f32,
}

impl CustomOp3 for OnePass {
    fn name(&self) -> &'static str {
        "layer-norm"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        weight: &CpuStorage,
        weight_layout: &Layout,
        bias: &CpuStorage,
        bias_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (weight, bias) = (numbers(weight, weight_layout)?, numbers(bias, bias_layout)?);
        let normed = layer_norm(numbers(x, x_layout)?, weight, bias, self.epsilon);
        Ok((CpuStorage::F32(normed), x_layout.shape().clone()))
    }

    #[cfg(feature = "cuda")]
    fn cuda_fwd(
        &self,
        x: &CudaStorage,
        x_layout: &Layout,
        weight: &CudaStorage,
        weight_layout: &Layout,
        bias: &CudaStorage,
        bias_layout: &Layout,
    ) -> Result<(CudaStorage, Shape)> {
        let (weight, bias) = ((weight, weight_layout), (bias, bias_layout));
        let normed = layer_norm_on_gpu(self.epsilon, (x, x_layout), weight, bias)?;
        Ok((normed, x_layout.shape().clone()))
    }

    fn bwd(
        &self,
        x: &Tensor,
        weight: &Tensor,
        _: &Tensor,
        _: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let (gradient, size) = (gradient.contiguous()?, weight.dim(0)?);
        let (tracked, trained) = (x.track_op(), weight.track_op());
        if !tracked && !trained {
            return Ok((None, None, None));
        }
        let both = x.apply_op3_no_bwd(weight, &gradient, &Back { epsilon: self.epsilon })?;
        let sum = |rows: &Tensor| row_sum(&rows.reshape(((), size))?);
        Ok((
            tracked.then(|| both.get(0)).transpose()?,
            trained.then(|| sum(&both.get(1)?)).transpose()?,
            trained.then(|| sum(&gradient)).transpose()?,
        ))
    }
}

/// The backward pass: from rows, weight and output gradient, the gradients (2, N, size) of the rows and of the weight
/// before the sum over rows.
struct Back {
    epsilon: f32,
}

impl Back {
    fn shape(x: &Layout) -> Shape {
        Shape::from([&[2], x.dims()].concat())
    }
}

impl CustomOp3 for Back {
    fn name(&self) -> &'static str {
        "layer-norm-back"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        weight: &CpuStorage,
        weight_layout: &Layout,
        gradient: &CpuStorage,
        gradient_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let weight = numbers(weight, weight_layout)?;
        let gradient = numbers(gradient, gradient_layout)?;
        let both = layer_norm_backward(numbers(x, x_layout)?, weight, gradient, self.epsilon);
        Ok((CpuStorage::F32(both), Self::shape(x_layout)))
    }

    #[cfg(feature = "cuda")]
    fn cuda_fwd(
        &self,
        x: &CudaStorage,
        x_layout: &Layout,
        weight: &CudaStorage,
        weight_layout: &Layout,
        gradient: &CudaStorage,
        gradient_layout: &Layout,
    ) -> Result<(CudaStorage, Shape)> {
        let (weight, gradient) = ((weight, weight_layout), (gradient, gradient_layout));
        let both = layer_norm_backward_on_gpu(self.epsilon, (x, x_layout), weight, gradient)?;
        Ok((both, Self::shape(x_layout)))
    }
}
