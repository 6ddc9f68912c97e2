//! Convolutions and affine maps as matrix products, for GPUs: written once for the storages of both devices, so that the
//! tests follow on the CPU what runs on a GPU.

#[cfg(feature = "cuda")]
use candle_core::CudaStorage;
use candle_core::backend::BackendStorage;
use candle_core::{CpuStorage, CustomOp1, CustomOp2, CustomOp3, DType, Layout, Result, Shape};
use candle_core::{Tensor, bail};

use crate::kernels::{Activation, Places};
use crate::nn::row_sum::row_sum;
use crate::on_host::{bytes, numbers};

/// What happens beside the products.
trait Beside: BackendStorage {
    /// [`Places::patches`] or, of bytes, [`Places::patches_of_bytes`].
    fn patches(&self, layout: &Layout, places: &Places) -> Result<Self>;

    /// [`Places::sum`].
    fn sum_of_patches(&self, layout: &Layout, places: &Places) -> Result<Self>;

    /// Adds a bias to every row of what is fresh, and applies the activation.
    fn finish(&mut self, bias: (&Self, &Layout), activation: Activation) -> Result<()>;

    /// The gradient before the activation, from output and gradient after it.
    fn before(
        output: (&Self, &Layout),
        gradient: (&Self, &Layout),
        activation: Activation,
    ) -> Result<Self>;
}

impl Beside for CpuStorage {
    fn patches(&self, layout: &Layout, places: &Places) -> Result<Self> {
        Ok(Self::F32(match self {
            Self::U8(_) => places.patches_of_bytes(bytes(self, layout)?),
            _ => places.patches(numbers(self, layout)?),
        }))
    }

    fn sum_of_patches(&self, layout: &Layout, places: &Places) -> Result<Self> {
        Ok(Self::F32(places.sum(numbers(self, layout)?)))
    }

    fn finish(&mut self, bias: (&Self, &Layout), activation: Activation) -> Result<()> {
        let bias = numbers(bias.0, bias.1)?;
        if let Self::F32(values) = self {
            for row in values.chunks_mut(bias.len()) {
                row.iter_mut().zip(bias).for_each(|(value, bias)| *value += bias);
            }
            activation.apply(values);
        }
        Ok(())
    }

    fn before(
        output: (&Self, &Layout),
        gradient: (&Self, &Layout),
        activation: Activation,
    ) -> Result<Self> {
        let gradient = numbers(gradient.0, gradient.1)?;
        let before = activation.back(numbers(output.0, output.1)?, gradient);
        Ok(Self::F32(before.unwrap_or_else(|| gradient.to_vec())))
    }
}

#[cfg(feature = "cuda")]
impl Beside for CudaStorage {
    fn patches(&self, layout: &Layout, places: &Places) -> Result<Self> {
        places.patches_on_gpu(self, layout)
    }

    fn sum_of_patches(&self, layout: &Layout, places: &Places) -> Result<Self> {
        places.sum_on_gpu(self, layout)
    }

    fn finish(&mut self, bias: (&Self, &Layout), activation: Activation) -> Result<()> {
        activation.apply_on_gpu(self, bias.0, bias.1)
    }

    fn before(
        output: (&Self, &Layout),
        gradient: (&Self, &Layout),
        activation: Activation,
    ) -> Result<Self> {
        activation.back_on_gpu(output, gradient)
    }
}

/// A tensor's storage and how it lies there.
type Part<'a, S> = (&'a S, &'a Layout);

/// Forward of an operation on three tensors, the same computation on both devices.
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

/// A product by other sizes than the matrix's would read beside it.
fn fits(what: &str, got: &[usize], expected: &[usize]) -> Result<()> {
    if got != expected {
        bail!("{what}: {got:?}, expected {expected:?}");
    }
    Ok(())
}

/// `x Wᵀ + b` and the activation: `x` (B, in), matrix (out, in), bias (out).
pub(super) struct AffineProduct(pub(super) Activation);

