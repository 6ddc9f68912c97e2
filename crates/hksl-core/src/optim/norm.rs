//! How long gradients are.

use candle_core::DType;
use candle_core::backprop::GradStore;

use crate::Result;
use crate::params::Parameters;

/// The Euclidean norm of the gradients of all these parameters together.
///
/// # Errors
/// Whatever the tensors report.
pub fn gradient_norm(parameters: &Parameters, gradients: &GradStore) -> Result<f64> {
    let mut squares = 0.0;
    for (_, parameter) in parameters.iter() {
        if let Some(gradient) = gradients.get(parameter) {
            squares += gradient.sqr()?.sum_all()?.to_dtype(DType::F64)?.to_scalar::<f64>()?;
        }
    }
    Ok(squares.sqrt())
}
