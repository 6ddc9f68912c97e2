//! Convolutions between maps (images, rows, columns, channels): any side and stride, no padding.
//!
//! One shape joins a large map and a small one by `k×k` taps: `small[p] = Σ_t large[s·p + t] · w_t`. A convolution goes
//! from the large map to the small one; a transposed convolution, and a convolution's gradient towards its input, go
//! back. Going back is split by the phase `s·p mod s` of the large map's points: each phase is a convolution of stride
//! 1 over the small map with a border of zeros, by every s-th tap. Sums are direct, but for 3×3 kernels of stride 1
//! between maps of as many channels, which go through Winograd's form; the weight's gradient is always direct.

mod portable;
mod vector;

use rayon::prelude::*;

use super::memory::zeros;
use super::{Kernels, Pool};
use vector::{Grow, Packed, Shrink, Sum};

/// Images in one task.
const IMAGES: usize = 8;
/// Tasks at most that sum a weight's gradient: each holds one.
const SUMS: usize = 8;

/// The shape, and the instructions it runs on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct MapConvolution {
    pub(crate) kernels: Kernels,
    /// Rows and columns of the large map.
    pub(crate) large: (usize, usize),
    /// Channels of the large map, `C`.
    pub(crate) channels: usize,
    /// Channels of the small map, `F`.
    pub(crate) filters: usize,
    /// Of the square kernel, `k`.
    pub(crate) side: usize,
    pub(crate) stride: usize,
}

impl MapConvolution {
    /// Rows and columns of the small map; 0 where the kernel does not fit.
    pub(crate) fn small(&self) -> (usize, usize) {
        let side = |side: usize| {
            let steps = side.checked_sub(self.side).and_then(|rest| rest.checked_div(self.stride));
            steps.map_or(0, |steps| steps + 1)
        };
        (side(self.large.0), side(self.large.1))
    }

    /// Numbers of the large map of one image.
    pub(crate) fn large_numbers(&self) -> usize {
        self.large.0 * self.large.1 * self.channels
    }

    /// Numbers of the small map of one image.
    pub(crate) fn small_numbers(&self) -> usize {
        let (rows, columns) = self.small();
        rows * columns * self.filters
    }

    /// Whether Winograd's form applies: kernels of 3×3, stride 1, as many channels on both sides, in whole vectors.
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

    /// Operations of one image, two for each multiply-add.
    pub(crate) fn operations(&self) -> f64 {
        2.0 * (self.small_numbers() * self.taps() * self.channels) as f64
    }

    /// From the large map to the small one.
    ///
    /// # Shapes
    /// - `large`: `(B, H, W, C)`
    /// - `weight`: `(F, C, k, k)`
    /// - `bias`: `(F)`
    /// - output: `(B, h, w, F)`
    pub(crate) fn shrink(
        &self,
        pool: &Pool,
        large: &[f32],
        weight: &[f32],
        bias: Option<&[f32]>,
    ) -> Vec<f32> {
        let images = large.len() / self.large_numbers();
        let mut small = zeros(images * self.small_numbers());
        let packed = Packed::shrinking(self, weight, bias);
        small
            .par_chunks_mut(IMAGES * self.small_numbers())
            .zip(large.par_chunks(IMAGES * self.large_numbers()))
            .for_each(|(small, large)| {
                let mut task = Shrink { shape: self, packed: &packed, pool, large, small };
                if self.kernels.run(&mut task).is_none() {
                    portable::shrink(self, large, weight, bias, task.small);
                }
            });
        small
    }

