//! Convolutions with vector instructions, a few images at a time.

use pulp::{Simd, WithSimd};

use super::MapConvolution;
use crate::kernels::convolutions::winograd::{self, Layer, Outcome, Scratch};
use crate::kernels::product::{Columns, Finish, Start, product};
use crate::kernels::simd::Offsets;
use crate::kernels::{Kernels, Pool};

/// Output positions that the weight gradient processes at a time, so that they and their inputs stay in the cache.
const POINTS: usize = 96;

/// Runs `$task.run::<S, M>` with the number of rows per block that fits the registers.
macro_rules! with_rows {
    ($task:expr, $simd:expr) => {
        if S::F32_LANES == 8 { $task.run::<S, 6>($simd) } else { $task.run::<S, 8>($simd) }
    };
}

/// Weight and bias, packed in the order in which products read them and padded to whole vectors.
pub(super) struct Packed {
    /// One packed weight per phase; a single one for convolutions.
    phases: Vec<Vec<f32>>,
    bias: Vec<f32>,
}

impl Packed {
    /// For [`Forward`]: (taps · C, padded F).
    pub(super) fn forward(shape: &MapConvolution, weight: &[f32], bias: Option<&[f32]>) -> Self {
        let padded = padded(shape.kernels, shape.filters);
        let (taps, channels) = (shape.taps(), shape.channels);
        if shape.by_winograd() {
            let tap =
                |from: usize, to: usize, tap: usize| weight[(to * channels + from) * taps + tap];
            let transformed = winograd::transform(channels, padded, tap);
            return Self { phases: vec![transformed], bias: padded_bias(bias, padded) };
        }
        let mut packed = vec![0f32; taps * channels * padded];
        for filter in 0..shape.filters {
            for channel in 0..channels {
                for tap in 0..taps {
                    packed[(tap * channels + channel) * padded + filter] =
                        weight[(filter * channels + channel) * taps + tap];
                }
            }
        }
        Self { phases: vec![packed], bias: padded_bias(bias, padded) }
    }

    /// For [`Transposed`]: of each phase (its taps · F, padded C).
    pub(super) fn transposed(shape: &MapConvolution, weight: &[f32], bias: Option<&[f32]>) -> Self {
        let padded = padded(shape.kernels, shape.channels);
        let (taps, channels, filters) = (shape.taps(), shape.channels, shape.filters);
        if shape.by_winograd() {
            // Kernel rotated by 180°, because the transposed convolution is computed as a convolution.
            let tap = |from: usize, to: usize, tap: usize| {
                weight[(from * channels + to) * taps + taps - 1 - tap]
            };
            let transformed = winograd::transform(channels, padded, tap);
            return Self { phases: vec![transformed], bias: padded_bias(bias, padded) };
        }
        let pack = |phase: Phase| {
            let own: Vec<usize> = phase.taps(shape).collect();
            let mut packed = vec![0f32; own.len() * filters * padded];
            for (index, tap) in own.into_iter().enumerate() {
                for filter in 0..filters {
                    let row = &mut packed[(index * filters + filter) * padded..][..channels];
                    for (channel, target) in row.iter_mut().enumerate() {
                        *target = weight[(filter * channels + channel) * taps + tap];
                    }
                }
            }
            packed
        };
        Self { phases: Phase::all(shape).map(pack).collect(), bias: padded_bias(bias, padded) }
    }
}

impl Packed {
    /// The layer for Winograd's algorithm on this map.
    fn layer<'a>(
        &'a self,
        shape: &MapConvolution,
        input: &'a [f32],
        size: (usize, usize),
        border: usize,
    ) -> Layer<'a> {
        let (weights, channels) = (&self.phases[0], shape.channels);
        Layer { input, size, border, weights, channels, padded: self.bias.len() }
    }
}

fn padded(kernels: Kernels, channels: usize) -> usize {
    channels.next_multiple_of(kernels.lanes())
}

fn padded_bias(bias: Option<&[f32]>, padded: usize) -> Vec<f32> {
    let mut bias = bias.map(<[f32]>::to_vec).unwrap_or_default();
    bias.resize(padded, 0.0);
    bias
}

/// Input positions whose row and column have these remainders modulo the stride.
#[derive(Debug, Clone, Copy)]
struct Phase {
    row: usize,
    column: usize,
}

impl Phase {
    fn all(shape: &MapConvolution) -> impl Iterator<Item = Self> {
        let stride = shape.stride;
        (0..stride * stride).map(move |phase| Self { row: phase / stride, column: phase % stride })
    }

    /// The taps that reach the phase's positions.
    fn taps(self, shape: &MapConvolution) -> impl Iterator<Item = usize> {
        let (side, stride) = (shape.side, shape.stride);
        let rows = (self.row..side).step_by(stride);
        rows.flat_map(move |row| {
            (self.column..side).step_by(stride).map(move |column| row * side + column)
        })
    }

