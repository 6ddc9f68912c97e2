//! The GPU's kernels, launched: storages of candle in, storages of candle out.
//!
//! They are compiled by CUDA's own run-time compiler when the first of them is wanted, so a build needs no more than
//! candle's does.

use std::ops::Range;
use std::sync::OnceLock;

use candle_core::cuda_backend::cudarc::driver::{LaunchConfig, PushKernelArg};
use candle_core::cuda_backend::cudarc::nvrtc::compile_ptx;
use candle_core::cuda_backend::{CudaDType, CudaDevice, CudaStorage, WrapErr};
use candle_core::{Layout, Result, bail};

use super::{Activation, MomentStep, WeightStep};

const SOURCE: &str = include_str!("cuda/kernels.cu");

/// Threads of a block.
const BLOCK: u32 = 256;

/// Threads that work on a row together.
const WARP: usize = 32;

/// Most blocks at once; threads go on with further numbers.
const BLOCKS: u32 = 1 << 16;

/// What candle keeps the compiled kernels under.
const MODULE: &str = "hksl";

/// The kernels as PTX, which the driver makes into its GPU's instructions. Compiled once in a process.
fn compiled() -> Result<&'static str> {
    static COMPILED: OnceLock<std::result::Result<String, String>> = OnceLock::new();
    let compiled = COMPILED.get_or_init(|| match compile_ptx(SOURCE) {
        Ok(ptx) => Ok(ptx.to_src()),
        Err(error) => Err(format!("{error:?}")),
    });
    match compiled {
        Ok(ptx) => Ok(ptx),
        Err(error) => bail!("CUDA's run-time compiler refused the GPU's kernels: {error}"),
    }
}

/// Runs the kernel of this name with a count of what its threads go through, and these arguments.
macro_rules! launch {
    ($device:expr, $name:expr, $count:expr, $($argument:expr),+) => {{
        let count = counted($count)?;
        let function = $device.get_or_load_custom_func($name, MODULE, compiled()?)?;
        let mut builder = function.builder();
        builder.arg(&count);
        $(builder.arg($argument);)+
        // SAFETY: the arguments are of the kernel's types and in its order, and each function below has held the lengths
        // of what its kernel reads and writes against each other.
        #[allow(unsafe_code)]
        unsafe { builder.launch(threads(count)) }.w()?;
    }};
}

// After the macro that it launches by.
mod places;

/// A thread for each of so many numbers, within reason.
fn threads(count: u32) -> LaunchConfig {
    let blocks = count.div_ceil(BLOCK).clamp(1, BLOCKS);
    LaunchConfig { grid_dim: (blocks, 1, 1), block_dim: (BLOCK, 1, 1), shared_mem_bytes: 0 }
}

/// As the kernels count, in every tensor that they read or write: a thread must be able to step beyond the last number.
fn counted(count: usize) -> Result<u32> {
    match i32::try_from(count) {
        Ok(count) => Ok(count.unsigned_abs()),
        Err(_) => {
            bail!(
                "{count} numbers in one tensor, where the GPU's kernels take {} at most: smaller batches \
                 (batch_size), images or encoders would do",
                i32::MAX
            )
        }
    }
}

/// Where the numbers of a contiguous tensor stand, of which there may be so many.
fn range(layout: &Layout) -> Result<Range<usize>> {
    match layout.contiguous_offsets() {
        Some((start, end)) => {
            counted(end - start)?;
            Ok(start..end)
        }
        None => bail!("a kernel of the GPU was given a tensor that is not contiguous"),
    }
}

/// Room for numbers, all of which the caller's kernel writes.
fn room(device: &CudaDevice, count: usize) -> Result<CudaStorage> {
    counted(count)?;
    // SAFETY: any bits are an f32, and none is read before the kernel has written it.
    #[allow(unsafe_code)]
    let room = unsafe { device.alloc::<f32>(count) }?;
    Ok(f32::wrap_cuda_slice(room, device.clone()))
}

impl Activation {
    /// As the kernels number them.
    fn number(self) -> i32 {
        match self {
            Self::None => 0,
            Self::Relu => 1,
            Self::Elu => 2,
        }
    }

    /// Adds the bias `(width)` to a fresh storage of values `(N, width)` and applies the activation, in place.
    pub(crate) fn apply_on_gpu(
        self,
        values: &mut CudaStorage,
        bias: &CudaStorage,
        layout: &Layout,
    ) -> Result<()> {
        let (device, range) = (values.device.clone(), range(layout)?);
        let width = counted(range.len())?;
        let values = values.as_cuda_slice_mut::<f32>()?;
        let (count, number) = (values.len(), self.number());
        let bias = bias.as_cuda_slice::<f32>()?.slice(range);
        launch!(device, "bias_and_activation", count, &width, &number, &bias, values);
        Ok(())
    }

