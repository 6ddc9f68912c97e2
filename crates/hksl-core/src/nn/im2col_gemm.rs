//! GEMM convolutions and linear layers for GPUs. The code is generic over the storage, so that tests without a GPU run it
//! on the CPU.

mod device_ops;

#[cfg(feature = "cuda")]
use candle_core::CudaStorage;
use candle_core::{CpuStorage, CustomOp3, DType, Layout, Result, Shape, Tensor, bail};

use self::device_ops::{DeviceOps, activation_backward, col2im, im2col};
use crate::kernels::{Activation, Counter, Im2col};
use crate::nn::row_sum::row_sum;

/// A tensor's storage and layout.
type Part<'a, S> = (&'a S, &'a Layout);

/// Implements `cpu_fwd` and `cuda_fwd` of an operation on three tensors with the same generic function.
macro_rules! on_both_devices {
    () => {
        fn cpu_fwd(
            &self,
            x: &CpuStorage,
            x_layout: &Layout,
            matrix: &CpuStorage,
            matrix_layout: &Layout,
            bias: &CpuStorage,
            bias_layout: &Layout,
        ) -> Result<(CpuStorage, Shape)> {
            self.forward((x, x_layout), (matrix, matrix_layout), (bias, bias_layout))
        }

        #[cfg(feature = "cuda")]
        fn cuda_fwd(
            &self,
            x: &CudaStorage,
            x_layout: &Layout,
            matrix: &CudaStorage,
            matrix_layout: &Layout,
            bias: &CudaStorage,
            bias_layout: &Layout,
        ) -> Result<(CudaStorage, Shape)> {
            self.forward((x, x_layout), (matrix, matrix_layout), (bias, bias_layout))
        }
    };
}

/// Checks sizes before a matrix product, which would read out of bounds otherwise.
fn check_sizes(what: &str, got: &[usize], expected: &[usize]) -> Result<()> {
    if got != expected {
        bail!("{what}: {got:?}, expected {expected:?}");
    }
    Ok(())
}

/// `x Wᵀ + b` with activation: `x` (B, in), matrix (out, in), bias (out).
pub(super) struct AffineGemm {
    pub(super) activation: Activation,
    pub(super) counter: Counter,
}

impl AffineGemm {
    fn forward<S: DeviceOps>(
        &self,
        (x, x_layout): Part<S>,
        (matrix, matrix_layout): Part<S>,
        bias: Part<S>,
    ) -> Result<(S, Shape)> {
        let ((batch, inputs), (outputs, expected)) =
            (x_layout.shape().dims2()?, matrix_layout.shape().dims2()?);
        check_sizes("rows of an affine map", &[inputs], &[expected])?;
        let sizes = (1, batch, outputs, inputs);
        let mut y = x.matmul(matrix, sizes, x_layout, &matrix_layout.transpose(0, 1)?)?;
        self.counter.add_product(batch, inputs, outputs);
        y.add_bias_and_activate(bias, self.activation)?;
        Ok((y, (batch, outputs).into()))
    }
}

impl CustomOp3 for AffineGemm {
    fn name(&self) -> &'static str {
        "affine-gemm"
    }

    on_both_devices!();

    fn bwd(
        &self,
        x: &Tensor,
        matrix: &Tensor,
        _: &Tensor,
        output: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let gradient = activation_backward(self.activation, output, gradient)?;
        let ((batch, inputs), outputs) = (x.dims2()?, matrix.dim(0)?);
        for _ in [x, matrix].iter().filter(|factor| factor.track_op()) {
            self.counter.add_product(batch, inputs, outputs);
        }
        let grad_x = x.track_op().then(|| gradient.matmul(&matrix.detach())).transpose()?;
        let trained = matrix.track_op();
        let grad_matrix = trained.then(|| gradient.t()?.matmul(&x.detach())).transpose()?;
        Ok((grad_x, grad_matrix, trained.then(|| row_sum(&gradient)).transpose()?))
    }
}

/// A convolution without padding, with bias and activation, from f32 maps (B, H, W, C) or u8 images (B, C, H, W) to maps
/// (B, h, w, F). The matrix is (F, k·k·C) in the order of [`Im2col::im2col`], the bias (F).
pub(super) struct ConvolutionGemm {
    pub(super) im2col: Im2col,
    pub(super) activation: Activation,
    pub(super) counter: Counter,
}

