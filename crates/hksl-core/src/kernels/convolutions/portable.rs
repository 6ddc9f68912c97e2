//! The stack in plain Rust, by the definition of a convolution: what the vector kernels are tested against.

use super::{Convolutions, KERNEL, TAPS};

/// A layer's shape: what it reads and what it writes, both (rows, columns, channels).
struct Layer {
    inputs: usize,
    input_width: usize,
    outputs: usize,
    size: (usize, usize),
    stride: usize,
}

impl Layer {
    fn new(stack: &Convolutions, layer: usize) -> Self {
        let (inputs, input_width, stride) = if layer == 0 {
            (stack.channels, stack.width, stack.stride)
        } else {
            (stack.filters, stack.size(layer - 1).1, 1)
        };
        Self { inputs, input_width, outputs: stack.filters, size: stack.size(layer), stride }
    }

    /// Calls `f(output pixel, input pixel, tap)` for every pair that a kernel joins.
    fn for_each(&self, mut f: impl FnMut(usize, usize, usize)) {
        let (height, width) = self.size;
        for output in 0..height * width {
            let (row, column) = (output / width * self.stride, output % width * self.stride);
            for tap in 0..TAPS {
                f(output, (row + tap / KERNEL) * self.input_width + column + tap % KERNEL, tap);
            }
        }
    }
}

/// (F, C, 3, 3) → (9, C, F)
fn taps_first(weight: &[f32], channels: usize, filters: usize) -> Vec<f32> {
    let mut reordered = vec![0f32; weight.len()];
    for (index, number) in weight.iter().enumerate() {
        let (filter, channel, tap) =
            (index / TAPS / channels, index / TAPS % channels, index % TAPS);
        reordered[(tap * channels + channel) * filters + filter] = *number;
    }
    reordered
}

/// An image (C, H, W) of u8 as (H, W, C) between 0 and 1.
fn scaled(stack: &Convolutions, image: &[u8]) -> Vec<f32> {
    let plane = stack.height * stack.width;
    let pixel = |index: usize| image[index % stack.channels * plane + index / stack.channels];
    (0..image.len()).map(|index| f32::from(pixel(index)) / 255.0).collect()
}

fn relu_layer(layer: &Layer, input: &[f32], weight: &[f32], bias: &[f32]) -> Vec<f32> {
    let (inputs, outputs) = (layer.inputs, layer.outputs);
    let mut result = bias.repeat(layer.size.0 * layer.size.1);
    layer.for_each(|output, pixel, tap| {
        let target = &mut result[output * outputs..][..outputs];
        for channel in 0..inputs {
            let factor = input[pixel * inputs + channel];
            let row = &weight[(tap * inputs + channel) * outputs..][..outputs];
            for (target, weight) in target.iter_mut().zip(row) {
                *target += factor * weight;
            }
        }
    });
    for number in &mut result {
        *number = number.max(0.0);
    }
    result
}

pub(super) fn forward(
    stack: &Convolutions,
    parameters: &[f32],
    images: &[u8],
    output: &mut [f32],
    activations: &mut [f32],
) {
    let (kept, written) = (stack.activation_numbers(), stack.output_numbers());
    for (index, image) in images.chunks_exact(stack.image_numbers()).enumerate() {
        let mut maps = scaled(stack, image);
        let mut at = index * kept;
        for number in 0..stack.layers {
            let (weight, bias) = stack.parameters(number);
            let layer = Layer::new(stack, number);
            let weight = taps_first(&parameters[weight], layer.inputs, layer.outputs);
            maps = relu_layer(&layer, &maps, &weight, &parameters[bias]);
            if number + 1 < stack.layers {
                activations[at..at + maps.len()].copy_from_slice(&maps);
                at += maps.len();
            }
        }
        output[index * written..(index + 1) * written].copy_from_slice(&maps);
    }
}

/// The sums over these images of the parameters' gradients, in the parameters' order.
pub(super) fn gradient(
    stack: &Convolutions,
    parameters: &[f32],
    images: &[u8],
    activations: &[f32],
    output: &[f32],
    gradient: &[f32],
) -> Vec<f32> {
    let mut sums = vec![0f32; stack.parameter_count()];
    let (kept, written) = (stack.activation_numbers(), stack.output_numbers());
    for (index, image) in images.chunks_exact(stack.image_numbers()).enumerate() {
        let part = index * written..(index + 1) * written;
        let mut above = gradient[part.clone()].to_vec();
        let mut outputs = &output[part];
        let mut maps = &activations[index * kept..(index + 1) * kept];
        let pixels = scaled(stack, image);
        for number in (0..stack.layers).rev() {
            for (gradient, output) in above.iter_mut().zip(outputs) {
                *gradient = if *output > 0.0 { *gradient } else { 0.0 };
            }
            let layer = Layer::new(stack, number);
            let input = if number == 0 {
                &pixels[..]
            } else {
                let (rest, input) = maps.split_at(maps.len() - stack.map_numbers(number - 1));
                maps = rest;
                input
            };
            above = layer_gradient(stack, &layer, number, parameters, input, &above, &mut sums);
            outputs = input;
        }
    }
    sums
}

/// Adds to the gradients of layer `number`'s parameters and returns the one towards its input.
fn layer_gradient(
    stack: &Convolutions,
    layer: &Layer,
    number: usize,
    parameters: &[f32],
    input: &[f32],
    above: &[f32],
    sums: &mut [f32],
) -> Vec<f32> {
    let (inputs, outputs) = (layer.inputs, layer.outputs);
    let (weight, bias) = stack.parameters(number);
    let first = weight.start;
    let weight = &parameters[weight];
    let mut below = vec![0f32; input.len()];
    layer.for_each(|output, pixel, tap| {
        for filter in 0..outputs {
            let gradient = above[output * outputs + filter];
            if gradient == 0.0 {
                continue;
            }
            for channel in 0..inputs {
                let at = (filter * inputs + channel) * TAPS + tap;
                sums[first + at] += gradient * input[pixel * inputs + channel];
                below[pixel * inputs + channel] += gradient * weight[at];
            }
        }
    });
    for row in above.chunks_exact(outputs) {
        for (sum, gradient) in sums[bias.clone()].iter_mut().zip(row) {
            *sum += gradient;
        }
    }
    below
}
