//! Convolutions by their definition in plain Rust, the reference for the vector kernels.

use super::MapConvolution;

impl MapConvolution {
    /// Calls `f(output index, input index, weight index)` for every product of one image.
    fn for_each(&self, mut f: impl FnMut(usize, usize, usize)) {
        let (rows, columns) = self.output_size();
        let taps = self.taps();
        for point in 0..rows * columns {
            for tap in 0..taps {
                let row = point / columns * self.stride + tap / self.side;
                let column = point % columns * self.stride + tap % self.side;
                let input = (row * self.input_size.1 + column) * self.channels;
                for filter in 0..self.filters {
                    for channel in 0..self.channels {
                        let weight = (filter * self.channels + channel) * taps + tap;
                        f(point * self.filters + filter, input + channel, weight);
                    }
                }
            }
        }
    }

    fn images<'a>(
        &self,
        input: &'a [f32],
        output: &'a [f32],
    ) -> impl Iterator<Item = (&'a [f32], &'a [f32])> {
        input.chunks_exact(self.input_len()).zip(output.chunks_exact(self.output_len()))
    }
}

pub(super) fn convolve(
    shape: &MapConvolution,
    input: &[f32],
    weight: &[f32],
    bias: Option<&[f32]>,
    output: &mut [f32],
) {
    let images = input.chunks_exact(shape.input_len());
    for (input, output) in images.zip(output.chunks_exact_mut(shape.output_len())) {
        start(output, shape.filters, bias);
        shape.for_each(|s, l, w| output[s] += input[l] * weight[w]);
    }
}

pub(super) fn convolve_transposed(
    shape: &MapConvolution,
    output: &[f32],
    weight: &[f32],
    bias: Option<&[f32]>,
    input: &mut [f32],
) {
    let images = output.chunks_exact(shape.output_len());
    for (output, input) in images.zip(input.chunks_exact_mut(shape.input_len())) {
        start(input, shape.channels, bias);
        shape.for_each(|s, l, w| input[l] += output[s] * weight[w]);
    }
}

pub(super) fn weight_gradient(shape: &MapConvolution, input: &[f32], output: &[f32]) -> Vec<f32> {
    let mut sums = vec![0f32; shape.filters * shape.channels * shape.taps()];
    for (input, output) in shape.images(input, output) {
        shape.for_each(|s, l, w| sums[w] += output[s] * input[l]);
    }
    sums
}

fn start(map: &mut [f32], channels: usize, bias: Option<&[f32]>) {
    for point in map.chunks_exact_mut(channels) {
        match bias {
            Some(bias) => point.copy_from_slice(bias),
            None => point.fill(0.0),
        }
    }
}
