//! Diagnostic metrics of latents and actions.

use candle_core::{D, DType, Tensor};

use crate::Result;

/// Absolute value above which an action dimension counts as saturated.
const SATURATION_THRESHOLD: f64 = 0.95;

/// The fraction of action components whose absolute value exceeds 0.95.
///
/// # Errors
/// Whatever the tensors report.
pub fn saturated(actions: &Tensor) -> Result<f64> {
    Ok(actions.abs()?.gt(SATURATION_THRESHOLD)?.to_dtype(DType::F64)?.mean_all()?.to_scalar()?)
}

/// Standard deviation and effective rank of latents `(B, Z)`.
///
/// The first value is the standard deviation over the batch, averaged over dimensions. The second is the participation
/// ratio `(Σ λ)² / Σ λ²` of the eigenvalues `λ` of the covariance: 1 if all latents lie on a line, `Z` if their covariance
/// is isotropic, 0 if all are equal.
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
    fn effective_rank_counts_directions() {
        let spread = |values: &[f32]| {
            let rows = (values.len() / 2, 2);
            spread(&Tensor::from_slice(values, rows, &Device::Cpu).unwrap()).unwrap()
        };
        // Equal latents, latents on a line, and two directions of equal variance.
        assert_eq!(spread(&[3.0, 1.0, 3.0, 1.0]), (0.0, 0.0));
        let (std, rank) = spread(&[1.0, 2.0, -1.0, -2.0]);
        assert!((std - 1.5).abs() < 1e-12 && (rank - 1.0).abs() < 1e-12);
        let (std, rank) = spread(&[1.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, -1.0]);
        assert!((std - 0.5f64.sqrt()).abs() < 1e-12 && (rank - 2.0).abs() < 1e-12);
    }
}
