//! The trait of learning methods.

use std::collections::BTreeMap;
use std::fmt;

use candle_core::{Device, Tensor};
use hksl_core::named::{expect_empty, prefixed, take, take_count};
use hksl_core::optim::{Adam, load_into, state_of};
use rand_chacha::ChaCha8Rng;

use crate::Result;
use crate::draw::Draw;
use crate::networks::Networks;
use crate::update_report::UpdateReport;

/// How an action is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Acting {
    /// Uniformly from [−1, 1], for the initial random steps of a run.
    Uniform,
    /// Sampled from the policy, for training.
    Sample,
    /// The policy's deterministic action, for evaluation.
    Mean,
}

/// A policy's recurrent state in the running episode. Its tensors are empty when an episode begins, and always empty
/// for policies without recurrence.
#[derive(Debug, Clone, Default)]
pub struct RecurrentState {
    /// Number of actions chosen in this episode.
    pub steps: u32,
    /// The state's tensors by name.
    pub tensors: BTreeMap<String, Tensor>,
}

/// A learning method: its networks, their optimisers and its learning step. An [`crate::Agent`] adds replay, random
/// number generators and checkpoints.
pub trait Learner: fmt::Debug + Send {
    /// The networks, which checkpoints save and analyses read.
    fn networks(&self) -> &Networks;

    /// The optimisers with their names. Checkpoints contain these names, so they must not change between versions.
    fn optimizers(&mut self) -> Vec<(String, &mut Adam)>;

    /// Chooses an action `(1, A)` for one observation `(1, C, H, W)`, without gradient. `acting` is never
    /// [`Acting::Uniform`].
    fn act(
        &self,
        observation: &Tensor,
        acting: Acting,
        random: &mut ChaCha8Rng,
        state: &mut RecurrentState,
    ) -> Result<Tensor>;

    /// Takes the learning step of `agent_step`, counted from 0. Returns None if no learning step is due or the replay has no
    /// trajectory to sample.
    fn update(&mut self, draw: &mut Draw, agent_step: u64) -> Result<Option<UpdateReport>>;

    /// Computes diagnostic metrics by name on a batch from `draw`. No weight changes. Empty if the replay has no trajectory
    /// to sample.
    fn diagnose(&self, draw: &mut Draw) -> Result<Vec<(String, f64)>>;

    /// Takes one pretraining step: a learning step before the first agent step that learns. Returns None if none is left or
    /// the replay has no trajectory to sample.
    fn pretrain(&mut self, _: &mut Draw) -> Result<Option<UpdateReport>> {
        Ok(None)
    }

    /// Number of pretraining steps taken, and their total number.
    fn pretraining(&self) -> (u64, u64) {
        (0, 0)
    }

    /// Counters that checkpoints save, with their names.
    fn counters(&mut self) -> Vec<(&'static str, &mut u64)> {
        Vec::new()
    }
}

impl dyn Learner + '_ {
    /// Copies all weights, optimiser moments and counters.
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

    /// Restores a state from [`Self::state`].
    ///
    /// # Errors
    /// A tensor that is missing, unknown or of another shape. Nothing changes in that case.
    pub fn load_state(&mut self, mut state: BTreeMap<String, Tensor>) -> Result<()> {
        let (weights, moments) = (take(&mut state, "weights"), take(&mut state, "moments"));
        let names = self.counters().into_iter().map(|(name, _)| name);
        let counts = names.map(|name| take_count(&mut state, name));
        let counts = counts.collect::<hksl_core::Result<Vec<u64>>>()?;
        expect_empty(&state)?;
        self.networks().parameters.check(&weights)?;
        load_into(self.optimizers(), moments)?;
        self.networks().parameters.load(&weights)?;
        for ((_, counter), count) in self.counters().into_iter().zip(counts) {
            *counter = count;
        }
        Ok(())
    }
}
