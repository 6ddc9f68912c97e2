//! Direct convolution: the first layer, from the pixels, and its gradient towards the weight.

use pulp::Simd;

use super::{Convolutions, KERNEL, TAPS};
use crate::kernels::product::{Columns, Finish, Start, product};
use crate::kernels::simd::{Offsets, load, store};

/// Outputs that the gradient takes at a time: they and their inputs stay in the first-level cache.
const OUTPUTS: usize = 96;

/// Where a layer's inputs are read: from each output's corner, at each tap of each channel.
pub(super) struct Plan {
    corners: Offsets,
    /// The corners again, in parts.
    parts: Vec<Offsets>,
    taps: Offsets,
    padded: usize,
}

impl Plan {
    /// Of the first layer, on one image (C, H, W).
    pub(super) fn pixels(stack: &Convolutions) -> Self {
        let (height, width) = stack.size(0);
        let corner = |row: usize, column: usize| (row * stack.width + column) * stack.stride;
        let corners = (0..height).flat_map(|row| (0..width).map(move |column| corner(row, column)));
        let plane = stack.height * stack.width;
        let tap = |tap: usize| {
            let (channel, row, column) = (tap / TAPS, tap % TAPS / KERNEL, tap % KERNEL);
            channel * plane + row * stack.width + column
        };
        let taps = (0..stack.channels * TAPS).map(tap).collect();
        Self::new(corners.collect(), taps, stack.padded())
    }

    fn new(corners: Offsets, taps: Offsets, padded: usize) -> Self {
        let count = corners.len();
        let part = |first: usize| corners.part(first, OUTPUTS.min(count - first));
        let parts = (0..count).step_by(OUTPUTS).map(part).collect();
        Self { corners, parts, taps, padded }
    }
}

/// The first layer's weight, (F, C, 3, 3) → (C·9, padded F), scaled by 1/255.
pub(super) fn pack(weight: &[f32], channels: usize, filters: usize, padded: usize) -> Vec<f32> {
    let terms = channels * TAPS;
    let mut packed = vec![0f32; terms * padded];
    for filter in 0..filters {
        for term in 0..terms {
            packed[term * padded + filter] = weight[filter * terms + term] / 255.0;
        }
    }
    packed
}

/// The gradient of [`pack`], appended to `target`.
pub(super) fn unpack_first(
    packed: &[f32],
    channels: usize,
    filters: usize,
    padded: usize,
    target: &mut Vec<f32>,
) {
    let terms = channels * TAPS;
    for filter in 0..filters {
        target.extend((0..terms).map(|term| packed[term * padded + filter] / 255.0));
    }
}

/// An image's pixels as numbers from 0 to 255.
#[inline(always)]
pub(super) fn planes(image: &[u8], planes: &mut [f32]) {
    for (plane, pixel) in planes.iter_mut().zip(image) {
        *plane = f32::from(*pixel);
    }
}

/// The first layer's output on one image, with bias and ReLU.
#[inline(always)]
pub(super) fn forward<S: Simd, const M: usize>(
    simd: S,
    plan: &Plan,
    planes: &[f32],
    weight: &[f32],
    bias: &[f32],
    output: &mut [f32],
) {
    let (padded, corners, taps) = (plan.padded, &plan.corners, &plan.taps);
    let columns = Columns { numbers: weight, stride: padded, vectors: padded / S::F32_LANES };
    let (start, relu) = (Start::Row(bias), Finish::Relu);
    product::<S, M>(simd, planes, corners, taps, columns, output, padded, start, relu);
}

/// Adds to the gradient of the weight, (taps, padded F), given the one towards the output before its ReLU.
#[inline(always)]
pub(super) fn weight_gradient<S: Simd, const M: usize>(
    simd: S,
    plan: &Plan,
    input: &[f32],
    gradient: &[f32],
    sum: &mut [f32],
) {
    let (padded, taps) = (plan.padded, &plan.taps);
    let vectors = padded / S::F32_LANES;
    for (part, gradient) in plan.parts.iter().zip(gradient.chunks(OUTPUTS * padded)) {
        let columns = Columns { numbers: gradient, stride: padded, vectors };
        let (add, keep) = (Start::Add, Finish::Keep);
        product::<S, M>(simd, input, taps, part, columns, sum, padded, add, keep);
    }
}

/// Adds to the gradient of a layer's bias, (padded F), likewise. Sums of a few pixels keep the rounding small.
#[inline(always)]
pub(super) fn bias_gradient<S: Simd>(simd: S, gradient: &[f32], sum: &mut [f32]) {
    let padded = sum.len();
    for part in gradient.chunks(OUTPUTS * padded) {
        for at in (0..padded).step_by(S::F32_LANES) {
            let mut total = simd.splat_f32s(0.0);
            for pixel in part.chunks_exact(padded) {
                total = simd.add_f32s(total, load::<S>(pixel, at));
            }
            store::<S>(sum, at, simd.add_f32s(load::<S>(sum, at), total));
        }
    }
}