    /// The gradient before the activation, from its output and the gradient after it.
    pub(crate) fn back_on_gpu(
        self,
        (output, output_layout): (&CudaStorage, &Layout),
        (gradient, gradient_layout): (&CudaStorage, &Layout),
    ) -> Result<CudaStorage> {
        let device = &output.device;
        let (of_output, of_gradient) = (range(output_layout)?, range(gradient_layout)?);
        if of_output.len() != of_gradient.len() {
            bail!("{} gradients of {} outputs", of_gradient.len(), of_output.len());
        }
        let (count, number) = (of_output.len(), self.number());
        let mut result = room(device, count)?;
        let written = result.as_cuda_slice_mut::<f32>()?;
        let output = output.as_cuda_slice::<f32>()?.slice(of_output);
        let gradient = gradient.as_cuda_slice::<f32>()?.slice(of_gradient);
        launch!(device, "before_activation", count, &number, &output, &gradient, written);
        Ok(result)
    }
}

/// Kernels of tensors that all have as many numbers.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Elementwise {
    Gated,
    GatedBack,
    Blended,
    BlendedBack,
}

impl Elementwise {
    /// Its name, how many tensors it reads, and how many times as many numbers it writes.
    fn facts(self) -> (&'static str, usize, usize) {
        match self {
            Self::Gated => ("gated", 2, 1),
            Self::GatedBack => ("gated_back", 3, 2),
            Self::Blended => ("blended", 3, 1),
            Self::BlendedBack => ("blended_back", 4, 3),
        }
    }
}

/// What the kernel makes of these tensors.
pub(crate) fn elementwise_on_gpu(
    kernel: Elementwise,
    read: &[(&CudaStorage, &Layout)],
) -> Result<CudaStorage> {
    let (name, arity, times) = kernel.facts();
    let mut views = Vec::with_capacity(arity);
    for (storage, layout) in read {
        views.push(storage.as_cuda_slice::<f32>()?.slice(range(layout)?));
    }
    let count = views.first().map_or(0, |view| view.len());
    if views.len() != arity || views.iter().any(|view| view.len() != count) {
        bail!("{name} of {:?} numbers", views.iter().map(|view| view.len()).collect::<Vec<_>>());
    }
    let device = &read[0].0.device;
    let mut result = room(device, times * count)?;
    let written = result.as_cuda_slice_mut::<f32>()?;
    let count = counted(count)?;
    let function = device.get_or_load_custom_func(name, MODULE, compiled()?)?;
    let mut builder = function.builder();
    builder.arg(&count);
    for view in &views {
        builder.arg(view);
    }
    builder.arg(written);
    // SAFETY: the kernel takes `arity` tensors of `count` numbers, and writes `times` as many.
    #[allow(unsafe_code)]
    unsafe { builder.launch(threads(count)) }.w()?;
    Ok(result)
}

/// As [`super::layer_norm`].
pub(crate) fn layer_norm_on_gpu(
    epsilon: f32,
    (x, x_layout): (&CudaStorage, &Layout),
    (weight, weight_layout): (&CudaStorage, &Layout),
    (bias, bias_layout): (&CudaStorage, &Layout),
) -> Result<CudaStorage> {
    let (device, of_x) = (&x.device, range(x_layout)?);
    let (of_weight, of_bias) = (range(weight_layout)?, range(bias_layout)?);
    let (rows, size) = rows(&of_x, &of_weight)?;
    if of_bias.len() != of_weight.len() {
        bail!("layer normalisation with {} biases of {size}", of_bias.len());
    }
    let mut result = room(device, of_x.len())?;
    let written = result.as_cuda_slice_mut::<f32>()?;
    let x = x.as_cuda_slice::<f32>()?.slice(of_x);
    let weight = weight.as_cuda_slice::<f32>()?.slice(of_weight);
    let bias = bias.as_cuda_slice::<f32>()?.slice(of_bias);
    launch!(device, "layer_norm", rows * WARP, &size, &epsilon, &x, &weight, &bias, written);
    Ok(result)
}

