//! Products of dense matrices. Both operands are packed in the order in which register tiles read them.

use std::ops::Range;

use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::simd::{store, tile};
use super::{Block, Kernels, Pool};

/// Rows of a tile with 32 registers and with 16. A tile is two vectors wide.
const ROWS: usize = 12;
const FEW_ROWS: usize = 6;
/// Elements of the packed right-hand side that stay in the second-level cache while all rows are processed.
const RESIDENT: usize = 1 << 16;
/// Minimal number of multiplications for multiple threads.
const PARALLEL: usize = 1 << 18;
/// Side of the squares that are transposed in registers.
const SIDE: usize = 4;

/// A view of a matrix with arbitrary strides.
#[derive(Clone, Copy)]
pub(super) struct Matrix<'a> {
    numbers: &'a [f32],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> Matrix<'a> {
    /// Creates a view of a row-major matrix with `columns` columns.
    pub(super) fn new(numbers: &'a [f32], columns: usize) -> Self {
        let rows = numbers.len() / columns.max(1);
        Self { numbers, rows, columns, row_stride: columns, column_stride: 1 }
    }

    /// The transposed matrix.
    pub(super) fn transposed(self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }

    /// A range of rows.
    fn part(self, rows: Range<usize>) -> Self {
        let numbers = &self.numbers[rows.start * self.row_stride..];
        Self { numbers, rows: rows.len(), ..self }
    }

    fn at(&self, row: usize, column: usize) -> f32 {
        self.numbers[row * self.row_stride + column * self.column_stride]
    }

    /// Packs `width` rows starting at `first` column by column, with zeros for missing rows.
    fn pack(&self, first: usize, width: usize, target: &mut [f32]) {
        // Constant widths for each tile and vector size.
        match width {
            6 => self.pack_lines::<6>(first, target),
            8 => self.pack_lines::<8>(first, target),
            12 => self.pack_lines::<12>(first, target),
            16 => self.pack_lines::<16>(first, target),
            32 => self.pack_lines::<32>(first, target),
            _ => {
                for (column, target) in target.chunks_exact_mut(width).enumerate() {
                    self.pack_line(first, column, target);
                }
            }
        }
    }

    fn pack_line(&self, first: usize, column: usize, target: &mut [f32]) {
        for (row, target) in target.iter_mut().enumerate() {
            *target = if first + row < self.rows { self.at(first + row, column) } else { 0.0 };
        }
    }

    fn pack_lines<const W: usize>(&self, first: usize, target: &mut [f32]) {
        let (lines, _) = target.as_chunks_mut::<W>();
        if self.row_stride == 1 {
            let count = W.min(self.rows - first);
            for (column, line) in lines.iter_mut().enumerate() {
                let start = first + column * self.column_stride;
                if count == W {
                    line.copy_from_slice(&self.numbers[start..start + W]);
                } else {
                    line[..count].copy_from_slice(&self.numbers[start..start + count]);
                    line[count..].fill(0.0);
                }
            }
            return;
        }
        let mut transposed = 0;
        if first + W <= self.rows && self.column_stride == 1 {
            let row = |row: usize| &self.numbers[(first + row) * self.row_stride..][..self.columns];
            for start in (0..W / SIDE * SIDE).step_by(SIDE) {
                transpose(std::array::from_fn(|offset| row(start + offset)), lines, start);
            }
            for start in W / SIDE * SIDE..W {
                for (line, number) in lines.iter_mut().zip(row(start)) {
                    line[start] = *number;
                }
            }
            transposed = self.columns / SIDE * SIDE;
        }
        for (column, line) in lines.iter_mut().enumerate().skip(transposed) {
            self.pack_line(first, column, line);
        }
    }
}

/// Transposes adjacent squares of rows into `lines`, at offset `start` of each line.
fn transpose<const W: usize>(rows: [&[f32]; SIDE], lines: &mut [[f32; W]], start: usize) {
    let [a, b, c, d] = rows.map(|row| row.as_chunks::<SIDE>().0);
    for ((((a, b), c), d), lines) in
        a.iter().zip(b).zip(c).zip(d).zip(lines.as_chunks_mut::<SIDE>().0)
    {
        for (column, line) in lines.iter_mut().enumerate() {
            line[start..start + SIDE]
                .copy_from_slice(&[a[column], b[column], c[column], d[column]]);
        }
    }
}

/// Bias and activation of a product.
#[derive(Clone, Copy)]
pub(super) struct Finish<'a> {
    /// One bias per column.
    pub(super) bias: Option<&'a [f32]>,
    /// Whether to apply ReLU.
    pub(super) relu: bool,
}

impl<'a> Finish<'a> {
    /// No bias and no activation.
    pub(super) const NONE: Self = Self { bias: None, relu: false };

    /// The part for a range of columns.
    fn part(self, columns: Range<usize>) -> Self {
        Self { bias: self.bias.map(|bias| &bias[columns]), ..self }
    }
}

