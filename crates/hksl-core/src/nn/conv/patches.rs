//! Every 3×3 patch of an image as one row of a matrix.

use candle_core::{CpuStorage, DType, Device, Layout, Shape, Tensor, bail};
use candle_core::{CustomOp1, Result as CandleResult};
use rayon::prelude::*;

use super::Convolution;
use crate::Result;

const KERNEL: usize = Convolution::KERNEL;

/// The side of a convolution's output over an input of side `side`.
pub(crate) fn output_side(side: usize, stride: usize) -> usize {
    (side - KERNEL) / stride + 1
}

/// Patches of u8 images, as f32 in [0, 1].
///
/// # Shapes
/// - `x`: `(B, C, H, W)` u8
/// - output: `(B·h·w, C·9)`, channel-major like a convolution's weight
pub(super) fn of_pixels(x: &Tensor, stride: usize) -> Result<Tensor> {
    if matches!(x.device(), Device::Cpu) {
        return Ok(x.contiguous()?.apply_op1_no_bwd(&PixelPatches { stride })?);
    }
    let (batch, channels, height, width) = x.dims4()?;
    let x = (x.to_dtype(DType::F32)? / 255.0)?;
    let windows = windows(&x, 2, stride)?;
    let rows = batch * output_side(height, stride) * output_side(width, stride);
    let columns = channels * KERNEL * KERNEL;
    Ok(Tensor::stack(&windows, 4)?.permute((0, 2, 3, 1, 4))?.reshape((rows, columns))?)
}

/// Patches of feature maps, with a gradient.
///
/// # Shapes
/// - `x`: `(B, H, W, C)` f32
/// - output: `(B·h·w, 9·C)`, channels innermost
pub(super) fn of_maps(x: &Tensor, stride: usize) -> Result<Tensor> {
    if matches!(x.device(), Device::Cpu) {
        return Ok(x.contiguous()?.apply_op1(MapPatches { stride })?);
    }
    let (batch, height, width, channels) = x.dims4()?;
    let windows = windows(x, 1, stride)?;
    let rows = batch * output_side(height, stride) * output_side(width, stride);
    Ok(Tensor::cat(&windows, 3)?.reshape((rows, KERNEL * KERNEL * channels))?)
}

/// The nine shifted views of an image whose height is dimension `rows` and width the one after it: the way
/// to patches on devices that have no kernel of ours.
fn windows(x: &Tensor, rows: usize, stride: usize) -> Result<Vec<Tensor>> {
    let pick = |x: &Tensor, dimension: usize, start: usize| -> Result<Tensor> {
        let count = output_side(x.dim(dimension)?, stride);
        if stride == 1 {
            return Ok(x.narrow(dimension, start, count)?);
        }
        let indices: Vec<u32> = (0..count).map(|i| (start + i * stride) as u32).collect();
        Ok(x.index_select(&Tensor::new(indices, x.device())?, dimension)?)
    };
    let mut windows = Vec::with_capacity(KERNEL * KERNEL);
    for row in 0..KERNEL {
        // The height is still whole here, so its output side is the right one.
        let band = pick(x, rows, row)?;
        for column in 0..KERNEL {
            windows.push(pick(&band, rows + 1, column)?);
        }
    }
    Ok(windows)
}

struct PixelPatches {
    stride: usize,
}

impl CustomOp1 for PixelPatches {
    fn name(&self) -> &'static str {
        "pixel-patches"
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> CandleResult<(CpuStorage, Shape)> {
        let (batch, channels, height, width) = layout.shape().dims4()?;
        let (CpuStorage::U8(pixels), Some((start, end))) = (storage, layout.contiguous_offsets())
        else {
            bail!("pixels must be contiguous u8, not {:?}", layout)
        };
        let pixels = &pixels[start..end];
        let scaled: [f32; 256] = std::array::from_fn(|level| level as f32 / 255.0);
        let (out_height, out_width) =
            (output_side(height, self.stride), output_side(width, self.stride));
        let columns = channels * KERNEL * KERNEL;
        let mut patches = vec![0f32; batch * out_height * out_width * columns];
        patches.par_chunks_mut(out_width * columns).enumerate().for_each(|(band, output)| {
            let (image, top) = (band / out_height, band % out_height * self.stride);
            for (column, patch) in output.chunks_exact_mut(columns).enumerate() {
                let left = column * self.stride;
                for (channel, square) in patch.chunks_exact_mut(KERNEL * KERNEL).enumerate() {
                    let plane = (image * channels + channel) * height;
                    for (row, cells) in square.chunks_exact_mut(KERNEL).enumerate() {
                        let from = (plane + top + row) * width + left;
                        for (cell, &level) in cells.iter_mut().zip(&pixels[from..from + KERNEL]) {
                            *cell = scaled[usize::from(level)];
                        }
                    }
                }
            }
        });
        let shape = (batch * out_height * out_width, columns);
        Ok((CpuStorage::F32(patches), shape.into()))
    }
}

