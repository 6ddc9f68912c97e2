//! The HKSL agent: the learner with its replay and its random streams.

use std::collections::BTreeMap;
use std::time::Instant;

use candle_core::{Device, Tensor};
use hksl_core::nn::PixelEncoder;
use hksl_core::{Encoder, rng};
use ndarray::ArrayView3;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use crate::agent::{Acting, Agent, AgentRest, AgentState, FeatureMaps, Field};
use crate::config::{AugmentationConfig, ReplayConfig};
use crate::learner::{
    Architecture, HkslLearner, LearningBatch, Noise, Phase, Schedule, UpdateReport,
};
use crate::replay::{Layout, Replay, Sampler};
use crate::{Error, Result};

/// Acts, remembers and learns by HKSL and soft actor-critic.
#[derive(Debug)]
pub struct HkslAgent {
    pub(super) learner: HkslLearner,
    pub(super) replay: Replay,
    sampler: Sampler,
    pub(super) device: Device,
    streams: AgentStreams,
}

#[derive(Debug)]
struct AgentStreams {
    act: ChaCha8Rng,
    replay: ChaCha8Rng,
    augment: ChaCha8Rng,
    policy_noise: ChaCha8Rng,
}

impl AgentStreams {
    const NAMES: [&'static str; 4] = ["act", "replay", "augment", "policy noise"];

    fn new(seed: u64) -> Self {
        let [act, replay, augment, policy_noise] = Self::NAMES.map(|name| rng::stream(seed, name));
        Self { act, replay, augment, policy_noise }
    }

    fn each(&mut self) -> [&mut ChaCha8Rng; 4] {
        [&mut self.act, &mut self.replay, &mut self.augment, &mut self.policy_noise]
    }
}

/// The parts of the parameters that belong to learning only.
const TARGETS: [&str; 2] = ["targets", "momentum"];

impl HkslAgent {
    /// A new agent with all its random streams derived from `seed`.
    ///
    /// `layout` says what single frames look like; its stack must give the architecture's observation.
    ///
    /// # Errors
    /// Sizes out of range.
    pub fn new(
        architecture: Architecture,
        layout: Layout,
        replay: &ReplayConfig,
        augmentation: &AugmentationConfig,
        seed: u64,
        device: &Device,
    ) -> Result<Self> {
        let (stacked, expected) = (layout.observation(), architecture.observation);
        if stacked != expected {
            let (got, expected) = (stacked.iter().product(), expected.iter().product());
            return Err(Error::Size { what: "stacked observation", got, expected });
        }
        Ok(Self {
            learner: HkslLearner::new(architecture, seed, device)?,
            replay: Replay::new(layout, replay.capacity),
            sampler: Sampler::new(augmentation.pad),
            device: device.clone(),
            streams: AgentStreams::new(seed),
        })
    }

    /// Its networks.
    pub fn learner(&self) -> &HkslLearner {
        &self.learner
    }

    fn schedule(&self, agent_step: u64) -> Schedule {
        let Architecture { hksl, sac, .. } = self.learner.architecture();
        Schedule {
            actor: agent_step.is_multiple_of(hksl.actor_update_every),
            targets: agent_step.is_multiple_of(sac.target_update_every),
        }
    }

    /// Encoders by name: `level 1`, the finest, and so on; `shared` where there is one.
    fn encoder_names(&self) -> Vec<String> {
        let config = self.learner.hierarchy().config();
        if config.shared_encoder {
            return vec!["shared".to_owned()];
        }
        (1..=config.levels()).map(|level| format!("level {level}")).collect()
    }
}

impl Agent for HkslAgent {
    fn act(&mut self, observation: ArrayView3<u8>, acting: Acting) -> Result<Vec<f32>> {
        let action_dims = self.learner.architecture().action_dims;
        if acting == Acting::Uniform {
            let mut draw = || self.streams.act.random_range(-1f32..=1.0);
            return Ok((0..action_dims).map(|_| draw()).collect());
        }
        let (channels, height, width) = observation.dim();
        let pixels: Vec<u8> = observation.iter().copied().collect();
        let pixels = Tensor::from_vec(pixels, (1, channels, height, width), &self.device)?;
        let (learner, streams) = (&self.learner, &mut self.streams);
        let latents = learner.hierarchy().encode(&pixels)?;
        let action = if acting == Acting::Sample {
            let noise = rng::standard_normal(&mut streams.act, &[1, action_dims], &self.device)?;
            learner.policy().sample(&latents, &noise)?.action
        } else {
            learner.policy().mean(&latents)?
        };
        let action = action.flatten_all()?.to_vec1::<f32>()?;
        Ok(action.into_iter().map(|number| number.clamp(-1.0, 1.0)).collect())
    }

    fn begin_episode(&mut self, frame: ArrayView3<u8>) -> Result<()> {
        self.replay.begin_episode(&bytes(frame))
    }

    fn observe(
        &mut self,
        action: &[f32],
        reward: f64,
        terminal: bool,
        frame: ArrayView3<u8>,
    ) -> Result<()> {
        self.replay.push(action, reward as f32, terminal, &bytes(frame))
    }

    fn end_episode(&mut self) {
        self.replay.end_episode();
    }

