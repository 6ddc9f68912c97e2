//! Affine maps `y = x Wᵀ + b`, forward and backward, on row-major matrices.

use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::Kernels;
use super::memory::zeros;
use super::product::{Columns, Finish, Start, product};
use super::simd::{Offsets, inner};

/// Terms of an inner product that are summed before the next rows are taken: what of both operands then stays
/// in the cache.
const TERMS: usize = 1024;
/// Numbers of a packed group of panels: a quarter of a common second-level cache.
const PACKED: usize = 1 << 16;
/// Products with fewer multiplications are not worth a second thread.
const PARALLEL: usize = 1 << 18;

/// The sizes of an affine map of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Sizes {
    pub(crate) batch: usize,
    pub(crate) inputs: usize,
    pub(crate) outputs: usize,
}

impl Sizes {
    /// How many of `rows` rows one task takes: a whole number of `block`s, and all where there is little to do.
    /// No result depends on it.
    fn share(&self, rows: usize, block: usize) -> usize {
        if self.batch * self.inputs * self.outputs < PARALLEL {
            return rows.max(1);
        }
        rows.div_ceil(rayon::current_num_threads()).next_multiple_of(block)
    }
}

/// The map's output `(B, out)`; negative numbers become 0 if `relu`.
///
/// # Shapes
/// - `x`: `(B, in)`
/// - `weight`: `(out, in)`
/// - `bias`: `(out)`
pub(crate) fn linear(
    kernels: Kernels,
    sizes: Sizes,
    x: &[f32],
    weight: &[f32],
    bias: &[f32],
    relu: bool,
) -> Vec<f32> {
    let Sizes { batch, inputs, outputs } = sizes;
    let mut y = zeros(batch * outputs);
    let rows = sizes.share(batch, 6);
    let task = |(y, x): (&mut [f32], &[f32])| {
        if kernels.run(Forward { inputs, outputs, x, weight, y }).is_none() {
            for (y, x) in y.chunks_exact_mut(outputs).zip(x.chunks_exact(inputs)) {
                for (y, weight) in y.iter_mut().zip(weight.chunks_exact(inputs)) {
                    *y = x.iter().zip(weight).map(|(x, weight)| x * weight).sum();
                }
            }
        }
        for y in y.chunks_exact_mut(outputs) {
            for (y, bias) in y.iter_mut().zip(bias) {
                *y = if relu { (*y + bias).max(0.0) } else { *y + bias };
            }
        }
    };
    if rows >= batch {
        task((&mut y, x));
    } else {
        y.par_chunks_mut(rows * outputs).zip(x.par_chunks(rows * inputs)).for_each(task);
    }
    y
}

struct Forward<'a> {
    inputs: usize,
    outputs: usize,
    x: &'a [f32],
    weight: &'a [f32],
    y: &'a mut [f32],
}

impl WithSimd for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // As many sums as the registers hold: 16 registers with AVX2, 32 elsewhere.
        if S::F32_LANES == 8 { self.run::<S, 4, 2>(simd) } else { self.run::<S, 6, 4>(simd) }
    }
}

impl Forward<'_> {
    #[inline(always)]
    fn run<S: Simd, const M: usize, const N: usize>(self, simd: S) {
        let Self { inputs, outputs, x, weight, y } = self;
        let batch = y.len() / outputs;
        for first in (0..inputs).step_by(TERMS) {
            let count = (inputs - first).min(TERMS);
            for output in (0..outputs).step_by(N) {
                let mut columns = [0; N];
                for (n, column) in columns.iter_mut().enumerate() {
                    *column = (output + n).min(outputs - 1) * inputs + first;
                }
                for sample in (0..batch).step_by(M) {
                    let mut rows = [0; M];
                    for (m, row) in rows.iter_mut().enumerate() {
                        *row = (sample + m).min(batch - 1) * inputs + first;
                    }
                    let sums = inner::<S, M, N>(simd, x, rows, weight, columns, count);
                    for (y, sums) in y[sample * outputs..].chunks_mut(outputs).zip(sums) {
                        for (y, sum) in y[output..].iter_mut().zip(sums) {
                            *y += sum;
                        }
                    }
                }
            }
        }
    }
}

/// The gradients of an affine map.
#[derive(Debug)]
pub(crate) struct LinearGradients {
    /// `(B, in)`, if asked for.
    pub(crate) x: Option<Vec<f32>>,
    /// `(out, in)`, if asked for.
    pub(crate) weight: Option<Vec<f32>>,
    /// `(out)`, if the weight's was asked for.
    pub(crate) bias: Option<Vec<f32>>,
}

