//! A learner with its replay and its random streams.

use std::borrow::Cow;
use std::collections::BTreeMap;

use candle_core::{Device, Tensor};
use hksl_core::rng;
use ndarray::ArrayView3;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use crate::agent::{Acting, Agent, AgentRest, AgentState, Draw, FeatureMaps, Learner, Memory};
use crate::config::{AugmentationConfig, ReplayConfig};
use crate::learner::{Operations, UpdateReport};
use crate::replay::{Layout, Replay, Sampler};
use crate::{Error, Result};

/// Acts, remembers and learns by a method: what all methods have in common.
#[derive(Debug)]
pub struct PixelAgent<L> {
    learner: L,
    pub(super) replay: Replay,
    sampler: Sampler,
    pub(super) device: Device,
    seed: u64,
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

impl<L: Learner> PixelAgent<L> {
    /// An agent of this learner with an empty replay and all its random streams derived from `seed`.
    ///
    /// `layout` says what single frames look like; its stack must give the observation, `(C, H, W)`, that the learner
    /// was built for, and its `action_dims` the numbers of an action, which is not checked here.
    ///
    /// # Errors
    /// [`Error::Size`] if the observation is another.
    pub fn of(
        learner: L,
        observation: [usize; 3],
        layout: Layout,
        replay: &ReplayConfig,
        augmentation: &AugmentationConfig,
        seed: u64,
        device: &Device,
    ) -> Result<Self> {
        let stacked = layout.observation();
        if stacked != observation {
            let (got, expected) = (stacked.iter().product(), observation.iter().product());
            return Err(Error::Size { what: "stacked observation", got, expected });
        }
        Ok(Self {
            learner,
            replay: Replay::new(layout, replay.capacity),
            sampler: Sampler::configured(augmentation),
            device: device.clone(),
            seed,
            streams: AgentStreams::new(seed),
        })
    }

    /// Its networks.
    pub fn learner(&self) -> &L {
        &self.learner
    }

    /// The learner, and what it draws from when it learns.
    fn learning(&mut self) -> (&mut L, Draw<'_>) {
        let AgentStreams { replay, augment, policy_noise, .. } = &mut self.streams;
        let random = [replay, augment, policy_noise];
        (&mut self.learner, Draw::learning(&self.replay, &self.sampler, &self.device, random))
    }
}

impl<L: Learner> Agent for PixelAgent<L> {
    fn act(
        &mut self,
        observation: ArrayView3<u8>,
        acting: Acting,
        memory: &mut Memory,
    ) -> Result<Vec<f32>> {
        if acting == Acting::Uniform {
            let mut draw = || self.streams.act.random_range(-1f32..=1.0);
            return Ok((0..self.replay.layout().action_dims).map(|_| draw()).collect());
        }
        let (channels, height, width) = observation.dim();
        let pixels: Vec<u8> = observation.iter().copied().collect();
        let pixels = Tensor::from_vec(pixels, (1, channels, height, width), &self.device)?;
        // An evaluation must give the same at any time, and leave the run as it was.
        let mut aside;
        let random = if acting == Acting::Sample {
            &mut self.streams.act
        } else {
            aside = rng::stream(self.seed, &format!("act in evaluation {}", memory.steps));
            &mut aside
        };
        let action = self.learner.action(&pixels, acting, random, memory)?;
        memory.steps += 1;
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

    fn pretrain(&mut self) -> Result<Option<UpdateReport>> {
        let (learner, mut draw) = self.learning();
        Ok(learner.pretrain(&mut draw)?.map(|report| draw.and(report)))
    }

    fn pretraining(&self) -> (u64, u64) {
        self.learner.pretraining()
    }

    fn update(&mut self, agent_step: u64) -> Result<Option<UpdateReport>> {
        let (learner, mut draw) = self.learning();
        Ok(learner.update(&mut draw, agent_step)?.map(|report| draw.and(report)))
    }

    fn diagnose(&self, random: &mut ChaCha8Rng) -> Result<Vec<(String, f64)>> {
        let mut draw = Draw::looking(&self.replay, &self.sampler, &self.device, random);
        let mut figures = self.learner.diagnose(&mut draw)?;
        if !figures.is_empty() {
            figures.extend(self.value_figures(random)?);
        }
        Ok(figures)
    }

    fn encode(&self, observations: &Tensor) -> Result<Vec<(String, Tensor)>> {
        self.learner.encode(observations)
    }

    fn feature_maps(&self, observations: &Tensor) -> Result<Vec<FeatureMaps>> {
        self.learner.feature_maps(observations)
    }

    fn operations(&self) -> Result<Operations> {
        self.learner.operations()
    }

    fn learning_bytes(&self) -> u64 {
        self.learner.memory_bytes()
    }

    fn networks(&self) -> Vec<(String, usize)> {
        self.learner.networks()
    }

    fn weights(&self) -> Result<BTreeMap<String, Tensor>> {
        let mut weights = self.learner.parameters().snapshot()?;
        weights.retain(|name, _| !is_target(name));
        Ok(weights)
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
        if let Some(name) = saved.into_keys().next() {
            let reason = "this agent has no such stream".to_owned();
            return Err(Error::SavedState { part: format!("random stream `{name}`"), reason });
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

fn is_target(name: &str) -> bool {
    TARGETS.iter().any(|part| name.split('.').next() == Some(part))
}

fn bytes(frame: ArrayView3<'_, u8>) -> Cow<'_, [u8]> {
    frame.to_slice().map_or_else(|| frame.iter().copied().collect(), Cow::Borrowed)
}