impl AffineProduct {
    fn forward<S: Beside>(
        &self,
        (x, x_layout): Part<S>,
        (matrix, matrix_layout): Part<S>,
        bias: Part<S>,
    ) -> Result<(S, Shape)> {
        let ((batch, inputs), (outputs, expected)) =
            (x_layout.shape().dims2()?, matrix_layout.shape().dims2()?);
        fits("rows of an affine map", &[inputs], &[expected])?;
        let sizes = (1, batch, outputs, inputs);
        let mut y = x.matmul(matrix, sizes, x_layout, &matrix_layout.transpose(0, 1)?)?;
        y.finish(bias, self.0)?;
        Ok((y, (batch, outputs).into()))
    }
}

impl CustomOp3 for AffineProduct {
    fn name(&self) -> &'static str {
        "affine-product"
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
        let gradient = before(self.0, output, gradient)?;
        let towards_x = x.track_op().then(|| gradient.matmul(&matrix.detach())).transpose()?;
        let trained = matrix.track_op();
        let towards_matrix = trained.then(|| gradient.t()?.matmul(&x.detach())).transpose()?;
        Ok((towards_x, towards_matrix, trained.then(|| row_sum(&gradient)).transpose()?))
    }
}

/// A convolution without padding, bias and activation: maps (B, H, W, C), or images (B, C, H, W) of bytes, matrix
/// (F, side·side·C) in the order of [`Places::patches`], bias (F); maps (B, h, w, F) come out.
pub(super) struct Shrinking {
    pub(super) places: Places,
    pub(super) activation: Activation,
}

impl Shrinking {
    fn forward<S: Beside>(
        &self,
        (maps, maps_layout): Part<S>,
        (matrix, matrix_layout): Part<S>,
        bias: Part<S>,
    ) -> Result<(S, Shape)> {
        let ((rows, columns), batch) = (self.places.grid(), maps_layout.dims()[0]);
        let Places { maps: (height, width), channels, .. } = self.places;
        let expected = match maps.dtype() {
            DType::U8 => [channels, height, width],
            _ => [height, width, channels],
        };
        fits("maps to be convolved", &maps_layout.dims()[1..], &expected)?;
        let (filters, patch) = matrix_layout.shape().dims2()?;
        fits("numbers of a patch", &[patch], &[self.places.patch()])?;
        let patches = maps.patches(maps_layout, &self.places)?;
        let seen = Layout::contiguous((batch * rows * columns, patch));
        let sizes = (1, batch * rows * columns, filters, patch);
        let mut result = patches.matmul(matrix, sizes, &seen, &matrix_layout.transpose(0, 1)?)?;
        result.finish(bias, self.activation)?;
        Ok((result, (batch, rows, columns, filters).into()))
    }
}

impl CustomOp3 for Shrinking {
    fn name(&self) -> &'static str {
        "convolution-as-product"
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
        let gradient = before(self.activation, output, gradient)?.reshape(((), filters))?;
        let towards_maps = maps
            .track_op()
            .then(|| sum_of_patches(&gradient.matmul(&matrix.detach())?, self.places))
            .transpose()?;
        let trained = matrix.track_op();
        let towards_matrix =
            trained.then(|| gradient.t()?.matmul(&patches(maps, self.places)?)).transpose()?;
        Ok((towards_maps, towards_matrix, trained.then(|| row_sum(&gradient)).transpose()?))
    }
}

/// The transpose of a convolution, bias and activation: maps (B, h, w, F), matrix (F, side·side·C), bias (C); maps
/// (B, H, W, C) come out.
pub(super) struct Growing {
    pub(super) places: Places,
    pub(super) activation: Activation,
}

impl Growing {
    fn forward<S: Beside>(
        &self,
        (maps, maps_layout): Part<S>,
        (matrix, matrix_layout): Part<S>,
        bias: Part<S>,
    ) -> Result<(S, Shape)> {
        let (batch, rows, columns, filters) = maps_layout.shape().dims4()?;
        let (grid, patch) = (self.places.grid(), self.places.patch());
        let (points, (from, to)) = (batch * rows * columns, matrix_layout.shape().dims2()?);
        fits("maps to grow", &[rows, columns, filters, patch], &[grid.0, grid.1, from, to])?;
        let rows_of_maps =
            Layout::contiguous_with_offset((points, filters), maps_layout.start_offset());
        let sizes = (1, points, patch, filters);
        let patches = maps.matmul(matrix, sizes, &rows_of_maps, matrix_layout)?;
        let seen = Layout::contiguous((points, patch));
        let mut result = patches.sum_of_patches(&seen, &self.places)?;
        result.finish(bias, self.activation)?;
        let Places { maps: (height, width), channels, .. } = self.places;
        Ok((result, (batch, height, width, channels).into()))
    }
}

