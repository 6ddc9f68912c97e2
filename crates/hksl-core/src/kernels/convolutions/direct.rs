//! The first layer, computed directly from the pixels.

use pulp::Simd;

use super::{Convolutions, KERNEL, TAPS};
use crate::kernels::product::{Columns, Finish, Start, product};
use crate::kernels::simd::{Offsets, load, store};

/// Where an image's pixels are read: from each output's corner, at each tap of each channel.
pub(super) struct Plan {
    corners: Offsets,
    taps: Offsets,
    padded: usize,
}

impl Plan {
    pub(super) fn new(stack: &Convolutions) -> Self {
        let (height, width) = stack.size(0);
        let corner = |row: usize, column: usize| (row * stack.width + column) * stack.stride;
        let corners = (0..height).flat_map(|row| (0..width).map(move |column| corner(row, column)));
        let plane = stack.height * stack.width;
        let tap = |tap: usize| {
            let (channel, row, column) = (tap / TAPS, tap % TAPS / KERNEL, tap % KERNEL);
            channel * plane + row * stack.width + column
        };
        Self {
            corners: corners.collect(),
            taps: (0..stack.channels * TAPS).map(tap).collect(),
            padded: stack.padded(),
        }
    }
}

/// (F, C, 3, 3) → (C·9, padded F), scaled by 1/255.
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
pub(super) fn unpack(
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

#[inline(always)]
pub(super) fn forward<S: Simd, const M: usize>(
    simd: S,
    plan: &Plan,
    planes: &[f32],
    weight: &[f32],
    bias: &[f32],
    output: &mut [f32],
) {
    let padded = plan.padded;
    let columns = Columns { numbers: weight, stride: padded, vectors: padded / S::F32_LANES };
    let start = Start::Row(bias);
    product::<S, M>(
        simd,
        planes,
        &plan.corners,
        &plan.taps,
        columns,
        output,
        padded,
        start,
        Finish::Relu,
    );
}

/// Adds to the gradients of weight (packed) and bias.
#[inline(always)]
pub(super) fn gradient<S: Simd, const M: usize>(
    simd: S,
    plan: &Plan,
    planes: &[f32],
    gradient: &[f32],
    weight_sum: &mut [f32],
    bias_sum: &mut [f32],
) {
    let padded = plan.padded;
    let vectors = padded / S::F32_LANES;
    let columns = Columns { numbers: gradient, stride: padded, vectors };
    product::<S, M>(
        simd,
        planes,
        &plan.taps,
        &plan.corners,
        columns,
        weight_sum,
        padded,
        Start::Add,
        Finish::Keep,
    );
    sum_pixels(simd, gradient, bias_sum);
}

/// Adds a map's pixels to `sum`, which has the (padded) filters of one.
#[inline(always)]
pub(super) fn sum_pixels<S: Simd>(simd: S, map: &[f32], sum: &mut [f32]) {
    for at in (0..sum.len()).step_by(S::F32_LANES) {
        let mut total = load::<S>(sum, at);
        for pixel in map.chunks_exact(sum.len()) {
            total = simd.add_f32s(total, load::<S>(pixel, at));
        }
        store::<S>(sum, at, total);
    }
}
