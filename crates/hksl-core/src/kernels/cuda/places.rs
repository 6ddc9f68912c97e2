//! Patches of maps on the GPU, and their transpose.

use candle_core::cuda_backend::WrapErr;
use candle_core::cuda_backend::cudarc::driver::PushKernelArg;
use candle_core::{CudaStorage, Layout, Result, bail};

use super::super::Places;
use super::{MODULE, compiled, counted, range, room, threads};

impl Places {
    /// Rows, columns, channels, side, step, height and width, as the kernels take them, and whether they may take the
    /// channels of tensors that start here by fours.
    fn arguments(&self, start: usize) -> Result<([u32; 7], bool)> {
        let by_four = self.channels.is_multiple_of(4) && start.is_multiple_of(4);
        let channels = if by_four { self.channels / 4 } else { self.channels };
        let ((rows, columns), (height, width)) = (self.grid(), self.maps);
        let mut arguments = [0; 7];
        let sizes = [rows, columns, channels, self.side, self.step, height, width];
        for (argument, size) in arguments.iter_mut().zip(sizes) {
            *argument = counted(size)?;
        }
        Ok((arguments, by_four))
    }

    /// As [`Places::patches`] or, of bytes, [`Places::patches_of_bytes`].
    pub(crate) fn patches_on_gpu(
        &self,
        maps: &CudaStorage,
        layout: &Layout,
    ) -> Result<CudaStorage> {
        let (device, range) = (&maps.device, range(layout)?);
        let (grid, numbers) = (self.grid(), self.maps.0 * self.maps.1 * self.channels);
        if !range.len().is_multiple_of(numbers) {
            bail!("patches of {} numbers by maps of {numbers}", range.len());
        }
        let count = range.len() / numbers * grid.0 * grid.1 * self.patch();
        let mut result = room(device, count)?;
        let to = result.as_cuda_slice_mut::<f32>()?;
        if let Ok(bytes) = maps.as_cuda_slice::<u8>() {
            // One number at a time: an offset of 1 tells so.
            let ([a, b, c, d, e, f, g], _) = self.arguments(1)?;
            let from = bytes.slice(range);
            launch!(device, "patches_of_images", count, &a, &b, &c, &d, &e, &f, &g, &from, to);
            return Ok(result);
        }
        let ([a, b, c, d, e, f, g], by_four) = self.arguments(range.start)?;
        let from = maps.as_cuda_slice::<f32>()?.slice(range);
        if by_four {
            let name = "patches_of_maps_by_four";
            launch!(device, name, count / 4, &a, &b, &c, &d, &e, &f, &g, &from, to);
        } else {
            launch!(device, "patches_of_maps", count, &a, &b, &c, &d, &e, &f, &g, &from, to);
        }
        Ok(result)
    }

    /// As [`Places::sum`].
    pub(crate) fn sum_on_gpu(&self, patches: &CudaStorage, layout: &Layout) -> Result<CudaStorage> {
        let (device, range) = (&patches.device, range(layout)?);
        let (grid, numbers) = (self.grid(), self.maps.0 * self.maps.1 * self.channels);
        let of_one = grid.0 * grid.1 * self.patch();
        if !range.len().is_multiple_of(of_one) {
            bail!("{} numbers of patches, {of_one} to a map", range.len());
        }
        let count = range.len() / of_one * numbers;
        let ([a, b, c, d, e, f, g], by_four) = self.arguments(range.start)?;
        let mut result = room(device, count)?;
        let to = result.as_cuda_slice_mut::<f32>()?;
        let from = patches.as_cuda_slice::<f32>()?.slice(range);
        if by_four {
            let name = "sum_of_patches_by_four";
            launch!(device, name, count / 4, &a, &b, &c, &d, &e, &f, &g, &from, to);
        } else {
            launch!(device, "sum_of_patches", count, &a, &b, &c, &d, &e, &f, &g, &from, to);
        }
        Ok(result)
    }
}