    fn update(&mut self, agent_step: u64) -> Result<Option<UpdateReport>> {
        let mut clock = Instant::now();
        let architecture = self.learner.architecture();
        let (count, length) = (architecture.sac.batch_size, architecture.hksl.trajectory_length);
        let Some(starts) = self.replay.starts(&mut self.streams.replay, count, length) else {
            return Ok(None);
        };
        let mut sampling = UpdateReport::default();
        sampling.lap(Phase::Sample, &mut clock);
        let batch = self.sampler.batch(&self.replay, &starts, length, &mut self.streams.augment);
        sampling.lap(Phase::Augment, &mut clock);
        let (trajectories, rewards, not_done) = batch.to_device(&self.device)?;
        let batch = LearningBatch { trajectories, rewards, not_done };
        let noise = noise(&self.learner, &mut self.streams.policy_noise, &self.device)?;
        sampling.lap(Phase::Sample, &mut clock);
        let report = self.learner.step(&batch, &noise, self.schedule(agent_step))?;
        Ok(Some(sampling.merge(report)))
    }

    fn diagnose(&self, random: &mut ChaCha8Rng) -> Result<Vec<(String, f64)>> {
        let architecture = self.learner.architecture();
        let (count, length) = (architecture.sac.batch_size, architecture.hksl.trajectory_length);
        let Some(starts) = self.replay.starts(random, count, length) else {
            return Ok(Vec::new());
        };
        let batch = self.sampler.batch(&self.replay, &starts, length, random);
        let (trajectories, rewards, not_done) = batch.to_device(&self.device)?;
        let batch = LearningBatch { trajectories, rewards, not_done };
        let mut figures =
            self.learner.diagnose(&batch, &noise(&self.learner, random, &self.device)?)?;
        figures.extend(self.value_bias(random)?);
        Ok(figures)
    }

    fn encode(&self, observations: &Tensor) -> Result<Vec<(String, Tensor)>> {
        let hierarchy = self.learner.hierarchy();
        let latents = (0..).map(|index| hierarchy.frozen_encoder(index).forward(observations));
        let named = self.encoder_names().into_iter().zip(latents);
        named.map(|(name, latents)| Ok((name, latents?))).collect()
    }

    fn feature_maps(&self, observations: &Tensor) -> Result<Vec<FeatureMaps>> {
        let hierarchy = self.learner.hierarchy();
        let maps = (0..).map(|index| hierarchy.frozen_encoder(index).feature_maps(observations));
        let (side, spacing) = PixelEncoder::map_field();
        let field = Field { side, spacing };
        let named = self.encoder_names().into_iter().zip(maps);
        named.map(|(encoder, maps)| Ok(FeatureMaps { encoder, maps: maps?, field })).collect()
    }

    fn learning_bytes(&self) -> u64 {
        self.learner.memory_bytes()
    }

    fn networks(&self) -> Vec<(String, usize)> {
        let parameters = self.learner.parameters();
        let count = |prefix: &str| parameters.under(prefix).elements();
        let hierarchy = self.learner.hierarchy();
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

    fn weights(&self) -> BTreeMap<String, Tensor> {
        let mut weights = self.learner.parameters().tensors();
        weights.retain(|name, _| !is_target(name));
        weights
    }

    fn load_weights(&mut self, weights: &BTreeMap<String, Tensor>) -> Result<()> {
        let mut all = self.learner.parameters().tensors();
        all.retain(|name, _| is_target(name));
        if let Some(name) = weights.keys().find(|name| is_target(name)) {
            return Err(hksl_core::Error::UnknownParameter(name.clone()).into());
        }
        all.extend(weights.iter().map(|(name, tensor)| (name.clone(), tensor.clone())));
        Ok(self.learner.parameters().load(&all)?)
    }

    fn save(&self) -> Result<AgentState> {
        let AgentStreams { act, replay, augment, policy_noise } = &self.streams;
        let streams = AgentStreams::NAMES.into_iter().zip([act, replay, augment, policy_noise]);
        let streams = streams.map(|(name, rng)| (name.to_owned(), rng.clone())).collect();
        Ok(AgentState { tensors: self.learner.state()?, rest: AgentRest { streams } })
    }

    fn load(&mut self, state: AgentState) -> Result<()> {
        let mut saved = state.rest.streams;
        let mut streams = AgentStreams::new(0);
        for (name, rng) in AgentStreams::NAMES.into_iter().zip(streams.each()) {
            *rng = saved.remove(name).ok_or_else(|| Error::SavedState {
                part: format!("random stream `{name}`"),
                reason: "it is missing".to_owned(),
            })?;
        }
        self.learner.load(&state.tensors)?;
        self.streams = streams;
        Ok(())
    }

    fn replay(&self) -> &Replay {
        &self.replay
    }

    fn replay_mut(&mut self) -> &mut Replay {
        &mut self.replay
    }
}

/// The noise of one learning step.
fn noise(learner: &HkslLearner, random: &mut ChaCha8Rng, device: &Device) -> Result<Noise> {
    let architecture = learner.architecture();
    let shape = [architecture.sac.batch_size, architecture.action_dims];
    let mut draw = || rng::standard_normal(random, &shape, device);
    let levels = architecture.hksl.skips.iter();
    let critics = levels.map(|_| draw()).collect::<hksl_core::Result<_>>()?;
    Ok(Noise { critics, actor: draw()? })
}

fn is_target(name: &str) -> bool {
    TARGETS.iter().any(|part| name.split('.').next() == Some(part))
}

fn bytes(frame: ArrayView3<'_, u8>) -> std::borrow::Cow<'_, [u8]> {
    frame.to_slice().map_or_else(|| frame.iter().copied().collect(), std::borrow::Cow::Borrowed)
}
