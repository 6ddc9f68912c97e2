//! Measures how much memory a run needs, and checks whether it fits.

use std::hint::black_box;

use candle_core::Device;
use hksl_core::nn::Initialisation;
use hksl_core::rng;
use hksl_envs::Spec;
use hksl_sac::Agent;

use super::error::{Error, Result};
use super::{Plan, Summary};
use crate::config::ReplayStorage;
use crate::memory::process::{peak_of, resident};
use crate::memory::{LimitedBy, SystemMemory};
use crate::synthetic::record;

/// Memory of the smallest run: code, rendering, MuJoCo.
const LEAST_BYTES: u64 = 150_000_000;
/// Memory that the allocator reserves ahead of need, for limits that count it.
const AHEAD_BYTES: u64 = 64 << 20;
/// Batches that are measured before the run's own, as divisors of it.
const DIVISORS: [usize; 2] = [32, 8];

/// Memory of a run without its replay, in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunMemory {
    /// The process with an environment that has rendered a frame, before an agent is built.
    pub process: u64,
    /// The agent with its learning steps and checkpoints.
    pub learning: u64,
}

impl RunMemory {
    /// Takes a learning step on random frames between two checkpoints, on the CPU. To stay within limits whose excess
    /// aborts the process, first the agent's size and then two small batches tell whether the step would fit; if not,
    /// its memory is estimated from them. None if the system does not tell.
    ///
    /// # Errors
    /// Whatever the environment or the agent reports.
    pub(super) fn measure(
        plan: &Plan,
        memory: Option<SystemMemory>,
    ) -> crate::Result<Option<Self>> {
        let random = rng::stream(plan.config.seed, "memory");
        let mut environment = plan.factories.environment(plan.config, random)?;
        environment.reset()?;
        // Rendering takes its memory at the first frame.
        environment.frame()?;
        let Some(process) = resident() else { return Ok(None) };
        let fits = |memory: Option<SystemMemory>, needed: Self| {
            memory.is_none_or(|memory| with_margin(needed.total()) <= memory.available)
        };
        let batch = plan.config.batch().1;
        let state = new_agent(plan, environment.spec(), 1)?.state_bytes();
        // The agent, a checkpoint's copy of its state, and the copy's bytes.
        let least = Self { process, learning: 3 * state };
        if !fits(memory, least) {
            return Ok(Some(Self { learning: with_margin(least.total()) - process, ..least }));
        }
        let [small, large] = DIVISORS.map(|divisor| batch.div_ceil(divisor));
        let learning = |items| -> crate::Result<Option<u64>> {
            let (done, peak) = peak_of(|| learn_and_save(plan, environment.spec(), items));
            done?;
            Ok(peak.map(|peak| peak.saturating_sub(process)))
        };
        let (Some(low), Some(high)) = (learning(small)?, learning(large)?) else { return Ok(None) };
        let per_item = high.saturating_sub(low) / (large - small).max(1) as u64;
        let extrapolated = Self { process, learning: high + per_item * (batch - large) as u64 };
        if !fits(memory, extrapolated) {
            return Ok(Some(extrapolated));
        }
        Ok(learning(batch)?.map(|learning| Self { process, learning }))
    }

    fn total(self) -> u64 {
        self.process + self.learning
    }
}

/// A new agent on the CPU, with `items` in its batch. Its weights are uniform: wide orthogonal matrices take seconds to
/// draw, and take as much memory.
fn new_agent(plan: &Plan, spec: &Spec, items: usize) -> crate::Result<Agent> {
    let mut config = plan.config.with_batch(items);
    config.replay.storage = ReplayStorage::Memory;
    config.hksl.initialisation = Initialisation::Uniform;
    config.baseline.initialisation = Initialisation::Uniform;
    plan.factories.agent(&config, spec, &Device::Cpu)
}

/// Takes a learning step of a new agent with `items` in its batch, on random frames, between two checkpoints.
fn learn_and_save(plan: &Plan, spec: &Spec, items: usize) -> crate::Result<()> {
    let mut agent = new_agent(plan, spec, items)?;
    let length = (plan.config.sampled_transitions() + 1).min(spec.steps_per_episode);
    record(&mut agent, spec, &mut rng::stream(plan.config.seed, "memory"), 1, length)?;
    prepare_checkpoint(&mut agent)?;
    // Agent step 0 is a multiple of every period.
    agent.update(0)?;
    prepare_checkpoint(&mut agent)
}

/// Makes the largest parts of a checkpoint: the agent's state and its bytes.
fn prepare_checkpoint(agent: &mut Agent) -> crate::Result<()> {
    let state = agent.save()?;
    black_box(hksl_core::to_safetensors(&state.tensors)?);
    Ok(())
}

/// Adds a margin for limits whose excess aborts the process.
fn with_margin(needed: u64) -> u64 {
    needed + needed / 8 + AHEAD_BYTES
}

impl Summary {
    /// Memory of the run in bytes, if it could be measured; with a GPU, most of it is GPU memory.
    pub fn memory_bytes(&self) -> Option<u64> {
        Some(self.memory?.total() + self.replay_in_memory())
    }

    fn replay_in_memory(&self) -> u64 {
        match self.replay_storage {
            ReplayStorage::Memory => self.replay_bytes,
            ReplayStorage::File => 0,
        }
    }

    /// # Errors
    /// [`Error::Memory`] if a run on the CPU needs more than is free.
    pub(super) fn check_memory(&self, memory: Option<SystemMemory>) -> Result<()> {
        let Some(mut needed) = self.memory_bytes().filter(|_| self.device == "cpu") else {
            return Ok(());
        };
        let limit = memory.and_then(|memory| memory.binding_limit());
        let by = limit.map(|limit| limit.by);
        if by == Some(LimitedBy::AddressSpace) && self.replay_storage == ReplayStorage::File {
            needed += self.replay_bytes;
        }
        // Exceeding these limits aborts the process, so leave a margin for the estimate and the allocator.
        if matches!(by, Some(LimitedBy::AddressSpace | LimitedBy::Data)) {
            needed = with_margin(needed);
        }
        refuse_beyond(needed, self.replay_in_memory(), memory)
    }
}

/// Refuses to start if not even the process fits.
///
/// # Errors
/// [`Error::Memory`] if less is free than the process needs before training.
pub(super) fn check_least(on_cpu: bool, memory: Option<SystemMemory>) -> Result<()> {
    if on_cpu { refuse_beyond(LEAST_BYTES, 0, memory) } else { Ok(()) }
}

fn refuse_beyond(needed: u64, replay: u64, memory: Option<SystemMemory>) -> Result<()> {
    match memory {
        Some(memory) if memory.available < needed => {
            let limit = memory.binding_limit();
            Err(Error::Memory { needed, replay, available: memory.available, limit })
        }
        _ => Ok(()),
    }
}