    /// From the small map to the large one.
    ///
    /// # Shapes
    /// - `small`: `(B, h, w, F)`
    /// - `weight`: `(F, C, k, k)`
    /// - `bias`: `(C)`
    /// - output: `(B, H, W, C)`
    pub(crate) fn grow(
        &self,
        pool: &Pool,
        small: &[f32],
        weight: &[f32],
        bias: Option<&[f32]>,
    ) -> Vec<f32> {
        let images = small.len() / self.small_numbers();
        let mut large = zeros(images * self.large_numbers());
        let packed = Packed::growing(self, weight, bias);
        large
            .par_chunks_mut(IMAGES * self.large_numbers())
            .zip(small.par_chunks(IMAGES * self.small_numbers()))
            .for_each(|(large, small)| {
                let mut task = Grow { shape: self, packed: &packed, pool, small, large };
                if self.kernels.run(&mut task).is_none() {
                    portable::grow(self, small, weight, bias, task.large);
                }
            });
        large
    }

    /// The gradient towards the weight, `(F, C, k, k)`: of the two maps one is an input, the other the output's gradient.
    ///
    /// # Shapes
    /// - `large`: `(B, H, W, C)`
    /// - `small`: `(B, h, w, F)`
    pub(crate) fn weight_gradient(&self, pool: &Pool, large: &[f32], small: &[f32]) -> Vec<f32> {
        let images = large.len() / self.large_numbers();
        let share = images.div_ceil(SUMS).max(IMAGES);
        let sums: Vec<Vec<f32>> = large
            .par_chunks(share * self.large_numbers())
            .zip(small.par_chunks(share * self.small_numbers()))
            .map(|(large, small)| {
                let task = Sum { shape: self, pool, large, small };
                let packed = self.kernels.run(&task);
                packed.unwrap_or_else(|| portable::weight_gradient(self, large, small))
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

/// The sum over all points of a map, one number a channel.
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

    /// Every set of kernels against the portable ones, which follow the definition.
    #[test]
    fn vector_kernels_follow_the_definition() {
        let mut random = stream(5, "maps");
        for (large, channels, filters, side, stride, images) in [
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
                |kernels| MapConvolution { kernels, large, channels, filters, side, stride };
            let reference = shape(Kernels::portable());
            let mut draw = |count: usize| -> Vec<f32> {
                (0..count).map(|_| random.random_range(-1f32..1.0)).collect()
            };
            let big = draw(images * reference.large_numbers());
            let small = draw(images * reference.small_numbers());
            let weight = draw(filters * channels * side * side);
            let (of_small, of_large) = (draw(filters), draw(channels));
            let pool = Pool::default();
            for kernels in Kernels::available() {
                let shape = shape(kernels);
                let what = format!("{shape:?}");
                close(
                    &shape.shrink(&pool, &big, &weight, Some(&of_small)),
                    &reference.shrink(&pool, &big, &weight, Some(&of_small)),
                    &what,
                );
                close(
                    &shape.grow(&pool, &small, &weight, Some(&of_large)),
                    &reference.grow(&pool, &small, &weight, Some(&of_large)),
                    &what,
                );
                close(
                    &shape.weight_gradient(&pool, &big, &small),
                    &reference.weight_gradient(&pool, &big, &small),
                    &what,
                );
            }
        }
    }

    /// Shrinking and growing are each other's adjoint, and so is the weight's gradient.
    #[test]
    fn the_three_are_one_bilinear_form() {
        let mut random = stream(6, "maps");
        let shape = MapConvolution {
            kernels: Kernels::detect(),
            large: (10, 7),
            channels: 3,
            filters: 4,
            side: 3,
            stride: 2,
        };
        let mut draw = |count: usize| -> Vec<f32> {
            (0..count).map(|_| random.random_range(-1f32..1.0)).collect()
        };
        let (large, small) = (draw(2 * shape.large_numbers()), draw(2 * shape.small_numbers()));
        let weight = draw(4 * 3 * 9);
        let pool = Pool::default();
        let dot = |a: &[f32], b: &[f32]| -> f64 {
            a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
        };
        let down = dot(&shape.shrink(&pool, &large, &weight, None), &small);
        let up = dot(&shape.grow(&pool, &small, &weight, None), &large);
        let across = dot(&shape.weight_gradient(&pool, &large, &small), &weight);
        assert!((down - up).abs() < 1e-4 && (down - across).abs() < 1e-4, "{down} {up} {across}");
    }
}
