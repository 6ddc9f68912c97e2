//! Convolutions of feature maps (images, rows, columns, channels) with any kernel size and stride, without padding.
//!
//! A convolution computes `output[p] = Σ_t input[s·p + t] · w_t` over `k×k` taps `t`. A transposed convolution, which is
//! also the input gradient of a convolution, computes the input from the output. It is split by the phase of the input
//! position modulo the stride `s`: each phase is a convolution of stride 1 over the zero-padded output with every s-th
//! tap. Sums are direct, except for 3×3 kernels of stride 1 with equally many input and output channels, which use
//! Winograd's algorithm. The weight gradient is always direct.

mod portable;
mod vector;

use rayon::prelude::*;

use super::convolutions::winograd;
use super::memory::zeros;
use super::{Counter, Engine, Kernels};
use vector::{Forward, Packed, Sum, Transposed};

/// Images per task.
const IMAGES: usize = 8;
/// Maximal number of tasks for a weight gradient. Each task has its own partial sum.
const SUMS: usize = 8;

/// The shape of a convolution, with the kernels that compute it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct MapConvolution {
    pub(crate) kernels: Kernels,
    /// Rows and columns of the input.
    pub(crate) input_size: (usize, usize),
    /// Channels of the input, `C`.
    pub(crate) channels: usize,
    /// Channels of the output, `F`.
    pub(crate) filters: usize,
    /// Kernel size, `k`.
    pub(crate) side: usize,
    pub(crate) stride: usize,
}

impl MapConvolution {
    /// Rows and columns of the output; 0 if the kernel does not fit.
    pub(crate) fn output_size(&self) -> (usize, usize) {
        let side = |side: usize| {
            let steps = side.checked_sub(self.side).and_then(|rest| rest.checked_div(self.stride));
            steps.map_or(0, |steps| steps + 1)
        };
        (side(self.input_size.0), side(self.input_size.1))
    }

    /// Number of elements of the input per image.
    pub(crate) fn input_len(&self) -> usize {
        self.input_size.0 * self.input_size.1 * self.channels
    }

    /// Number of elements of the output per image.
    pub(crate) fn output_len(&self) -> usize {
        let (rows, columns) = self.output_size();
        rows * columns * self.filters
    }

    /// Whether Winograd's algorithm applies: 3×3 kernel, stride 1, equally many input and output channels in whole vectors.
    fn by_winograd(&self) -> bool {
        let whole = self.channels.is_multiple_of(self.kernels.lanes());
        self.side == 3
            && self.stride == 1
            && self.channels == self.filters
            && whole
            && self.kernels != Kernels::portable()
    }

    fn taps(&self) -> usize {
        self.side * self.side
    }

    /// Counts a convolution of `images`, transposed or not, or its weight gradient. `winograd` is the output size if
    /// Winograd's algorithm computes it.
    fn count(&self, counter: &Counter, images: usize, winograd: Option<(usize, usize)>) {
        let defined = 2 * self.output_len() * self.taps() * self.channels;
        let executed = winograd.map_or(defined, |(rows, columns)| {
            2 * winograd::products(rows, columns) * self.channels * self.filters
        });
        counter.add(images * defined, images * executed);
    }

    /// The convolution.
    ///
    /// # Shapes
    /// - `input`: `(B, H, W, C)`
    /// - `weight`: `(F, C, k, k)`
    /// - `bias`: `(F)`
    /// - output: `(B, h, w, F)`
    pub(crate) fn convolve(
        &self,
        Engine { pool, counter, .. }: &Engine,
        input: &[f32],
        weight: &[f32],
        bias: Option<&[f32]>,
    ) -> Vec<f32> {
        let images = input.len() / self.input_len();
        self.count(counter, images, self.by_winograd().then(|| self.output_size()));
        let mut output = zeros(images * self.output_len());
        let packed = Packed::forward(self, weight, bias);
        output
            .par_chunks_mut(IMAGES * self.output_len())
            .zip(input.par_chunks(IMAGES * self.input_len()))
            .for_each(|(output, input)| {
                let mut task = Forward { shape: self, packed: &packed, pool, input, output };
                if self.kernels.run(&mut task).is_none() {
                    portable::convolve(self, input, weight, bias, task.output);
                }
            });
        output
    }

    /// The transposed convolution, which computes the input from the output.
    ///
    /// # Shapes
    /// - `output`: `(B, h, w, F)`
    /// - `weight`: `(F, C, k, k)`
    /// - `bias`: `(C)`
    /// - result: `(B, H, W, C)`
    pub(crate) fn convolve_transposed(
        &self,
        Engine { pool, counter, .. }: &Engine,
        output: &[f32],
        weight: &[f32],
        bias: Option<&[f32]>,
    ) -> Vec<f32> {
        let images = output.len() / self.output_len();
        self.count(counter, images, self.by_winograd().then_some(self.input_size));
        let mut input = zeros(images * self.input_len());
        let packed = Packed::transposed(self, weight, bias);
        input
            .par_chunks_mut(IMAGES * self.input_len())
            .zip(output.par_chunks(IMAGES * self.output_len()))
            .for_each(|(input, output)| {
                let mut task = Transposed { shape: self, packed: &packed, pool, output, input };
                if self.kernels.run(&mut task).is_none() {
                    portable::convolve_transposed(self, output, weight, bias, task.input);
                }
            });
        input
    }

