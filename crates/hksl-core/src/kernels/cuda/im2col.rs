//! im2col and col2im on the GPU.

use candle_core::cuda_backend::WrapErr;
use candle_core::cuda_backend::cudarc::driver::PushKernelArg;
use candle_core::{CudaStorage, Layout, Result, bail};

use super::super::Im2col;
use super::{MODULE, allocate, checked_count, compiled, range, threads};

impl Im2col {
    /// The size arguments of the kernels, and whether the kernels can process four channels at once in tensors that start at
    /// this offset.
    fn arguments(&self, start: usize) -> Result<([u32; 7], bool)> {
        let by_four = self.channels.is_multiple_of(4) && start.is_multiple_of(4);
        let channels = if by_four { self.channels / 4 } else { self.channels };
        let ((rows, columns), (height, width)) = (self.output_size(), self.input_size);
        let mut arguments = [0; 7];
        let sizes = [rows, columns, channels, self.kernel, self.stride, height, width];
        for (argument, size) in arguments.iter_mut().zip(sizes) {
            *argument = checked_count(size)?;
        }
        Ok((arguments, by_four))
    }

    /// [`Im2col::im2col`] of f32 maps, or [`Im2col::im2col_u8`] of u8 images, on the GPU.
    pub(crate) fn im2col_on_gpu(&self, maps: &CudaStorage, layout: &Layout) -> Result<CudaStorage> {
        let (device, range) = (&maps.device, range(layout)?);
        let (grid, numbers) =
            (self.output_size(), self.input_size.0 * self.input_size.1 * self.channels);
        if !range.len().is_multiple_of(numbers) {
            bail!("patches of {} numbers by maps of {numbers}", range.len());
        }
        let count = range.len() / numbers * grid.0 * grid.1 * self.columns();
        let mut result = allocate(device, count)?;
        let to = result.as_cuda_slice_mut::<f32>()?;
        if let Ok(bytes) = maps.as_cuda_slice::<u8>() {
            // An offset of 1 selects one channel at a time.
            let ([a, b, c, d, e, f, g], _) = self.arguments(1)?;
            let from = bytes.slice(range);
            launch!(device, "im2col_u8", count, &a, &b, &c, &d, &e, &f, &g, &from, to);
            return Ok(result);
        }
        let ([a, b, c, d, e, f, g], by_four) = self.arguments(range.start)?;
        let from = maps.as_cuda_slice::<f32>()?.slice(range);
        if by_four {
            let name = "im2col_by_four";
            launch!(device, name, count / 4, &a, &b, &c, &d, &e, &f, &g, &from, to);
        } else {
            launch!(device, "im2col", count, &a, &b, &c, &d, &e, &f, &g, &from, to);
        }
        Ok(result)
    }

    /// [`Im2col::col2im`] on the GPU.
    pub(crate) fn col2im_on_gpu(
        &self,
        patches: &CudaStorage,
        layout: &Layout,
    ) -> Result<CudaStorage> {
        let (device, range) = (&patches.device, range(layout)?);
        let (grid, numbers) =
            (self.output_size(), self.input_size.0 * self.input_size.1 * self.channels);
        let of_one = grid.0 * grid.1 * self.columns();
        if !range.len().is_multiple_of(of_one) {
            bail!("{} numbers of patches, {of_one} to a map", range.len());
        }
        let count = range.len() / of_one * numbers;
        let ([a, b, c, d, e, f, g], by_four) = self.arguments(range.start)?;
        let mut result = allocate(device, count)?;
        let to = result.as_cuda_slice_mut::<f32>()?;
        let from = patches.as_cuda_slice::<f32>()?.slice(range);
        if by_four {
            let name = "col2im_by_four";
            launch!(device, name, count / 4, &a, &b, &c, &d, &e, &f, &g, &from, to);
        } else {
            launch!(device, "col2im", count, &a, &b, &c, &d, &e, &f, &g, &from, to);
        }
        Ok(result)
    }
}
