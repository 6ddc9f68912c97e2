//! The agent: a method with its replay, its random number generators and its checkpoints.

use std::borrow::Cow;
use std::collections::BTreeMap;

use candle_core::{Device, Tensor};
use hksl_core::rng;
use ndarray::ArrayView3;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::config::{AugmentationConfig, ReplayConfig};
use crate::draw::Draw;
use crate::learner::{Acting, Learner, RecurrentState};
use crate::networks::Networks;
use crate::replay::{Layout, Replay, Sampler};
use crate::update_report::UpdateReport;
use crate::value_diagnosis::value_figures;
use crate::{Error, Result};

/// An agent's random number generators by name, positions included.
pub type Streams = BTreeMap<String, ChaCha8Rng>;

/// Everything that an agent needs to resume, except its replay.
#[derive(Debug, Clone)]
pub struct AgentState {
    /// Weights, moments and counters.
    pub tensors: BTreeMap<String, Tensor>,
    /// What is not a tensor.
    pub rest: AgentRest,
}

/// The part of an [`AgentState`] that is not a tensor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AgentRest {
    /// Random number generators with their positions.
    pub streams: Streams,
}

/// Acts, stores what happens and learns by a method.
///
/// The caller brings the observations. Frames handed to [`Agent::begin_episode`] and [`Agent::observe`] are single
/// ones, which the replay stacks when it is sampled.
#[derive(Debug)]
pub struct Agent {
    learner: Box<dyn Learner>,
    replay: Replay,
    sampler: Sampler,
    device: Device,
    seed: u64,
    generators: Generators,
}

#[derive(Debug)]
struct Generators {
    act: ChaCha8Rng,
    replay: ChaCha8Rng,
    augment: ChaCha8Rng,
    policy_noise: ChaCha8Rng,
}

impl Generators {
    const NAMES: [&'static str; 4] = ["act", "replay", "augment", "policy noise"];

    fn new(seed: u64) -> Self {
        let [act, replay, augment, policy_noise] = Self::NAMES.map(|name| rng::stream(seed, name));
        Self { act, replay, augment, policy_noise }
    }

    fn each(&mut self) -> [&mut ChaCha8Rng; 4] {
        [&mut self.act, &mut self.replay, &mut self.augment, &mut self.policy_noise]
    }
}

impl Agent {
    /// An agent of this method with an empty replay and all its random number generators derived from `seed`.
    ///
    /// `layout` describes single frames; stacked, they must give the observation that the networks read. Its
    /// `action_dims` must be the networks' too, which is not checked here.
    ///
    /// # Errors
    /// [`Error::Size`] if the networks read another observation.
    pub fn new(
        learner: Box<dyn Learner>,
        layout: Layout,
        replay: &ReplayConfig,
        augmentation: &AugmentationConfig,
        seed: u64,
        device: &Device,
    ) -> Result<Self> {
        let (stacked, read) = (layout.observation(), learner.networks().observation);
        if stacked != read {
            let (got, expected) = (stacked.iter().product(), read.iter().product());
            return Err(Error::Size { what: "stacked observation", got, expected });
        }
        Ok(Self {
            learner,
            replay: Replay::new(layout, replay.capacity),
            sampler: Sampler::configured(augmentation),
            device: device.clone(),
            seed,
            generators: Generators::new(seed),
        })
    }

    /// The method.
    pub fn learner(&self) -> &dyn Learner {
        self.learner.as_ref()
    }

    /// The method's networks.
    pub fn networks(&self) -> &Networks {
        self.learner.networks()
    }

    /// The stored transitions.
    pub fn replay(&self) -> &Replay {
        &self.replay
    }

    /// The stored transitions, to restore them.
    pub fn replay_mut(&mut self) -> &mut Replay {
        &mut self.replay
    }

    /// An action for an observation `(stack·C, H, W)`, frames oldest first, with an episode's first frame in place of
    /// the frames before it. Each component lies in [−1, 1]. `state` belongs to the observation's episode. Acting by
    /// the deterministic action leaves all generators of the agent as they are.
    ///
    /// # Errors
    /// An observation of another shape.
    pub fn act(
        &mut self,
        observation: ArrayView3<u8>,
        acting: Acting,
        state: &mut RecurrentState,
    ) -> Result<Vec<f32>> {
        if acting == Acting::Uniform {
            let mut component = || self.generators.act.random_range(-1f32..=1.0);
            return Ok((0..self.replay.layout().action_dims).map(|_| component()).collect());
        }
        let (channels, height, width) = observation.dim();
        let pixels: Vec<u8> = observation.iter().copied().collect();
        let pixels = Tensor::from_vec(pixels, (1, channels, height, width), &self.device)?;
        // An evaluation must give the same at any time, and leave the run as it was.
        let mut apart;
        let random = if acting == Acting::Sample {
            &mut self.generators.act
        } else {
            apart = rng::stream(self.seed, &format!("act in evaluation {}", state.steps));
            &mut apart
        };
        let action = self.learner.act(&pixels, acting, random, state)?;
        state.steps += 1;
        let action = action.flatten_all()?.to_vec1::<f32>()?;
        Ok(action.into_iter().map(|component| component.clamp(-1.0, 1.0)).collect())
    }

