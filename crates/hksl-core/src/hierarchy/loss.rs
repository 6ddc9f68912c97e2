//! How far predictions are from what came.

use candle_core::{D, Tensor};

use crate::Result;
use crate::hierarchy::Projection;

/// Norms are not allowed below this.
const SMALLEST_NORM: f64 = 1e-8;

/// A level's loss and what it was computed from.
#[derive(Debug, Clone)]
pub struct LevelLoss {
    /// The loss, a scalar; with its graph, but from [`crate::HierarchyLearner::step`].
    pub loss: Tensor,
    /// The level's predictions, one `(B, Z)` a step, before the projection.
    pub latents: Vec<Tensor>,
    /// The momentum encodings they are held against, `(N_l, B, Z)`.
    pub targets: Tensor,
}

/// `Σ_s mean_B( 2 − 2 cos(w(z_s), target_s) )`, the squared distance of the normalised vectors (HKSL eq. 1).
///
/// # Shapes
/// - `latents`: `N` of `(B, Z)`
/// - `targets`: `(N, B, Z)`
/// - output: scalar, between 0 and 4 N
///
/// ```
/// use candle_core::{Device, Tensor};
/// use hksl_core::hierarchy::prediction_loss;
///
/// let latents = [Tensor::new(&[[3f32, 0.], [0., 2.]], &Device::Cpu)?];
/// // One target in the same direction, one at a right angle: the mean of 0 and 2.
/// let targets = Tensor::new(&[[[1f32, 0.], [5., 0.]]], &Device::Cpu)?;
/// assert_eq!(prediction_loss(&latents, &targets, None)?.to_scalar::<f32>()?, 1.0);
/// # Ok::<(), hksl_core::Error>(())
/// ```
pub fn prediction_loss(
    latents: &[Tensor],
    targets: &Tensor,
    projection: Option<&Projection>,
) -> Result<Tensor> {
    let predictions = match projection {
        Some(projection) => {
            // All steps pass the projection as one batch.
            let (steps, batch, dims) = targets.dims3()?;
            projection.forward(&Tensor::cat(latents, 0)?)?.reshape((steps, batch, dims))?
        }
        None => Tensor::stack(latents, 0)?,
    };
    let product = (&predictions * targets)?.sum(D::Minus1)?;
    let cosine = ((product / norm(&predictions)?)? / norm(targets)?)?;
    let distance = cosine.affine(-2.0, 2.0)?;
    Ok(distance.mean(1)?.sum_all()?)
}

/// Euclidean norms over the last dimension, floored.
fn norm(x: &Tensor) -> Result<Tensor> {
    // Floored before the root, whose gradient at 0 is not finite.
    Ok(x.sqr()?.sum(D::Minus1)?.maximum(SMALLEST_NORM * SMALLEST_NORM)?.sqrt()?)
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Var};

    use super::*;

    #[test]
    fn a_zero_prediction_has_a_finite_gradient() {
        let latent = Var::zeros((1, 3), candle_core::DType::F32, &Device::Cpu).unwrap();
        let targets = Tensor::new(&[[[1f32, 0., 0.]]], &Device::Cpu).unwrap();
        let loss = prediction_loss(&[latent.as_tensor().clone()], &targets, None).unwrap();
        assert_eq!(loss.to_scalar::<f32>().unwrap(), 2.0);
        let gradients = loss.backward().unwrap();
        let gradient = gradients.get(&latent).unwrap().flatten_all().unwrap();
        assert!(gradient.to_vec1::<f32>().unwrap().iter().all(|g| g.is_finite()));
    }
}
