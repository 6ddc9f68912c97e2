//! Compares every set of kernels with the portable ones for random shapes.

use proptest::prelude::*;
use rand::Rng;

use super::*;
use crate::rng::stream;

/// Relative to the largest element. Rounding errors are about 1e-6.
const TOLERANCE: f32 = 5e-6;

fn random(count: usize, seed: u64) -> Vec<f32> {
    let mut rng = stream(seed, "kernels");
    (0..count).map(|_| rng.random_range(-1f32..1.0)).collect()
}

fn assert_close(what: &str, kernels: Kernels, got: &[f32], expected: &[f32]) {
    assert_close_on(1e-3, what, kernels, got, expected);
}

/// Compares with a tolerance relative to at least `scale`: sums can cancel, their rounding errors do not.
fn assert_close_on(scale: f32, what: &str, kernels: Kernels, got: &[f32], expected: &[f32]) {
    assert_eq!(got.len(), expected.len(), "{what} {kernels}");
    let largest = expected.iter().fold(scale, |largest, number| largest.max(number.abs()));
    for (index, (got, expected)) in got.iter().zip(expected).enumerate() {
        let off = (got - expected).abs() / largest;
        assert!(off <= TOLERANCE, "{what} {kernels}: number {index} off by {off:e} of the largest");
    }
}

fn vector_kernels() -> Vec<Kernels> {
    Kernels::available().into_iter().filter(|&set| set != Kernels::portable()).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    #[test]
    fn convolutions_agree(
        (channels, filters) in (1usize..5, 1usize..40),
        (rows, columns) in (0usize..14, 0usize..14),
        (stride, layers, count) in (1usize..3, 1usize..5, 1usize..19),
        seed in 0u64..1000,
    ) {
        // At least one output.
        let least = 2 * (layers - 1) * stride + KERNEL;
        let (height, width) = (least + rows, least + columns);
        let stack = |kernels| {
            Convolutions { kernels, channels, height, width, filters, stride, layers }
        };
        let oracle = stack(Kernels::portable());
        let images: Vec<u8> = random(count * channels * height * width, seed)
            .into_iter()
            .map(|number| (127.5 * (number + 1.0)) as u8)
            .collect();
        // Biases larger than any sum keep every ReLU active or inactive. Near 0, rounding could change a ReLU and its
        // gradient.
        let mut parameters = random(oracle.parameter_count(), seed + 1);
        for layer in 0..layers {
            let (weight, bias) = oracle.parameters(layer);
            let scale = 0.3 * filters as f32 / weight.len() as f32;
            parameters[weight].iter_mut().for_each(|number| *number *= scale);
            parameters[bias].iter_mut().for_each(|number| *number = number.signum() + *number / 2.0);
        }
        let engine = Engine::default();
        let (output, maps) = oracle.forward(&images, &parameters, &engine, true);
        let maps = maps.unwrap();
        let gradient = random(output.len(), seed + 2);
        let expected = oracle.gradient(&images, &parameters, &engine, &maps, &output, &gradient);
        for kernels in vector_kernels() {
            let stack = stack(kernels);
            let (got, maps) = stack.forward(&images, &parameters, &engine, true);
            assert_close("convolution", kernels, &got, &output);
            prop_assert!(stack.forward(&images, &parameters, &engine, false).0 == got);
            let maps = maps.unwrap();
            let got = stack.gradient(&images, &parameters, &engine, &maps, &got, &gradient);
            // The scale of a sum of as many random values as a filter's gradient sums.
            let scale = 0.5 * ((output.len() / filters) as f32).sqrt();
            assert_close_on(scale, "gradient", kernels, &got, &expected);
        }
    }

    #[test]
    fn affine_maps_agree(
        (batch, inputs, outputs) in (1usize..70, 1usize..1100, 1usize..150),
        relu in any::<bool>(),
        seed in 0u64..1000,
    ) {
        let sizes = Sizes { batch, inputs, outputs };
        let (x, weight) = (random(batch * inputs, seed), random(outputs * inputs, seed + 1));
        let (bias, gradient) = (random(outputs, seed + 2), random(batch * outputs, seed + 3));
        let portable = &Engine::new(Kernels::portable());
        let expected = linear(portable, sizes, &x, &weight, &bias, relu);
        let gradients = linear_gradients(portable, sizes, &x, &weight, &gradient, (true, true));
        for kernels in vector_kernels() {
            let engine = Engine::new(kernels);
            let got = linear(&engine, sizes, &x, &weight, &bias, relu);
            assert_close("affine map", kernels, &got, &expected);
            let got = linear_gradients(&engine, sizes, &x, &weight, &gradient, (true, true));
            for (what, got, expected) in [
                ("gradient of x", got.x, &gradients.x),
                ("gradient of the weight", got.weight, &gradients.weight),
                ("gradient of the bias", got.bias, &gradients.bias),
            ] {
                assert_close(what, kernels, &got.unwrap(), expected.as_ref().unwrap());
            }
        }
    }
}
