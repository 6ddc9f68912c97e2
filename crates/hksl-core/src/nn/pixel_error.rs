//! Squared reconstruction error of images.

use candle_core::{CpuStorage, CustomOp2, DType, Device, Layout, Result as CandleResult, Shape};
use candle_core::{Tensor, bail};
use rayon::prelude::*;

use crate::Result;
use crate::on_host::{bytes, cpu, numbers};

/// The squared error `Σ (maps − (images / 255 − ½))²`, summed over all elements. The gradient reaches the maps.
///
/// # Shapes
/// - `maps`: `(B, H, W, C)`
/// - `images`: `(B, C, H, W)` u8
/// - output: scalar
///
/// ```
/// use candle_core::{Device, Tensor};
/// use hksl_core::nn::pixel_error;
///
/// let maps = Tensor::new(&[[[[0.5f32, -0.5], [0.0, 0.0]]]], &Device::Cpu)?;
/// let images = Tensor::new(&[[[[255u8, 255]], [[0, 0]]]], &Device::Cpu)?;
/// assert_eq!(pixel_error(&maps, &images)?.to_scalar::<f32>()?, 0.5);
/// # Ok::<(), hksl_core::Error>(())
/// ```
pub fn pixel_error(maps: &Tensor, images: &Tensor) -> Result<Tensor> {
    if maps.device().is_cpu() {
        return Ok(maps.contiguous()?.apply_op2(&images.contiguous()?, PixelError)?);
    }
    let wanted = images.permute((0, 2, 3, 1))?.to_dtype(DType::F32)?.affine(1.0 / 255.0, -0.5)?;
    Ok((maps - wanted)?.sqr()?.sum_all()?)
}

struct PixelError;

/// Calls `each` with the index and the difference of every element of one image, in the order of the map.
fn differences(map: &[f32], image: &[u8], channels: usize, mut each: impl FnMut(usize, f32)) {
    let plane = image.len() / channels;
    for (point, numbers) in map.chunks_exact(channels).enumerate() {
        for (channel, number) in numbers.iter().enumerate() {
            let wanted = f32::from(image[channel * plane + point]) / 255.0 - 0.5;
            each(point * channels + channel, number - wanted);
        }
    }
}

impl CustomOp2 for PixelError {
    fn name(&self) -> &'static str {
        "pixel-error"
    }

    fn cpu_fwd(
        &self,
        maps: &CpuStorage,
        maps_layout: &Layout,
        images: &CpuStorage,
        image_layout: &Layout,
    ) -> CandleResult<(CpuStorage, Shape)> {
        let (batch, rows, columns, channels) = maps_layout.shape().dims4()?;
        if image_layout.shape().dims4()? != (batch, channels, rows, columns) {
            bail!("maps {:?} and images {:?}", maps_layout.dims(), image_layout.dims());
        }
        let count = rows * columns * channels;
        let (maps, images) = (numbers(maps, maps_layout)?, bytes(images, image_layout)?);
        let sums: Vec<f64> = maps
            .par_chunks(count)
            .zip(images.par_chunks(count))
            .map(|(map, image)| {
                let mut sum = 0f64;
                differences(map, image, channels, |_, off| sum += f64::from(off * off));
                sum
            })
            .collect();
        Ok((CpuStorage::F32(vec![sums.iter().sum::<f64>() as f32]), ().into()))
    }

    fn bwd(
        &self,
        maps: &Tensor,
        images: &Tensor,
        _: &Tensor,
        gradient: &Tensor,
    ) -> CandleResult<(Option<Tensor>, Option<Tensor>)> {
        let (_, rows, columns, channels) = maps.dims4()?;
        let count = rows * columns * channels;
        let factor = 2.0 * gradient.to_scalar::<f32>()?;
        let (maps_storage, maps_layout) = maps.storage_and_layout();
        let (image_storage, image_layout) = images.storage_and_layout();
        let numbers = numbers(cpu(&maps_storage)?, maps_layout)?;
        let bytes = bytes(cpu(&image_storage)?, image_layout)?;
        let mut towards = vec![0f32; numbers.len()];
        towards
            .par_chunks_mut(count)
            .zip(numbers.par_chunks(count).zip(bytes.par_chunks(count)))
            .for_each(|(towards, (map, image))| {
                differences(map, image, channels, |at, off| towards[at] = factor * off);
            });
        Ok((Some(Tensor::from_vec(towards, maps.shape(), &Device::Cpu)?), None))
    }
}

#[cfg(test)]
mod tests {
    use candle_core::Var;

    use super::*;

    #[test]
    fn the_gradient_is_twice_the_difference() {
        let maps = Var::new(&[[[[0.25f32, -0.5], [1.0, 0.0]]]], &Device::Cpu).unwrap();
        let images = Tensor::new(&[[[[255u8, 0]], [[0, 255]]]], &Device::Cpu).unwrap();
        let loss = (pixel_error(&maps, &images).unwrap() * 3.0).unwrap();
        let gradients = loss.backward().unwrap();
        let gradient = gradients.get(&maps).unwrap().flatten_all().unwrap();
        assert_eq!(gradient.to_vec1::<f32>().unwrap(), [-1.5, 0.0, 9.0, -3.0]);
    }
}
