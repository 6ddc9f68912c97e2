//! Distributions over classes, several variables at a time.

use candle_core::{D, DType, Tensor};
use hksl_sac::Result;

/// `ln` of the classes' probabilities, with the largest logit taken out before the exponential.
///
/// # Shapes
/// - `logits`, output: `(…, K)`
pub fn log_softmax(logits: &Tensor) -> Result<Tensor> {
    let shifted = logits.broadcast_sub(&logits.max_keepdim(D::Minus1)?.detach())?;
    Ok(shifted.broadcast_sub(&shifted.exp()?.sum_keepdim(D::Minus1)?.log()?)?)
}

/// A class of each variable as a one-hot vector: the first whose cumulated probability exceeds `uniform`. The gradient
/// is that of the probabilities (straight-through).
///
/// # Shapes
/// - `logits`, output: `(N, V, K)`
/// - `uniform`: `(N, V)`, in [0, 1)
///
/// ```
/// use candle_core::{Device, Tensor};
/// use hksl_baselines::dreamer::categorical::sample;
///
/// let logits = Tensor::new(&[[[0.2f32, 0.5, 0.3], [0.2, 0.5, 0.3]]], &Device::Cpu)?.log()?;
/// let uniform = Tensor::new(&[[0.1f32, 0.65]], &Device::Cpu)?;
/// let drawn = sample(&logits, &uniform)?.to_vec3::<f32>()?;
/// assert_eq!(drawn, [[[1., 0., 0.], [0., 1., 0.]]]);
/// # Ok::<(), hksl_baselines::Error>(())
/// ```
pub fn sample(logits: &Tensor, uniform: &Tensor) -> Result<Tensor> {
    let probabilities = log_softmax(logits)?.exp()?;
    let classes = logits.dim(D::Minus1)?;
    let below = probabilities.detach().cumsum(D::Minus1)?.broadcast_le(&uniform.unsqueeze(2)?)?;
    // Rounding may leave the last cumulated probability below the number drawn.
    let class =
        below.to_dtype(DType::F32)?.sum_keepdim(D::Minus1)?.minimum((classes - 1) as f64)?;
    let all = Tensor::arange(0f32, classes as f32, logits.device())?;
    let one_hot = class.broadcast_eq(&all.reshape((1, 1, classes))?)?.to_dtype(DType::F32)?;
    Ok((one_hot + (&probabilities - probabilities.detach())?)?)
}

/// `KL(p ‖ q)` summed over the variables.
///
/// # Shapes
/// - `p`, `q`: logits, `(N, V, K)`
/// - output: `(N)`
///
/// ```
/// use candle_core::{Device, Tensor};
/// use hksl_baselines::dreamer::categorical::divergence;
///
/// let logits = |p: [f32; 3]| Tensor::new(&[[p]], &Device::Cpu)?.log();
/// let apart = divergence(&logits([0.7, 0.2, 0.1])?, &logits([0.3, 0.3, 0.4])?)?;
/// assert!((apart.to_vec1::<f32>()?[0] - 0.373_386_04).abs() < 1e-6);
/// # Ok::<(), hksl_baselines::Error>(())
/// ```
pub fn divergence(p: &Tensor, q: &Tensor) -> Result<Tensor> {
    let (p, q) = (log_softmax(p)?, log_softmax(q)?);
    Ok((p.exp()? * (p - q)?)?.sum(D::Minus1)?.sum(D::Minus1)?)
}

