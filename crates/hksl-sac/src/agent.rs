//! The agent: a method with its replay, its random number generators and its checkpoints.

use std::borrow::Cow;
use std::collections::BTreeMap;

use candle_core::{Device, Tensor};
use hksl_core::named::under;
use hksl_core::rng;
use ndarray::ArrayView3;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::config::{AugmentationConfig, ReplayConfig};
use crate::draw::Draw;
use crate::learner::{Acting, Learner, RecurrentState};
use crate::networks::{Networks, is_for_learning};
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
    /// The state of the random number generators.
    pub rest: AgentRest,
}

impl AgentState {
    /// The weights that acting and analyses need, without target networks, as in [`crate::Networks::weights`]. They share
    /// storage with the state.
    pub fn weights(&self) -> BTreeMap<String, Tensor> {
        let mut weights = under(&self.tensors, "weights");
        weights.retain(|name, _| !is_for_learning(name));
        weights
    }
}

/// The part of an [`AgentState`] that is not a tensor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AgentRest {
    /// Random number generators with their positions.
    pub streams: Streams,
}

/// Acts, stores transitions and learns with a [`Learner`].
///
/// The caller steps the environment. [`Agent::begin_episode`] and [`Agent::observe`] take single frames; the replay
/// stacks them when it is sampled.
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
    /// Creates an agent with an empty replay and random number generators derived from `seed`.
    ///
    /// `layout` describes single frames. Stacked frames must have the shape of the networks' observations. The layout's
    /// `action_dims` must equal the networks' action dimensions, which is not checked here.
    ///
    /// # Errors
    /// [`Error::Size`] if the networks read observations of another size.
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

    /// The stored transitions, mutably, for restoring a saved replay.
    pub fn replay_mut(&mut self) -> &mut Replay {
        &mut self.replay
    }

    /// Chooses an action for an observation `(stack·C, H, W)`. Frames are ordered oldest first; at an episode's start the
    /// first frame is repeated. Each component of the action lies in [−1, 1]. `state` is the recurrent state of the
    /// observation's episode. [`Acting::Mean`] does not advance any of the agent's random number generators.
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
        // Evaluation uses its own generator: its result must not depend on training steps, nor change them.
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

    /// Begins an episode with its first frame `(C, H, W)`.
    ///
    /// # Errors
    /// A frame of another shape.
    pub fn begin_episode(&mut self, frame: ArrayView3<u8>) -> Result<()> {
        self.replay.begin_episode(&bytes(frame))
    }

    /// Stores a transition of the running episode and its next frame. `terminal` is true if the transition ended in a
    /// terminal state; time limits truncate, they do not terminate.
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

    /// Ends the running episode and makes it available for sampling.
    pub fn end_episode(&mut self) {
        self.replay.end_episode();
    }

    /// Takes the learning step of `agent_step`, counted from 0, after its action is chosen and before it is taken. Returns
    /// None if no learning step is due or the replay has no trajectory to sample. Actor and target updates run when
    /// `agent_step` is a multiple of their period. The caller skips the initial random steps (paper: 1000).
    ///
    /// # Errors
    /// Whatever the method reports.
    pub fn update(&mut self, agent_step: u64) -> Result<Option<UpdateReport>> {
        let (learner, mut draw) = self.learning();
        Ok(learner.update(&mut draw, agent_step)?.map(|report| draw.add_timings(report)))
    }

    /// Takes one pretraining step: a learning step before the first agent step that learns. Returns None if none is left or
    /// the replay has no trajectory to sample.
    ///
    /// # Errors
    /// Whatever the method reports.
    pub fn pretrain(&mut self) -> Result<Option<UpdateReport>> {
        let (learner, mut draw) = self.learning();
        Ok(learner.pretrain(&mut draw)?.map(|report| draw.add_timings(report)))
    }

    /// The learner, with a source of batches and noise.
    fn learning(&mut self) -> (&mut dyn Learner, Draw<'_>) {
        let Generators { replay, augment, policy_noise, .. } = &mut self.generators;
        let random = [replay, augment, policy_noise];
        let draw = Draw::for_learning(&self.replay, &self.sampler, &self.device, random);
        (self.learner.as_mut(), draw)
    }

    /// Computes diagnostic metrics by name: the learner's own on a batch sampled with `random`, and the critics' on the last
    /// finished episode. No weight changes and no generator of the agent advances. Empty if the replay has no trajectory
    /// to sample.
    ///
    /// # Errors
    /// Whatever the method reports.
    pub fn diagnose(&self, random: &mut ChaCha8Rng) -> Result<Vec<(String, f64)>> {
        let mut draw = Draw::for_diagnosis(&self.replay, &self.sampler, &self.device, random);
        let mut figures = self.learner.diagnose(&mut draw)?;
        if !figures.is_empty() {
            let networks = self.learner.networks();
            figures.extend(value_figures(networks, &self.replay, &self.device, random)?);
        }
        Ok(figures)
    }

    /// Copies everything that resuming needs, except the replay.
    ///
    /// # Errors
    /// Whatever the tensors report.
    pub fn save(&mut self) -> Result<AgentState> {
        let names = Generators::NAMES.map(str::to_owned);
        let streams = self.generators.each().map(|generator| generator.clone());
        let streams = names.into_iter().zip(streams).collect();
        Ok(AgentState { tensors: self.learner.state()?, rest: AgentRest { streams } })
    }

    /// Restores a saved state.
    ///
    /// # Errors
    /// A part that is missing or unknown, or a tensor of another shape.
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
