//! The weights of a layer whose gradient is not exactly 0.

use std::sync::atomic::{AtomicU64, Ordering};

use pulp::Simd;

use crate::kernels::convolutions::{KERNEL, TAPS};
use crate::kernels::simd::{load, nonzero};

/// Channels in a mask.
const BITS: usize = u64::BITS as usize;

/// The weights that multiply an input other than 0 at a position whose output gradient is not 0, in at least one image.
/// Each task of a batch adds its images.
pub(in crate::kernels) struct Paired {
    channels: usize,
    /// Masks for the filters.
    words: usize,
    /// (9, channels, words).
    masks: Vec<AtomicU64>,
}

impl Paired {
    /// None yet, of a layer with as many filters as channels.
    pub(in crate::kernels) fn new(channels: usize) -> Self {
        let words = channels.div_ceil(BITS);
        let masks = (0..TAPS * channels * words).map(|_| AtomicU64::new(0)).collect();
        Self { channels, words, masks }
    }

    /// Adds some images.
    ///
    /// # Shapes
    /// - `input`: (images, rows, columns, padded channels), with `size` its rows and columns
    /// - `gradient`: (images, rows − 2, columns − 2, padded filters)
    #[inline(always)]
    pub(in crate::kernels) fn add<S: Simd>(
        &self,
        simd: S,
        input: &[f32],
        size: (usize, usize),
        gradient: &[f32],
        padded: usize,
    ) {
        let (inputs, gradients) =
            (self.bits(simd, input, padded), self.bits(simd, gradient, padded));
        let mut missing = Missing::new(self, &inputs, &gradients);
        if missing.pairs.iter().all(|pairs| *pairs == 0) {
            return;
        }
        let ((rows, columns), words) = (size, self.words);
        let (height, width) = (rows - KERNEL + 1, columns - KERNEL + 1);
        for (position, filters) in gradients.chunks_exact(words).enumerate() {
            if missing.none_of(filters) {
                continue;
            }
            let (image, place) = (position / (height * width), position % (height * width));
            let corner = (image * rows + place / width) * columns + place % width;
            for tap in 0..TAPS {
                let pixel = corner + tap / KERNEL * columns + tap % KERNEL;
                missing.pair(tap, &inputs[pixel * words..][..words], filters);
            }
        }
        let found = missing.possible.iter().zip(&missing.pairs);
        for (mask, (possible, missing)) in self.masks.iter().zip(found) {
            mask.fetch_or(possible & !missing, Ordering::Relaxed);
        }
    }

    /// Sets the gradient (9, channels, padded filters) of all other weights to 0.
    pub(in crate::kernels) fn clear_others(&self, gradient: &mut [f32], padded: usize) {
        let rows = gradient.chunks_exact_mut(padded).zip(self.masks.chunks_exact(self.words));
        for (row, masks) in rows {
            for (numbers, mask) in row[..self.channels].chunks_mut(BITS).zip(masks) {
                let mask = mask.load(Ordering::Relaxed);
                for (filter, number) in numbers.iter_mut().enumerate() {
                    if mask & (1 << filter) == 0 {
                        *number = 0.0;
                    }
                }
            }
        }
    }

    /// For each position a bit for each channel, set where its number is not 0.
    #[inline(always)]
    fn bits<S: Simd>(&self, simd: S, map: &[f32], padded: usize) -> Vec<u64> {
        let mut masks = vec![0u64; map.len() / padded * self.words];
        for (masks, pixel) in masks.chunks_exact_mut(self.words).zip(map.chunks_exact(padded)) {
            for at in (0..padded).step_by(S::F32_LANES) {
                // A padded channel may lie beyond the last mask.
                if let Some(mask) = masks.get_mut(at / BITS) {
                    *mask |= u64::from(nonzero(simd, load::<S>(pixel, at))) << (at % BITS);
                }
            }
        }
        masks
    }
}

/// The pairs that a task can still find.
struct Missing {
    words: usize,
    /// The pairs of which both channel and filter are anywhere other than 0, (9, channels, words).
    possible: Vec<u64>,
    /// Those of them that were not found yet.
    pairs: Vec<u64>,
    /// Per tap, the channels and the filters of such pairs: a superset, to pass over most positions.
    channels: Vec<u64>,
    filters: Vec<u64>,
    /// The filters of all taps.
    wanted: Vec<u64>,
}

impl Missing {
    fn new(paired: &Paired, inputs: &[u64], gradients: &[u64]) -> Self {
        let words = paired.words;
        let anywhere = |masks: &[u64]| {
            let mut anywhere = vec![0u64; words];
            for masks in masks.chunks_exact(words) {
                for (anywhere, mask) in anywhere.iter_mut().zip(masks) {
                    *anywhere |= mask;
                }
            }
            anywhere
        };
        let (channels, filters) = (anywhere(inputs), anywhere(gradients));
        let possible: Vec<u64> = (0..TAPS * paired.channels * words)
            .map(|index| {
                let channel = index / words % paired.channels;
                let used = channels[channel / BITS] >> (channel % BITS) & 1 == 1;
                if used { filters[index % words] } else { 0 }
            })
            .collect();
        let pairs = possible
            .iter()
            .zip(&paired.masks)
            .map(|(possible, found)| possible & !found.load(Ordering::Relaxed))
            .collect();
        let mut missing = Self {
            words,
            possible,
            pairs,
            channels: vec![0; TAPS * words],
            filters: vec![0; TAPS * words],
            wanted: vec![0; words],
        };
        (0..TAPS).for_each(|tap| missing.summarise(tap));
        missing
    }