struct MapPatches {
    stride: usize,
}

impl CustomOp1 for MapPatches {
    fn name(&self) -> &'static str {
        "map-patches"
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> CandleResult<(CpuStorage, Shape)> {
        let (batch, height, width, channels) = layout.shape().dims4()?;
        let maps = contiguous(storage, layout)?;
        let (out_height, out_width) =
            (output_side(height, self.stride), output_side(width, self.stride));
        let run = KERNEL * channels;
        let mut patches = vec![0f32; batch * out_height * out_width * KERNEL * run];
        patches.par_chunks_mut(out_width * KERNEL * run).enumerate().for_each(|(band, output)| {
            let (image, top) = (band / out_height, band % out_height * self.stride);
            for (column, patch) in output.chunks_exact_mut(KERNEL * run).enumerate() {
                for (row, cells) in patch.chunks_exact_mut(run).enumerate() {
                    let from =
                        ((image * height + top + row) * width + column * self.stride) * channels;
                    cells.copy_from_slice(&maps[from..from + run]);
                }
            }
        });
        let shape = (batch * out_height * out_width, KERNEL * run);
        Ok((CpuStorage::F32(patches), shape.into()))
    }

    fn bwd(&self, arg: &Tensor, _: &Tensor, gradient: &Tensor) -> CandleResult<Option<Tensor>> {
        let (_, height, width, channels) = arg.dims4()?;
        let scatter = PatchSum { stride: self.stride, height, width, channels };
        Ok(Some(gradient.contiguous()?.apply_op1_no_bwd(&scatter)?))
    }
}

/// The gradient of [`MapPatches`]: every cell of a map collects what its patches received.
struct PatchSum {
    stride: usize,
    height: usize,
    width: usize,
    channels: usize,
}

impl CustomOp1 for PatchSum {
    fn name(&self) -> &'static str {
        "patch-sum"
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> CandleResult<(CpuStorage, Shape)> {
        let Self { stride, height, width, channels } = *self;
        let patches = contiguous(storage, layout)?;
        let (out_height, out_width) = (output_side(height, stride), output_side(width, stride));
        let run = KERNEL * channels;
        let image_patches = out_height * out_width * KERNEL * run;
        let batch = patches.len() / image_patches;
        let mut maps = vec![0f32; batch * height * width * channels];
        // One image is one task, so no two tasks write the same cell and the order of sums is fixed.
        maps.par_chunks_mut(height * width * channels).enumerate().for_each(|(image, map)| {
            let patches = &patches[image * image_patches..(image + 1) * image_patches];
            for (index, patch) in patches.chunks_exact(KERNEL * run).enumerate() {
                let (top, left) = (index / out_width * stride, index % out_width * stride);
                for (row, cells) in patch.chunks_exact(run).enumerate() {
                    let to = ((top + row) * width + left) * channels;
                    for (sum, cell) in map[to..to + run].iter_mut().zip(cells) {
                        *sum += cell;
                    }
                }
            }
        });
        Ok((CpuStorage::F32(maps), (batch, height, width, channels).into()))
    }
}

/// The f32 numbers of a contiguous tensor.
pub(super) fn contiguous<'a>(storage: &'a CpuStorage, layout: &Layout) -> CandleResult<&'a [f32]> {
    match (storage, layout.contiguous_offsets()) {
        (CpuStorage::F32(numbers), Some((start, end))) => Ok(&numbers[start..end]),
        _ => bail!("a contiguous f32 tensor is needed, not {layout:?}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{standard_normal, stream};

    /// The path of other devices, run on the CPU, gives the kernel's very patches.
    #[test]
    fn windows_are_the_patches() {
        for stride in [1, 2] {
            let x = standard_normal(&mut stream(1, "x"), &[2, 8, 9, 3], &Device::Cpu).unwrap();
            let kernel = of_maps(&x, stride).unwrap();
            let views = Tensor::cat(&windows(&x, 1, stride).unwrap(), 3).unwrap();
            let views = views.reshape(kernel.shape()).unwrap();
            assert_eq!(kernel.to_vec2::<f32>().unwrap(), views.to_vec2::<f32>().unwrap());
        }
    }
}
