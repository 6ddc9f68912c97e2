//! Register-blocked inner loops, and the only `unsafe` code of this crate's CPU arithmetic.
//!
//! Each function checks all bounds once per call and panics if an argument is out of bounds, so it is safe to call. All
//! functions are `inline(always)`, because their instructions are enabled only inside `Simd::vectorize`.
#![allow(unsafe_code)]

use pulp::Simd;

/// Offsets relative to a start, in elements, with their maximum.
#[derive(Debug, Clone, Default)]
pub(crate) struct Offsets {
    values: Vec<usize>,
    maximum: usize,
}

impl Offsets {
    /// `0, step, 2·step, …`.
    pub(crate) fn strided(count: usize, step: usize) -> Self {
        (0..count).map(|index| index * step).collect()
    }

    /// Number of offsets.
    pub(crate) fn len(&self) -> usize {
        self.values.len()
    }

    /// The `count` offsets starting at `first`.
    pub(crate) fn part(&self, first: usize, count: usize) -> Self {
        self.values[first..first + count].iter().copied().collect()
    }

    /// The `M` offsets starting at `first`; the last offset is repeated if there are fewer.
    #[inline(always)]
    pub(crate) fn block<const M: usize>(&self, first: usize) -> [usize; M] {
        let last = self.values.len() - 1;
        let mut block = [0; M];
        for (m, offset) in block.iter_mut().enumerate() {
            *offset = self.values[(first + m).min(last)];
        }
        block
    }
}

impl FromIterator<usize> for Offsets {
    fn from_iter<I: IntoIterator<Item = usize>>(iterator: I) -> Self {
        let values: Vec<usize> = iterator.into_iter().collect();
        let maximum = values.iter().copied().max().unwrap_or(0);
        Self { values, maximum }
    }
}

/// Reads the vector at `x[at..]`.
#[inline(always)]
pub(crate) fn load<S: Simd>(x: &[f32], at: usize) -> S::f32s {
    assert!(at + S::F32_LANES <= x.len());
    // SAFETY: the vector lies within `x`, as just checked; any bit pattern is a valid vector.
    unsafe { x.as_ptr().add(at).cast::<S::f32s>().read_unaligned() }
}

/// A bit for each number of a vector, the lowest for the first, set where the number does not equal 0; also for NaN.
#[inline(always)]
pub(crate) fn nonzero<S: Simd>(simd: S, numbers: S::f32s) -> u32 {
    let zero = simd.equal_f32s(numbers, simd.splat_f32s(0.0));
    let all = u32::MAX >> (32 - S::F32_LANES);
    if size_of::<S::m32s>() == size_of::<u16>() {
        // AVX-512: the mask is a register of bits.
        return !u32::from(pulp::bytemuck::cast::<S::m32s, u16>(zero)) & all;
    }
    let mut bits = 0;
    for (lane, zero) in pulp::bytemuck::bytes_of(&zero).chunks_exact(4).enumerate() {
        bits |= u32::from(zero[0] == 0) << lane;
    }
    bits
}

/// Writes a vector to `x[at..]`.
#[inline(always)]
pub(crate) fn store<S: Simd>(x: &mut [f32], at: usize, vector: S::f32s) {
    assert!(at + S::F32_LANES <= x.len());
    // SAFETY: the vector lies within `x`, as just checked.
    unsafe { x.as_mut_ptr().add(at).cast::<S::f32s>().write_unaligned(vector) }
}

/// Computes `start[m][n] + Σ_j a[rows[m] + terms[j]] · b[j·stride + n·lanes ..]`: `M` gathered rows times `N` vectors of
/// columns.
#[inline(always)]
pub(crate) fn outer<S: Simd, const M: usize, const N: usize>(
    simd: S,
    a: &[f32],
    rows: [usize; M],
    terms: &Offsets,
    b: &[f32],
    stride: usize,
    start: [[S::f32s; N]; M],
) -> [[S::f32s; N]; M] {
    let count = terms.values.len();
    if count == 0 {
        return start;
    }
    for row in rows {
        assert!(row + terms.maximum < a.len());
    }
    assert!((count - 1) * stride + N * S::F32_LANES <= b.len());
    let mut sums = start;
    // SAFETY: `a` is read at `rows[m] + terms[j]`, at most `rows[m] + terms.maximum`; `b` at `j·stride` and the
    // `N` vectors after it, `j < count`. Both were checked just above against the slices' lengths.
    unsafe {
        let mut starts = [a.as_ptr(); M];
        for (start, row) in starts.iter_mut().zip(rows) {
            *start = start.add(row);
        }
        for (j, &term) in terms.values.iter().enumerate() {
            let columns = b.as_ptr().add(j * stride);
            let mut vectors = [simd.splat_f32s(0.0); N];
            for (n, vector) in vectors.iter_mut().enumerate() {
                *vector = columns.add(n * S::F32_LANES).cast::<S::f32s>().read_unaligned();
            }
            for (sums, start) in sums.iter_mut().zip(starts) {
                let factor = simd.splat_f32s(*start.add(term));
                for (sum, vector) in sums.iter_mut().zip(vectors) {
                    *sum = simd.mul_add_e_f32s(factor, vector, *sum);
                }
            }
        }
    }
    sums
}

