//! A stride-1 layer by Winograd's F(4×4, 3×3): `Y = Aᵀ [(G w Gᵀ) ⊙ (Bᵀ d B)] A` for each tile of 4×4 outputs and
//! the 6×6 inputs `d` under it (Lavin & Gray, arXiv 1509.09308), in 36 multiplications instead of 144.
//!
//! The polynomials behind it are evaluated at 0, ±3/4, ±3/2 and ∞: all constants but those of the weights are
//! exact in binary, and three layers' outputs are off by some 6e-7 of the largest, where the usual points 0, ±1,
//! ±2, ∞ give 2e-6 and direct summation 2e-7 (measured on random maps of 32 channels).
//!
//! Tiles of all images are taken in blocks. At each of the 36 positions of a transformed tile, the sum over
//! channels is a matrix product (tiles × channels) · (channels × filters).
//!
//! The gradient towards a layer's input is such a layer too: of the output's gradient with a border of two
//! zeros, by the turned weight. For the gradient towards the weight see [`weight_gradient`].

/// `[f(0), …, f(5)]`, written out: loops over arrays of vectors are not unrolled and go through memory, and vector
/// instructions in a closure are not inlined.
macro_rules! for_inputs {
    (|$index:ident| $value:expr) => { for_each!($index, $value, 0 1 2 3 4 5) };
}

/// `[f(0), …, f(3)]`, likewise.
macro_rules! for_outputs {
    (|$index:ident| $value:expr) => { for_each!($index, $value, 0 1 2 3) };
}

macro_rules! for_each {
    ($index:ident, $value:expr, $($number:literal)*) => {
        [$({
            let $index: usize = $number;
            $value
        }),*]
    };
}

mod gradient;
mod paired;

use pulp::Simd;

pub(in crate::kernels) use gradient::weight_gradient;
pub(in crate::kernels) use paired::Paired;

use super::TAPS;
use crate::kernels::memory::{Block, Pool};
use crate::kernels::product::{Columns, Finish, Start, product};
use crate::kernels::simd::{Offsets, load, store};

/// Tiles in a block.
const TILES: usize = 48;
/// Numbers between the positions of a block, a cache line: so that a tile's positions lie in different sets of
/// the first-level cache.
const GAP: usize = 16;
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
pub(in crate::kernels) fn products(rows: usize, columns: usize) -> usize {
    rows.div_ceil(OUTPUTS) * columns.div_ceil(OUTPUTS) * POSITIONS
}

/// `G w Gᵀ` for all pairs of channels: `tap(from, to, tap)` is the weight of a tap from one channel to another,
/// of `channels` on each side; the result is (36, from, padded to).
pub(in crate::kernels) fn transform(
    channels: usize,
    padded: usize,
    tap: impl Fn(usize, usize, usize) -> f32,
) -> Vec<f32> {
    let mut transformed = vec![0f32; POSITIONS * channels * padded];
    for from in 0..channels {
        for first in (0..channels).step_by(GROUP) {
            let count = (channels - first).min(GROUP);
            let mut weights = [[0f64; GROUP]; TAPS];
            for (index, weights) in weights.iter_mut().enumerate() {
                for (to, weight) in weights.iter_mut().enumerate().take(count) {
                    *weight = tap(from, first + to, index).into();
                }
            }
            let [a, b, c, d, e, f, g, h, i] = weights;
            let columns = [expand([a, d, g]), expand([b, e, h]), expand([c, f, i])];
            let [a, b, c] = columns;
            for (row, ((a, b), c)) in a.into_iter().zip(b).zip(c).enumerate() {
                let expanded = expand([a, b, c]);
                for (column, numbers) in expanded.iter().enumerate() {
                    let at = ((row * INPUTS + column) * channels + from) * padded + first;
                    for (target, number) in transformed[at..at + count].iter_mut().zip(numbers) {
                        *target = *number as f32;
                    }
                }
            }
        }
    }
    transformed
}

/// `G w` of one column or row, for a group of filters at once; in f64, for what is rounded here is in every
/// output.
fn expand([a, b, c]: [[f64; GROUP]; 3]) -> [[f64; GROUP]; INPUTS] {
    let [p1, p2, q1, q2] = [P, P2, Q, Q2].map(f64::from);
    // 1 / Π (p − p') over the other finite points p', for the points 0, ±P and ±Q.
    let zero = 1.0 / (p2 * q2);
    let (p, q) = (1.0 / (2.0 * p2 * (p2 - q2)), 1.0 / (2.0 * q2 * (q2 - p2)));
    let mut expanded = [[0f64; GROUP]; INPUTS];
    for n in 0..GROUP {
        let (even_p, odd_p) = (p * (a[n] + p2 * c[n]), p * p1 * b[n]);
        let (even_q, odd_q) = (q * (a[n] + q2 * c[n]), q * q1 * b[n]);
        expanded[0][n] = zero * a[n];
        expanded[1][n] = even_p + odd_p;
        expanded[2][n] = even_p - odd_p;
        expanded[3][n] = even_q + odd_q;
        expanded[4][n] = even_q - odd_q;
        expanded[5][n] = c[n];
    }
    expanded
}

