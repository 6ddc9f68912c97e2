//! Linear layers `y = x Wᵀ + b`, forward and backward, on row-major matrices.

use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::Engine;
use super::matrices::{Finish, Matrix, multiply};
use super::memory::zeros;
use super::simd::inner;

/// Terms of an inner product that are summed before the next rows, so that both operands stay in the cache.
const TERMS: usize = 1024;
/// Elements of the weight that stay in the second-level cache while all samples are processed.
const RESIDENT: usize = 1 << 16;
/// The weight is packed for at least this many samples and outputs and at most this many inputs. Otherwise its rows and
/// those of `x` are multiplied unpacked.
const PACKED_BATCH: usize = 16;
const PACKED_INPUTS: usize = 2048;
const PACKED_OUTPUTS: usize = 8;
/// Minimal number of multiplications for multiple threads.
const PARALLEL: usize = 1 << 18;

/// Sizes of a linear layer and its batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Sizes {
    pub(crate) batch: usize,
    pub(crate) inputs: usize,
    pub(crate) outputs: usize,
}

impl Sizes {
    /// Rows per task, out of `rows`: a multiple of `block`, or all rows of a small product. Results do not depend on it.
    fn share(&self, rows: usize, block: usize) -> usize {
        if self.batch * self.inputs * self.outputs < PARALLEL {
            return rows.max(1);
        }
        rows.div_ceil(rayon::current_num_threads()).next_multiple_of(block)
    }
}

/// The layer's output `(B, out)`, with ReLU if `relu`.
///
/// # Shapes
/// - `x`: `(B, in)`
/// - `weight`: `(out, in)`
/// - `bias`: `(out)`
pub(crate) fn linear(
    Engine { kernels, pool, counter }: &Engine,
    sizes: Sizes,
    x: &[f32],
    weight: &[f32],
    bias: &[f32],
    relu: bool,
) -> Vec<f32> {
    let Sizes { batch, inputs, outputs } = sizes;
    counter.add_product(batch, inputs, outputs);
    let mut y = zeros(batch * outputs);
    if batch >= PACKED_BATCH && inputs <= PACKED_INPUTS && outputs >= PACKED_OUTPUTS {
        let (x, weight) = (Matrix::new(x, inputs), Matrix::new(weight, inputs).transposed());
        multiply(*kernels, pool, x, weight, Finish { bias: Some(bias), relu }, &mut y);
        return y;
    }
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
        // As many sums as fit the registers: 16 registers with AVX2, 32 otherwise.
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
            let group = (RESIDENT / count).next_multiple_of(N);
            for start in (0..outputs).step_by(group) {
                for sample in (0..batch).step_by(M) {
                    let mut rows = [0; M];
                    for (m, row) in rows.iter_mut().enumerate() {
                        *row = (sample + m).min(batch - 1) * inputs + first;
                    }
                    for output in (start..outputs.min(start + group)).step_by(N) {
                        let mut columns = [0; N];
                        for (n, column) in columns.iter_mut().enumerate() {
                            *column = (output + n).min(outputs - 1) * inputs + first;
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
}

/// The gradients of a linear layer.
#[derive(Debug)]
pub(crate) struct LinearGradients {
    /// Gradient of the input `(B, in)`, if requested.
    pub(crate) x: Option<Vec<f32>>,
    /// Gradient of the weight `(out, in)`, if requested.
    pub(crate) weight: Option<Vec<f32>>,
    /// Gradient of the bias `(out)`, if the weight's gradient is requested.
    pub(crate) bias: Option<Vec<f32>>,
}

/// The gradients of [`linear`] from the gradient `(B, out)` before the ReLU. The two flags request the gradients of `x` and
/// of the parameters.
pub(crate) fn linear_gradients(
    Engine { kernels, pool, counter }: &Engine,
    sizes: Sizes,
    x: &[f32],
    weight: &[f32],
    gradient: &[f32],
    (towards_x, towards_parameters): (bool, bool),
) -> LinearGradients {
    let Sizes { batch, inputs, outputs } = sizes;
    let gradients = Matrix::new(gradient, outputs);
    let product = |a: Matrix<'_>, numbers: &[f32], rows: usize| {
        counter.add_product(batch, inputs, outputs);
        let mut c = zeros(rows * inputs);
        multiply(*kernels, pool, a, Matrix::new(numbers, inputs), Finish::NONE, &mut c);
        c
    };
    let bias = || {
        let mut bias = vec![0f32; outputs];
        for row in gradient.chunks_exact(outputs) {
            for (bias, number) in bias.iter_mut().zip(row) {
                *bias += number;
            }
        }
        bias
    };
    LinearGradients {
        x: towards_x.then(|| product(gradients, weight, batch)),
        weight: towards_parameters.then(|| product(gradients.transposed(), x, outputs)),
        bias: towards_parameters.then(bias),
    }
}