impl ConvolutionGemm {
    fn forward<S: DeviceOps>(
        &self,
        (maps, maps_layout): Part<S>,
        (matrix, matrix_layout): Part<S>,
        bias: Part<S>,
    ) -> Result<(S, Shape)> {
        let ((rows, columns), batch) = (self.im2col.output_size(), maps_layout.dims()[0]);
        let Im2col { input_size: (height, width), channels, .. } = self.im2col;
        let expected = match maps.dtype() {
            DType::U8 => [channels, height, width],
            _ => [height, width, channels],
        };
        check_sizes("maps to be convolved", &maps_layout.dims()[1..], &expected)?;
        let (filters, patch) = matrix_layout.shape().dims2()?;
        check_sizes("numbers of a patch", &[patch], &[self.im2col.columns()])?;
        let patches = maps.im2col(maps_layout, &self.im2col)?;
        let seen = Layout::contiguous((batch * rows * columns, patch));
        let sizes = (1, batch * rows * columns, filters, patch);
        let mut result = patches.matmul(matrix, sizes, &seen, &matrix_layout.transpose(0, 1)?)?;
        self.counter.add_product(batch * rows * columns, patch, filters);
        if maps.dtype() == DType::U8 {
            self.counter.add_encoder_images(batch);
        }
        result.add_bias_and_activate(bias, self.activation)?;
        Ok((result, (batch, rows, columns, filters).into()))
    }
}

impl CustomOp3 for ConvolutionGemm {
    fn name(&self) -> &'static str {
        "convolution-gemm"
    }

    on_both_devices!();

    fn bwd(
        &self,
        maps: &Tensor,
        matrix: &Tensor,
        _: &Tensor,
        output: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let filters = matrix.dim(0)?;
        let gradient =
            activation_backward(self.activation, output, gradient)?.reshape(((), filters))?;
        for _ in [maps, matrix].iter().filter(|factor| factor.track_op()) {
            self.counter.add_product(gradient.dim(0)?, self.im2col.columns(), filters);
        }
        if maps.dtype() == DType::U8 {
            self.counter.add_encoder_images(2 * maps.dim(0)?);
        }
        let grad_maps = maps
            .track_op()
            .then(|| col2im(&gradient.matmul(&matrix.detach())?, self.im2col))
            .transpose()?;
        let trained = matrix.track_op();
        let grad_matrix =
            trained.then(|| gradient.t()?.matmul(&im2col(maps, self.im2col)?)).transpose()?;
        Ok((grad_maps, grad_matrix, trained.then(|| row_sum(&gradient)).transpose()?))
    }
}

/// A transposed convolution with bias and activation, from maps (B, h, w, F) to maps (B, H, W, C). The matrix is
/// (F, k·k·C), the bias (C).
pub(super) struct TransposedConvolutionGemm {
    pub(super) im2col: Im2col,
    pub(super) activation: Activation,
    pub(super) counter: Counter,
}

impl TransposedConvolutionGemm {
    fn forward<S: DeviceOps>(
        &self,
        (maps, maps_layout): Part<S>,
        (matrix, matrix_layout): Part<S>,
        bias: Part<S>,
    ) -> Result<(S, Shape)> {
        let (batch, rows, columns, filters) = maps_layout.shape().dims4()?;
        let (grid, patch) = (self.im2col.output_size(), self.im2col.columns());
        let (points, (from, to)) = (batch * rows * columns, matrix_layout.shape().dims2()?);
        check_sizes("maps to grow", &[rows, columns, filters, patch], &[grid.0, grid.1, from, to])?;
        let rows_of_maps =
            Layout::contiguous_with_offset((points, filters), maps_layout.start_offset());
        let sizes = (1, points, patch, filters);
        self.counter.add_product(points, filters, patch);
        let patches = maps.matmul(matrix, sizes, &rows_of_maps, matrix_layout)?;
        let seen = Layout::contiguous((points, patch));
        let mut result = patches.col2im(&seen, &self.im2col)?;
        result.add_bias_and_activate(bias, self.activation)?;
        let Im2col { input_size: (height, width), channels, .. } = self.im2col;
        Ok((result, (batch, height, width, channels).into()))
    }
}

impl CustomOp3 for TransposedConvolutionGemm {
    fn name(&self) -> &'static str {
        "transposed-convolution-gemm"
    }

    on_both_devices!();

    fn bwd(
        &self,
        maps: &Tensor,
        matrix: &Tensor,
        _: &Tensor,
        output: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let filters = matrix.dim(0)?;
        let gradient = activation_backward(self.activation, output, gradient)?;
        let seen = im2col(&gradient, self.im2col)?;
        for _ in [maps, matrix].iter().filter(|factor| factor.track_op()) {
            self.counter.add_product(seen.dim(0)?, self.im2col.columns(), filters);
        }
        let grad_maps = maps
            .track_op()
            .then(|| seen.matmul(&matrix.detach().t()?)?.reshape(maps.shape()))
            .transpose()?;
        let trained = matrix.track_op();
        let grad_matrix = trained
            .then(|| maps.detach().reshape(((), filters))?.t()?.matmul(&seen))
            .transpose()?;
        let grad_bias =
            trained.then(|| row_sum(&gradient.reshape(((), self.im2col.channels))?)).transpose()?;
        Ok((grad_maps, grad_matrix, grad_bias))
    }
}
