//! DreamerV2 as a method of the agent.

use std::collections::BTreeMap;

use candle_core::{Device, Tensor};
use hksl_core::Parameters;
use hksl_core::named::{nothing_left, prefixed, take, take_count};
use hksl_core::optim::{Adam, load_into, state_of};
use hksl_sac::diagnosis::{saturated, spread};
use hksl_sac::learner::{Operations, UpdateReport};
use hksl_sac::{Acting, Draw, FeatureMaps, Learner, Memory, Result};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::rssm::State;
use super::vision::{Eye, Hand};
use super::{DreamerV2, Sizes};

/// What the agent remembers of an episode.
const STOCHASTIC: &str = "stochastic";
const DETERMINISTIC: &str = "deterministic";
const ACTION: &str = "action";

/// Counters in a saved state.
const STEPS: &str = "steps";
const PRETRAINED: &str = "pretrained";

/// The encoder's name.
const ENCODER: &str = "encoder";

/// What allocator and bookkeeping add.
const MARGIN: f64 = 1.2;

impl DreamerV2 {
    fn optimisers(&self) -> [(&'static str, &Adam); 3] {
        [("world", &self.world_adam), ("actor", &self.actor_adam), ("critic", &self.critic_adam)]
    }

    fn uniform(&self, random: &mut ChaCha8Rng, count: usize, device: &Device) -> Result<Tensor> {
        let numbers: Vec<f32> = (0..count).map(|_| random.random()).collect();
        Ok(Tensor::from_vec(numbers, (1, count), device)?)
    }
}

impl Learner for DreamerV2 {
    fn parameters(&self) -> &Parameters {
        self.parameters()
    }

    fn discount(&self) -> f64 {
        self.sizes.config.discount
    }

    /// Filters the observation into the remembered state, and acts from there.
    fn action(
        &self,
        observation: &Tensor,
        acting: Acting,
        random: &mut ChaCha8Rng,
        memory: &mut Memory,
    ) -> Result<Tensor> {
        let (device, dims) = (observation.device(), self.sizes.action_dims);
        let world = &self.frozen_world;
        let remembered = |name: &str| memory.tensors.get(name);
        let (state, action) =
            match (remembered(STOCHASTIC), remembered(DETERMINISTIC), remembered(ACTION)) {
                (Some(stochastic), Some(deterministic), Some(action)) => {
                    let on = |tensor: &Tensor| tensor.to_device(device);
                    let (stochastic, deterministic) = (on(stochastic)?, on(deterministic)?);
                    (State { stochastic, deterministic }, on(action)?)
                }
                _ => {
                    let nothing = Tensor::zeros((1, dims), candle_core::DType::F32, device)?;
                    (world.rssm.start(1, device)?, nothing)
                }
            };
        let embedding = world.eye.forward(observation)?;
        let deterministic = world.rssm.advance(&state, &action)?;
        let logits = world.rssm.posterior(&deterministic, &embedding)?;
        let for_state = self.uniform(random, self.sizes.config.variables, device)?;
        let state = world.rssm.draw(deterministic, &logits, &for_state)?;
        let feature = state.feature()?;
        let action = if acting == Acting::Sample {
            self.act(&feature, Some(&self.uniform(random, dims, device)?))?
        } else {
            self.act(&feature, None)?
        };
        memory.tensors = BTreeMap::from([
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
        let embeddings = self.frozen_world.eye.forward(&sequences.observations.flatten_to(1)?)?;
        let (std, rank) = spread(&embeddings)?;
        let feature = filtered.starts()?.feature()?;
        let actions = self.act(&feature, uniform.actions.first())?;
        Ok(vec![
            ("latent_std".to_owned(), std),
            ("latent_rank".to_owned(), rank),
            ("saturated_actions".to_owned(), saturated(&actions)?),
        ])
    }

    /// None: its critic judges states of the model, not single observations and actions.
    fn values(&self, _: &Tensor, _: &Tensor) -> Result<Vec<(String, Vec<f64>)>> {
        Ok(Vec::new())
    }

    fn encode(&self, observations: &Tensor) -> Result<Vec<(String, Tensor)>> {
        Ok(vec![(ENCODER.to_owned(), self.frozen_world.eye.forward(observations)?)])
    }

    fn feature_maps(&self, observations: &Tensor) -> Result<Vec<FeatureMaps>> {
        Ok(vec![self.frozen_world.eye.feature_maps(ENCODER, observations)?])
    }

    fn networks(&self) -> Vec<(String, usize)> {
        let parts = [
            ("encoder", "encoder"),
            ("state-space model", "rssm"),
            ("decoder", "decoder"),
            ("reward head", "reward"),
            ("actor", "actor"),
            ("critic", "critic"),
        ];
        let count = |(name, prefix): (&str, &str)| {
            (name.to_owned(), self.parameters.under(prefix).elements())
        };
        parts.into_iter().map(count).collect()
    }

    fn operations(&self) -> Result<Operations> {
        let Sizes { observation, encoder, config, .. } = &self.sizes;
        let pictures = (config.batch_sequences * config.sequence_length) as f64;
        let (forward, backward) = Eye::operations(*observation, *encoder, config)?;
        let drawn = Hand::operations(*observation, self.sizes.feature(), *encoder, config)?;
        let vision = pictures * (forward + backward + 3.0 * drawn);
        Ok(Operations {
            encoder_passes: 3,
            encoders: vision,
            encoders_executed: vision,
            networks: self.network_operations(),
        })
    }

    fn memory_bytes(&self) -> u64 {
        let Sizes { observation: [channels, height, width], encoder, config, .. } = &self.sizes;
        let pictures = config.batch_sequences * config.sequence_length;
        let slow = self.parameters.under("targets").elements();
        let weights = 4 * (self.parameters.elements() - slow) + slow;
        // Encoder and decoder keep their maps, and as many gradients are on the way; the decoder's first maps and the
        // pictures themselves come on top.
        let filters = encoder.filters.max(*channels);
        let maps = 4 * pictures * 4 * height * width * filters / 4;
        let drawn = 4 * pictures * channels * height * width;
        let states = pictures * (config.horizon + 1);
        let heads = config.behaviour_layers * config.behaviour_units
            + config.reward_layers * config.reward_units;
        let imagined = states * (3 * heads + 6 * self.sizes.feature());
        (MARGIN * (size_of::<f32>() * (weights + maps + drawn + imagined)) as f64) as u64
    }

    fn state(&self) -> Result<BTreeMap<String, Tensor>> {
        let mut state = prefixed("weights", self.parameters.snapshot()?);
        state.extend(prefixed("moments", state_of(self.optimisers())?));
        for (name, count) in [(STEPS, self.steps), (PRETRAINED, self.pretrained)] {
            state.insert(name.to_owned(), Tensor::new(count as i64, &Device::Cpu)?);
        }
        Ok(state)
    }

    fn load(&mut self, state: &BTreeMap<String, Tensor>) -> Result<()> {
        let mut rest = state.clone();
        let (weights, moments) = (take(&mut rest, "weights"), take(&mut rest, "moments"));
        let counts = (take_count(&mut rest, STEPS)?, take_count(&mut rest, PRETRAINED)?);
        nothing_left(&rest)?;
        self.parameters.check(&weights)?;
        let Self { world_adam, actor_adam, critic_adam, .. } = self;
        let optimisers = [("world", world_adam), ("actor", actor_adam), ("critic", critic_adam)];
        load_into(optimisers, moments)?;
        self.parameters.load(&weights)?;
        (self.steps, self.pretrained) = counts;
        Ok(())
    }
}
