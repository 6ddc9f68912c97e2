//! Weights and gradients in the forms that the vector kernels read and write.

use rayon::prelude::*;

use super::winograd::{self, Paired};
use super::{Convolutions, TAPS, direct};
use crate::kernels::Kernels;

/// All layers' weights and biases; empty for the portable kernels.
pub(super) struct Weights {
    /// The first layer's, as [`direct::pack`] gives it.
    pub(super) first: Vec<f32>,
    /// The others', as [`winograd::transform`] gives them.
    pub(super) rest: Vec<Vec<f32>>,
    /// Padded filters each.
    pub(super) biases: Vec<Vec<f32>>,
}

impl Weights {
    /// What the forward pass reads.
    pub(super) fn forward(stack: &Convolutions, parameters: &[f32]) -> Self {
        Self::new(stack, parameters, |weight, from, to, tap| {
            weight[(to * stack.filters + from) * TAPS + tap]
        })
    }

    /// What the gradient reads: the later layers' weights from filters back to channels, turned by half a turn.
    pub(super) fn backward(stack: &Convolutions, parameters: &[f32]) -> Self {
        Self::new(stack, parameters, |weight, from, to, tap| {
            weight[(from * stack.filters + to) * TAPS + TAPS - 1 - tap]
        })
    }

    fn new(
        stack: &Convolutions,
        parameters: &[f32],
        tap: impl Fn(&[f32], usize, usize, usize) -> f32 + Sync,
    ) -> Self {
        if stack.kernels == Kernels::portable() {
            return Self { first: Vec::new(), rest: Vec::new(), biases: Vec::new() };
        }
        let (filters, padded) = (stack.filters, stack.padded());
        let weight = |layer: usize| &parameters[stack.parameters(layer).0];
        let transformed = |layer: usize| {
            let weight = weight(layer);
            winograd::transform(filters, padded, |from, to, index| tap(weight, from, to, index))
        };
        let first = direct::pack(weight(0), stack.channels, filters, padded);
        let rest = (1..stack.layers).into_par_iter().map(transformed).collect();
        let biases = (0..stack.layers)
            .map(|layer| {
                let mut bias = parameters[stack.parameters(layer).1].to_vec();
                bias.resize(padded, 0.0);
                bias
            })
            .collect();
        Self { first, rest, biases }
    }
}

/// Numbers of each layer's weight gradient, as the tasks sum it; the bias's, one for each padded
/// filter, follow each.
pub(super) fn gradient_sizes(stack: &Convolutions) -> Vec<usize> {
    let inputs = std::iter::once(stack.channels).chain(std::iter::repeat(stack.filters));
    inputs.take(stack.layers).map(|inputs| TAPS * inputs * stack.padded()).collect()
}

/// From such sums to the parameters' gradient; `paired` is of each layer but the first.
pub(super) fn unpack(stack: &Convolutions, sums: &mut [f32], paired: &[Paired]) -> Vec<f32> {
    let (filters, padded) = (stack.filters, stack.padded());
    let mut gradient = Vec::with_capacity(stack.parameter_count());
    let mut rest = sums;
    for (layer, numbers) in gradient_sizes(stack).into_iter().enumerate() {
        let (weight, after) = rest.split_at_mut(numbers);
        let (bias, after) = after.split_at_mut(padded);
        if layer == 0 {
            direct::unpack_first(weight, stack.channels, filters, padded, &mut gradient);
        } else {
            paired[layer - 1].clear_others(weight, padded);
            unpack_later(weight, filters, padded, &mut gradient);
        }
        gradient.extend_from_slice(&bias[..filters]);
        rest = after;
    }
    gradient
}

/// A later layer's gradient, (9, C, padded F) → (F, C, 3, 3), appended to `target`.
fn unpack_later(packed: &[f32], filters: usize, padded: usize, target: &mut Vec<f32>) {
    for filter in 0..filters {
        for channel in 0..filters {
            let tap = |tap: usize| packed[(tap * filters + channel) * padded + filter];
            target.extend((0..TAPS).map(tap));
        }
    }
}
