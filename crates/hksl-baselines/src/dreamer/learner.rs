//! DreamerV2 as a [`Learner`].

use std::collections::BTreeMap;

use candle_core::{Device, Tensor};
use hksl_core::Encoder;
use hksl_core::optim::Adam;
use hksl_sac::diagnosis::{saturated, spread};
use hksl_sac::{Acting, Draw, Learner, Networks, RecurrentState, Result, UpdateReport};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::DreamerV2;
use super::rssm::State;

/// Names of the recurrent state's tensors.
const STOCHASTIC: &str = "stochastic";
const DETERMINISTIC: &str = "deterministic";
const ACTION: &str = "action";

impl DreamerV2 {
    fn uniform(&self, random: &mut ChaCha8Rng, count: usize, device: &Device) -> Result<Tensor> {
        let numbers: Vec<f32> = (0..count).map(|_| random.random()).collect();
        Ok(Tensor::from_vec(numbers, (1, count), device)?)
    }
}

impl Learner for DreamerV2 {
    fn networks(&self) -> &Networks {
        &self.networks
    }

    fn optimizers(&mut self) -> Vec<(String, &mut Adam)> {
        let Self { world_adam, actor_adam, critic_adam, .. } = self;
        let all = [("world", world_adam), ("actor", actor_adam), ("critic", critic_adam)];
        all.map(|(name, adam)| (name.to_owned(), adam)).into()
    }

    fn counters(&mut self) -> Vec<(&'static str, &mut u64)> {
        vec![("steps", &mut self.steps), ("pretrained", &mut self.pretrained)]
    }

    /// Updates the recurrent state with the observation and chooses an action for the new state.
    fn act(
        &self,
        observation: &Tensor,
        acting: Acting,
        random: &mut ChaCha8Rng,
        recurrent: &mut RecurrentState,
    ) -> Result<Tensor> {
        let (device, dims) = (observation.device(), self.sizes.action_dims);
        let world = &self.frozen_world;
        let remembered = |name: &str| recurrent.tensors.get(name);
        let (state, action) =
            match (remembered(STOCHASTIC), remembered(DETERMINISTIC), remembered(ACTION)) {
                (Some(stochastic), Some(deterministic), Some(action)) => {
                    let on = |tensor: &Tensor| tensor.to_device(device);
                    let (stochastic, deterministic) = (on(stochastic)?, on(deterministic)?);
                    (State { stochastic, deterministic }, on(action)?)
                }
                _ => {
                    let nothing = Tensor::zeros((1, dims), candle_core::DType::F32, device)?;
                    (world.rssm.initial_state(1, device)?, nothing)
                }
            };
        let embedding = world.encoder.forward(observation)?;
        let deterministic = world.rssm.advance(&state, &action)?;
        let logits = world.rssm.posterior(&deterministic, &embedding)?;
        let for_state = self.uniform(random, self.sizes.config.variables, device)?;
        let state = world.rssm.draw(deterministic, &logits, &for_state)?;
        let feature = state.feature()?;
        let action = if acting == Acting::Sample {
            self.policy(&feature, Some(&self.uniform(random, dims, device)?))?
        } else {
            self.policy(&feature, None)?
        };
        recurrent.tensors = BTreeMap::from([
            (STOCHASTIC.to_owned(), state.stochastic.detach()),
            (DETERMINISTIC.to_owned(), state.deterministic.detach()),
            (ACTION.to_owned(), action.detach()),
        ]);
        Ok(action)
    }

    fn pretrain(&mut self, draw: &mut Draw) -> Result<Option<UpdateReport>> {
        if self.pretrained >= self.sizes.config.pretraining_steps {
            return Ok(None);
        }
        let report = self.learn(draw)?;
        self.pretrained += u64::from(report.is_some());
        Ok(report)
    }

    fn pretraining(&self) -> (u64, u64) {
        (self.pretrained, self.sizes.config.pretraining_steps)
    }

    fn update(&mut self, draw: &mut Draw, agent_step: u64) -> Result<Option<UpdateReport>> {
        if agent_step.is_multiple_of(self.sizes.config.train_every) {
            self.learn(draw)
        } else {
            Ok(None)
        }
    }

    fn diagnose(&self, draw: &mut Draw) -> Result<Vec<(String, f64)>> {
        let Some((sequences, uniform)) = self.draw(draw)? else { return Ok(Vec::new()) };
        let filtered = self.frozen_world.filter(&sequences, &uniform.posterior)?;
        let embeddings =
            self.frozen_world.encoder.forward(&sequences.observations.flatten_to(1)?)?;
        let (std, rank) = spread(&embeddings)?;
        let feature = filtered.starts()?.feature()?;
        let actions = self.policy(&feature, uniform.actions.first())?;
        Ok(vec![
            ("latent_std".to_owned(), std),
            ("latent_rank".to_owned(), rank),
            ("saturated_actions".to_owned(), saturated(&actions)?),
        ])
    }
}
