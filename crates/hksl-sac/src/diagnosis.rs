//! Figures that explain a learning curve, of latents and actions.

use candle_core::{D, DType, Tensor};

use crate::Result;

/// An action's number counts as saturated beyond this.
const SATURATED: f64 = 0.95;

/// The share of numbers in actions that lie near an end of their range.
///
/// # Errors
/// Whatever the tensors report.
pub fn saturated(actions: &Tensor) -> Result<f64> {
    Ok(actions.abs()?.gt(SATURATED)?.to_dtype(DType::F64)?.mean_all()?.to_scalar()?)
}

/// Of latents `(B, Z)`: the mean over dimensions of the standard deviation over the batch, and in how many directions
/// they spread: `(Σ λ)² / Σ λ²` over the eigenvalues of their covariance, from 1, a line, to `Z`, a ball; 0 for a
/// point.
///
/// # Errors
/// Whatever the tensors report.
pub fn spread(latents: &Tensor) -> Result<(f64, f64)> {
    let latents = latents.to_dtype(DType::F64)?;
    let count = latents.dim(0)? as f64;
    let centred = latents.broadcast_sub(&latents.mean_keepdim(0)?)?;
    let covariance = (centred.t()?.matmul(&centred)? / count)?;
    let deviations = (centred.sqr()?.sum(0)? / count)?.sqrt()?;
    let trace = centred.sqr()?.sum_all()?.to_scalar::<f64>()? / count;
    let squares = covariance.sqr()?.sum_all()?.to_scalar::<f64>()?;
    let rank = if squares > 0.0 { trace * trace / squares } else { 0.0 };
    Ok((deviations.mean(D::Minus1)?.to_scalar()?, rank))
}

#[cfg(test)]
mod tests {
    use candle_core::Device;

    use super::*;

    #[test]
    fn counts_the_directions_of_a_spread() {
        let spread = |numbers: &[f32]| {
            let rows = (numbers.len() / 2, 2);
            spread(&Tensor::from_slice(numbers, rows, &Device::Cpu).unwrap()).unwrap()
        };
        // A point, a line, and two directions of equal width.
        assert_eq!(spread(&[3.0, 1.0, 3.0, 1.0]), (0.0, 0.0));
        let (std, rank) = spread(&[1.0, 2.0, -1.0, -2.0]);
        assert!((std - 1.5).abs() < 1e-12 && (rank - 1.0).abs() < 1e-12);
        let (std, rank) = spread(&[1.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, -1.0]);
        assert!((std - 0.5f64.sqrt()).abs() < 1e-12 && (rank - 2.0).abs() < 1e-12);
    }
}
