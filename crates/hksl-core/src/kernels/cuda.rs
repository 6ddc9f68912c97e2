//! GPU kernels on candle's CUDA storages.
//!
//! NVRTC compiles the kernels on first use, so a build needs nothing beyond candle's requirements.

use std::ops::Range;
use std::sync::OnceLock;

use candle_core::cuda_backend::cudarc::driver::{LaunchConfig, PushKernelArg};
use candle_core::cuda_backend::cudarc::nvrtc::compile_ptx;
use candle_core::cuda_backend::{CudaDType, CudaDevice, CudaStorage, WrapErr};
use candle_core::{Layout, Result, bail};

use super::{Activation, MomentStep, WeightStep};

const SOURCE: &str = include_str!("cuda/kernels.cu");

/// Threads per block.
const BLOCK: u32 = 256;

/// Threads that process one row together.
const WARP: usize = 32;

/// Maximal number of blocks. Threads loop over further elements.
const BLOCKS: u32 = 1 << 16;

/// Name of the compiled module in candle's cache.
const MODULE: &str = "hksl";

/// The kernels as PTX, compiled once per process. The driver translates PTX for its GPU.
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

/// Launches the kernel of this name with the number of elements that its threads process and further arguments.
macro_rules! launch {
    ($device:expr, $name:expr, $count:expr, $($argument:expr),+) => {{
        let count = checked_count($count)?;
        let function = $device.get_or_load_custom_func($name, MODULE, compiled()?)?;
        let mut builder = function.builder();
        builder.arg(&count);
        $(builder.arg($argument);)+
        // SAFETY: the arguments have the kernel's types and order, and each function below checks the lengths of the buffers
        // that its kernel reads and writes.
        #[allow(unsafe_code)]
        unsafe { builder.launch(threads(count)) }.w()?;
    }};
}

// Must come after the macro `launch`.
mod im2col;

/// A launch configuration with one thread per element, up to [`BLOCKS`] blocks.
fn threads(count: u32) -> LaunchConfig {
    let blocks = count.div_ceil(BLOCK).clamp(1, BLOCKS);
    LaunchConfig { grid_dim: (blocks, 1, 1), block_dim: (BLOCK, 1, 1), shared_mem_bytes: 0 }
}

/// Converts a number of elements to the kernels' index type. The limit is `i32::MAX` because a thread's index must be able
/// to pass the last element.
fn checked_count(count: usize) -> Result<u32> {
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

/// The range of a contiguous tensor in its storage, after a check of its length.
fn range(layout: &Layout) -> Result<Range<usize>> {
    match layout.contiguous_offsets() {
        Some((start, end)) => {
            checked_count(end - start)?;
            Ok(start..end)
        }
        None => bail!("a kernel of the GPU was given a tensor that is not contiguous"),
    }
}

/// Allocates an uninitialised buffer, which the caller's kernel must write completely.
fn allocate(device: &CudaDevice, count: usize) -> Result<CudaStorage> {
    checked_count(count)?;
    // SAFETY: any bit pattern is a valid f32, and nothing reads an element before the kernel has written it.
    #[allow(unsafe_code)]
    let buffer = unsafe { device.alloc::<f32>(count) }?;
    Ok(f32::wrap_cuda_slice(buffer, device.clone()))
}

impl Activation {
    /// The activation's number in the kernels.
    fn number(self) -> i32 {
        match self {
            Self::None => 0,
            Self::Relu => 1,
            Self::Elu => 2,
        }
    }

    /// Adds the bias `(width)` to values `(N, width)` and applies the activation, in place.
    pub(crate) fn apply_on_gpu(
        self,
        values: &mut CudaStorage,
        bias: &CudaStorage,
        layout: &Layout,
    ) -> Result<()> {
        let (device, range) = (values.device.clone(), range(layout)?);
        let width = checked_count(range.len())?;
        let values = values.as_cuda_slice_mut::<f32>()?;
        let (count, number) = (values.len(), self.number());
        let bias = bias.as_cuda_slice::<f32>()?.slice(range);
        launch!(device, "bias_and_activation", count, &width, &number, &bias, values);
        Ok(())
    }

    /// The gradient before the activation, from the output and the gradient after it.
    pub(crate) fn backward_on_gpu(
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
        let mut result = allocate(device, count)?;
        let written = result.as_cuda_slice_mut::<f32>()?;
        let output = output.as_cuda_slice::<f32>()?.slice(of_output);
        let gradient = gradient.as_cuda_slice::<f32>()?.slice(of_gradient);
        launch!(device, "activation_backward", count, &number, &output, &gradient, written);
        Ok(result)
    }
}

/// Elementwise kernels.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Elementwise {
    ApplyGate,
    ApplyGateBackward,
    GruUpdate,
    GruUpdateBackward,
}

