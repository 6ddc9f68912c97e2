//! The representation loss.

use candle_core::{D, Tensor};

use crate::Result;
use crate::hierarchy::Projection;

/// Lower bound of norms.
const MIN_NORM: f64 = 1e-8;

/// A level's loss with its predictions and targets.
#[derive(Debug, Clone)]
pub struct LevelLoss {
    /// The loss, a scalar. Results of [`crate::HierarchyLearner::step`] are detached.
    pub loss: Tensor,
    /// The level's predictions before the projection, one `(B, Z)` per step.
    pub latents: Vec<Tensor>,
    /// The targets: momentum encodings, `(N_l, B, Z)`.
    pub targets: Tensor,
}

/// The loss `Σ_s mean_B( 2 − 2 cos(w(z_s), target_s) )`, the squared distance of normalised predictions and targets (HKSL
/// eq. 1).
///
/// # Shapes
/// - `latents`: `N` tensors of shape `(B, Z)`
/// - `targets`: `(N, B, Z)`
/// - output: scalar, between 0 and 4 N
///
/// ```
/// use candle_core::{Device, Tensor};
/// use hksl_core::hierarchy::prediction_loss;
///
/// let latents = [Tensor::new(&[[3f32, 0.], [0., 2.]], &Device::Cpu)?];
/// // One target in the same direction, one orthogonal: the mean of 0 and 2.
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
            // Project all steps as one batch.
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

/// Euclidean norms over the last dimension, with a lower bound.
fn norm(x: &Tensor) -> Result<Tensor> {
    // The bound is applied before the square root, whose derivative at 0 is infinite.
    Ok(x.sqr()?.sum(D::Minus1)?.maximum(MIN_NORM * MIN_NORM)?.sqrt()?)
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
