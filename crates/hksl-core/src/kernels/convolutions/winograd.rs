//! A stride-1 layer by Winograd's F(2×2, 3×3): `Y = Aᵀ [(G w Gᵀ) ⊙ (Bᵀ d B)] A` for each tile of 2×2 outputs and
//! the 4×4 inputs `d` under it (Lavin & Gray, arXiv 1509.09308, section 4.1), and its exact gradient.
//!
//! Tiles are taken in blocks. At each of the 16 positions of a transformed tile, the sum over channels is a
//! matrix product (tiles × channels) · (channels × filters).

use pulp::Simd;

use super::{Convolutions, TAPS};
use crate::kernels::product::{Columns, Finish, Start, product};
use crate::kernels::simd::{Offsets, load, store};

/// Tiles in a block.
const TILES: usize = 24;
/// Filters whose weights are transformed together.
const GROUP: usize = 16;
/// Positions of a transformed tile.
const POSITIONS: usize = 16;

/// Multiplications for an output of this size, one channel to one filter.
pub(super) fn products(rows: usize, columns: usize) -> usize {
    rows.div_ceil(2) * columns.div_ceil(2) * POSITIONS
}

/// Transformed weights.
pub(super) struct Weights {
    /// (16, C, padded F)
    forward: Vec<f32>,
    /// (16, F, padded C)
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

/// `G w Gᵀ`.
fn transform_weight(weight: &[f32]) -> [f32; POSITIONS] {
    let expand = |a: f32, b: f32, c: f32| [a, 0.5 * (a + b + c), 0.5 * (a - b + c), c];
    let mut rows = [[0f32; 3]; 4];
    for column in 0..3 {
        let expanded = expand(weight[column], weight[3 + column], weight[6 + column]);
        for (row, number) in rows.iter_mut().zip(expanded) {
            row[column] = number;
        }
    }
    let mut transformed = [0f32; POSITIONS];
    for (target, [a, b, c]) in transformed.chunks_exact_mut(4).zip(rows) {
        target.copy_from_slice(&expand(a, b, c));
    }
    transformed
}

/// The gradient of the transform: (16, C, padded F) → (F, C, 3, 3), appended to `target`.
pub(super) fn unpack(packed: &[f32], filters: usize, padded: usize, target: &mut Vec<f32>) {
    let reduce = |u: [f32; 4]| {
        let (sum, difference) = (0.5 * (u[1] + u[2]), 0.5 * (u[1] - u[2]));
        [u[0] + sum, difference, sum + u[3]]
    };
    for filter in 0..filters {
        for channel in 0..filters {
            let at = |position: usize| packed[(position * filters + channel) * padded + filter];
            let mut rows = [[0f32; 4]; 3];
            for column in 0..4 {
                let reduced = reduce([at(column), at(4 + column), at(8 + column), at(12 + column)]);
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
    /// Transformed inputs, (16, tiles, padded C).
    inputs: Vec<f32>,
    /// Transformed outputs or their gradients, (16, tiles, padded F).
    outputs: Vec<f32>,
    /// Gradients of transformed inputs, (16, tiles, padded C).
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
        let columns = (width - 2).div_ceil(2);
        Self { height, width, columns, tiles: (height - 2).div_ceil(2) * columns, padded }
    }

    /// Row and column of a tile's first input, and of its first output.
    fn corner(&self, tile: usize) -> (usize, usize) {
        (tile / self.columns * 2, tile % self.columns * 2)
    }

    /// Whether all 4×4 inputs of a tile exist.
    fn is_whole(&self, (row, column): (usize, usize)) -> bool {
        row + 4 <= self.height && column + 4 <= self.width
    }
}

type Tile<V> = [[V; 4]; 4];

/// `Bᵀ d` of one column or row.
#[inline(always)]
fn enter<S: Simd>(simd: S, d: [S::f32s; 4]) -> [S::f32s; 4] {
    [
        simd.sub_f32s(d[0], d[2]),
        simd.add_f32s(d[1], d[2]),
        simd.sub_f32s(d[2], d[1]),
        simd.sub_f32s(d[1], d[3]),
    ]
}

/// `B v`, the transpose of [`enter`].
#[inline(always)]
fn leave<S: Simd>(simd: S, v: [S::f32s; 4]) -> [S::f32s; 4] {
    [
        v[0],
        simd.add_f32s(simd.sub_f32s(v[1], v[2]), v[3]),
        simd.sub_f32s(simd.add_f32s(v[1], v[2]), v[0]),
        simd.neg_f32s(v[3]),
    ]
}

/// `Aᵀ v`.
#[inline(always)]
fn gather<S: Simd>(simd: S, v: [S::f32s; 4]) -> [S::f32s; 2] {
    [simd.add_f32s(simd.add_f32s(v[0], v[1]), v[2]), simd.sub_f32s(simd.sub_f32s(v[1], v[2]), v[3])]
}

/// `A y`, the transpose of [`gather`].
#[inline(always)]
fn spread<S: Simd>(simd: S, y: [S::f32s; 2]) -> [S::f32s; 4] {
    [y[0], simd.add_f32s(y[0], y[1]), simd.sub_f32s(y[0], y[1]), simd.neg_f32s(y[1])]
}

/// A map applied to every column, then to every row.
#[inline(always)]
fn on_both_sides<V: Copy>(tile: Tile<V>, map: impl Fn([V; 4]) -> [V; 4]) -> Tile<V> {
    let mut columns = tile;
    for column in 0..4 {
        let mapped = map([tile[0][column], tile[1][column], tile[2][column], tile[3][column]]);
        for (row, number) in columns.iter_mut().zip(mapped) {
            row[column] = number;
        }
    }
    [map(columns[0]), map(columns[1]), map(columns[2]), map(columns[3])]
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
    let whole = grid.is_whole((row, column));
    for at in (0..grid.padded).step_by(S::F32_LANES) {
        let mut numbers = [[simd.splat_f32s(0.0); 4]; 4];
        for (r, numbers) in numbers.iter_mut().enumerate() {
            for (c, number) in numbers.iter_mut().enumerate() {
                if whole || (row + r < grid.height && column + c < grid.width) {
                    let pixel = (row + r) * grid.width + column + c;
                    *number = load::<S>(input, pixel * grid.padded + at);
                }
            }
        }
        let numbers = on_both_sides(
            numbers,
            #[inline(always)]
            |d| enter(simd, d),
        );
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
    let whole = grid.is_whole((row, column));
    for at in (0..grid.padded).step_by(S::F32_LANES) {
        let mut numbers = [[simd.splat_f32s(0.0); 4]; 4];
        for (position, number) in numbers.iter_mut().flatten().enumerate() {
            *number = load::<S>(block, (position * TILES + place) * grid.padded + at);
        }
        let numbers = on_both_sides(
            numbers,
            #[inline(always)]
            |v| leave(simd, v),
        );
        for (r, numbers) in numbers.into_iter().enumerate() {
            for (c, number) in numbers.into_iter().enumerate() {
                if whole || (row + r < grid.height && column + c < grid.width) {
                    let place = ((row + r) * grid.width + column + c) * grid.padded + at;
                    let sum = simd.add_f32s(load::<S>(gradient, place), number);
                    store::<S>(gradient, place, sum);
                }
            }
        }
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
    let zero = simd.splat_f32s(0.0);
    for at in (0..grid.padded).step_by(S::F32_LANES) {
        let bias = load::<S>(bias, at);
        let mut rows = [[zero; 2]; 4];
        for (r, row) in rows.iter_mut().enumerate() {
            let mut numbers = [zero; 4];
            for (c, number) in numbers.iter_mut().enumerate() {
                *number = load::<S>(block, ((4 * r + c) * TILES + place) * grid.padded + at);
            }
            *row = gather(simd, numbers);
        }
        for c in 0..2 {
            let sums = gather(simd, [rows[0][c], rows[1][c], rows[2][c], rows[3][c]]);
            for (r, sum) in sums.into_iter().enumerate() {
                if row + r < height && column + c < width {
                    let place = ((row + r) * width + column + c) * grid.padded + at;
                    store::<S>(output, place, simd.max_f32s(simd.add_f32s(sum, bias), zero));
                }
            }
        }
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
    let zero = simd.splat_f32s(0.0);
    for at in (0..grid.padded).step_by(S::F32_LANES) {
        let mut columns = [[zero; 2]; 4];
        for c in 0..2 {
            let mut numbers = [zero; 2];
            for (r, number) in numbers.iter_mut().enumerate() {
                if row + r < height && column + c < width {
                    let pixel = (row + r) * width + column + c;
                    *number = load::<S>(gradient, pixel * grid.padded + at);
                }
            }
            for (columns, number) in columns.iter_mut().zip(spread(simd, numbers)) {
                columns[c] = number;
            }
        }
        for (r, numbers) in columns.into_iter().enumerate() {
            for (c, number) in spread(simd, numbers).into_iter().enumerate() {
                store::<S>(block, ((4 * r + c) * TILES + place) * grid.padded + at, number);
            }
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
        // The middle of a spread tile is the sum of its outputs' gradients.
        let middle = &scratch.outputs[position(5, padded)];
        for at in (0..padded).step_by(S::F32_LANES) {
            let mut sum = load::<S>(bias_sum, at);
            for place in 0..count {
                sum = simd.add_f32s(sum, load::<S>(middle, place * padded + at));
            }
            store::<S>(bias_sum, at, sum);
        }
        for place in 0..count {
            leave_tile(simd, grid, first + place, place, &scratch.gradients, below);
        }
    }
    let zero = simd.splat_f32s(0.0);
    for at in (0..below.len()).step_by(S::F32_LANES) {
        let positive = simd.greater_than_f32s(load::<S>(input, at), zero);
        store::<S>(below, at, simd.select_f32s(positive, load::<S>(below, at), zero));
    }
}
