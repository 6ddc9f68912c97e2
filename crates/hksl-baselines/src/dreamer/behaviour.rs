//! Actor and critic, in imagination.

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

/// The smallest deviation of the policy.
const LEAST_DEVIATION: f64 = 0.1;

/// The policy: a truncated normal distribution from a feature.
///
/// Parameters: `{0, 2, …}`.
#[derive(Debug)]
pub struct DreamerActor(Mlp);

impl DreamerActor {
    pub(super) fn new(builder: &mut Builder, sizes: &Sizes) -> Result<Self> {
        Ok(Self(head(builder, sizes, 2 * sizes.action_dims)?))
    }

    /// Location and deviation, `(N, A)` each: `tanh(m)` and `2 σ(s/2) + 0.1`.
    ///
    /// # Errors
    /// Features of another size.
    pub fn distribution(&self, features: &Tensor) -> Result<(Tensor, Tensor)> {
        let parts = self.0.forward(features)?.chunk(2, D::Minus1)?;
        // 2 σ(s/2) = 1 + tanh(s/4).
        let deviation = ((&parts[1] * 0.25)?.tanh()? + (1.0 + LEAST_DEVIATION))?;
        Ok((parts[0].tanh()?, deviation))
    }
}

/// The value of a feature.
///
/// Parameters: `{0, 2, …}`.
#[derive(Debug)]
pub struct DreamerCritic(Mlp);

impl DreamerCritic {
    pub(super) fn new(builder: &mut Builder, sizes: &Sizes) -> Result<Self> {
        Ok(Self(head(builder, sizes, 1)?))
    }

    /// `(N)`.
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

/// Imagined trajectories: of the states `0…H`, and of the actions at `0…H−1`.
#[derive(Debug)]
pub struct Imagined {
    /// `H + 1` of `(N, …)`.
    pub features: Vec<Tensor>,
    /// `H` of `(N, A)`.
    pub actions: Vec<Tensor>,
    /// Of the policy at `0…H−1`, summed over an action's numbers: `H` of `(N)`.
    pub entropies: Vec<Tensor>,
}

/// Imagines `uniform_actions.len()` steps from `starts`. A gradient reaches the actor, through all that follows from
/// its actions; `world` must be without gradient.
///
/// # Shapes
/// - `starts`: `(N, …)`
/// - `uniform_actions`: `H` of `(N, A)`
/// - `uniform_states`: `H` of `(N, V)`
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

/// What actor and critic learn from imagined trajectories.
#[derive(Debug)]
pub struct BehaviourLosses {
    /// A gradient reaches the actor.
    pub actor: Tensor,
    /// A gradient reaches the critic.
    pub critic: Tensor,
    /// The policy's mean entropy.
    pub entropy: Tensor,
    /// The mean return, without gradient.
    pub returns: Tensor,
    /// The mean value, without gradient.
    pub values: Tensor,
}

/// The losses: the actor's is `−mean(γ^t (G_{t+1} + η H_t))` over `t = 0…H−2`, for no action of these trajectories
/// bears on `G_0`; the critic's `mean(γ^t ½ (v(s_t) − G_t)²)` over `t = 0…H−1` (DreamerV2 §2.3).
///
/// # Errors
/// Shapes that do not fit.
pub fn losses(
    world: &WorldModel,
    critic: &DreamerCritic,
    slow_critic: &DreamerCritic,
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
    let slow_values = by_time(&slow_critic.values(&features)?)?;
    let returns = lambda_returns(&rewards, &slow_values, discount, lambda)?;
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