/// Computes `start[m][n] + Σ_j a[j·M + m] · b[(j·N + n)·lanes ..]` for `j < count`: packed rows times packed columns.
#[inline(always)]
pub(crate) fn tile<S: Simd, const M: usize, const N: usize>(
    simd: S,
    a: &[f32],
    b: &[f32],
    count: usize,
    start: [[S::f32s; N]; M],
) -> [[S::f32s; N]; M] {
    assert!(count * M <= a.len() && count * N * S::F32_LANES <= b.len());
    let mut sums = start;
    // SAFETY: `a` is read at `j·M + m`, `m < M`, and `b` at the `N` vectors from `j·N` on, `j < count`, as checked
    // just above against the slices' lengths.
    unsafe {
        let (mut a, mut b) = (a.as_ptr(), b.as_ptr());
        for _ in 0..count {
            let mut vectors = [simd.splat_f32s(0.0); N];
            for (n, vector) in vectors.iter_mut().enumerate() {
                *vector = b.add(n * S::F32_LANES).cast::<S::f32s>().read_unaligned();
            }
            for (m, sums) in sums.iter_mut().enumerate() {
                let factor = simd.splat_f32s(*a.add(m));
                for (sum, vector) in sums.iter_mut().zip(vectors) {
                    *sum = simd.mul_add_e_f32s(factor, vector, *sum);
                }
            }
            a = a.add(M);
            b = b.add(N * S::F32_LANES);
        }
    }
    sums
}

/// Computes `Σ_j a[rows[m] + j] · b[columns[n] + j]` for `j < count`: inner products of `M` rows with `N` rows.
#[inline(always)]
pub(crate) fn inner<S: Simd, const M: usize, const N: usize>(
    simd: S,
    a: &[f32],
    rows: [usize; M],
    b: &[f32],
    columns: [usize; N],
    count: usize,
) -> [[f32; N]; M] {
    for row in rows {
        assert!(row + count <= a.len());
    }
    for column in columns {
        assert!(column + count <= b.len());
    }
    let whole = count / S::F32_LANES * S::F32_LANES;
    let mut sums = [[simd.splat_f32s(0.0); N]; M];
    // SAFETY: `a` is read from `rows[m]` and `b` from `columns[n]` on, whole vectors that end at `whole ≤ count`;
    // `rows[m] + count` and `columns[n] + count` were checked just above against the slices' lengths.
    unsafe {
        let (mut left, mut right) = ([a.as_ptr(); M], [b.as_ptr(); N]);
        for (start, row) in left.iter_mut().zip(rows) {
            *start = start.add(row);
        }
        for (start, column) in right.iter_mut().zip(columns) {
            *start = start.add(column);
        }
        let mut j = 0;
        while j < whole {
            let mut vectors = [simd.splat_f32s(0.0); N];
            for (vector, start) in vectors.iter_mut().zip(right) {
                *vector = start.add(j).cast::<S::f32s>().read_unaligned();
            }
            for (sums, start) in sums.iter_mut().zip(left) {
                let factor = start.add(j).cast::<S::f32s>().read_unaligned();
                for (sum, vector) in sums.iter_mut().zip(vectors) {
                    *sum = simd.mul_add_e_f32s(factor, vector, *sum);
                }
            }
            j += S::F32_LANES;
        }
    }
    if whole < count {
        let mut vectors = [simd.splat_f32s(0.0); N];
        for (vector, column) in vectors.iter_mut().zip(columns) {
            *vector = simd.partial_load_f32s(&b[column + whole..column + count]);
        }
        for (sums, row) in sums.iter_mut().zip(rows) {
            let factor = simd.partial_load_f32s(&a[row + whole..row + count]);
            for (sum, vector) in sums.iter_mut().zip(vectors) {
                *sum = simd.mul_add_e_f32s(factor, vector, *sum);
            }
        }
    }
    let mut totals = [[0.0; N]; M];
    for (totals, sums) in totals.iter_mut().zip(sums) {
        for (total, sum) in totals.iter_mut().zip(sums) {
            *total = simd.reduce_sum_f32s(sum);
        }
    }
    totals
}
