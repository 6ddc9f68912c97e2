//! Comparisons for this crate's tests.

use candle_core::{Device, Tensor};

/// The device for tests of GPU code paths: the CPU, or the GPU with the index in `HKSL_TEST_GPU`.
pub(crate) fn device() -> Device {
    match std::env::var("HKSL_TEST_GPU") {
        Ok(number) => Device::new_cuda(number.parse().unwrap()).unwrap(),
        Err(_) => Device::Cpu,
    }
}

/// The gradients of a weighted sum of the outputs. The weights are the same on every device.
pub(crate) fn gradients(output: &Tensor) -> candle_core::backprop::GradStore {
    let weight = crate::rng::standard_normal(
        &mut crate::rng::stream(4, "weights"),
        output.dims(),
        &Device::Cpu,
    );
    let weight = weight.unwrap().to_device(output.device()).unwrap();
    (output * weight).unwrap().sum_all().unwrap().backward().unwrap()
}

/// The largest absolute value. Asserts that all values are finite, because a maximum ignores NaN.
pub(crate) fn largest(numbers: &[f32]) -> f32 {
    if let Some(index) = numbers.iter().position(|x| !x.is_finite()) {
        panic!("number {index} of {} is {}", numbers.len(), numbers[index]);
    }
    numbers.iter().fold(0.0, |most, x| most.max(x.abs()))
}

/// Asserts `|got − expected| ≤ tolerance · max|expected|` for all elements.
pub(crate) fn assert_close_numbers(got: &[f32], expected: &[f32], tolerance: f32, what: &str) {
    assert_eq!(got.len(), expected.len(), "{what}");
    let differences: Vec<f32> = got.iter().zip(expected).map(|(a, b)| a - b).collect();
    let (off, scale) = (largest(&differences), largest(expected));
    assert!(off <= tolerance * scale, "{what}: off by {off:e} of {scale:e}");
}

/// Asserts equal shapes and elements within a relative tolerance of 1e-5.
pub(crate) fn assert_close(got: &Tensor, expected: &Tensor) {
    assert_eq!(got.dims(), expected.dims());
    let numbers = |tensor: &Tensor| tensor.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    assert_close_numbers(&numbers(got), &numbers(expected), 1e-5, "tensor");
}

#[test]
fn equal_numbers_are_close() {
    assert_close_numbers(&[1.0, -2.0], &[1.0, -2.0], 0.0, "numbers");
}

#[test]
#[should_panic(expected = "off by")]
fn a_number_that_is_off_is_not_close() {
    assert_close_numbers(&[1.0, -2.0], &[1.0, -2.1], 1e-2, "numbers");
}

#[test]
#[should_panic(expected = "number 1 of 2 is NaN")]
fn nan_is_close_to_nothing() {
    assert_close_numbers(&[1.0, f32::NAN], &[1.0, 2.0], 1e-2, "numbers");
}

#[test]
#[should_panic(expected = "is inf")]
fn infinity_is_no_scale() {
    largest(&[f32::INFINITY, 1.0]);
}