    /// Number of rows and columns of the input in this phase.
    fn size(self, shape: &MapConvolution) -> (usize, usize) {
        let count = |length: usize, rest: usize| length.saturating_sub(rest).div_ceil(shape.stride);
        (count(shape.input_size.0, self.row), count(shape.input_size.1, self.column))
    }
}

/// The convolution of some images.
pub(super) struct Forward<'a, 'b> {
    pub(super) shape: &'a MapConvolution,
    pub(super) packed: &'a Packed,
    pub(super) pool: &'a Pool,
    pub(super) input: &'a [f32],
    pub(super) output: &'b mut [f32],
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
        let Forward { shape, packed, .. } = *self;
        let padded = packed.bias.len();
        if shape.by_winograd() {
            let layer = packed.layer(shape, self.input, shape.input_size, 0);
            let mut scratch = Scratch::new(self.pool, padded);
            let plain = Outcome::Plain(&packed.bias);
            winograd::layer::<S, M>(simd, layer, plain, self.output, &mut scratch);
            return;
        }
        let images = self.input.len() / shape.input_len();
        let (corners, taps) = (corners(shape, images), taps(shape));
        let numbers = &packed.phases[0];
        let columns = Columns { numbers, stride: padded, vectors: padded / S::F32_LANES };
        let (start, keep) = (Start::Row(&packed.bias), Finish::Keep);
        if padded == shape.filters {
            let output = &mut *self.output;
            product::<S, M>(
                simd, self.input, &corners, &taps, columns, output, padded, start, keep,
            );
            return;
        }
        let mut rows = self.pool.take(corners.len() * padded);
        product::<S, M>(simd, self.input, &corners, &taps, columns, &mut rows, padded, start, keep);
        let points = self.output.chunks_exact_mut(shape.filters);
        for (point, row) in points.zip(rows.chunks_exact(padded)) {
            point.copy_from_slice(&row[..shape.filters]);
        }
    }
}

/// Offsets into the input of each output position.
fn corners(shape: &MapConvolution, images: usize) -> Offsets {
    let (rows, columns) = shape.output_size();
    let corner = |point: usize| {
        let (image, point) = (point / (rows * columns), point % (rows * columns));
        let (row, column) = (point / columns * shape.stride, point % columns * shape.stride);
        image * shape.input_len() + (row * shape.input_size.1 + column) * shape.channels
    };
    (0..images * rows * columns).map(corner).collect()
}

/// Offsets of each tap and channel from a position's corner.
fn taps(shape: &MapConvolution) -> Offsets {
    let offset = |index: usize| {
        let (tap, channel) = (index / shape.channels, index % shape.channels);
        (tap / shape.side * shape.input_size.1 + tap % shape.side) * shape.channels + channel
    };
    (0..shape.taps() * shape.channels).map(offset).collect()
}

/// The transposed convolution of some images.
pub(super) struct Transposed<'a, 'b> {
    pub(super) shape: &'a MapConvolution,
    pub(super) packed: &'a Packed,
    pub(super) pool: &'a Pool,
    pub(super) output: &'a [f32],
    pub(super) input: &'b mut [f32],
}

impl WithSimd for &mut Transposed<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        with_rows!(self, simd);
    }
}

/// An output map with zero padding: before it as many rows and columns as the taps of a phase reach back, after it as many
/// as the input extends beyond it.
struct Bordered {
    before: usize,
    columns: usize,
    numbers: usize,
}

impl Bordered {
    fn new(shape: &MapConvolution) -> Self {
        let before = shape.side.div_ceil(shape.stride) - 1;
        let length =
            |input: usize, output: usize| before + output.max(input.div_ceil(shape.stride));
        let (rows, columns) = shape.output_size();
        let (rows, columns) =
            (length(shape.input_size.0, rows), length(shape.input_size.1, columns));
        Self { before, columns, numbers: rows * columns * shape.filters }
    }

    /// Copies one image's map into the interior. The padding must be zero already.
    fn fill(&self, shape: &MapConvolution, output: &[f32], target: &mut [f32]) {
        let row = shape.output_size().1 * shape.filters;
        for (index, numbers) in output.chunks_exact(row).enumerate() {
            let at = ((self.before + index) * self.columns + self.before) * shape.filters;
            target[at..at + row].copy_from_slice(numbers);
        }
    }
}

