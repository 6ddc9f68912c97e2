//! How good a policy is.

use std::sync::atomic::{AtomicBool, Ordering};

use candle_core::Device;
use hksl_core::rng;
use hksl_envs::Environment;
use hksl_sac::{Acting, Agent, Networks, Rollout};
use ndarray::ArrayView3;

use crate::config::Config;
use crate::factories::Factories;
use crate::{Result, checkpoint};

/// Returns of some episodes acted by the policy's deterministic actions.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// One return an episode, undiscounted.
    pub returns: Vec<f64>,
}

impl Evaluation {
    /// Their mean.
    pub fn mean(&self) -> f64 {
        self.returns.iter().sum::<f64>() / self.returns.len() as f64
    }

    /// Their standard deviation over the episodes (ddof 0).
    pub fn std(&self) -> f64 {
        let mean = self.mean();
        let squares = self.returns.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
        (squares / self.returns.len() as f64).sqrt()
    }

    /// The smallest return.
    pub fn min(&self) -> f64 {
        self.returns.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// The largest return.
    pub fn max(&self) -> f64 {
        self.returns.iter().copied().fold(f64::NEG_INFINITY, f64::max)
    }
}

/// The environment in which the evaluation at this environment step takes place: one of its own, drawn from
/// the seed and the step alone, so that the same weights evaluate to the same bits at any later time.
pub fn evaluation_environment(
    factories: &dyn Factories,
    config: &Config,
    environment_step: u64,
) -> Result<Box<dyn Environment>> {
    factories.environment(config, rng::stream(config.seed, &format!("eval {environment_step}")))
}

/// What an evaluation shows as it goes.
#[derive(Debug)]
pub enum Seen<'a> {
    /// A frame of an episode.
    Frame {
        /// Which episode, counted from 0.
        episode: usize,
        /// `(C, H, W)`.
        frame: ArrayView3<'a, u8>,
    },
    /// An episode is over.
    Return {
        /// Which episode, counted from 0.
        episode: usize,
        /// Its return.
        value: f64,
    },
}

/// Acts `episodes` episodes without learning. `watch` sees each frame and hears of each return as they come. None if
/// `stop` was set before the last of them ended.
///
/// # Errors
/// Whatever the environment or the agent reports.
pub fn evaluate(
    agent: &mut Agent,
    environment: &mut dyn Environment,
    frame_stack: usize,
    episodes: usize,
    stop: &AtomicBool,
    watch: &mut dyn FnMut(Seen),
) -> Result<Option<Evaluation>> {
    let mut rollout = Rollout::new(frame_stack, environment.spec().frame);
    let mut returns = Vec::with_capacity(episodes);
    for episode in 0..episodes {
        let frame = rollout.reset(environment)?;
        watch(Seen::Frame { episode, frame: frame.view() });
        let mut total = 0.0;
        loop {
            if stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            let action = rollout.act(agent, Acting::Mean)?;
            let (step, frame) = rollout.step(environment, &action)?;
            total += step.reward;
            if step.last {
                break;
            }
            watch(Seen::Frame { episode, frame: frame.view() });
        }
        watch(Seen::Return { episode, value: total });
        returns.push(total);
    }
    Ok(Some(Evaluation { returns }))
}

/// Gives networks of this configuration the weights, as safetensors, that its run kept at `environment_step`.
///
/// # Errors
/// [`checkpoint::Error::OtherWeights`] where they are not such an agent's.
pub fn load_weights(
    networks: &Networks,
    config: &Config,
    weights: &[u8],
    environment_step: u64,
) -> Result<()> {
    networks.load_weights(&hksl_core::from_safetensors(weights)?).map_err(|error| {
        checkpoint::Error::OtherWeights {
            environment_step,
            method: config.method.clone(),
            reason: error.to_string(),
        }
        .into()
    })
}

/// Evaluates weights as the run that they come from would have done at `environment_step`.
///
/// # Errors
/// Weights of another model; whatever the environment or the agent reports.
pub fn evaluate_weights(
    config: &Config,
    factories: &dyn Factories,
    weights: &[u8],
    environment_step: u64,
    episodes: usize,
    device: &Device,
    watch: &mut dyn FnMut(Seen),
) -> Result<Evaluation> {
    let mut environment = evaluation_environment(factories, config, environment_step)?;
    let mut agent = factories.agent(config, environment.spec(), device)?;
    load_weights(agent.networks(), config, weights, environment_step)?;
    let stack = config.environment.frame_stack;
    let never = AtomicBool::new(false);
    let evaluation = evaluate(&mut agent, environment.as_mut(), stack, episodes, &never, watch)?;
    Ok(evaluation.unwrap_or(Evaluation { returns: Vec::new() }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_of_returns() {
        let evaluation = Evaluation { returns: vec![1.0, 3.0, 8.0] };
        assert_eq!((evaluation.mean(), evaluation.min(), evaluation.max()), (4.0, 1.0, 8.0));
        assert!((evaluation.std() - (26.0f64 / 3.0).sqrt()).abs() < 1e-12);
    }
}
