//! Actor and critic, and their losses on imagined trajectories.

use candle_core::{D, Tensor};
use hksl_core::Builder;
use hksl_core::nn::{Activation, Mlp};
use hksl_sac::Result;

use super::Sizes;
use super::returns::lambda_returns;
use super::rssm::State;
use super::truncated_normal;
use super::world::WorldModel;
use crate::config::DreamerConfig;

/// Minimum of the policy's scale parameter.
const MIN_DEVIATION: f64 = 0.1;

/// The policy: a truncated normal distribution computed from a feature.
///
/// Parameters: `{0, 2, …}`.
#[derive(Debug)]
pub struct DreamerActor(Mlp);

impl DreamerActor {
    pub(super) fn new(builder: &mut Builder, sizes: &Sizes) -> Result<Self> {
        Ok(Self(head(builder, sizes, 2 * sizes.action_dims)?))
    }

    /// Location `tanh(m)` and scale `2 σ(s/2) + 0.1` of the distribution, `(N, A)` each.
    ///
    /// # Errors
    /// Features of another size.
    pub fn distribution(&self, features: &Tensor) -> Result<(Tensor, Tensor)> {
        let parts = self.0.forward(features)?.chunk(2, D::Minus1)?;
        // 2 σ(s/2) = 1 + tanh(s/4).
        let deviation = ((&parts[1] * 0.25)?.tanh()? + (1.0 + MIN_DEVIATION))?;
        Ok((parts[0].tanh()?, deviation))
    }
}

/// The value function of features.
///
/// Parameters: `{0, 2, …}`.
#[derive(Debug)]
pub struct DreamerCritic(Mlp);

impl DreamerCritic {
    pub(super) fn new(builder: &mut Builder, sizes: &Sizes) -> Result<Self> {
        Ok(Self(head(builder, sizes, 1)?))
    }

    /// The values of features, `(N)`.
    ///
    /// # Errors
    /// Features of another size.
    pub fn values(&self, features: &Tensor) -> Result<Tensor> {
        Ok(self.0.forward(features)?.squeeze(D::Minus1)?)
    }
}

fn head(builder: &mut Builder, sizes: &Sizes, outputs: usize) -> Result<Mlp> {
    let DreamerConfig { behaviour_layers, behaviour_units, .. } = sizes.config;
    let mut layers = vec![sizes.feature()];
    layers.extend(vec![behaviour_units; behaviour_layers]);
    layers.push(outputs);
    Ok(Mlp::with(builder, &layers, Activation::Elu)?)
}

/// Imagined trajectories of `H` actions and `H + 1` states.
#[derive(Debug)]
pub struct Imagined {
    /// Features of the states, `H + 1` tensors of shape `(N, …)`.
    pub features: Vec<Tensor>,
    /// Actions, `H` tensors of shape `(N, A)`.
    pub actions: Vec<Tensor>,
    /// Entropies of the policy, summed over action dimensions, `H` tensors of shape `(N)`.
    pub entropies: Vec<Tensor>,
}

/// Imagines `uniform_actions.len()` steps from `starts`. The gradient of states and actions reaches the actor through the
/// world model's dynamics. `world` must be a view without gradient.
///
/// # Shapes
/// - `starts`: `(N, …)`
/// - `uniform_actions`: `H` tensors of shape `(N, A)`
/// - `uniform_states`: `H` tensors of shape `(N, V)`
///
/// # Errors
/// Shapes that do not fit.
pub fn imagine(
    world: &WorldModel,
    actor: &DreamerActor,
    starts: State,
    uniform_actions: &[Tensor],
    uniform_states: &[Tensor],
) -> Result<Imagined> {
    let mut imagined =
        Imagined { features: vec![starts.feature()?], actions: Vec::new(), entropies: Vec::new() };
    let mut state = starts;
    for (for_action, for_state) in uniform_actions.iter().zip(uniform_states) {
        let (location, deviation) = actor.distribution(&state.feature()?.detach())?;
        let action = truncated_normal::sample(&location, &deviation, for_action)?;
        let entropy = truncated_normal::entropy(&location, &deviation)?.sum(D::Minus1)?;
        let deterministic = world.rssm.advance(&state, &action)?;
        let prior = world.rssm.prior(&deterministic)?;
        state = world.rssm.draw(deterministic, &prior, for_state)?;
        imagined.features.push(state.feature()?);
        imagined.actions.push(action);
        imagined.entropies.push(entropy);
    }
    Ok(imagined)
}

/// The losses of actor and critic on imagined trajectories.
#[derive(Debug)]
pub struct BehaviourLosses {
    /// Actor loss.
    pub actor: Tensor,
    /// Critic loss.
    pub critic: Tensor,
    /// Mean entropy of the policy, without gradient.
    pub entropy: Tensor,
    /// Mean return, without gradient.
    pub returns: Tensor,
    /// Mean value, without gradient.
    pub values: Tensor,
}

/// Computes the losses of actor and critic (DreamerV2 §2.3).
///
/// The actor loss is `−mean(γ^t (G_{t+1} + η H_t))` over `t = 0…H−2`. It does not contain `G_0`, whose state is not
/// imagined. The critic loss is `mean(γ^t ½ (v(s_t) − G_t)²)` over `t = 0…H−1`.
///
/// # Errors
/// Shapes that do not fit.
pub fn losses(
    world: &WorldModel,
    critic: &DreamerCritic,
    target_critic: &DreamerCritic,
    imagined: &Imagined,
    config: &DreamerConfig,
) -> Result<BehaviourLosses> {
    let DreamerConfig { discount, lambda, entropy_weight, .. } = *config;
    let (steps, count) = (imagined.actions.len(), imagined.features[0].dim(0)?);
    // One pass through each head for all times.
    let features = Tensor::cat(&imagined.features, 0)?;
    let by_time = |numbers: &Tensor| -> Result<Vec<Tensor>> {
        (0..=steps).map(|time| Ok(numbers.narrow(0, time * count, count)?)).collect()
    };
    let rewards = by_time(&world.rewards(&features)?)?;
    let target_values = by_time(&target_critic.values(&features)?)?;
    let returns = lambda_returns(&rewards, &target_values, discount, lambda)?;
    let weighted = |terms: &[Tensor]| -> Result<Tensor> {
        let term = |(time, term): (usize, &Tensor)| term * discount.powi(time as i32);
        let terms: Vec<Tensor> =
            terms.iter().enumerate().map(term).collect::<candle_core::Result<_>>()?;
        Ok(Tensor::stack(&terms, 0)?.mean_all()?)
    };
    let gains: Vec<Tensor> = returns[1..]
        .iter()
        .zip(&imagined.entropies)
        .map(|(later, entropy)| later + (entropy * entropy_weight)?)
        .collect::<candle_core::Result<_>>()?;
    let seen = features.narrow(0, 0, steps * count)?.detach();
    let values = critic.values(&seen)?;
    let targets = Tensor::cat(&returns, 0)?.detach();
    let errors = ((&values - &targets)?.sqr()? * 0.5)?;
    let errors: Vec<Tensor> = (0..steps)
        .map(|time| errors.narrow(0, time * count, count))
        .collect::<candle_core::Result<_>>()?;
    let entropies = Tensor::stack(&imagined.entropies[..steps - 1], 0)?;
    Ok(BehaviourLosses {
        actor: weighted(&gains)?.neg()?,
        critic: weighted(&errors)?,
        entropy: entropies.mean_all()?.detach(),
        returns: targets.mean_all()?,
        values: values.mean_all()?.detach(),
    })
}
