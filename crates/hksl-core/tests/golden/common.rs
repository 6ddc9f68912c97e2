//! What the golden tests of all crates share.

use candle_core::{DType, Device, Tensor};

/// Where the networks live: the CPU, or the GPU whose number is in `HKSL_TEST_GPU` (a build with the feature `cuda`).
pub fn device() -> Device {
    match std::env::var("HKSL_TEST_GPU") {
        Ok(number) => Device::new_cuda(number.parse().unwrap()).unwrap(),
        Err(_) => Device::Cpu,
    }
}

/// The largest magnitude in a tensor; NaN if a number is not finite, which a maximum alone passes over.
pub fn largest(tensor: &Tensor) -> f64 {
    let numbers = tensor.flatten_all().unwrap().to_dtype(DType::F64).unwrap();
    let numbers = numbers.to_vec1::<f64>().unwrap();
    if numbers.iter().any(|x| !x.is_finite()) {
        return f64::NAN;
    }
    numbers.into_iter().fold(0.0, |most, x| most.max(x.abs()))
}
