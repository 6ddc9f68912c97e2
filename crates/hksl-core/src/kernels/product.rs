//! Register-blocked matrix products.

use pulp::Simd;

use super::simd::{Offsets, load, outer, store};

/// Initial value of the sums of a product.
#[derive(Clone, Copy)]
pub(super) enum Start<'a> {
    /// Zero.
    Zero,
    /// The current content of the output.
    Add,
    /// The same values for every row.
    Row(&'a [f32]),
}

/// Activation of a product.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Finish {
    /// None.
    Keep,
    /// ReLU.
    Relu,
}

/// The right-hand side of a product: `vectors` whole vectors of each row, with rows `stride` elements apart.
#[derive(Clone, Copy)]
pub(super) struct Columns<'a> {
    pub(super) numbers: &'a [f32],
    pub(super) stride: usize,
    pub(super) vectors: usize,
}

/// Computes `c[i·c_stride + v] = start + Σ_j a[rows[i] + terms[j]] · b[j·stride + v]` for every row `i` and every vector `v`
/// of columns.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // The operands of one formula.
pub(super) fn product<S: Simd, const M: usize>(
    simd: S,
    a: &[f32],
    rows: &Offsets,
    terms: &Offsets,
    b: Columns<'_>,
    c: &mut [f32],
    c_stride: usize,
    start: Start<'_>,
    finish: Finish,
) {
    let mut vector = 0;
    while vector < b.vectors {
        let pair = vector + 1 < b.vectors;
        let at = vector * S::F32_LANES;
        let mut first = 0;
        while first < rows.len() {
            let (block, count) = (rows.block::<M>(first), (rows.len() - first).min(M));
            let place = first * c_stride + at;
            let numbers = &b.numbers[at..];
            if pair {
                block_product::<S, M, 2>(
                    simd, a, block, count, terms, numbers, b.stride, c, place, c_stride, at, start,
                    finish,
                );
            } else {
                block_product::<S, M, 1>(
                    simd, a, block, count, terms, numbers, b.stride, c, place, c_stride, at, start,
                    finish,
                );
            }
            first += M;
        }
        vector += 2;
    }
}

#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn block_product<S: Simd, const M: usize, const N: usize>(
    simd: S,
    a: &[f32],
    rows: [usize; M],
    count: usize,
    terms: &Offsets,
    b: &[f32],
    b_stride: usize,
    c: &mut [f32],
    place: usize,
    c_stride: usize,
    column: usize,
    start: Start<'_>,
    finish: Finish,
) {
    let mut sums = [[simd.splat_f32s(0.0); N]; M];
    for (m, sums) in sums.iter_mut().enumerate() {
        for (n, sum) in sums.iter_mut().enumerate() {
            *sum = match start {
                Start::Zero => *sum,
                Start::Add if m < count => load::<S>(c, place + m * c_stride + n * S::F32_LANES),
                Start::Add => *sum,
                Start::Row(row) => load::<S>(row, column + n * S::F32_LANES),
            };
        }
    }
    let sums = outer::<S, M, N>(simd, a, rows, terms, b, b_stride, sums);
    for (m, sums) in sums.into_iter().enumerate() {
        if m < count {
            for (n, sum) in sums.into_iter().enumerate() {
                let sum = match finish {
                    Finish::Keep => sum,
                    Finish::Relu => simd.max_f32s(sum, simd.splat_f32s(0.0)),
                };
                store::<S>(c, place + m * c_stride + n * S::F32_LANES, sum);
            }
        }
    }
}
