//! Returns of imagined trajectories.

use candle_core::Tensor;
use hksl_sac::Result;

/// λ-returns `G_t = r_t + γ ((1 − λ) v_{t+1} + λ G_{t+1})` for `t = 0…H−1`, with `G_H = v_H` (DreamerV2 §2.3).
///
/// # Shapes
/// - `rewards`: `H + 1` tensors of equal shape, one for each state; the last is ignored
/// - `values`: `H + 1` tensors of the same shape
/// - output: `H` tensors of the same shape
///
/// ```
/// use candle_core::{Device, Tensor};
/// use hksl_baselines::dreamer::returns::lambda_returns;
///
/// let numbers = |list: [f32; 4]| list.map(|x| Tensor::new(x, &Device::Cpu)).into_iter().collect();
/// let rewards: Result<Vec<Tensor>, _> = numbers([1., 2., 3., 0.]);
/// let values: Result<Vec<Tensor>, _> = numbers([10., 11., 12., 13.]);
/// let returns = lambda_returns(&rewards?, &values?, 0.99, 0.95)?;
/// for (got, expected) in returns.iter().zip([18.021_810_77, 17.519_735, 15.87]) {
///     assert!((got.to_scalar::<f32>()? - expected).abs() < 1e-5);
/// }
/// # Ok::<(), hksl_baselines::Error>(())
/// ```
pub fn lambda_returns(
    rewards: &[Tensor],
    values: &[Tensor],
    discount: f64,
    lambda: f64,
) -> Result<Vec<Tensor>> {
    let Some(last) = values.last() else { return Ok(Vec::new()) };
    let mut later = last.clone();
    let mut returns = Vec::with_capacity(values.len() - 1);
    for (reward, value) in rewards[..values.len() - 1].iter().zip(&values[1..]).rev() {
        let ahead = ((value * (1.0 - lambda))? + (&later * lambda)?)?;
        later = (reward + (ahead * discount)?)?;
        returns.push(later.clone());
    }
    returns.reverse();
    Ok(returns)
}
