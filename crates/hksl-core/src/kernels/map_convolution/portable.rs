//! By the definition, in plain Rust: what the vector kernels are tested against.

use super::MapConvolution;

impl MapConvolution {
    /// Calls `f(place in the small map, place in the large map, place in the weight)` for every product of one image.
    fn for_each(&self, mut f: impl FnMut(usize, usize, usize)) {
        let (rows, columns) = self.small();
        let taps = self.taps();
        for point in 0..rows * columns {
            for tap in 0..taps {
                let row = point / columns * self.stride + tap / self.side;
                let column = point % columns * self.stride + tap % self.side;
                let large = (row * self.large.1 + column) * self.channels;
                for filter in 0..self.filters {
                    for channel in 0..self.channels {
                        let weight = (filter * self.channels + channel) * taps + tap;
                        f(point * self.filters + filter, large + channel, weight);
                    }
                }
            }
        }
    }

    fn images<'a>(
        &self,
        large: &'a [f32],
        small: &'a [f32],
    ) -> impl Iterator<Item = (&'a [f32], &'a [f32])> {
        large.chunks_exact(self.large_numbers()).zip(small.chunks_exact(self.small_numbers()))
    }
}

pub(super) fn shrink(
    shape: &MapConvolution,
    large: &[f32],
    weight: &[f32],
    bias: Option<&[f32]>,
    small: &mut [f32],
) {
    let images = large.chunks_exact(shape.large_numbers());
    for (large, small) in images.zip(small.chunks_exact_mut(shape.small_numbers())) {
        start(small, shape.filters, bias);
        shape.for_each(|s, l, w| small[s] += large[l] * weight[w]);
    }
}

pub(super) fn grow(
    shape: &MapConvolution,
    small: &[f32],
    weight: &[f32],
    bias: Option<&[f32]>,
    large: &mut [f32],
) {
    let images = small.chunks_exact(shape.small_numbers());
    for (small, large) in images.zip(large.chunks_exact_mut(shape.large_numbers())) {
        start(large, shape.channels, bias);
        shape.for_each(|s, l, w| large[l] += small[s] * weight[w]);
    }
}

pub(super) fn weight_gradient(shape: &MapConvolution, large: &[f32], small: &[f32]) -> Vec<f32> {
    let mut sums = vec![0f32; shape.filters * shape.channels * shape.taps()];
    for (large, small) in shape.images(large, small) {
        shape.for_each(|s, l, w| sums[w] += small[s] * large[l]);
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
