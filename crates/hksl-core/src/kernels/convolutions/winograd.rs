//! A stride-1 layer by Winograd's F(4×4, 3×3): `Y = Aᵀ [(G w Gᵀ) ⊙ (Bᵀ d B)] A` for each tile of 4×4 outputs and
//! the 6×6 inputs `d` under it (Lavin & Gray, arXiv 1509.09308), and its exact gradient.
//!
//! The polynomials behind it are evaluated at 0, ±3/4, ±3/2 and ∞: all constants but those of the weights are
//! exact in binary, and three layers' outputs are off by some 6e-7 of the largest, where the usual points 0, ±1,
//! ±2, ∞ give 2e-6 and direct summation 2e-7 (measured on random maps of 32 channels).
//!
//! Tiles are taken in blocks. At each of the 36 positions of a transformed tile, the sum over channels is a
//! matrix product (tiles × channels) · (channels × filters).

use pulp::Simd;

use super::{Convolutions, TAPS};
use crate::kernels::product::{Columns, Finish, Start, product};
use crate::kernels::simd::{Offsets, load, store};

/// Tiles in a block.
const TILES: usize = 24;
/// Filters whose weights are transformed together.
const GROUP: usize = 16;
/// Rows and columns of a tile's outputs.
const OUTPUTS: usize = 4;
/// Rows and columns of a tile's inputs, and of its transform.
const INPUTS: usize = OUTPUTS + 2;
/// Positions of a transformed tile.
const POSITIONS: usize = INPUTS * INPUTS;

/// The two points beside 0 and ∞, each with both signs.
const P: f32 = 0.75;
const Q: f32 = 1.5;
const P2: f32 = P * P;
const Q2: f32 = Q * Q;

/// Multiplications for an output of this size, one channel to one filter.
pub(super) fn products(rows: usize, columns: usize) -> usize {
    rows.div_ceil(OUTPUTS) * columns.div_ceil(OUTPUTS) * POSITIONS
}

/// Transformed weights.
pub(super) struct Weights {
    /// (36, C, padded F)
    forward: Vec<f32>,
    /// (36, F, padded C)
    backward: Vec<f32>,
    filters: usize,
    padded: usize,
}

impl Weights {
    /// From a weight (F, F, 3, 3); what only the gradient needs is left out unless `with_gradient`.
    pub(super) fn new(weight: &[f32], filters: usize, padded: usize, with_gradient: bool) -> Self {
        let mut forward = vec![0f32; POSITIONS * filters * padded];
        let mut backward = vec![0f32; if with_gradient { forward.len() } else { 0 }];
        // A few filters at a time, so that each position's row of them is written as a whole.
        for channel in 0..filters {
            for first in (0..filters).step_by(GROUP) {
                let count = (filters - first).min(GROUP);
                let mut group = [[0f32; POSITIONS]; GROUP];
                for (index, transformed) in group.iter_mut().enumerate().take(count) {
                    let at = ((first + index) * filters + channel) * TAPS;
                    *transformed = transform_weight(&weight[at..at + TAPS]);
                }
                for position in 0..POSITIONS {
                    let at = (position * filters + channel) * padded + first;
                    for (number, transformed) in forward[at..at + count].iter_mut().zip(&group) {
                        *number = transformed[position];
                    }
                }
            }
        }
        if with_gradient {
            let matrices = backward.chunks_exact_mut(filters * padded);
            for (backward, forward) in matrices.zip(forward.chunks_exact(filters * padded)) {
                for (filter, row) in backward.chunks_exact_mut(padded).enumerate() {
                    for (channel, number) in row.iter_mut().take(filters).enumerate() {
                        *number = forward[channel * padded + filter];
                    }
                }
            }
        }
        Self { forward, backward, filters, padded }
    }

    /// How many numbers the transformed weight has.
    pub(super) fn numbers(&self) -> usize {
        self.forward.len()
    }
}

/// `1 / Π (p − p')` over the other finite points `p'`, for the points 0, ±P and ±Q.
const SCALES: [f32; 3] =
    [1.0 / (P2 * Q2), 1.0 / (2.0 * P2 * (P2 - Q2)), 1.0 / (2.0 * Q2 * (Q2 - P2))];

/// `G w` of one column or row.
fn expand([a, b, c]: [f32; 3]) -> [f32; INPUTS] {
    let [zero, p, q] = SCALES;
    let (even_p, odd_p) = (p * (a + P2 * c), p * P * b);
    let (even_q, odd_q) = (q * (a + Q2 * c), q * Q * b);
    [zero * a, even_p + odd_p, even_p - odd_p, even_q + odd_q, even_q - odd_q, c]
}