impl Elementwise {
    /// The kernel's name, its number of inputs, and the size of its output in multiples of the input size.
    fn facts(self) -> (&'static str, usize, usize) {
        match self {
            Self::ApplyGate => ("apply_gate", 2, 1),
            Self::ApplyGateBackward => ("apply_gate_backward", 3, 2),
            Self::GruUpdate => ("gru_update", 3, 1),
            Self::GruUpdateBackward => ("gru_update_backward", 4, 3),
        }
    }
}

/// Runs an elementwise kernel on the inputs `read`.
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
    let mut result = allocate(device, times * count)?;
    let written = result.as_cuda_slice_mut::<f32>()?;
    let count = checked_count(count)?;
    let function = device.get_or_load_custom_func(name, MODULE, compiled()?)?;
    let mut builder = function.builder();
    builder.arg(&count);
    for view in &views {
        builder.arg(view);
    }
    builder.arg(written);
    // SAFETY: the kernel reads `arity` tensors of `count` elements and writes `times · count` elements.
    #[allow(unsafe_code)]
    unsafe { builder.launch(threads(count)) }.w()?;
    Ok(result)
}

/// [`super::layer_norm`] on the GPU.
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
    let mut result = allocate(device, of_x.len())?;
    let written = result.as_cuda_slice_mut::<f32>()?;
    let x = x.as_cuda_slice::<f32>()?.slice(of_x);
    let weight = weight.as_cuda_slice::<f32>()?.slice(of_weight);
    let bias = bias.as_cuda_slice::<f32>()?.slice(of_bias);
    launch!(device, "layer_norm", rows * WARP, &size, &epsilon, &x, &weight, &bias, written);
    Ok(result)
}

/// [`super::layer_norm_backward`] on the GPU.
pub(crate) fn layer_norm_backward_on_gpu(
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
    let mut result = allocate(device, 2 * of_x.len())?;
    let written = result.as_cuda_slice_mut::<f32>()?;
    let x = x.as_cuda_slice::<f32>()?.slice(of_x);
    let weight = weight.as_cuda_slice::<f32>()?.slice(of_weight);
    let gradient = gradient.as_cuda_slice::<f32>()?.slice(of_gradient);
    let count = rows * WARP;
    launch!(device, "layer_norm_backward", count, &size, &epsilon, &x, &weight, &gradient, written);
    Ok(result)
}

/// Number of rows, and elements per row.
fn rows(of_x: &Range<usize>, of_weight: &Range<usize>) -> Result<(usize, u32)> {
    if of_weight.is_empty() || !of_x.len().is_multiple_of(of_weight.len()) {
        bail!("layer normalisation of {} numbers in rows of {}", of_x.len(), of_weight.len());
    }
    Ok((of_x.len() / of_weight.len(), checked_count(of_weight.len())?))
}

impl MomentStep {
    /// [`MomentStep::apply`] on the GPU.
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
    /// [`WeightStep::apply`] on the GPU.
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

/// Soft update `target ← target + τ (source − target)`, in place.
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
    /// Compiling needs no GPU.
    #[test]
    #[allow(clippy::unwrap_used)]
    fn the_kernels_compile() {
        let ptx = super::compiled().unwrap();
        for name in ["im2col_u8", "layer_norm_backward", "moving_average"] {
            assert!(ptx.contains(&format!(".entry {name}(")), "{name}");
        }
    }
}
