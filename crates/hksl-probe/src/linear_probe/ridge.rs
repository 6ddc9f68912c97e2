//! Ridge regression in closed form.

use nalgebra::{Cholesky, DMatrix};
use ndarray::{Array2, ArrayView2, Axis};

use super::LinearMap;
use crate::{Error, Result};

/// Fits `W = (XᵀX + n·penalty·v·I)⁻¹ XᵀY` on centred data, so that the intercept is not penalised. `v` is the mean variance
/// of X's columns.
pub(super) fn fit(
    inputs: ArrayView2<'_, f64>,
    targets: ArrayView2<'_, f64>,
    penalty: f64,
) -> Result<LinearMap> {
    let (dims, outputs) = (inputs.ncols(), targets.ncols());
    let input_mean = inputs.mean_axis(Axis(0)).unwrap_or_default();
    let target_mean = targets.mean_axis(Axis(0)).unwrap_or_default();
    let (x, y) = (&inputs - &input_mean, &targets - &target_mean);
    let gram = x.t().dot(&x);
    let variance = gram.diag().sum() / dims as f64;
    // Latents are f32. A variance at the level of their rounding errors counts as none.
    let level = inputs.iter().fold(0f64, |level, value| level.max(value.abs()));
    let rounding = inputs.nrows() as f64 * (4.0 * level * f64::from(f32::EPSILON)).powi(2);
    let weights = if variance <= rounding {
        Array2::zeros((dims, outputs))
    } else {
        let mut left = DMatrix::from_fn(dims, dims, |row, column| gram[(row, column)]);
        for index in 0..dims {
            left[(index, index)] += penalty * variance;
        }
        let right = x.t().dot(&y);
        let right = DMatrix::from_fn(dims, outputs, |row, column| right[(row, column)]);
        let solved = Cholesky::new(left).ok_or(Error::Singular { penalty })?.solve(&right);
        Array2::from_shape_fn((dims, outputs), |index| solved[index])
    };
    let intercept = target_mean - input_mean.dot(&weights);
    Ok(LinearMap { weights, intercept })
}