/// `Gᵀ u` of one column or row, the transpose of [`expand`].
fn reduce(u: [f32; INPUTS]) -> [f32; 3] {
    let [zero, p, q] = SCALES;
    let (even_p, odd_p) = (p * (u[1] + u[2]), p * P * (u[1] - u[2]));
    let (even_q, odd_q) = (q * (u[3] + u[4]), q * Q * (u[3] - u[4]));
    [zero * u[0] + even_p + even_q, odd_p + odd_q, P2 * even_p + Q2 * even_q + u[5]]
}

/// `G w Gᵀ`.
fn transform_weight(weight: &[f32]) -> [f32; POSITIONS] {
    let mut rows = [[0f32; 3]; INPUTS];
    for column in 0..3 {
        let expanded = expand([weight[column], weight[3 + column], weight[6 + column]]);
        for (row, number) in rows.iter_mut().zip(expanded) {
            row[column] = number;
        }
    }
    let mut transformed = [0f32; POSITIONS];
    for (target, row) in transformed.chunks_exact_mut(INPUTS).zip(rows) {
        target.copy_from_slice(&expand(row));
    }
    transformed
}

/// The gradient of the transform: (36, C, padded F) → (F, C, 3, 3), appended to `target`.
pub(super) fn unpack(packed: &[f32], filters: usize, padded: usize, target: &mut Vec<f32>) {
    for filter in 0..filters {
        for channel in 0..filters {
            let at = |position: usize| packed[(position * filters + channel) * padded + filter];
            let mut rows = [[0f32; INPUTS]; 3];
            for column in 0..INPUTS {
                let reduced = reduce(std::array::from_fn(|row| at(row * INPUTS + column)));
                for (row, number) in rows.iter_mut().zip(reduced) {
                    row[column] = number;
                }
            }
            target.extend(rows.into_iter().flat_map(reduce));
        }
    }
}

/// Room for one block of tiles.
pub(super) struct Scratch {
    /// Transformed inputs, (36, tiles, padded C).
    inputs: Vec<f32>,
    /// Transformed outputs or their gradients, (36, tiles, padded F).
    outputs: Vec<f32>,
    /// Gradients of transformed inputs, (36, tiles, padded C).
    gradients: Vec<f32>,
}

impl Scratch {
    pub(super) fn new(stack: &Convolutions) -> Self {
        let block = vec![0f32; POSITIONS * TILES * stack.padded()];
        Self { inputs: block.clone(), outputs: block.clone(), gradients: block }
    }
}

/// The tiles of a map: `size` is the input's, the output is two smaller.
#[derive(Clone, Copy)]
struct Grid {
    height: usize,
    width: usize,
    columns: usize,
    tiles: usize,
    padded: usize,
}

impl Grid {
    fn new((height, width): (usize, usize), padded: usize) -> Self {
        let columns = (width - 2).div_ceil(OUTPUTS);
        let tiles = (height - 2).div_ceil(OUTPUTS) * columns;
        Self { height, width, columns, tiles, padded }
    }

    /// Row and column of a tile's first input, and of its first output.
    fn corner(&self, tile: usize) -> (usize, usize) {
        (tile / self.columns * OUTPUTS, tile % self.columns * OUTPUTS)
    }

    /// How many of `side` rows and columns from `corner` on are on a map of `height` × `width`.
    fn present(
        side: usize,
        (row, column): (usize, usize),
        (height, width): (usize, usize),
    ) -> (usize, usize) {
        (side.min(height - row), side.min(width - column))
    }
}

/// Runs `$body` for each row `$r` and column `$c` below `$present`; where all are present, with constant bounds,
/// so that the loops unroll and the vectors stay in registers.
macro_rules! for_present {
    ($side:ident, $present:ident, |$r:ident, $c:ident| $body:block) => {
        if $present == ($side, $side) {
            for $r in 0..$side {
                for $c in 0..$side {
                    $body
                }
            }
        } else {
            for $r in 0..$present.0 {
                for $c in 0..$present.1 {
                    $body
                }
            }
        }
    };
}

