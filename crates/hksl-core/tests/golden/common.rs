//! Shared code of the reference tests.

use candle_core::{DType, Device, Tensor};

/// The device of the networks: the CPU, or the GPU with the index in `HKSL_TEST_GPU` (feature `cuda`).
pub fn device() -> Device {
    match std::env::var("HKSL_TEST_GPU") {
        Ok(number) => Device::new_cuda(number.parse().unwrap()).unwrap(),
        Err(_) => Device::Cpu,
    }
}

/// The largest absolute value in a tensor, or NaN if a value is NaN or infinity, which a maximum alone would ignore.
pub fn largest(tensor: &Tensor) -> f64 {
    let numbers = tensor.flatten_all().unwrap().to_dtype(DType::F64).unwrap();
    let numbers = numbers.to_vec1::<f64>().unwrap();
    if numbers.iter().any(|x| !x.is_finite()) {
        return f64::NAN;
    }
    numbers.into_iter().fold(0.0, |most, x| most.max(x.abs()))
}
