//! Tensors on the CPU as slices.

use candle_core::{CpuStorage, Layout, Result, Storage, bail};

/// The storage of a tensor on the CPU.
pub(crate) fn cpu(storage: &Storage) -> Result<&CpuStorage> {
    match storage {
        Storage::Cpu(storage) => Ok(storage),
        _ => bail!("a kernel of the CPU was given a tensor of another device"),
    }
}

/// The elements of a contiguous f32 tensor.
pub(crate) fn numbers<'a>(storage: &'a CpuStorage, layout: &Layout) -> Result<&'a [f32]> {
    part(storage.as_slice::<f32>()?, layout)
}

/// The elements of a contiguous u8 tensor.
pub(crate) fn bytes<'a>(storage: &'a CpuStorage, layout: &Layout) -> Result<&'a [u8]> {
    part(storage.as_slice::<u8>()?, layout)
}

/// The elements of a contiguous f32 tensor, mutably.
pub(crate) fn numbers_mut<'a>(
    storage: &'a mut CpuStorage,
    layout: &Layout,
) -> Result<&'a mut [f32]> {
    match (storage, layout.contiguous_offsets()) {
        (CpuStorage::F32(numbers), Some((start, end))) => Ok(&mut numbers[start..end]),
        _ => bail!("a kernel was given a tensor to change that is not contiguous f32"),
    }
}

fn part<'a, T>(numbers: &'a [T], layout: &Layout) -> Result<&'a [T]> {
    match layout.contiguous_offsets() {
        Some((start, end)) => Ok(&numbers[start..end]),
        None => bail!("a kernel was given a tensor that is not contiguous"),
    }
}