/// As [`super::layer_norm_back`].
pub(crate) fn layer_norm_back_on_gpu(
    epsilon: f32,
    (x, x_layout): (&CudaStorage, &Layout),
    (weight, weight_layout): (&CudaStorage, &Layout),
    (gradient, gradient_layout): (&CudaStorage, &Layout),
) -> Result<CudaStorage> {
    let (device, of_x) = (&x.device, range(x_layout)?);
    let (of_weight, of_gradient) = (range(weight_layout)?, range(gradient_layout)?);
    let (rows, size) = rows(&of_x, &of_weight)?;
    if of_gradient.len() != of_x.len() {
        bail!("{} gradients of {} numbers", of_gradient.len(), of_x.len());
    }
    let mut result = room(device, 2 * of_x.len())?;
    let written = result.as_cuda_slice_mut::<f32>()?;
    let x = x.as_cuda_slice::<f32>()?.slice(of_x);
    let weight = weight.as_cuda_slice::<f32>()?.slice(of_weight);
    let gradient = gradient.as_cuda_slice::<f32>()?.slice(of_gradient);
    let count = rows * WARP;
    launch!(device, "layer_norm_back", count, &size, &epsilon, &x, &weight, &gradient, written);
    Ok(result)
}

/// How many rows, and how many numbers in each.
fn rows(of_x: &Range<usize>, of_weight: &Range<usize>) -> Result<(usize, u32)> {
    if of_weight.is_empty() || !of_x.len().is_multiple_of(of_weight.len()) {
        bail!("layer normalisation of {} numbers in rows of {}", of_x.len(), of_weight.len());
    }
    Ok((of_x.len() / of_weight.len(), counted(of_weight.len())?))
}

impl MomentStep {
    /// As [`MomentStep::apply`].
    pub(crate) fn on_gpu(
        &self,
        (moments, moments_layout): (&mut CudaStorage, &Layout),
        [(gradients, gradients_layout), (weights, weights_layout)]: [(&CudaStorage, &Layout); 2],
    ) -> Result<()> {
        let device = moments.device.clone();
        let (of_gradients, of_weights) = (range(gradients_layout)?, range(weights_layout)?);
        let (of_moments, count) = (range(moments_layout)?, of_gradients.len());
        if of_weights.len() != count || of_moments.len() != 2 * count {
            bail!("{count} gradients, {} weights, {} moments", of_weights.len(), of_moments.len());
        }
        let mut moments = moments.as_cuda_slice_mut::<f32>()?.slice_mut(of_moments);
        let gradients = gradients.as_cuda_slice::<f32>()?.slice(of_gradients);
        let weights = weights.as_cuda_slice::<f32>()?.slice(of_weights);
        let Self { betas: (beta1, beta2), scale, l2 } = self;
        launch!(
            device,
            "adam_moments",
            count,
            beta1,
            beta2,
            scale,
            l2,
            &gradients,
            &weights,
            &mut moments
        );
        Ok(())
    }
}

impl WeightStep {
    /// As [`WeightStep::apply`].
    pub(crate) fn on_gpu(
        &self,
        (weights, weights_layout): (&mut CudaStorage, &Layout),
        (moments, moments_layout): (&CudaStorage, &Layout),
    ) -> Result<()> {
        let device = weights.device.clone();
        let (of_weights, of_moments) = (range(weights_layout)?, range(moments_layout)?);
        let count = of_weights.len();
        if of_moments.len() != 2 * count {
            bail!("{count} weights, {} moments", of_moments.len());
        }
        let mut weights = weights.as_cuda_slice_mut::<f32>()?.slice_mut(of_weights);
        let moments = moments.as_cuda_slice::<f32>()?.slice(of_moments);
        let Self { rate, root_correction2, epsilon, kept } = self;
        launch!(
            device,
            "adam_step",
            count,
            rate,
            root_correction2,
            epsilon,
            kept,
            &moments,
            &mut weights
        );
        Ok(())
    }
}

/// `target ← target + τ (source − target)`, in place.
pub(crate) fn moving_average(
    tau: f32,
    (target, target_layout): (&mut CudaStorage, &Layout),
    (source, source_layout): (&CudaStorage, &Layout),
) -> Result<()> {
    let device = target.device.clone();
    let (of_target, of_source) = (range(target_layout)?, range(source_layout)?);
    let count = of_target.len();
    if of_source.len() != count {
        bail!("a moving average of {} numbers by {count}", of_source.len());
    }
    let mut target = target.as_cuda_slice_mut::<f32>()?.slice_mut(of_target);
    let source = source.as_cuda_slice::<f32>()?.slice(of_source);
    launch!(device, "moving_average", count, &tau, &source, &mut target);
    Ok(())
}

#[cfg(test)]
mod tests {
    /// No GPU is needed for that.
    #[test]
    #[allow(clippy::unwrap_used)]
    fn the_kernels_compile() {
        let ptx = super::compiled().unwrap();
        for name in ["patches_of_images", "layer_norm_back", "moving_average"] {
            assert!(ptx.contains(&format!(".entry {name}(")), "{name}");
        }
    }
}