/// `Bᵀ d` of one column or row.
#[inline(always)]
fn enter<S: Simd>(simd: S, d: [S::f32s; INPUTS]) -> [S::f32s; INPUTS] {
    let [p, p2, q, q2] = [P, P2, Q, Q2].map(|number| simd.splat_f32s(number));
    let (sum, product) = (simd.splat_f32s(P2 + Q2), simd.splat_f32s(P2 * Q2));
    let even_p = simd.negate_mul_add_e_f32s(q2, d[2], d[4]);
    let odd_p = simd.negate_mul_add_e_f32s(q2, d[1], d[3]);
    let even_q = simd.negate_mul_add_e_f32s(p2, d[2], d[4]);
    let odd_q = simd.negate_mul_add_e_f32s(p2, d[1], d[3]);
    [
        simd.mul_add_e_f32s(product, d[0], simd.negate_mul_add_e_f32s(sum, d[2], d[4])),
        simd.mul_add_e_f32s(p, odd_p, even_p),
        simd.negate_mul_add_e_f32s(p, odd_p, even_p),
        simd.mul_add_e_f32s(q, odd_q, even_q),
        simd.negate_mul_add_e_f32s(q, odd_q, even_q),
        simd.mul_add_e_f32s(product, d[1], simd.negate_mul_add_e_f32s(sum, d[3], d[5])),
    ]
}

/// `B v`, the transpose of [`enter`].
#[inline(always)]
fn leave<S: Simd>(simd: S, v: [S::f32s; INPUTS]) -> [S::f32s; INPUTS] {
    let [p, p2, q, q2] = [P, P2, Q, Q2].map(|number| simd.splat_f32s(number));
    let (sum, product) = (simd.splat_f32s(P2 + Q2), simd.splat_f32s(P2 * Q2));
    let (even_p, even_q) = (simd.add_f32s(v[1], v[2]), simd.add_f32s(v[3], v[4]));
    let odd_p = simd.mul_f32s(p, simd.sub_f32s(v[1], v[2]));
    let odd_q = simd.mul_f32s(q, simd.sub_f32s(v[3], v[4]));
    let (even, odd) = (simd.add_f32s(even_p, even_q), simd.add_f32s(odd_p, odd_q));
    let crossed = |by_q2, by_p2| simd.mul_add_e_f32s(q2, by_q2, simd.mul_f32s(p2, by_p2));
    [
        simd.mul_f32s(product, v[0]),
        simd.sub_f32s(simd.mul_f32s(product, v[5]), crossed(odd_p, odd_q)),
        simd.negate_mul_add_e_f32s(sum, v[0], simd.neg_f32s(crossed(even_p, even_q))),
        simd.negate_mul_add_e_f32s(sum, v[5], odd),
        simd.add_f32s(v[0], even),
        v[5],
    ]
}

/// `Aᵀ v`.
#[inline(always)]
fn gather<S: Simd>(simd: S, v: [S::f32s; INPUTS]) -> [S::f32s; OUTPUTS] {
    let [p, p2, q, q2] = [P, P2, Q, Q2].map(|number| simd.splat_f32s(number));
    let (even_p, even_q) = (simd.add_f32s(v[1], v[2]), simd.add_f32s(v[3], v[4]));
    let odd_p = simd.mul_f32s(p, simd.sub_f32s(v[1], v[2]));
    let odd_q = simd.mul_f32s(q, simd.sub_f32s(v[3], v[4]));
    [
        simd.add_f32s(v[0], simd.add_f32s(even_p, even_q)),
        simd.add_f32s(odd_p, odd_q),
        simd.mul_add_e_f32s(p2, even_p, simd.mul_f32s(q2, even_q)),
        simd.mul_add_e_f32s(p2, odd_p, simd.mul_add_e_f32s(q2, odd_q, v[5])),
    ]
}

/// `A y`, the transpose of [`gather`].
#[inline(always)]
fn spread<S: Simd>(simd: S, y: [S::f32s; OUTPUTS]) -> [S::f32s; INPUTS] {
    let [p, p2, q, q2] = [P, P2, Q, Q2].map(|number| simd.splat_f32s(number));
    let even_p = simd.mul_add_e_f32s(p2, y[2], y[0]);
    let odd_p = simd.mul_f32s(p, simd.mul_add_e_f32s(p2, y[3], y[1]));
    let even_q = simd.mul_add_e_f32s(q2, y[2], y[0]);
    let odd_q = simd.mul_f32s(q, simd.mul_add_e_f32s(q2, y[3], y[1]));
    [
        y[0],
        simd.add_f32s(even_p, odd_p),
        simd.sub_f32s(even_p, odd_p),
        simd.add_f32s(even_q, odd_q),
        simd.sub_f32s(even_q, odd_q),
        y[3],
    ]
}