/// The gradients of [`linear`] where its output's is `gradient` `(B, out)`, taken before the ReLU: that towards
/// `x` and those towards the parameters, each if asked for.
pub(crate) fn linear_gradients(
    kernels: Kernels,
    sizes: Sizes,
    x: &[f32],
    weight: &[f32],
    gradient: &[f32],
    (towards_x, towards_parameters): (bool, bool),
) -> LinearGradients {
    let Sizes { batch, inputs, outputs } = sizes;
    let towards_x = towards_x.then(|| {
        let rows = Offsets::strided(batch, outputs);
        let terms = Offsets::strided(outputs, 1);
        by_rows(kernels, sizes, gradient, &rows, &terms, weight, inputs)
    });
    let weight = towards_parameters.then(|| {
        let rows = Offsets::strided(outputs, 1);
        let terms = Offsets::strided(batch, outputs);
        by_rows(kernels, sizes, gradient, &rows, &terms, x, inputs)
    });
    let bias = towards_parameters.then(|| {
        let mut bias = vec![0f32; outputs];
        for row in gradient.chunks_exact(outputs) {
            for (bias, number) in bias.iter_mut().zip(row) {
                *bias += number;
            }
        }
        bias
    });
    LinearGradients { x: towards_x, weight, bias }
}

/// `c[i][k] = Σ_j a[rows[i] + terms[j]] · b[j][k]` for `b` of rows of `columns` numbers.
fn by_rows(
    kernels: Kernels,
    sizes: Sizes,
    a: &[f32],
    rows: &Offsets,
    terms: &Offsets,
    b: &[f32],
    columns: usize,
) -> Vec<f32> {
    let mut c = zeros(rows.len() * columns);
    let share = sizes.share(rows.len(), 1);
    let task = |(index, c): (usize, &mut [f32])| {
        let rows = rows.part(index * share, c.len() / columns);
        if kernels.run(Product { a, rows: &rows, terms, b, columns, c: &mut *c }).is_none() {
            for (row, c) in c.chunks_exact_mut(columns).enumerate() {
                for (term, b) in terms.iter().zip(b.chunks_exact(columns)) {
                    let factor = a[rows.at(row) + term];
                    for (c, b) in c.iter_mut().zip(b) {
                        *c += factor * b;
                    }
                }
            }
        }
    };
    if share >= rows.len() {
        task((0, &mut c));
    } else {
        c.par_chunks_mut(share * columns).enumerate().for_each(task);
    }
    c
}

struct Product<'a> {
    a: &'a [f32],
    rows: &'a Offsets,
    terms: &'a Offsets,
    b: &'a [f32],
    columns: usize,
    c: &'a mut [f32],
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // The block that leaves fewer rows over.
        let left_over = |block: usize| self.rows.len().next_multiple_of(block) - self.rows.len();
        if S::F32_LANES == 8 {
            self.run::<S, 4>(simd);
        } else if left_over(5) < left_over(8) {
            self.run::<S, 5>(simd);
        } else {
            self.run::<S, 8>(simd);
        }
    }
}

impl Product<'_> {
    /// Packs some panels of `b`, each two vectors wide, so that a panel's rows follow each other in memory;
    /// then multiplies all rows by each.
    #[inline(always)]
    fn run<S: Simd, const M: usize>(self, simd: S) {
        let Self { a, rows, terms, b, columns, c } = self;
        let width = 2 * S::F32_LANES;
        let panel = terms.len() * width;
        let panels = (PACKED / panel.max(1)).clamp(1, columns.div_ceil(width));
        let mut packed = vec![0f32; panels * panel];
        let mut narrow =
            vec![0f32; if columns.is_multiple_of(width) { 0 } else { rows.len() * width }];
        for first in (0..columns).step_by(panels * width) {
            let group = (columns - first).min(panels * width);
            for (row, b) in b.chunks_exact(columns).enumerate() {
                for (index, b) in b[first..first + group].chunks(width).enumerate() {
                    packed[index * panel + row * width..][..b.len()].copy_from_slice(b);
                }
            }
            for (index, numbers) in packed.chunks_exact(panel).enumerate() {
                let column = first + index * width;
                if column >= first + group {
                    break;
                }
                let b = Columns { numbers, stride: width, vectors: 2 };
                let (start, finish) = (Start::Zero, Finish::Keep);
                if column + width <= columns {
                    let c = &mut c[column..];
                    product::<S, M>(simd, a, rows, terms, b, c, columns, start, finish);
                } else {
                    product::<S, M>(simd, a, rows, terms, b, &mut narrow, width, start, finish);
                    for (c, narrow) in c.chunks_exact_mut(columns).zip(narrow.chunks_exact(width)) {
                        c[column..].copy_from_slice(&narrow[..columns - column]);
                    }
                }
            }
        }
    }
}
