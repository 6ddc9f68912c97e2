//! HKSL as a method of the agent.

use std::collections::BTreeMap;

use candle_core::{Device, Tensor};
use hksl_core::{Encoder, Parameters, rng};
use rand_chacha::ChaCha8Rng;

use crate::Result;
use crate::agent::{Acting, Draw, FeatureMaps, Learner, Memory, PixelAgent, feature_maps_of};
use crate::config::{AugmentationConfig, ReplayConfig};
use crate::learner::{
    Architecture, HkslLearner, LearningBatch, Noise, Operations, Schedule, UpdateReport,
};
use crate::replay::Layout;

/// Acts, remembers and learns by HKSL and soft actor-critic.
pub type HkslAgent = PixelAgent<HkslLearner>;

impl HkslAgent {
    /// A new agent with all its random streams derived from `seed`.
    ///
    /// `layout` says what single frames look like; its stack must give the architecture's observation. Episodes shorter
    /// than `trajectory_length` are never sampled, so an agent that meets no longer ones never learns.
    ///
    /// # Errors
    /// Settings out of range, a layout that does not fit.
    pub fn new(
        architecture: Architecture,
        layout: Layout,
        replay: &ReplayConfig,
        augmentation: &AugmentationConfig,
        seed: u64,
        device: &Device,
    ) -> Result<Self> {
        let observation = architecture.observation;
        let learner = HkslLearner::new(architecture, seed, device)?;
        Self::of(learner, observation, layout, replay, augmentation, seed, device)
    }
}

impl HkslLearner {
    fn schedule(&self, agent_step: u64) -> Schedule {
        let Architecture { hksl, sac, .. } = self.architecture();
        Schedule {
            actor: agent_step.is_multiple_of(hksl.actor_update_every),
            targets: agent_step.is_multiple_of(sac.target_update_every),
        }
    }

    /// Encoders by name: `level 1`, the finest, and so on; `shared` where there is one.
    fn encoder_names(&self) -> Vec<String> {
        let config = self.hierarchy().config();
        if config.shared_encoder {
            return vec!["shared".to_owned()];
        }
        (1..=config.levels()).map(|level| format!("level {level}")).collect()
    }

    /// A batch of trajectories and the noise of a step; none if nothing can be sampled yet.
    fn draw(&self, draw: &mut Draw) -> Result<Option<(LearningBatch, Noise)>> {
        let Architecture { hksl, sac, action_dims, .. } = self.architecture();
        let (count, length) = (sac.batch_size, hksl.trajectory_length);
        let Some(starts) = draw.starts(count, length) else { return Ok(None) };
        let batch = draw.batch(&starts, length)?;
        let shape = [count, *action_dims];
        let critics = hksl.skips.iter().map(|_| draw.normal(&shape)).collect::<Result<_>>()?;
        Ok(Some((batch, Noise { critics, actor: draw.normal(&shape)? })))
    }
}

impl Learner for HkslLearner {
    fn parameters(&self) -> &Parameters {
        self.parameters()
    }

    fn discount(&self) -> f64 {
        self.architecture().sac.discount
    }

    fn action(
        &self,
        observation: &Tensor,
        acting: Acting,
        random: &mut ChaCha8Rng,
        _: &mut Memory,
    ) -> Result<Tensor> {
        let latents = self.hierarchy().encode(observation)?;
        if acting == Acting::Sample {
            let shape = [1, self.architecture().action_dims];
            let noise = rng::standard_normal(random, &shape, observation.device())?;
            return Ok(self.policy().sample(&latents, &noise)?.action);
        }
        self.policy().mean(&latents)
    }

    fn update(&mut self, draw: &mut Draw, agent_step: u64) -> Result<Option<UpdateReport>> {
        let Some((batch, noise)) = self.draw(draw)? else { return Ok(None) };
        self.step(&batch, &noise, self.schedule(agent_step)).map(Some)
    }

    fn diagnose(&self, draw: &mut Draw) -> Result<Vec<(String, f64)>> {
        match self.draw(draw)? {
            Some((batch, noise)) => self.diagnose(&batch, &noise),
            None => Ok(Vec::new()),
        }
    }

    fn values(&self, observations: &Tensor, actions: &Tensor) -> Result<Vec<(String, Vec<f64>)>> {
        let values = |level: usize| {
            let values = self.values(level, observations, actions)?;
            Ok((format!("_{}", level + 1), values))
        };
        (0..self.hierarchy().config().levels()).map(values).collect()
    }

    fn encode(&self, observations: &Tensor) -> Result<Vec<(String, Tensor)>> {
        let hierarchy = self.hierarchy();
        let latents = (0..).map(|index| hierarchy.frozen_encoder(index).forward(observations));
        let named = self.encoder_names().into_iter().zip(latents);
        named.map(|(name, latents)| Ok((name, latents?))).collect()
    }

    fn feature_maps(&self, observations: &Tensor) -> Result<Vec<FeatureMaps>> {
        let names = self.encoder_names().into_iter().enumerate();
        let maps = |(index, name)| {
            feature_maps_of(name, self.hierarchy().frozen_encoder(index), observations)
        };
        names.map(maps).collect()
    }

    fn networks(&self) -> Vec<(String, usize)> {
        let parameters = self.parameters();
        let count = |prefix: &str| parameters.under(prefix).elements();
        let hierarchy = self.hierarchy();
        let mut networks = Vec::new();
        for (index, name) in self.encoder_names().into_iter().enumerate() {
            networks.push((format!("encoder, {name}"), count(&hierarchy.encoder_name(index))));
        }
        for level in 0..hierarchy.config().levels() {
            let part = |name: &str| count(&format!("levels.{level}.{name}"));
            let model = part("forward_model") + part("communication") + part("projection");
            networks.push((format!("forward model, level {}", level + 1), model));
        }
        for level in 0..hierarchy.config().levels() {
            let critic = count(&format!("critics.{level}"));
            networks.push((format!("twin critics, level {}", level + 1), critic));
        }
        networks.push(("actor".to_owned(), count("actor")));
        networks
    }

    fn operations(&self) -> Result<Operations> {
        Operations::of(self.architecture())
    }

    fn memory_bytes(&self) -> u64 {
        self.memory_bytes()
    }

    fn state(&self) -> Result<BTreeMap<String, Tensor>> {
        self.state()
    }

    fn load(&mut self, state: &BTreeMap<String, Tensor>) -> Result<()> {
        self.load(state)
    }
}