/// The mean divergence of posterior and prior, pulled apart into one that moves the posterior and one, `balance` of the
/// whole, that moves the prior; neither counts below `free` (DreamerV2 §2.2).
///
/// # Shapes
/// - `posterior`, `prior`: logits, `(N, V, K)`
/// - output: scalar
///
/// ```
/// use candle_core::{Device, Tensor, Var};
/// use hksl_baselines::dreamer::categorical::balanced_divergence;
///
/// let logits = |p: [f32; 3]| Tensor::new(&[[p]], &Device::Cpu)?.log();
/// let posterior = Var::from_tensor(&logits([0.7, 0.2, 0.1])?)?;
/// let prior = logits([0.3, 0.3, 0.4])?;
/// let whole = balanced_divergence(&posterior, &prior, 0.8, 0.0)?;
/// assert!((whole.to_scalar::<f32>()? - 0.373_386_04).abs() < 1e-6);
/// // Within the free nats, nothing moves.
/// let free = balanced_divergence(&posterior, &prior, 0.8, 1.0)?;
/// assert_eq!(free.to_scalar::<f32>()?, 1.0);
/// let gradients = free.backward()?;
/// let gradient = gradients.get(&posterior).map(|gradient| gradient.abs()?.sum_all()?.to_scalar::<f32>());
/// assert_eq!(gradient.transpose()?.unwrap_or(0.0), 0.0);
/// # Ok::<(), hksl_baselines::Error>(())
/// ```
pub fn balanced_divergence(
    posterior: &Tensor,
    prior: &Tensor,
    balance: f64,
    free: f64,
) -> Result<Tensor> {
    let side = |p: &Tensor, q: &Tensor| -> Result<Tensor> {
        Ok(divergence(p, q)?.mean_all()?.maximum(free)?)
    };
    let of_posterior = side(posterior, &prior.detach())?;
    let of_prior = side(&posterior.detach(), prior)?;
    Ok(((of_posterior * (1.0 - balance))? + (of_prior * balance)?)?)
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Var};

    use super::*;

    /// What is drawn is a class; its slope is the probabilities'.
    #[test]
    fn gradients_pass_straight_through() {
        let logits = Var::new(&[[[0.3f32, -0.2, 0.9, 0.1]]], &Device::Cpu).unwrap();
        let uniform = Tensor::new(&[[0.5f32]], &Device::Cpu).unwrap();
        let weight = Tensor::new(&[[[1.0f32, -2.0, 0.5, 3.0]]], &Device::Cpu).unwrap();
        let drawn = sample(&logits, &uniform).unwrap();
        assert_eq!(drawn.to_vec3::<f32>().unwrap(), [[[0., 0., 1., 0.]]]);
        let gradient = |x: &Tensor| {
            let gradients = (x * &weight).unwrap().sum_all().unwrap().backward().unwrap();
            gradients.get(&logits).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap()
        };
        let probabilities = log_softmax(&logits).unwrap().exp().unwrap();
        for (got, expected) in gradient(&drawn).iter().zip(gradient(&probabilities)) {
            assert!((got - expected).abs() < 1e-7, "{got} {expected}");
        }
    }

    /// Over many numbers drawn evenly, classes come as often as they are likely.
    #[test]
    fn classes_come_as_often_as_they_are_likely() {
        let count = 1000;
        let logits = Tensor::new(&[[[0.7f32, 0.2, 0.1]]], &Device::Cpu).unwrap().log().unwrap();
        let logits = logits.broadcast_as((count, 1, 3)).unwrap().contiguous().unwrap();
        let evenly: Vec<f32> = (0..count).map(|i| (i as f32 + 0.5) / count as f32).collect();
        let uniform = Tensor::from_vec(evenly, (count, 1), &Device::Cpu).unwrap();
        let shares = sample(&logits, &uniform).unwrap().mean(0).unwrap().flatten_all().unwrap();
        for (got, expected) in shares.to_vec1::<f32>().unwrap().iter().zip([0.7, 0.2, 0.1]) {
            assert!((got - expected).abs() < 2e-3, "{got} {expected}");
        }
    }

    #[test]
    fn the_balance_weighs_the_two_sides() {
        let p = Var::new(&[[[0.3f32, -0.2, 0.9]]], &Device::Cpu).unwrap();
        let q = Var::new(&[[[-0.4f32, 0.5, 0.2]]], &Device::Cpu).unwrap();
        let of = |loss: &Tensor, x: &Var| {
            let gradients = loss.backward().unwrap();
            gradients.get(x).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap()
        };
        let whole = divergence(&p, &q).unwrap().mean_all().unwrap();
        let balanced = balanced_divergence(&p, &q, 0.8, 0.0).unwrap();
        for (x, share) in [(&p, 0.2), (&q, 0.8)] {
            for (got, expected) in of(&balanced, x).iter().zip(of(&whole, x)) {
                assert!((got - share * expected).abs() < 1e-6, "{got} {expected}");
            }
        }
    }
}