/// A map applied to every column of a tile, then to every row: `T X Tᵀ`.
macro_rules! on_both_sides {
    ($simd:ident, $tile:expr, $map:ident, $from:ident, $to:ident) => {{
        let tile: [[S::f32s; $from]; $from] = $tile;
        let mut columns = [[$simd.splat_f32s(0.0); $from]; $to];
        for column in 0..$from {
            let mut numbers = [$simd.splat_f32s(0.0); $from];
            for (number, row) in numbers.iter_mut().zip(&tile) {
                *number = row[column];
            }
            for (row, number) in columns.iter_mut().zip($map($simd, numbers)) {
                row[column] = number;
            }
        }
        let mut rows = [[$simd.splat_f32s(0.0); $to]; $to];
        for (row, column) in rows.iter_mut().zip(columns) {
            *row = $map($simd, column);
        }
        rows
    }};
}

/// Transforms the inputs of tile `tile` into place `place` of a block.
#[inline(always)]
fn enter_tile<S: Simd>(
    simd: S,
    grid: Grid,
    tile: usize,
    place: usize,
    input: &[f32],
    block: &mut [f32],
) {
    let (row, column) = grid.corner(tile);
    let present = Grid::present(INPUTS, (row, column), (grid.height, grid.width));
    for at in (0..grid.padded).step_by(S::F32_LANES) {
        let mut numbers = [[simd.splat_f32s(0.0); INPUTS]; INPUTS];
        for_present!(INPUTS, present, |r, c| {
            let pixel = (row + r) * grid.width + column + c;
            numbers[r][c] = load::<S>(input, pixel * grid.padded + at);
        });
        let numbers = on_both_sides!(simd, numbers, enter, INPUTS, INPUTS);
        for (position, number) in numbers.into_iter().flatten().enumerate() {
            store::<S>(block, (position * TILES + place) * grid.padded + at, number);
        }
    }
}

/// Adds the gradients at place `place` of a block to those of the inputs of tile `tile`.
#[inline(always)]
fn leave_tile<S: Simd>(
    simd: S,
    grid: Grid,
    tile: usize,
    place: usize,
    block: &[f32],
    gradient: &mut [f32],
) {
    let (row, column) = grid.corner(tile);
    let present = Grid::present(INPUTS, (row, column), (grid.height, grid.width));
    for at in (0..grid.padded).step_by(S::F32_LANES) {
        let mut numbers = [[simd.splat_f32s(0.0); INPUTS]; INPUTS];
        for (position, number) in numbers.iter_mut().flatten().enumerate() {
            *number = load::<S>(block, (position * TILES + place) * grid.padded + at);
        }
        let numbers = on_both_sides!(simd, numbers, leave, INPUTS, INPUTS);
        for_present!(INPUTS, present, |r, c| {
            let place = ((row + r) * grid.width + column + c) * grid.padded + at;
            let sum = simd.add_f32s(load::<S>(gradient, place), numbers[r][c]);
            store::<S>(gradient, place, sum);
        });
    }
}

/// Transforms place `place` of a block into the outputs of tile `tile`, with bias and ReLU.
#[inline(always)]
fn gather_tile<S: Simd>(
    simd: S,
    grid: Grid,
    tile: usize,
    place: usize,
    block: &[f32],
    bias: &[f32],
    output: &mut [f32],
) {
    let (row, column) = grid.corner(tile);
    let (height, width) = (grid.height - 2, grid.width - 2);
    let present = Grid::present(OUTPUTS, (row, column), (height, width));
    let zero = simd.splat_f32s(0.0);
    for at in (0..grid.padded).step_by(S::F32_LANES) {
        let bias = load::<S>(bias, at);
        let mut numbers = [[zero; INPUTS]; INPUTS];
        for (position, number) in numbers.iter_mut().flatten().enumerate() {
            *number = load::<S>(block, (position * TILES + place) * grid.padded + at);
        }
        let sums = on_both_sides!(simd, numbers, gather, INPUTS, OUTPUTS);
        for_present!(OUTPUTS, present, |r, c| {
            let place = ((row + r) * width + column + c) * grid.padded + at;
            store::<S>(output, place, simd.max_f32s(simd.add_f32s(sums[r][c], bias), zero));
        });
    }
}

/// Transforms the gradients of the outputs of tile `tile` into place `place` of a block.
#[inline(always)]
fn spread_tile<S: Simd>(
    simd: S,
    grid: Grid,
    tile: usize,
    place: usize,
    gradient: &[f32],
    block: &mut [f32],
) {
    let (row, column) = grid.corner(tile);
    let (height, width) = (grid.height - 2, grid.width - 2);
    let present = Grid::present(OUTPUTS, (row, column), (height, width));
    let zero = simd.splat_f32s(0.0);
    for at in (0..grid.padded).step_by(S::F32_LANES) {
        let mut numbers = [[zero; OUTPUTS]; OUTPUTS];
        for_present!(OUTPUTS, present, |r, c| {
            let pixel = (row + r) * width + column + c;
            numbers[r][c] = load::<S>(gradient, pixel * grid.padded + at);
        });
        let numbers = on_both_sides!(simd, numbers, spread, OUTPUTS, INPUTS);
        for (position, number) in numbers.into_iter().flatten().enumerate() {
            store::<S>(block, (position * TILES + place) * grid.padded + at, number);
        }
    }
}

