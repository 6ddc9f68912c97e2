//! What a save takes.

use std::collections::BTreeSet;
use std::path::Path;
use std::time::Instant;

use candle_core::Device;
use hksl_core::rng;
use hksl_sac::RecurrentState;
use ndarray::Array3;

use crate::Result;
use crate::checkpoint::{Checkpoints, Content, RunState};
use crate::config::{Config, ReplayStorage};
use crate::factories::Factories;
use crate::synthetic::record;

/// Times and sizes of saves with a replay of some size.
#[derive(Debug, Clone, PartialEq)]
pub struct SaveTimes {
    /// Transitions stored.
    pub transitions: usize,
    /// Seconds of a save that has the whole replay to write.
    pub whole_seconds: f64,
    /// Seconds of a save one episode later.
    pub next_seconds: f64,
    /// Seconds of reading the newest state, checksums included.
    pub load_seconds: f64,
    /// Bytes of one checkpoint: weights and state.
    pub checkpoint_bytes: u64,
    /// Bytes of the stored episodes.
    pub replay_bytes: u64,
}

/// Saves an agent with `transitions` of random frames into `folder`, then once more after another episode, and reads
/// it back.
///
/// # Errors
/// A disk that cannot be written.
pub fn time_saves(
    config: &Config,
    factories: &dyn Factories,
    device: &Device,
    transitions: usize,
    folder: &Path,
) -> Result<SaveTimes> {
    let environment = factories.environment(config, rng::stream(config.seed, "env"))?;
    let spec = environment.spec();
    let mut agent = factories.agent(config, spec, device)?;
    let mut random = rng::stream(config.seed, "bench");
    let length = spec.steps_per_episode;
    record(&mut agent, spec, &mut random, transitions.div_ceil(length).max(1), length)?;
    let mut checkpoints = Checkpoints::new(folder);
    let shape = (spec.frame.channels, spec.frame.height, spec.frame.width);
    let mut save = |agent: &mut hksl_sac::Agent, step: u64| -> Result<f64> {
        let start = Instant::now();
        checkpoints.save(&Content {
            agent: agent.save()?,
            replay: agent.replay(),
            run: &RunState { agent_step: step, environment_step: step, ..RunState::default() },
            stack: vec![Array3::zeros(shape); config.environment.frame_stack],
            memory: RecurrentState::default(),
            reasons: BTreeSet::new(),
        })?;
        Ok(start.elapsed().as_secs_f64())
    };
    let whole_seconds = save(&mut agent, 0)?;
    record(&mut agent, spec, &mut random, 1, length)?;
    let next_seconds = save(&mut agent, 1)?;
    let layout = *agent.replay().layout();
    let transitions = agent.replay().transitions();
    drop(agent);
    let start = Instant::now();
    let mut checkpoints = Checkpoints::new(folder);
    checkpoints.load_newest(&layout, ReplayStorage::Memory)?;
    let load_seconds = start.elapsed().as_secs_f64();
    let newest = checkpoints.list()?.sound.pop_last().map(|(_, summary)| summary);
    let (files, episodes) =
        newest.map(|summary| (summary.files, summary.episodes)).unwrap_or_default();
    Ok(SaveTimes {
        transitions,
        whole_seconds,
        next_seconds,
        load_seconds,
        checkpoint_bytes: files.values().map(|record| record.bytes).sum(),
        replay_bytes: episodes.values().map(|record| record.bytes).sum(),
    })
}
