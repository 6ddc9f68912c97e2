//! Sums over rows, for bias gradients.

use candle_core::{Result, Tensor};

/// The sum of all rows (N, width), computed as a matrix product. candle's own sum would leave most of a GPU idle.
pub(super) fn row_sum(rows: &Tensor) -> Result<Tensor> {
    let ones = Tensor::ones((1, rows.dim(0)?), rows.dtype(), rows.device())?;
    ones.matmul(rows)?.squeeze(0)
}
