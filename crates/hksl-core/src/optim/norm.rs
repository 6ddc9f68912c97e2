//! Gradient norms.

use candle_core::backprop::GradStore;
use candle_core::{DType, Tensor};

use crate::Result;
use crate::params::Parameters;

/// The Euclidean norm of the gradients of all these parameters, taken as one vector.
///
/// # Errors
/// Whatever the tensors report.
pub fn gradient_norm(parameters: &Parameters, gradients: &GradStore) -> Result<f64> {
    let mut squares = Vec::new();
    for (_, parameter) in parameters.iter() {
        if let Some(gradient) = gradients.get(parameter) {
            squares.push(gradient.sqr()?.sum_all()?);
        }
    }
    if squares.is_empty() {
        return Ok(0.0);
    }
    // One transfer from the device for all norms.
    let squares = Tensor::stack(&squares, 0)?.to_dtype(DType::F64)?.to_vec1::<f64>()?;
    Ok(squares.iter().sum::<f64>().sqrt())
}
