//! The stack on a few images: what one task of a pass does, in vector instructions.

use pulp::{Simd, WithSimd};

use super::packed::{Weights, gradient_sizes};
use super::winograd::{Layer, Outcome, Paired, Scratch, layer, weight_gradient};
use super::{Convolutions, direct};
use crate::kernels::Pool;

/// Runs `$task.run::<S, M>` with as many rows in a block as the registers hold: 16 registers with AVX2, 32
/// elsewhere.
macro_rules! with_rows {
    ($task:expr, $simd:expr) => {
        if S::F32_LANES == 8 { $task.run::<S, 6>($simd) } else { $task.run::<S, 8>($simd) }
    };
}

/// The forward pass of some images.
pub(super) struct Forward<'a, 'b> {
    pub(super) stack: &'a Convolutions,
    pub(super) weights: &'a Weights,
    pub(super) pool: &'a Pool,
    pub(super) images: &'a [u8],
    pub(super) output: &'b mut [f32],
    /// The maps between the layers, layer after layer.
    pub(super) maps: &'b mut [f32],
}

impl WithSimd for &mut Forward<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        with_rows!(self, simd);
    }
}

impl Forward<'_, '_> {
    #[inline(always)]
    fn run<S: Simd, const M: usize>(&mut self, simd: S) {
        let (stack, weights, padded) = (self.stack, self.weights, self.stack.padded());
        let count = self.images.len() / stack.image_numbers();
        let mut scratch = Scratch::new(self.pool, padded);
        let mut maps: &mut [f32] = self.maps;
        let exact = padded == stack.filters;
        let last = count * stack.map_numbers(stack.layers - 1);
        let mut padded_output = self.pool.take(if exact { 0 } else { last });
        let mut targets: Vec<&mut [f32]> = Vec::with_capacity(stack.layers);
        for layer in 0..stack.layers - 1 {
            let (target, rest) =
                std::mem::take(&mut maps).split_at_mut(count * stack.map_numbers(layer));
            maps = rest;
            targets.push(target);
        }
        targets.push(if exact { &mut *self.output } else { &mut padded_output });
        let plan = direct::Plan::pixels(stack);
        let mut planes = self.pool.take(stack.image_numbers());
        let mut input: &[f32] = &[];
        for (number, target) in targets.into_iter().enumerate() {
            let bias = &weights.biases[number];
            if number == 0 {
                let images = self.images.chunks_exact(stack.image_numbers());
                for (image, target) in images.zip(target.chunks_exact_mut(stack.map_numbers(0))) {
                    direct::planes(image, &mut planes);
                    direct::forward::<S, M>(simd, &plan, &planes, &weights.first, bias, target);
                }
            } else {
                let shape = Layer {
                    input,
                    size: stack.size(number - 1),
                    border: 0,
                    weights: &weights.rest[number - 1],
                    channels: stack.filters,
                    padded,
                };
                layer::<S, M>(simd, shape, Outcome::Relu(bias), target, &mut scratch);
            }
            input = target;
        }
        if !exact {
            let rows = padded_output.chunks_exact(padded);
            for (output, row) in self.output.chunks_exact_mut(stack.filters).zip(rows) {
                output.copy_from_slice(&row[..stack.filters]);
            }
        }
    }
}

/// The gradient of some images.
pub(super) struct Backward<'a> {
    pub(super) stack: &'a Convolutions,
    pub(super) weights: &'a Weights,
    pub(super) pool: &'a Pool,
    pub(super) images: &'a [u8],
    /// As [`Forward`] left them.
    pub(super) maps: &'a [f32],
    pub(super) output: &'a [f32],
    pub(super) gradient: &'a [f32],
    /// Of each layer but the first.
    pub(super) paired: &'a [Paired],
}

impl WithSimd for &Backward<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f32> {
        with_rows!(self, simd)
    }
}

impl Backward<'_> {
    /// The sums over these images, as [`super::packed`] describes them.
    #[inline(always)]
    fn run<S: Simd, const M: usize>(&self, simd: S) -> Vec<f32> {
        let (stack, filters, padded) = (self.stack, self.stack.filters, self.stack.padded());
        let count = self.images.len() / stack.image_numbers();
        let sizes = gradient_sizes(stack);
        let mut sums = vec![0f32; sizes.iter().map(|weight| weight + padded).sum()];
        let mut scratch = Scratch::new(self.pool, padded);
        let numbers = |layer: usize| count * stack.map_numbers(layer);
        let mut gradient = self.pool.take(numbers(stack.layers - 1));
        let rows = self.gradient.chunks_exact(filters).zip(self.output.chunks_exact(filters));
        // Of what the padding holds nothing is kept, but it must not slow the arithmetic down.
        for (target, (row, output)) in gradient.chunks_exact_mut(padded).zip(rows) {
            target[filters..].fill(0.0);
            for ((target, number), output) in target.iter_mut().zip(row).zip(output) {
                *target = if *output > 0.0 { *number } else { 0.0 };
            }
        }
        let (mut maps, mut end) = (self.maps, sums.len());
        for number in (1..stack.layers).rev() {
            let start = end - sizes[number] - padded;
            let (weight_sum, bias_sum) = sums[start..end].split_at_mut(sizes[number]);
            end = start;
            let (before, input) = maps.split_at(maps.len() - numbers(number - 1));
            maps = before;
            let weights = &self.weights.rest[number - 1];
            let shape = Layer {
                input,
                size: stack.size(number - 1),
                border: 0,
                weights,
                channels: filters,
                padded,
            };
            let pool = self.pool;
            self.paired[number - 1].add(simd, input, shape.size, &gradient, padded);
            weight_gradient::<S, M>(simd, shape, &gradient, weight_sum, &mut scratch, pool);
            direct::bias_gradient(simd, &gradient, bias_sum);
            let mut below = pool.take(numbers(number - 1));
            let shape = Layer { input: &gradient, size: stack.size(number), border: 2, ..shape };
            layer::<S, M>(simd, shape, Outcome::Where(input), &mut below, &mut scratch);
            gradient = below;
        }
        let plan = direct::Plan::pixels(stack);
        let mut planes = self.pool.take(stack.image_numbers());
        let (weight_sum, bias_sum) = sums[..end].split_at_mut(sizes[0]);
        let images = self.images.chunks_exact(stack.image_numbers());
        for (image, gradient) in images.zip(gradient.chunks_exact(stack.map_numbers(0))) {
            direct::planes(image, &mut planes);
            direct::weight_gradient::<S, M>(simd, &plan, &planes, gradient, weight_sum);
            direct::bias_gradient(simd, gradient, bias_sum);
        }
        sums
    }
}
