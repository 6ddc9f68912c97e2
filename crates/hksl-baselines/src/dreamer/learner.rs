//! DreamerV2 as a [`Learner`].

use std::collections::BTreeMap;

use candle_core::{Device, Tensor};
use hksl_core::Encoder;
use hksl_core::optim::Adam;
use hksl_sac::diagnosis::{saturated, spread};
use hksl_sac::{Acting, Draw, Learner, Networks, Operations, RecurrentState, Result, UpdateReport};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::rssm::State;
use super::vision::{ConvDecoder, ConvEncoder};
use super::{DreamerV2, Sizes};

/// Names of the recurrent state's tensors.
const STOCHASTIC: &str = "stochastic";
const DETERMINISTIC: &str = "deterministic";
const ACTION: &str = "action";

/// Factor for the overhead of allocator and bookkeeping.
const MARGIN: f64 = 1.2;

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

    fn operations(&self) -> Result<Operations> {
        let Sizes { observation, encoder, config, .. } = &self.sizes;
        let images = (config.batch_sequences * config.sequence_length) as f64;
        let (forward, backward) = ConvEncoder::operations(*observation, *encoder, config)?;
        let drawn = ConvDecoder::operations(*observation, self.sizes.feature(), *encoder, config)?;
        let vision = images * (forward + backward + 3.0 * drawn);
        Ok(Operations {
            encoder_passes: 3,
            encoders: vision,
            encoders_executed: vision,
            networks: self.network_operations(),
        })
    }

    fn memory_bytes(&self) -> u64 {
        let Sizes { observation: [channels, height, width], encoder, config, .. } = &self.sizes;
        let images = config.batch_sequences * config.sequence_length;
        let slow = self.networks.parameters.under("targets").elements();
        let weights = 4 * (self.networks.parameters.elements() - slow) + slow;
        // Feature maps of encoder and decoder with their gradients, then the decoder's first maps and the images.
        let filters = encoder.filters.max(*channels);
        let maps = 4 * images * 4 * height * width * filters / 4;
        let drawn = 4 * images * channels * height * width;
        let states = images * (config.horizon + 1);
        let heads = config.behaviour_layers * config.behaviour_units
            + config.reward_layers * config.reward_units;
        let imagined = states * (3 * heads + 6 * self.sizes.feature());
        (MARGIN * (size_of::<f32>() * (weights + maps + drawn + imagined)) as f64) as u64
    }
}