impl Transposed<'_, '_> {
    #[inline(always)]
    fn run<S: Simd, const M: usize>(&mut self, simd: S) {
        let Transposed { shape, packed, .. } = *self;
        let (padded, filters, channels) = (packed.bias.len(), shape.filters, shape.channels);
        if shape.by_winograd() {
            let layer = packed.layer(shape, self.output, shape.output_size(), 2);
            let mut scratch = Scratch::new(self.pool, padded);
            let plain = Outcome::Plain(&packed.bias);
            winograd::layer::<S, M>(simd, layer, plain, self.input, &mut scratch);
            return;
        }
        let bordered = Bordered::new(shape);
        let mut map = self.pool.take(bordered.numbers);
        map.fill(0.0);
        let plans: Vec<(Phase, Offsets, Offsets)> = Phase::all(shape)
            .map(|phase| {
                let (rows, columns) = phase.size(shape);
                let corner =
                    |point: usize| (point / columns * bordered.columns + point % columns) * filters;
                let corners = (0..rows * columns).map(corner).collect();
                let term = |tap: usize| {
                    let row = bordered.before - tap / shape.side / shape.stride;
                    let column = bordered.before - tap % shape.side / shape.stride;
                    (row * bordered.columns + column) * filters
                };
                let terms = phase.taps(shape).flat_map(|tap| {
                    let first = term(tap);
                    (0..filters).map(move |filter| first + filter)
                });
                (phase, corners, terms.collect())
            })
            .collect();
        let most = plans.iter().map(|(_, corners, _)| corners.len()).max().unwrap_or(0);
        let whole = shape.stride == 1 && padded == channels;
        let mut scratch = self.pool.take(if whole { 0 } else { most * padded });
        let images = self.output.chunks_exact(shape.output_len());
        for (output, input) in images.zip(self.input.chunks_exact_mut(shape.input_len())) {
            bordered.fill(shape, output, &mut map);
            for ((phase, corners, terms), numbers) in plans.iter().zip(&packed.phases) {
                let columns = Columns { numbers, stride: padded, vectors: padded / S::F32_LANES };
                let (start, keep) = (Start::Row(&packed.bias), Finish::Keep);
                if whole {
                    product::<S, M>(
                        simd, &map, corners, terms, columns, input, padded, start, keep,
                    );
                    continue;
                }
                let rows = &mut scratch[..corners.len() * padded];
                product::<S, M>(simd, &map, corners, terms, columns, rows, padded, start, keep);
                let (_, width) = phase.size(shape);
                for (point, row) in rows.chunks_exact(padded).enumerate() {
                    let y = point / width * shape.stride + phase.row;
                    let x = point % width * shape.stride + phase.column;
                    let at = (y * shape.input_size.1 + x) * channels;
                    input[at..at + channels].copy_from_slice(&row[..channels]);
                }
            }
        }
    }
}

/// The weight gradient of some images, (taps · C, padded F).
pub(super) struct Sum<'a> {
    pub(super) shape: &'a MapConvolution,
    pub(super) pool: &'a Pool,
    pub(super) input: &'a [f32],
    pub(super) output: &'a [f32],
}

impl WithSimd for &Sum<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f32> {
        with_rows!(self, simd)
    }
}

impl Sum<'_> {
    #[inline(always)]
    fn run<S: Simd, const M: usize>(&self, simd: S) -> Vec<f32> {
        let shape = self.shape;
        let padded = padded(shape.kernels, shape.filters);
        let taps = taps(shape);
        let mut sums = vec![0f32; taps.len() * padded];
        let (rows, columns) = shape.output_size();
        let corners = corners(shape, 1);
        let points = rows * columns;
        let parts: Vec<Offsets> = (0..points)
            .step_by(POINTS)
            .map(|first| corners.part(first, POINTS.min(points - first)))
            .collect();
        let exact = padded == shape.filters;
        let mut rows = self.pool.take(if exact { 0 } else { points * padded });
        rows.fill(0.0);
        let images = self.input.chunks_exact(shape.input_len());
        for (input, output) in images.zip(self.output.chunks_exact(shape.output_len())) {
            let output = if exact {
                output
            } else {
                let padded_rows = rows.chunks_exact_mut(padded);
                for (row, point) in padded_rows.zip(output.chunks_exact(shape.filters)) {
                    row[..shape.filters].copy_from_slice(point);
                }
                &rows
            };
            for (part, numbers) in parts.iter().zip(output.chunks(POINTS * padded)) {
                let columns = Columns { numbers, stride: padded, vectors: padded / S::F32_LANES };
                let (add, keep) = (Start::Add, Finish::Keep);
                product::<S, M>(simd, input, &taps, part, columns, &mut sums, padded, add, keep);
            }
        }
        sums
    }
}

/// Converts a packed weight (taps · C, padded F) to (F, C, k, k).
pub(super) fn unpack(shape: &MapConvolution, sums: &[f32]) -> Vec<f32> {
    let padded = padded(shape.kernels, shape.filters);
    let (taps, channels) = (shape.taps(), shape.channels);
    let mut gradient = Vec::with_capacity(shape.filters * channels * taps);
    for filter in 0..shape.filters {
        for channel in 0..channels {
            gradient
                .extend((0..taps).map(|tap| sums[(tap * channels + channel) * padded + filter]));
        }
    }
    gradient
}