    /// Begins an episode with this frame `(C, H, W)`.
    ///
    /// # Errors
    /// A frame of another shape.
    pub fn begin_episode(&mut self, frame: ArrayView3<u8>) -> Result<()> {
        self.replay.begin_episode(&bytes(frame))
    }

    /// Stores a transition of the running episode and the frame that it led to. `terminal` says that the decision
    /// process ended there; a time limit does not end it.
    ///
    /// # Errors
    /// A frame or an action of another shape; no running episode.
    pub fn observe(
        &mut self,
        action: &[f32],
        reward: f64,
        terminal: bool,
        frame: ArrayView3<u8>,
    ) -> Result<()> {
        self.replay.push(action, reward as f32, terminal, &bytes(frame))
    }

    /// Ends the running episode. From now on it can be sampled.
    pub fn end_episode(&mut self) {
        self.replay.end_episode();
    }

    /// One learning step at this agent step, counted from 0, between choosing its action and taking it. None if none
    /// is due, or while nothing can be sampled. Actor and target updates run when `agent_step` is a multiple of their
    /// period. The caller leaves out the initial random steps (paper: 1000).
    ///
    /// # Errors
    /// Whatever the method reports.
    pub fn update(&mut self, agent_step: u64) -> Result<Option<UpdateReport>> {
        let (learner, mut draw) = self.learning();
        Ok(learner.update(&mut draw, agent_step)?.map(|report| draw.and(report)))
    }

    /// One of the learning steps before the first agent step that learns. None when there are no more, or while nothing
    /// can be sampled.
    ///
    /// # Errors
    /// Whatever the method reports.
    pub fn pretrain(&mut self) -> Result<Option<UpdateReport>> {
        let (learner, mut draw) = self.learning();
        Ok(learner.pretrain(&mut draw)?.map(|report| draw.and(report)))
    }

    /// The method, and what it samples from.
    fn learning(&mut self) -> (&mut dyn Learner, Draw<'_>) {
        let Generators { replay, augment, policy_noise, .. } = &mut self.generators;
        let random = [replay, augment, policy_noise];
        let draw = Draw::learning(&self.replay, &self.sampler, &self.device, random);
        (self.learner.as_mut(), draw)
    }

    /// Figures that explain a learning curve, by name: the method's own on a batch drawn by `random`, and those of its
    /// critics on the last finished episode. Nothing learns, and no generator of the agent moves. Empty while nothing
    /// can be sampled.
    ///
    /// # Errors
    /// Whatever the method reports.
    pub fn diagnose(&self, random: &mut ChaCha8Rng) -> Result<Vec<(String, f64)>> {
        let mut draw = Draw::looking(&self.replay, &self.sampler, &self.device, random);
        let mut figures = self.learner.diagnose(&mut draw)?;
        if !figures.is_empty() {
            let networks = self.learner.networks();
            figures.extend(value_figures(networks, &self.replay, &self.device, random)?);
        }
        Ok(figures)
    }

    /// Copies of everything that it needs to resume, except its replay.
    ///
    /// # Errors
    /// Whatever the tensors report.
    pub fn save(&mut self) -> Result<AgentState> {
        let names = Generators::NAMES.map(str::to_owned);
        let streams = self.generators.each().map(|generator| generator.clone());
        let streams = names.into_iter().zip(streams).collect();
        Ok(AgentState { tensors: self.learner.state()?, rest: AgentRest { streams } })
    }

    /// Returns to a saved state.
    ///
    /// # Errors
    /// A part that is missing, unknown or misshapen.
    pub fn load(&mut self, state: AgentState) -> Result<()> {
        let AgentState { tensors, rest: AgentRest { streams: mut saved } } = state;
        let mut generators = Generators::new(0);
        for (name, generator) in Generators::NAMES.into_iter().zip(generators.each()) {
            *generator = saved.remove(name).ok_or_else(|| Error::SavedState {
                part: format!("random stream `{name}`"),
                reason: "it is missing".to_owned(),
            })?;
        }
        if let Some(name) = saved.into_keys().next() {
            let reason = "this agent has no such stream".to_owned();
            return Err(Error::SavedState { part: format!("random stream `{name}`"), reason });
        }
        self.learner.load_state(tensors)?;
        self.generators = generators;
        Ok(())
    }
}

fn bytes(frame: ArrayView3<'_, u8>) -> Cow<'_, [u8]> {
    frame.to_slice().map_or_else(|| frame.iter().copied().collect(), Cow::Borrowed)
}