    /// Collects the channels and filters of a tap's missing pairs anew.
    fn summarise(&mut self, tap: usize) {
        let words = self.words;
        let part = self.pairs.len() / TAPS;
        let (channels, filters) =
            (&mut self.channels[tap * words..][..words], &mut self.filters[tap * words..][..words]);
        channels.fill(0);
        filters.fill(0);
        let pairs = self.pairs[tap * part..][..part].chunks_exact(words);
        for (channel, pairs) in pairs.enumerate() {
            for (filters, pairs) in filters.iter_mut().zip(pairs) {
                *filters |= pairs;
                channels[channel / BITS] |= u64::from(*pairs != 0) << (channel % BITS);
            }
        }
        self.wanted.fill(0);
        for filters in self.filters.chunks_exact(words) {
            for (wanted, filters) in self.wanted.iter_mut().zip(filters) {
                *wanted |= filters;
            }
        }
    }

    /// Whether no pair with one of these filters is missing at any tap.
    #[inline(always)]
    fn none_of(&self, filters: &[u64]) -> bool {
        disjoint(&self.wanted, filters)
    }

    /// Strikes off the pairs of these channels and filters at a tap.
    #[inline(always)]
    fn pair(&mut self, tap: usize, channels: &[u64], filters: &[u64]) {
        let words = self.words;
        if disjoint(&self.filters[tap * words..][..words], filters) {
            return;
        }
        let part = self.pairs.len() / TAPS;
        let mut complete = false;
        for (word, channels) in channels.iter().enumerate() {
            let mut rest = channels & self.channels[tap * words + word];
            while rest != 0 {
                let channel = word * BITS + rest.trailing_zeros() as usize;
                rest &= rest - 1;
                let pairs = &mut self.pairs[tap * part + channel * words..][..words];
                for (pairs, filters) in pairs.iter_mut().zip(filters) {
                    *pairs &= !filters;
                }
                complete |= pairs.iter().all(|pairs| *pairs == 0);
            }
        }
        if complete {
            self.summarise(tap);
        }
    }
}

/// Whether two masks have no bit in common.
#[inline(always)]
fn disjoint(a: &[u64], b: &[u64]) -> bool {
    a.iter().zip(b).all(|(a, b)| a & b == 0)
}

#[cfg(test)]
mod tests {
    use pulp::WithSimd;
    use rand::Rng;

    use super::*;
    use crate::kernels::Kernels;
    use crate::rng::stream;

    struct Add<'a> {
        paired: &'a Paired,
        input: &'a [f32],
        size: (usize, usize),
        gradient: &'a [f32],
        padded: usize,
    }

    impl WithSimd for Add<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            self.paired.add(simd, self.input, self.size, self.gradient, self.padded);
        }
    }

    /// Compares the weights whose gradient is kept with those that have a product other than 0, over two tasks, for channels
    /// that are 0 everywhere, nearly everywhere, or rarely.
    #[test]
    fn a_weight_is_paired_if_a_product_is_not_0() {
        let mut random = stream(7, "paired");
        let (size, images) = ((7, 6), 4);
        let output = (size.0 - 2) * (size.1 - 2);
        for channels in [5usize, 32, 70] {
            for kernels in Kernels::available().into_iter().filter(|set| set.lanes() > 1) {
                let padded = channels.next_multiple_of(kernels.lanes());
                let mut map = |pixels: usize| -> Vec<f32> {
                    let shares: Vec<f64> = (0..channels)
                        .map(|_| [0.0, 0.01, 0.05, 0.7][random.random_range(0..4)])
                        .collect();
                    (0..images * pixels * padded)
                        .map(|index| {
                            let share = shares.get(index % padded).copied().unwrap_or(1.0);
                            if random.random_bool(share) { -0.5 } else { 0.0 }
                        })
                        .collect()
                };
                let (input, gradient) = (map(size.0 * size.1), map(output));
                let paired = Paired::new(channels);
                let halves = input.chunks(input.len() / 2).zip(gradient.chunks(gradient.len() / 2));
                for (input, gradient) in halves {
                    kernels.run(Add { paired: &paired, input, size, gradient, padded });
                }
                let mut kept = vec![1.0; TAPS * channels * padded];
                paired.clear_others(&mut kept, padded);
                for tap in 0..TAPS {
                    for channel in 0..channels {
                        for filter in 0..channels {
                            let product = (0..images * output).any(|position| {
                                let (image, place) = (position / output, position % output);
                                let row = place / (size.1 - 2) + tap / KERNEL;
                                let column = place % (size.1 - 2) + tap % KERNEL;
                                let pixel = (image * size.0 + row) * size.1 + column;
                                input[pixel * padded + channel]
                                    * gradient[position * padded + filter]
                                    != 0.0
                            });
                            let number = kept[(tap * channels + channel) * padded + filter];
                            assert_eq!(
                                number != 0.0,
                                product,
                                "{kernels}: {tap}, {channel}, {filter}"
                            );
                        }
                    }
                }
            }
        }
    }
}
