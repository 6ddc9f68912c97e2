//! Vectors of categorical variables.

use candle_core::{D, DType, Tensor};
use hksl_sac::Result;

/// The log-softmax of logits over the last dimension. Subtracts the maximum first, to avoid overflow.
///
/// # Shapes
/// - `logits`, output: `(…, K)`
pub fn log_softmax(logits: &Tensor) -> Result<Tensor> {
    let shifted = logits.broadcast_sub(&logits.max_keepdim(D::Minus1)?.detach())?;
    Ok(shifted.broadcast_sub(&shifted.exp()?.sum_keepdim(D::Minus1)?.log()?)?)
}

/// Samples a one-hot vector for each variable by inverse transform sampling: the first class whose cumulative probability
/// exceeds `uniform`. The gradient is that of the probabilities (straight-through estimator).
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
    // Rounding may leave the last cumulative probability below `uniform`.
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
/// use hksl_baselines::dreamer::categorical::kl_divergence;
///
/// let logits = |p: [f32; 3]| Tensor::new(&[[p]], &Device::Cpu)?.log();
/// let apart = kl_divergence(&logits([0.7, 0.2, 0.1])?, &logits([0.3, 0.3, 0.4])?)?;
/// assert!((apart.to_vec1::<f32>()?[0] - 0.373_386_04).abs() < 1e-6);
/// # Ok::<(), hksl_baselines::Error>(())
/// ```
pub fn kl_divergence(p: &Tensor, q: &Tensor) -> Result<Tensor> {
    let (p, q) = (log_softmax(p)?, log_softmax(q)?);
    Ok((p.exp()? * (p - q)?)?.sum(D::Minus1)?.sum(D::Minus1)?)
}

/// The KL loss of posterior and prior with KL balancing (DreamerV2 §2.2). The term that trains the prior has the weight
/// `balance`, the term that trains the posterior the weight `1 − balance`. Each term is at least `free` nats.
///
/// # Shapes
/// - `posterior`, `prior`: logits, `(N, V, K)`
/// - output: scalar
///
/// ```
/// use candle_core::{Device, Tensor, Var};
/// use hksl_baselines::dreamer::categorical::balanced_kl_divergence;
///
/// let logits = |p: [f32; 3]| Tensor::new(&[[p]], &Device::Cpu)?.log();
/// let posterior = Var::from_tensor(&logits([0.7, 0.2, 0.1])?)?;
/// let prior = logits([0.3, 0.3, 0.4])?;
/// let whole = balanced_kl_divergence(&posterior, &prior, 0.8, 0.0)?;
/// assert!((whole.to_scalar::<f32>()? - 0.373_386_04).abs() < 1e-6);
/// // Below the free nats the gradient is zero.
/// let free = balanced_kl_divergence(&posterior, &prior, 0.8, 1.0)?;
/// assert_eq!(free.to_scalar::<f32>()?, 1.0);
/// let gradients = free.backward()?;
/// let gradient = gradients.get(&posterior).map(|gradient| gradient.abs()?.sum_all()?.to_scalar::<f32>());
/// assert_eq!(gradient.transpose()?.unwrap_or(0.0), 0.0);
/// # Ok::<(), hksl_baselines::Error>(())
/// ```
pub fn balanced_kl_divergence(
    posterior: &Tensor,
    prior: &Tensor,
    balance: f64,
    free: f64,
) -> Result<Tensor> {
    let side = |p: &Tensor, q: &Tensor| -> Result<Tensor> {
        Ok(kl_divergence(p, q)?.mean_all()?.maximum(free)?)
    };
    let of_posterior = side(posterior, &prior.detach())?;
    let of_prior = side(&posterior.detach(), prior)?;
    Ok(((of_posterior * (1.0 - balance))? + (of_prior * balance)?)?)
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Var};

    use super::*;

    /// The sample is one-hot; its gradient is that of the probabilities.
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

    /// Over evenly spaced noise, class frequencies match the probabilities.
    #[test]
    fn class_frequencies_match_probabilities() {
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
        let whole = kl_divergence(&p, &q).unwrap().mean_all().unwrap();
        let balanced = balanced_kl_divergence(&p, &q, 0.8, 0.0).unwrap();
        for (x, share) in [(&p, 0.2), (&q, 0.8)] {
            for (got, expected) in of(&balanced, x).iter().zip(of(&whole, x)) {
                assert!((got - share * expected).abs() < 1e-6, "{got} {expected}");
            }
        }
    }
}
