//! The gradient of a stride-1 layer towards its weight: `Gᵀ [Σ (Bᵀ d B) ⊙ (A y Aᵀ)] G` over all tiles, with the inputs `d`
//! and the output gradient `y` of a tile. It is the transpose of the layer in `w`, and takes as few multiplications.
//!
//! Rounding leaves a small number where the direct sum is exactly 0, and Adam makes a whole step of it:
//! [`super::Paired`] finds the weights whose gradient has to be 0.

use pulp::Simd;

use super::{
    Grid, INPUTS, Layer, OUTPUTS, P, P2, POSITIONS, Q, Q2, Scratch, TILES, enter_tile,
    position_stride,
};
use crate::kernels::convolutions::KERNEL;
use crate::kernels::memory::{Block, Pool};
use crate::kernels::product::{Columns, Finish, Start, product};
use crate::kernels::simd::{Offsets, load, store};

/// `A y` of one column or row.
#[inline(always)]
fn spread<S: Simd>(simd: S, y: [S::f32s; OUTPUTS]) -> [S::f32s; INPUTS] {
    let (p, p2) = (simd.splat_f32s(P), simd.splat_f32s(P2));
    let (q, q2) = (simd.splat_f32s(Q), simd.splat_f32s(Q2));
    let even_p = simd.mul_add_e_f32s(p2, y[2], y[0]);
    let odd_p = simd.mul_add_e_f32s(p2, y[3], y[1]);
    let even_q = simd.mul_add_e_f32s(q2, y[2], y[0]);
    let odd_q = simd.mul_add_e_f32s(q2, y[3], y[1]);
    [
        y[0],
        simd.mul_add_e_f32s(p, odd_p, even_p),
        simd.negate_mul_add_e_f32s(p, odd_p, even_p),
        simd.mul_add_e_f32s(q, odd_q, even_q),
        simd.negate_mul_add_e_f32s(q, odd_q, even_q),
        y[3],
    ]
}

/// `Gᵀ m` of one column or row.
#[inline(always)]
fn contract<S: Simd>(simd: S, m: [S::f32s; INPUTS]) -> [S::f32s; KERNEL] {
    let zero = simd.splat_f32s(1.0 / (P2 * Q2));
    let p = simd.splat_f32s(1.0 / (2.0 * P2 * (P2 - Q2)));
    let q = simd.splat_f32s(1.0 / (2.0 * Q2 * (Q2 - P2)));
    let even_p = simd.mul_f32s(p, simd.add_f32s(m[1], m[2]));
    let odd_p = simd.mul_f32s(p, simd.sub_f32s(m[1], m[2]));
    let even_q = simd.mul_f32s(q, simd.add_f32s(m[3], m[4]));
    let odd_q = simd.mul_f32s(q, simd.sub_f32s(m[3], m[4]));
    let (p1, p2) = (simd.splat_f32s(P), simd.splat_f32s(P2));
    let (q1, q2) = (simd.splat_f32s(Q), simd.splat_f32s(Q2));
    [
        simd.mul_add_e_f32s(zero, m[0], simd.add_f32s(even_p, even_q)),
        simd.mul_add_e_f32s(p1, odd_p, simd.mul_f32s(q1, odd_q)),
        simd.mul_add_e_f32s(p2, even_p, simd.mul_add_e_f32s(q2, even_q, m[5])),
    ]
}

/// Transforms the output gradient of tile `tile` into place `place` of a block.
#[inline(always)]
fn spread_tile<S: Simd>(
    simd: S,
    padded: usize,
    grid: Grid,
    tile: usize,
    place: usize,
    gradient: &[f32],
    block: &mut [f32],
) {
    let (image, row, column) = grid.place(tile);
    let (height, width) = grid.output;
    let (rows, columns) = (height - row, width - column);
    let first = (image * height + row) * width + column;
    let stride = position_stride(padded);
    let zero = simd.splat_f32s(0.0);
    for at in (0..padded).step_by(S::F32_LANES) {
        let place = place * padded + at;
        let half = for_outputs!(|c| {
            let numbers = for_outputs!(|r| if r < rows && c < columns {
                load::<S>(gradient, (first + r * width + c) * padded + at)
            } else {
                zero
            });
            spread(simd, numbers)
        });
        for_inputs!(|r| {
            let numbers = spread(simd, for_outputs!(|c| half[c][r]));
            for_inputs!(|c| {
                store::<S>(block, place + (r * INPUTS + c) * stride, numbers[c]);
            })
        });
    }
}

/// Adds to the gradient towards a layer's weight. `layer.weights` is not read.
///
/// # Shapes
/// - `gradient`: of the layer's output, (images, rows, columns, padded filters)
/// - `sum`: (9, channels, padded filters)
#[inline(always)]
pub(in crate::kernels) fn weight_gradient<S: Simd, const M: usize>(
    simd: S,
    layer: Layer<'_>,
    gradient: &[f32],
    sum: &mut [f32],
    scratch: &mut Scratch,
    pool: &Pool,
) {
    let (channels, padded) = (layer.channels, layer.padded);
    let grid = Grid::new(&layer);
    let tiles = grid.tiles * (gradient.len() / (grid.output.0 * grid.output.1 * padded));
    let (rows, vectors) = (Offsets::strided(channels, 1), padded / S::F32_LANES);
    let mut transformed: Block = pool.take(POSITIONS * channels * padded);
    for first in (0..tiles).step_by(TILES) {
        let count = (tiles - first).min(TILES);
        for place in 0..count {
            let tile = first + place;
            enter_tile(simd, &layer, grid, tile, place, &mut scratch.inputs);
            spread_tile(simd, padded, grid, tile, place, gradient, &mut scratch.outputs);
        }
        let terms = Offsets::strided(count, padded);
        let inputs = scratch.inputs.chunks_exact(position_stride(padded));
        let outputs = scratch.outputs.chunks_exact(position_stride(padded));
        let start = if first == 0 { Start::Zero } else { Start::Add };
        let targets = transformed.chunks_exact_mut(channels * padded);
        for ((inputs, numbers), target) in inputs.zip(outputs).zip(targets) {
            let columns = Columns { numbers, stride: padded, vectors };
            product::<S, M>(
                simd,
                inputs,
                &rows,
                &terms,
                columns,
                target,
                padded,
                start,
                Finish::Keep,
            );
        }
    }
    for channel in 0..channels {
        for at in (0..padded).step_by(S::F32_LANES) {
            let place = channel * padded + at;
            let number =
                |position: usize| load::<S>(&transformed, position * channels * padded + place);
            let half = for_inputs!(|c| contract(simd, for_inputs!(|r| number(r * INPUTS + c))));
            #[allow(clippy::needless_range_loop)] // `row` is the second index.
            for row in 0..KERNEL {
                let taps = contract(simd, for_inputs!(|c| half[c][row]));
                for (column, tap) in taps.into_iter().enumerate() {
                    let place = (row * KERNEL + column) * channels * padded + place;
                    store::<S>(sum, place, simd.add_f32s(load::<S>(sum, place), tap));
                }
            }
        }
    }
}
