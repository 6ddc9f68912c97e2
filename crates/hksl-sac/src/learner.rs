//! The trait between the training loop and a method.

use std::collections::BTreeMap;
use std::fmt;

use candle_core::{Device, Tensor};
use hksl_core::named::{nothing_left, prefixed, take, take_count};
use hksl_core::optim::{Adam, load_into, state_of};
use rand_chacha::ChaCha8Rng;

use crate::Result;
use crate::draw::Draw;
use crate::networks::Networks;
use crate::operations::Operations;
use crate::update_report::UpdateReport;

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

/// A policy's memory of the running episode. Empty when an episode begins, and always empty for policies that read the
/// current observation alone.
#[derive(Debug, Clone, Default)]
pub struct RecurrentState {
    /// How many actions the policy has chosen in this episode.
    pub steps: u32,
    /// The state's tensors by name.
    pub tensors: BTreeMap<String, Tensor>,
}

/// A learning method: its networks, their optimisers and its learning step. An [`crate::Agent`] adds replay, random
/// number generators and checkpoints.
pub trait Learner: fmt::Debug + Send {
    /// The networks: what checkpoints save and analyses read.
    fn networks(&self) -> &Networks;

    /// The optimisers by name. A name stays the same from one version to the next, since checkpoints contain it.
    fn optimizers(&mut self) -> Vec<(String, &mut Adam)>;

    /// An action `(1, A)` for one observation `(1, C, H, W)`, without gradient. Never called with [`Acting::Uniform`].
    fn act(
        &self,
        observation: &Tensor,
        acting: Acting,
        random: &mut ChaCha8Rng,
        state: &mut RecurrentState,
    ) -> Result<Tensor>;

    /// One learning step at this agent step, counted from 0. None if none is due, or while nothing can be sampled.
    fn update(&mut self, draw: &mut Draw, agent_step: u64) -> Result<Option<UpdateReport>>;

    /// Figures that explain a learning curve, by name, on a batch from `draw`. Nothing learns. Empty while nothing can
    /// be sampled.
    fn diagnose(&self, draw: &mut Draw) -> Result<Vec<(String, f64)>>;

    /// How much a learning step computes.
    fn operations(&self) -> Result<Operations>;

    /// Bytes that networks, optimisers and a learning step take at most on a CPU, estimated.
    fn memory_bytes(&self) -> u64;

    /// One learning step before the first agent step that learns. None when there are no more, or while nothing can be
    /// sampled.
    fn pretrain(&mut self, _: &mut Draw) -> Result<Option<UpdateReport>> {
        Ok(None)
    }

    /// How many learning steps [`Self::pretrain`] has taken, and how many it takes in all.
    fn pretraining(&self) -> (u64, u64) {
        (0, 0)
    }

    /// Counters that a checkpoint saves, by name.
    fn counters(&mut self) -> Vec<(&'static str, &mut u64)> {
        Vec::new()
    }
}

impl dyn Learner + '_ {
    /// Copies of all weights, moments and counters, by name.
    ///
    /// # Errors
    /// Whatever the tensors report.
    pub fn state(&mut self) -> Result<BTreeMap<String, Tensor>> {
        let mut state = prefixed("weights", self.networks().parameters.snapshot()?);
        let optimizers = self.optimizers();
        let moments = state_of(optimizers.iter().map(|(name, adam)| (name, &**adam)))?;
        state.extend(prefixed("moments", moments));
        for (name, count) in self.counters() {
            state.insert(name.to_owned(), Tensor::new(*count as i64, &Device::Cpu)?);
        }
        Ok(state)
    }

    /// Returns to a state of [`Self::state`].
    ///
    /// # Errors
    /// A tensor that is missing, unknown or misshapen, and then nothing was changed.
    pub fn load_state(&mut self, mut state: BTreeMap<String, Tensor>) -> Result<()> {
        let (weights, moments) = (take(&mut state, "weights"), take(&mut state, "moments"));
        let names = self.counters().into_iter().map(|(name, _)| name);
        let counts = names.map(|name| take_count(&mut state, name));
        let counts = counts.collect::<hksl_core::Result<Vec<u64>>>()?;
        nothing_left(&state)?;
        self.networks().parameters.check(&weights)?;
        load_into(self.optimizers(), moments)?;
        self.networks().parameters.load(&weights)?;
        for ((_, counter), count) in self.counters().into_iter().zip(counts) {
            *counter = count;
        }
        Ok(())
    }
}