impl CustomOp3 for Growing {
    fn name(&self) -> &'static str {
        "transposed-convolution-as-product"
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
        let gradient = before(self.activation, output, gradient)?;
        let seen = patches(&gradient, self.places)?;
        let towards_maps = maps
            .track_op()
            .then(|| seen.matmul(&matrix.detach().t()?)?.reshape(maps.shape()))
            .transpose()?;
        let trained = matrix.track_op();
        let towards_matrix = trained
            .then(|| maps.detach().reshape(((), filters))?.t()?.matmul(&seen))
            .transpose()?;
        let towards_bias =
            trained.then(|| row_sum(&gradient.reshape(((), self.places.channels))?)).transpose()?;
        Ok((towards_maps, towards_matrix, towards_bias))
    }
}

fn before(activation: Activation, output: &Tensor, gradient: &Tensor) -> Result<Tensor> {
    let gradient = gradient.contiguous()?;
    if activation == Activation::None {
        return Ok(gradient);
    }
    output.apply_op2_no_bwd(&gradient, &Before(activation))
}

struct Before(Activation);

impl CustomOp2 for Before {
    fn name(&self) -> &'static str {
        "before-activation"
    }

    fn cpu_fwd(
        &self,
        output: &CpuStorage,
        output_layout: &Layout,
        gradient: &CpuStorage,
        gradient_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let before = Beside::before((output, output_layout), (gradient, gradient_layout), self.0)?;
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
        let before = Beside::before((output, output_layout), (gradient, gradient_layout), self.0)?;
        Ok((before, output_layout.shape().clone()))
    }
}

/// Patches, one a row, of maps or of images.
fn patches(maps: &Tensor, places: Places) -> Result<Tensor> {
    maps.apply_op1_no_bwd(&Patches(places))
}

struct Patches(Places);

impl Patches {
    fn forward<S: Beside>(&self, (maps, layout): Part<S>) -> Result<(S, Shape)> {
        let ((rows, columns), batch) = (self.0.grid(), layout.dims()[0]);
        Ok((maps.patches(layout, &self.0)?, (batch * rows * columns, self.0.patch()).into()))
    }
}

impl CustomOp1 for Patches {
    fn name(&self) -> &'static str {
        "patches"
    }

    fn cpu_fwd(&self, maps: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        self.forward((maps, layout))
    }

    #[cfg(feature = "cuda")]
    fn cuda_fwd(&self, maps: &CudaStorage, layout: &Layout) -> Result<(CudaStorage, Shape)> {
        self.forward((maps, layout))
    }
}

/// Maps (B, H, W, C) from patches, one a row.
fn sum_of_patches(patches: &Tensor, places: Places) -> Result<Tensor> {
    patches.apply_op1_no_bwd(&SumOfPatches(places))
}

struct SumOfPatches(Places);

impl SumOfPatches {
    fn forward<S: Beside>(&self, (patches, layout): Part<S>) -> Result<(S, Shape)> {
        let ((rows, columns), (height, width)) = (self.0.grid(), self.0.maps);
        let batch = layout.dims()[0] / (rows * columns);
        let shape = (batch, height, width, self.0.channels).into();
        Ok((patches.sum_of_patches(layout, &self.0)?, shape))
    }
}

impl CustomOp1 for SumOfPatches {
    fn name(&self) -> &'static str {
        "sum-of-patches"
    }

    fn cpu_fwd(&self, patches: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        self.forward((patches, layout))
    }

    #[cfg(feature = "cuda")]
    fn cuda_fwd(&self, patches: &CudaStorage, layout: &Layout) -> Result<(CudaStorage, Shape)> {
        self.forward((patches, layout))
    }
}
