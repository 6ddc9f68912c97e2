//! What a training loop, an evaluation or an analysis asks of any method.

mod draw;
mod hksl;
mod learner;
mod pixel_agent;
mod value_diagnosis;

use std::collections::BTreeMap;

use candle_core::Tensor;
use ndarray::ArrayView3;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

pub use draw::{ArrivingSequences, Draw};
pub use hksl::HkslAgent;
pub use learner::{Learner, feature_maps_of};
pub use pixel_agent::PixelAgent;

use crate::Result;
use crate::learner::{Operations, UpdateReport};
use crate::replay::Replay;

/// How an action is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Acting {
    /// Uniformly in [−1, 1]: the first steps of a run.
    Uniform,
    /// Drawn from the policy: training.
    Sample,
    /// The policy's deterministic action: evaluation.
    Mean,
}

/// What an encoder's last convolution sees.
#[derive(Debug, Clone)]
pub struct FeatureMaps {
    /// The encoder's name.
    pub encoder: String,
    /// `(B, F, h, w)`.
    pub maps: Tensor,
    /// What a point of a map looks at.
    pub field: Field,
}

/// The square of pixels that a point of a feature map depends on; the first point's begins in the picture's corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// Its side, in pixels.
    pub side: usize,
    /// Pixels from one point's to its neighbour's.
    pub spacing: usize,
}

/// What an agent remembers of the episode in which it acts: empty at its beginning, and always for those to whom one
/// observation says all.
#[derive(Debug, Clone, Default)]
pub struct Memory {
    /// Times that it has acted by its policy.
    pub steps: u32,
    /// By name.
    pub tensors: BTreeMap<String, Tensor>,
}

/// An agent's random streams, positions included; by name.
pub type Streams = BTreeMap<String, ChaCha8Rng>;

/// Everything an agent needs to go on, but for its replay.
#[derive(Debug, Clone)]
pub struct AgentState {
    /// Weights and moments.
    pub tensors: BTreeMap<String, Tensor>,
    /// What is not a tensor.
    pub rest: AgentRest,
}

/// The part of an [`AgentState`] that is not a tensor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AgentRest {
    /// Random streams with their positions.
    pub streams: Streams,
}

/// A learning method.
///
/// The caller brings the observations; frames it hands to [`Agent::begin_episode`] and [`Agent::observe`] are
/// single ones, which the replay stacks when it is sampled.
pub trait Agent {
    /// An action for an observation `(stack·C, H, W)`, frames oldest first, an episode's first standing for those
    /// before it; each number in [−1, 1]. `memory` is of the episode that the
    /// observation belongs to; acting by the policy's deterministic action draws from no stream of the agent's.
    fn act(
        &mut self,
        observation: ArrayView3<u8>,
        acting: Acting,
        memory: &mut Memory,
    ) -> Result<Vec<f32>>;

    /// An episode begins with this frame `(C, H, W)`.
    fn begin_episode(&mut self, frame: ArrayView3<u8>) -> Result<()>;

    /// The running episode went on by one transition to this frame; `terminal` if the decision process
    /// ended there, which a time limit is not.
    fn observe(
        &mut self,
        action: &[f32],
        reward: f64,
        terminal: bool,
        frame: ArrayView3<u8>,
    ) -> Result<()>;

    /// The running episode is over.
    fn end_episode(&mut self);

    /// One of the learning steps that a method takes before the first that goes with an agent step; none if there are
    /// no more of them, or nothing can be sampled yet.
    fn pretrain(&mut self) -> Result<Option<UpdateReport>>;

    /// How many of those it has taken, and takes in all.
    fn pretraining(&self) -> (u64, u64);

    /// One learning step at this agent step, counted from 0, between choosing its action and taking it; none if none is
    /// due, or nothing can be sampled yet. Which of actor and slow networks move goes by the number. Leaving out the
    /// initial random steps (the paper: 1000) is the caller's part.
    fn update(&mut self, agent_step: u64) -> Result<Option<UpdateReport>>;

    /// Figures that explain a learning curve, by name, on a batch drawn by `rng`, the values' bias on the last finished
    /// episode; nothing learns, and no other stream moves. Empty if nothing can be sampled yet.
    fn diagnose(&self, rng: &mut ChaCha8Rng) -> Result<Vec<(String, f64)>>;

    /// The latents of each encoder, by the encoder's name, without gradient.
    ///
    /// # Shapes
    /// - `observations`: `(B, stack·C, H, W)` u8
    /// - output: one `(B, Z)` an encoder
    fn encode(&self, observations: &Tensor) -> Result<Vec<(String, Tensor)>>;

    /// The last feature maps of each encoder, after their activation.
    ///
    /// # Shapes
    /// - `observations`: `(B, stack·C, H, W)` u8
    fn feature_maps(&self, observations: &Tensor) -> Result<Vec<FeatureMaps>>;

    /// How much a learning step computes.
    fn operations(&self) -> Result<Operations>;

    /// Bytes that the networks, their optimisers and a learning step take at most on a CPU, estimated; a GPU takes more.
    fn learning_bytes(&self) -> u64;

    /// Networks that are trained, by name with how many parameters each has.
    fn networks(&self) -> Vec<(String, usize)>;

    /// Copies of the weights that acting and analyses need: no targets, no moments.
    ///
    /// # Errors
    /// Whatever the tensors report.
    fn weights(&self) -> Result<BTreeMap<String, Tensor>>;

    /// Takes over such weights; targets and moments stay as they are.
    ///
    /// # Errors
    /// A tensor that is missing, unknown or misshapen.
    fn load_weights(&mut self, weights: &BTreeMap<String, Tensor>) -> Result<()>;

    /// Copies of everything it needs to go on, but for its replay.
    fn save(&self) -> Result<AgentState>;

    /// Goes back to a saved state.
    ///
    /// # Errors
    /// A part that is missing, unknown or misshapen.
    fn load(&mut self, state: AgentState) -> Result<()>;

    /// What it has stored.
    fn replay(&self) -> &Replay;

    /// What it has stored, to be restored.
    fn replay_mut(&mut self) -> &mut Replay;
}