    /// The weight gradient `(F, C, k, k)`. For a convolution, `output` is the output gradient; for a transposed convolution,
    /// `input` is.
    ///
    /// # Shapes
    /// - `input`: `(B, H, W, C)`
    /// - `output`: `(B, h, w, F)`
    pub(crate) fn weight_gradient(
        &self,
        Engine { pool, counter, .. }: &Engine,
        input: &[f32],
        output: &[f32],
    ) -> Vec<f32> {
        let images = input.len() / self.input_len();
        self.count(counter, images, None);
        let share = images.div_ceil(SUMS).max(IMAGES);
        let sums: Vec<Vec<f32>> = input
            .par_chunks(share * self.input_len())
            .zip(output.par_chunks(share * self.output_len()))
            .map(|(input, output)| {
                let task = Sum { shape: self, pool, input, output };
                let packed = self.kernels.run(&task);
                packed.unwrap_or_else(|| portable::weight_gradient(self, input, output))
            })
            .collect();
        let total = sums.into_iter().reduce(|mut total, sum| {
            total.par_iter_mut().with_min_len(1 << 14).zip(&sum).for_each(|(t, s)| *t += s);
            total
        });
        let total = total.unwrap_or_default();
        if self.kernels == Kernels::portable() { total } else { vector::unpack(self, &total) }
    }
}

/// The sum over all positions of a map, per channel.
pub(crate) fn channel_sums(map: &[f32], channels: usize) -> Vec<f32> {
    let share = channels * (1 << 12);
    let sums: Vec<Vec<f32>> = map
        .par_chunks(share)
        .map(|part| {
            let mut sums = vec![0f32; channels];
            for point in part.chunks_exact(channels) {
                for (sum, number) in sums.iter_mut().zip(point) {
                    *sum += number;
                }
            }
            sums
        })
        .collect();
    let mut total = vec![0f32; channels];
    for sums in sums {
        for (total, sum) in total.iter_mut().zip(sums) {
            *total += sum;
        }
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::stream;
    use crate::testing::assert_close_numbers;
    use rand::Rng;

    fn close(got: &[f32], expected: &[f32], what: &str) {
        assert_close_numbers(got, expected, 5e-6, what);
    }

    /// Compares every set of kernels with the portable ones.
    #[test]
    fn vector_kernels_follow_the_definition() {
        let mut random = stream(5, "maps");
        for (input_size, channels, filters, side, stride, images) in [
            ((7, 9), 3, 5, 3, 1, 3),
            ((8, 11), 16, 32, 3, 2, 11),
            ((11, 9), 32, 32, 3, 1, 10),
            ((6, 13), 16, 16, 3, 1, 3),
            ((9, 9), 4, 17, 4, 2, 2),
            ((13, 10), 2, 3, 5, 2, 9),
            ((14, 15), 3, 16, 6, 2, 1),
            ((12, 12), 5, 4, 3, 3, 2),
            ((5, 5), 33, 9, 5, 2, 20),
        ] {
            let shape =
                |kernels| MapConvolution { kernels, input_size, channels, filters, side, stride };
            let reference = shape(Kernels::portable());
            let mut draw = |count: usize| -> Vec<f32> {
                (0..count).map(|_| random.random_range(-1f32..1.0)).collect()
            };
            let big = draw(images * reference.input_len());
            let output = draw(images * reference.output_len());
            let weight = draw(filters * channels * side * side);
            let (of_small, of_large) = (draw(filters), draw(channels));
            let engine = Engine::default();
            for kernels in Kernels::available() {
                let shape = shape(kernels);
                let what = format!("{shape:?}");
                close(
                    &shape.convolve(&engine, &big, &weight, Some(&of_small)),
                    &reference.convolve(&engine, &big, &weight, Some(&of_small)),
                    &what,
                );
                close(
                    &shape.convolve_transposed(&engine, &output, &weight, Some(&of_large)),
                    &reference.convolve_transposed(&engine, &output, &weight, Some(&of_large)),
                    &what,
                );
                close(
                    &shape.weight_gradient(&engine, &big, &output),
                    &reference.weight_gradient(&engine, &big, &output),
                    &what,
                );
            }
        }
    }

    /// Convolution, transposed convolution and weight gradient are adjoints of each other.
    #[test]
    fn the_three_are_one_bilinear_form() {
        let mut random = stream(6, "maps");
        let shape = MapConvolution {
            kernels: Kernels::detect(),
            input_size: (10, 7),
            channels: 3,
            filters: 4,
            side: 3,
            stride: 2,
        };
        let mut draw = |count: usize| -> Vec<f32> {
            (0..count).map(|_| random.random_range(-1f32..1.0)).collect()
        };
        let (input, output) = (draw(2 * shape.input_len()), draw(2 * shape.output_len()));
        let weight = draw(4 * 3 * 9);
        let engine = Engine::default();
        let dot = |a: &[f32], b: &[f32]| -> f64 {
            a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
        };
        let down = dot(&shape.convolve(&engine, &input, &weight, None), &output);
        let up = dot(&shape.convolve_transposed(&engine, &output, &weight, None), &input);
        let across = dot(&shape.weight_gradient(&engine, &input, &output), &weight);
        assert!((down - up).abs() < 1e-4 && (down - across).abs() < 1e-4, "{down} {up} {across}");
    }
}