/// A range of one position's numbers in a block.
fn position(position: usize, padded: usize) -> std::ops::Range<usize> {
    position * TILES * padded..(position + 1) * TILES * padded
}

/// The layer's output; `size` is the input's.
#[inline(always)]
pub(super) fn forward<S: Simd, const M: usize>(
    simd: S,
    size: (usize, usize),
    input: &[f32],
    weights: &Weights,
    bias: &[f32],
    output: &mut [f32],
    scratch: &mut Scratch,
) {
    let (filters, padded) = (weights.filters, weights.padded);
    let grid = Grid::new(size, padded);
    let channels = Offsets::strided(filters, 1);
    let vectors = padded / S::F32_LANES;
    for first in (0..grid.tiles).step_by(TILES) {
        let count = (grid.tiles - first).min(TILES);
        for place in 0..count {
            enter_tile(simd, grid, first + place, place, input, &mut scratch.inputs);
        }
        let rows = Offsets::strided(count, padded);
        for p in 0..POSITIONS {
            let part = p * filters * padded..(p + 1) * filters * padded;
            let columns = Columns { numbers: &weights.forward[part], stride: padded, vectors };
            let (inputs, outputs) = (&scratch.inputs, &mut scratch.outputs);
            let (inputs, outputs) =
                (&inputs[position(p, padded)], &mut outputs[position(p, padded)]);
            let (start, finish) = (Start::Zero, Finish::Keep);
            product::<S, M>(
                simd, inputs, &rows, &channels, columns, outputs, padded, start, finish,
            );
        }
        for place in 0..count {
            gather_tile(simd, grid, first + place, place, &scratch.outputs, bias, output);
        }
    }
}

/// Adds to the gradients of weight (transformed) and bias; `below` becomes the gradient towards the input,
/// where the input, a ReLU's output, is positive.
///
/// `gradient` is the one towards the output before its ReLU.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // The operands of one formula and where they go.
pub(super) fn gradient<S: Simd, const M: usize>(
    simd: S,
    size: (usize, usize),
    input: &[f32],
    weights: &Weights,
    gradient: &[f32],
    below: &mut [f32],
    weight_sum: &mut [f32],
    bias_sum: &mut [f32],
    scratch: &mut Scratch,
) {
    let (filters, padded) = (weights.filters, weights.padded);
    let grid = Grid::new(size, padded);
    let vectors = padded / S::F32_LANES;
    let channels = Offsets::strided(filters, 1);
    below.fill(0.0);
    for first in (0..grid.tiles).step_by(TILES) {
        let count = (grid.tiles - first).min(TILES);
        for place in 0..count {
            enter_tile(simd, grid, first + place, place, input, &mut scratch.inputs);
            spread_tile(simd, grid, first + place, place, gradient, &mut scratch.outputs);
        }
        let tiles = Offsets::strided(count, padded);
        for p in 0..POSITIONS {
            let part = p * filters * padded..(p + 1) * filters * padded;
            let inputs = &scratch.inputs[position(p, padded)];
            let outputs = &scratch.outputs[position(p, padded)];
            let gradients = &mut scratch.gradients[position(p, padded)];
            let columns = Columns { numbers: outputs, stride: padded, vectors };
            let sums = &mut weight_sum[part.clone()];
            let (add, keep) = (Start::Add, Finish::Keep);
            product::<S, M>(simd, inputs, &channels, &tiles, columns, sums, padded, add, keep);
            let columns = Columns { numbers: &weights.backward[part], stride: padded, vectors };
            let start = Start::Zero;
            product::<S, M>(
                simd, outputs, &tiles, &channels, columns, gradients, padded, start, keep,
            );
        }
        for place in 0..count {
            leave_tile(simd, grid, first + place, place, &scratch.gradients, below);
        }
    }
    super::direct::sum_pixels(simd, gradient, bias_sum);
    let zero = simd.splat_f32s(0.0);
    for at in (0..below.len()).step_by(S::F32_LANES) {
        let positive = simd.greater_than_f32s(load::<S>(input, at), zero);
        store::<S>(below, at, simd.select_f32s(positive, load::<S>(below, at), zero));
    }
}
