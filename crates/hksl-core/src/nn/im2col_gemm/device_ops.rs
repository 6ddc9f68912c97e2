//! Operations other than matrix products, on either device's storage.

#[cfg(feature = "cuda")]
use candle_core::CudaStorage;
use candle_core::backend::BackendStorage;
use candle_core::{CpuStorage, CustomOp1, CustomOp2, Layout, Result, Shape, Tensor};

use super::Part;
use crate::kernels::{Activation, Im2col};
use crate::on_host::{bytes, numbers};

/// Device operations other than matrix products.
pub(super) trait DeviceOps: BackendStorage {
    /// [`Im2col::im2col`] of f32 maps, or [`Im2col::im2col_u8`] of u8 images.
    fn im2col(&self, layout: &Layout, im2col: &Im2col) -> Result<Self>;

    /// [`Im2col::col2im`] of f32 columns.
    fn col2im(&self, layout: &Layout, im2col: &Im2col) -> Result<Self>;

    /// Adds the bias to every row and applies the activation, in place.
    fn add_bias_and_activate(
        &mut self,
        bias: (&Self, &Layout),
        activation: Activation,
    ) -> Result<()>;

    /// The gradient before the activation, computed from the activation's output and the gradient after it.
    fn activation_backward(
        output: (&Self, &Layout),
        gradient: (&Self, &Layout),
        activation: Activation,
    ) -> Result<Self>;
}

impl DeviceOps for CpuStorage {
    fn im2col(&self, layout: &Layout, im2col: &Im2col) -> Result<Self> {
        Ok(Self::F32(match self {
            Self::U8(_) => im2col.im2col_u8(bytes(self, layout)?),
            _ => im2col.im2col(numbers(self, layout)?),
        }))
    }

    fn col2im(&self, layout: &Layout, im2col: &Im2col) -> Result<Self> {
        Ok(Self::F32(im2col.col2im(numbers(self, layout)?)))
    }

    fn add_bias_and_activate(
        &mut self,
        bias: (&Self, &Layout),
        activation: Activation,
    ) -> Result<()> {
        let bias = numbers(bias.0, bias.1)?;
        if let Self::F32(values) = self {
            for row in values.chunks_mut(bias.len()) {
                row.iter_mut().zip(bias).for_each(|(value, bias)| *value += bias);
            }
            activation.apply(values);
        }
        Ok(())
    }

    fn activation_backward(
        output: (&Self, &Layout),
        gradient: (&Self, &Layout),
        activation: Activation,
    ) -> Result<Self> {
        let gradient = numbers(gradient.0, gradient.1)?;
        let before = activation.backward(numbers(output.0, output.1)?, gradient);
        Ok(Self::F32(before.unwrap_or_else(|| gradient.to_vec())))
    }
}

#[cfg(feature = "cuda")]
impl DeviceOps for CudaStorage {
    fn im2col(&self, layout: &Layout, im2col: &Im2col) -> Result<Self> {
        im2col.im2col_on_gpu(self, layout)
    }

    fn col2im(&self, layout: &Layout, im2col: &Im2col) -> Result<Self> {
        im2col.col2im_on_gpu(self, layout)
    }

    fn add_bias_and_activate(
        &mut self,
        bias: (&Self, &Layout),
        activation: Activation,
    ) -> Result<()> {
        activation.apply_on_gpu(self, bias.0, bias.1)
    }

    fn activation_backward(
        output: (&Self, &Layout),
        gradient: (&Self, &Layout),
        activation: Activation,
    ) -> Result<Self> {
        activation.backward_on_gpu(output, gradient)
    }
}

pub(super) fn activation_backward(
    activation: Activation,
    output: &Tensor,
    gradient: &Tensor,
) -> Result<Tensor> {
    let gradient = gradient.contiguous()?;
    if activation == Activation::None {
        return Ok(gradient);
    }
    output.apply_op2_no_bwd(&gradient, &ActivationBackward(activation))
}

struct ActivationBackward(Activation);

impl CustomOp2 for ActivationBackward {
    fn name(&self) -> &'static str {
        "activation-backward"
    }

    fn cpu_fwd(
        &self,
        output: &CpuStorage,
        output_layout: &Layout,
        gradient: &CpuStorage,
        gradient_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let before = DeviceOps::activation_backward(
            (output, output_layout),
            (gradient, gradient_layout),
            self.0,
        )?;
        Ok((before, output_layout.shape().clone()))
    }

    #[cfg(feature = "cuda")]
    fn cuda_fwd(
        &self,
        output: &CudaStorage,
        output_layout: &Layout,
        gradient: &CudaStorage,
        gradient_layout: &Layout,
    ) -> Result<(CudaStorage, Shape)> {
        let before = DeviceOps::activation_backward(
            (output, output_layout),
            (gradient, gradient_layout),
            self.0,
        )?;
        Ok((before, output_layout.shape().clone()))
    }
}

/// im2col of f32 maps or u8 images: one row per output position.
pub(super) fn im2col(maps: &Tensor, im2col: Im2col) -> Result<Tensor> {
    maps.apply_op1_no_bwd(&Im2colOp(im2col))
}

struct Im2colOp(Im2col);

impl Im2colOp {
    fn forward<S: DeviceOps>(&self, (maps, layout): Part<S>) -> Result<(S, Shape)> {
        let ((rows, columns), batch) = (self.0.output_size(), layout.dims()[0]);
        Ok((maps.im2col(layout, &self.0)?, (batch * rows * columns, self.0.columns()).into()))
    }
}

impl CustomOp1 for Im2colOp {
    fn name(&self) -> &'static str {
        "im2col"
    }

    fn cpu_fwd(&self, maps: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        self.forward((maps, layout))
    }

    #[cfg(feature = "cuda")]
    fn cuda_fwd(&self, maps: &CudaStorage, layout: &Layout) -> Result<(CudaStorage, Shape)> {
        self.forward((maps, layout))
    }
}

/// col2im: maps (B, H, W, C) from one row per output position.
pub(super) fn col2im(patches: &Tensor, im2col: Im2col) -> Result<Tensor> {
    patches.apply_op1_no_bwd(&Col2imOp(im2col))
}

struct Col2imOp(Im2col);

impl Col2imOp {
    fn forward<S: DeviceOps>(&self, (patches, layout): Part<S>) -> Result<(S, Shape)> {
        let ((rows, columns), (height, width)) = (self.0.output_size(), self.0.input_size);
        let batch = layout.dims()[0] / (rows * columns);
        let shape = (batch, height, width, self.0.channels).into();
        Ok((patches.col2im(layout, &self.0)?, shape))
    }
}

impl CustomOp1 for Col2imOp {
    fn name(&self) -> &'static str {
        "col2im"
    }

    fn cpu_fwd(&self, patches: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        self.forward((patches, layout))
    }

    #[cfg(feature = "cuda")]
    fn cuda_fwd(&self, patches: &CudaStorage, layout: &Layout) -> Result<(CudaStorage, Shape)> {
        self.forward((patches, layout))
    }
}