/// Computes `c = a · b`, row-major, with bias and activation. Results do not depend on the number of threads.
pub(super) fn multiply(
    kernels: Kernels,
    pool: &Pool,
    a: Matrix<'_>,
    b: Matrix<'_>,
    finish: Finish<'_>,
    c: &mut [f32],
) {
    let (rows, terms, columns) = (a.rows, a.columns, b.columns);
    assert!(b.rows == terms && c.len() == rows * columns, "matrices that do not fit");
    let lanes = kernels.lanes();
    if lanes == 1 || terms == 0 {
        return by_definition(a, b, finish, c);
    }
    let block = if lanes == 8 { FEW_ROWS } else { ROWS };
    let shape = Shape { width: 2 * lanes, terms };
    let parallel = rows * terms * columns >= PARALLEL;
    let left = shape.packed(pool, a, block, parallel);
    let strip = (RESIDENT / terms).max(1).next_multiple_of(shape.width);
    if columns <= strip {
        let right = shape.packed(pool, b.transposed(), shape.width, parallel);
        let task = |(c, left): (&mut [f32], &[f32])| {
            let c = c.chunks_exact_mut(columns).collect();
            kernels.run(Product { shape, left, right: &right, finish, c });
        };
        let threads = if parallel { rayon::current_num_threads() } else { 1 };
        let share = rows.div_ceil(threads).next_multiple_of(block);
        let tasks = c.par_chunks_mut(share * columns).zip(left.par_chunks(share * terms));
        return tasks.for_each(task);
    }
    let mut strips: Vec<Vec<&mut [f32]>> = Vec::new();
    strips.resize_with(columns.div_ceil(strip), || Vec::with_capacity(rows));
    for row in c.chunks_exact_mut(columns) {
        strips.iter_mut().zip(row.chunks_mut(strip)).for_each(|(strip, part)| strip.push(part));
    }
    let b = b.transposed();
    let task = |(index, c): (usize, Vec<&mut [f32]>)| {
        let columns = index * strip..(index * strip + strip).min(columns);
        let finish = finish.part(columns.clone());
        let right = shape.packed(pool, b.part(columns), shape.width, false);
        kernels.run(Product { shape, left: &left, right: &right, finish, c });
    };
    strips.into_par_iter().enumerate().for_each(task);
}

/// Columns of a tile and terms of each sum.
#[derive(Clone, Copy)]
struct Shape {
    width: usize,
    terms: usize,
}

impl Shape {
    /// Packs the rows of `matrix` in blocks of `width`.
    fn packed(self, pool: &Pool, matrix: Matrix<'_>, width: usize, parallel: bool) -> Block {
        let mut packed = pool.take(matrix.rows.next_multiple_of(width) * self.terms);
        let size = width * self.terms;
        let task = |(index, target): (usize, &mut [f32])| matrix.pack(index * width, width, target);
        if parallel {
            packed.par_chunks_mut(size).enumerate().for_each(task);
        } else {
            packed.chunks_mut(size).enumerate().for_each(task);
        }
        packed
    }
}

fn by_definition(a: Matrix<'_>, b: Matrix<'_>, finish: Finish<'_>, c: &mut [f32]) {
    for (row, c) in c.chunks_exact_mut(b.columns).enumerate() {
        c.fill(0.0);
        for term in 0..a.columns {
            let factor = a.at(row, term);
            for (column, c) in c.iter_mut().enumerate() {
                *c += factor * b.at(term, column);
            }
        }
        for (c, bias) in c.iter_mut().zip(finish.bias.unwrap_or_default()) {
            *c += bias;
        }
        if finish.relu {
            c.iter_mut().for_each(|c| *c = c.max(0.0));
        }
    }
}

/// A block of rows and columns of a product of packed operands.
struct Product<'a> {
    shape: Shape,
    /// Packed blocks of rows.
    left: &'a [f32],
    /// Packed panels of columns.
    right: &'a [f32],
    finish: Finish<'a>,
    /// The output rows of this block.
    c: Vec<&'a mut [f32]>,
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        if S::F32_LANES == 8 { self.run::<S, FEW_ROWS>(simd) } else { self.run::<S, ROWS>(simd) }
    }
}

impl Product<'_> {
    #[inline(always)]
    fn run<S: Simd, const M: usize>(mut self, simd: S) {
        let Shape { width, terms, .. } = self.shape;
        let mut c = std::mem::take(&mut self.c);
        for (c, left) in c.chunks_mut(M).zip(self.left.chunks_exact(M * terms)) {
            for (panel, right) in self.right.chunks_exact(width * terms).enumerate() {
                self.tile::<S, M>(simd, left, right, panel * width, c);
            }
        }
    }

    #[inline(always)]
    fn tile<S: Simd, const M: usize>(
        &self,
        simd: S,
        left: &[f32],
        right: &[f32],
        column: usize,
        c: &mut [&mut [f32]],
    ) {
        let lanes = S::F32_LANES;
        let mut bias = [simd.splat_f32s(0.0); 2];
        if let Some(numbers) = self.finish.bias {
            for (n, bias) in bias.iter_mut().enumerate() {
                let start = (column + n * lanes).min(numbers.len());
                let end = numbers.len().min(start + lanes);
                *bias = simd.partial_load_f32s(&numbers[start..end]);
            }
        }
        let mut sums = tile::<S, M, 2>(simd, left, right, self.shape.terms, [bias; M]);
        if self.finish.relu {
            for sum in sums.as_flattened_mut() {
                *sum = simd.max_f32s(*sum, simd.splat_f32s(0.0));
            }
        }
        for (c, [low, high]) in c.iter_mut().zip(sums) {
            if column + 2 * lanes <= c.len() {
                store::<S>(c, column, low);
                store::<S>(c, column + lanes, high);
            } else {
                let c = &mut c[column..];
                let (c_low, c_high) = c.split_at_mut(c.len().min(lanes));
                simd.partial_store_f32s(c_low, low);
                simd.partial_store_f32s(c_high, high);
            }
        }
    }
}