/// Numbers from one position of a block to the next.
fn position_stride(padded: usize) -> usize {
    TILES * padded + GAP
}

/// Room for one block of tiles, each (36, tiles, padded channels).
pub(in crate::kernels) struct Scratch {
    inputs: Block,
    outputs: Block,
}

impl Scratch {
    pub(in crate::kernels) fn new(pool: &Pool, padded: usize) -> Self {
        let block = || pool.take(POSITIONS * position_stride(padded));
        Self { inputs: block(), outputs: block() }
    }
}

/// A layer on some images' maps: what goes in, (images, rows, columns, padded channels).
#[derive(Clone, Copy)]
pub(in crate::kernels) struct Layer<'a> {
    pub(in crate::kernels) input: &'a [f32],
    /// Rows and columns.
    pub(in crate::kernels) size: (usize, usize),
    /// Rows and columns of zeros to add on each side.
    pub(in crate::kernels) border: usize,
    /// From [`transform`].
    pub(in crate::kernels) weights: &'a [f32],
    pub(in crate::kernels) channels: usize,
    pub(in crate::kernels) padded: usize,
}

/// What becomes of a layer's sums.
#[derive(Clone, Copy)]
pub(in crate::kernels) enum Outcome<'a> {
    /// `max(sum + bias, 0)`, a bias for each filter.
    Relu(&'a [f32]),
    /// `sum + bias`.
    Plain(&'a [f32]),
    /// The sum where this map, of the output's size, is positive; 0 elsewhere.
    Where(&'a [f32]),
}

impl Outcome<'_> {
    /// Of one vector of sums, at `place` of the output.
    #[inline(always)]
    fn of<S: Simd>(&self, simd: S, sum: S::f32s, bias: S::f32s, place: usize) -> S::f32s {
        let zero = simd.splat_f32s(0.0);
        match self {
            Self::Relu(_) => simd.max_f32s(simd.add_f32s(sum, bias), zero),
            Self::Plain(_) => simd.add_f32s(sum, bias),
            Self::Where(map) => {
                let positive = simd.greater_than_f32s(load::<S>(map, place), zero);
                simd.select_f32s(positive, sum, zero)
            }
        }
    }
}

/// The tiles of a layer.
#[derive(Clone, Copy)]
struct Grid {
    input: (usize, usize),
    output: (usize, usize),
    border: usize,
    columns: usize,
    /// In one image.
    tiles: usize,
}

impl Grid {
    fn new(layer: &Layer<'_>) -> Self {
        let output = (layer.size.0 + 2 * layer.border - 2, layer.size.1 + 2 * layer.border - 2);
        let columns = output.1.div_ceil(OUTPUTS);
        let tiles = output.0.div_ceil(OUTPUTS) * columns;
        Self { input: layer.size, output, border: layer.border, columns, tiles }
    }

    /// A tile's image, and row and column of its first output.
    fn place(&self, tile: usize) -> (usize, usize, usize) {
        let (image, tile) = (tile / self.tiles, tile % self.tiles);
        (image, tile / self.columns * OUTPUTS, tile % self.columns * OUTPUTS)
    }
}

/// Those of `side` rows or columns from `start` on that lie within `length`, where `border` comes before the 0th.
fn present(side: usize, start: usize, border: usize, length: usize) -> std::ops::Range<usize> {
    border.saturating_sub(start)..side.min((length + border).saturating_sub(start))
}

/// `Bᵀ d` of one column or row.
#[inline(always)]
fn enter<S: Simd>(simd: S, d: [S::f32s; INPUTS]) -> [S::f32s; INPUTS] {
    let (p, p2) = (simd.splat_f32s(P), simd.splat_f32s(P2));
    let (q, q2) = (simd.splat_f32s(Q), simd.splat_f32s(Q2));
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

/// `Aᵀ v`.
#[inline(always)]
fn gather<S: Simd>(simd: S, v: [S::f32s; INPUTS]) -> [S::f32s; OUTPUTS] {
    let (p, p2) = (simd.splat_f32s(P), simd.splat_f32s(P2));
    let (q, q2) = (simd.splat_f32s(Q), simd.splat_f32s(Q2));
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

/// Transforms the inputs of tile `tile` into place `place` of a block.
#[inline(always)]
fn enter_tile<S: Simd>(
    simd: S,
    layer: &Layer<'_>,
    grid: Grid,
    tile: usize,
    place: usize,
    block: &mut [f32],
) {
    let (image, row, column) = grid.place(tile);
    let (height, width) = grid.input;
    let rows = present(INPUTS, row, grid.border, height);
    let columns = present(INPUTS, column, grid.border, width);
    let whole = rows.len() == INPUTS && columns.len() == INPUTS;
    let first = (image * height + row) * width + column;
    let stride = position_stride(layer.padded);
    let skipped = grid.border * (width + 1) * layer.padded;
    let zero = simd.splat_f32s(0.0);
    for at in (0..layer.padded).step_by(S::F32_LANES) {
        let (pixels, place) = (first * layer.padded + at, place * layer.padded + at);
        let half = for_inputs!(|c| {
            let numbers = if whole {
                for_inputs!(|r| {
                    load::<S>(layer.input, pixels + (r * width + c) * layer.padded - skipped)
                })
            } else if columns.contains(&c) {
                for_inputs!(|r| {
                    if rows.contains(&r) {
                        load::<S>(layer.input, pixels + (r * width + c) * layer.padded - skipped)
                    } else {
                        zero
                    }
                })
            } else {
                [zero; INPUTS]
            };
            enter(simd, numbers)
        });
        for_inputs!(|r| {
            let numbers = enter(simd, for_inputs!(|c| half[c][r]));
            for_inputs!(|c| {
                store::<S>(block, place + (r * INPUTS + c) * stride, numbers[c]);
            })
        });
    }
}

/// Transforms place `place` of a block into the outputs of tile `tile`.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // The operands of one formula and where they lie.
fn gather_tile<S: Simd>(
    simd: S,
    layer: &Layer<'_>,
    grid: Grid,
    tile: usize,
    place: usize,
    block: &[f32],
    outcome: Outcome<'_>,
    output: &mut [f32],
) {
    let (image, row, column) = grid.place(tile);
    let (height, width) = grid.output;
    let rows = OUTPUTS.min(height - row);
    let columns = OUTPUTS.min(width - column);
    let first = (image * height + row) * width + column;
    let stride = position_stride(layer.padded);
    for at in (0..layer.padded).step_by(S::F32_LANES) {
        let place = place * layer.padded + at;
        let half = for_inputs!(|c| gather(
            simd,
            for_inputs!(|r| load::<S>(block, place + (r * INPUTS + c) * stride))
        ));
        let bias = match outcome {
            Outcome::Relu(bias) | Outcome::Plain(bias) => load::<S>(bias, at),
            Outcome::Where(_) => simd.splat_f32s(0.0),
        };
        #[allow(clippy::needless_range_loop)] // `r` is the second index.
        for r in 0..rows {
            let sums = gather(simd, for_inputs!(|c| half[c][r]));
            for (c, sum) in sums.iter().enumerate().take(columns) {
                let place = (first + r * width + c) * layer.padded + at;
                store::<S>(output, place, outcome.of(simd, *sum, bias, place));
            }
        }
    }
}

/// Runs a layer: `output` is (images, rows, columns, padded filters), each side `2·border − 2` longer than the
/// input's.
#[inline(always)]
pub(in crate::kernels) fn layer<S: Simd, const M: usize>(
    simd: S,
    layer: Layer<'_>,
    outcome: Outcome<'_>,
    output: &mut [f32],
    scratch: &mut Scratch,
) {
    let (channels, padded) = (layer.channels, layer.padded);
    let grid = Grid::new(&layer);
    let tiles = grid.tiles * (output.len() / (grid.output.0 * grid.output.1 * padded));
    let terms = Offsets::strided(channels, 1);
    let vectors = padded / S::F32_LANES;
    for first in (0..tiles).step_by(TILES) {
        let count = (tiles - first).min(TILES);
        for place in 0..count {
            enter_tile(simd, &layer, grid, first + place, place, &mut scratch.inputs);
        }
        let rows = Offsets::strided(count, padded);
        let inputs = scratch.inputs.chunks_exact(position_stride(padded));
        let outputs = scratch.outputs.chunks_exact_mut(position_stride(padded));
        let weights = layer.weights.chunks_exact(channels * padded);
        for ((inputs, outputs), numbers) in inputs.zip(outputs).zip(weights) {
            let columns = Columns { numbers, stride: padded, vectors };
            let (start, keep) = (Start::Zero, Finish::Keep);
            product::<S, M>(simd, inputs, &rows, &terms, columns, outputs, padded, start, keep);
        }
        for place in 0..count {
            let (tile, block) = (first + place, &scratch.outputs);
            gather_tile(simd, &layer, grid, tile, place, block, outcome, output);
        }
    }
}
