//! Checkpoints: what a run keeps of itself, written so that none is ever seen half done.
//!
//! ```text
//! checkpoints/step-000010000/weights.safetensors   what acting and the analyses need
//!                            checkpoint.json       steps, why it is kept
//!                            state/                everything else that is needed to go on
//! replay/episode-000000012.safetensors             finished episodes, each written once
//! ```

mod files;
mod retention;
mod state;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use hksl_sac::replay::{Episode, Layout};
use hksl_sac::{Agent, AgentState};
use ndarray::Array3;
use serde::{Deserialize, Serialize};

pub use retention::Reason;
pub use state::RunState;

use crate::{Error, Result};

/// Raised whenever files of an older program can no longer be read.
const FORMAT_VERSION: u32 = 1;

const WEIGHTS: &str = "weights.safetensors";
const SUMMARY: &str = "checkpoint.json";
const STATE: &str = "state";
const AGENT: &str = "agent.safetensors";
const RUN: &str = "run.json";
const RUNNING: &str = "running-episode.safetensors";
const STACK: &str = "frame-stack.safetensors";

/// A run's checkpoints and its stored episodes.
#[derive(Debug)]
pub struct Checkpoints {
    checkpoints: PathBuf,
    replay: PathBuf,
}

/// What `checkpoint.json` says.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Summary {
    /// Version of the files' format.
    pub format_version: u32,
    /// Agent steps learnt from.
    pub agent_step: u64,
    /// Environment steps learnt from.
    pub environment_step: u64,
    /// Why its weights are kept; none for a state that only serves a resume.
    pub reasons: BTreeSet<Reason>,
    /// Numbers of the finished episodes in the state's replay.
    pub episodes: BTreeSet<u64>,
}

/// A state read back.
#[derive(Debug)]
pub struct Saved {
    /// Where the run was.
    pub run: RunState,
    /// The agent but for its replay.
    pub agent: AgentState,
    /// The observation's frames, oldest first.
    pub stack: Vec<Array3<u8>>,
    /// Finished episodes, oldest first.
    pub finished: Vec<Episode>,
    /// The running episode.
    pub running: Option<Episode>,
}

impl Checkpoints {
    /// The checkpoints of the run in this folder.
    pub fn new(run: &Path) -> Self {
        Self { checkpoints: run.join("checkpoints"), replay: run.join("replay") }
    }

    /// All complete checkpoints, by environment step.
    ///
    /// # Errors
    /// A folder or summary that cannot be read.
    pub fn list(&self) -> Result<BTreeMap<u64, Summary>> {
        let mut found = BTreeMap::new();
        if !self.checkpoints.is_dir() {
            return Ok(found);
        }
        let entries = fs::read_dir(&self.checkpoints)
            .map_err(|source| Error::read(&self.checkpoints, source))?;
        for entry in entries {
            let path = entry.map_err(|source| Error::read(&self.checkpoints, source))?.path();
            let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
            // Whatever is named otherwise was not completed, or is not ours.
            if name.starts_with("step-") {
                let summary: Summary = files::read_json(&path.join(SUMMARY))?;
                check_version(&path, summary.format_version)?;
                found.insert(summary.environment_step, summary);
            }
        }
        Ok(found)
    }

    /// The environment step of the newest checkpoint with a full state.
    pub fn newest_state(&self) -> Result<Option<u64>> {
        let steps = self.list()?.into_keys().rev();
        Ok(steps.into_iter().find(|&step| self.has_state(step)))
    }

    /// The weights at this environment step, as safetensors.
    ///
    /// # Errors
    /// [`Error::NoCheckpoint`] names the nearest steps that there are.
    pub fn weights(&self, environment_step: u64) -> Result<Vec<u8>> {
        let steps: Vec<u64> = self.list()?.into_keys().collect();
        if !steps.contains(&environment_step) {
            return Err(Error::NoCheckpoint { step: environment_step, steps });
        }
        files::read(&self.folder(environment_step).join(WEIGHTS))
    }

    /// Saves weights and full state, then lets go of what is no longer kept: states but for the last two,
    /// weights that no reason keeps, episodes that no state needs.
    ///
    /// # Errors
    /// A disk that cannot be written; the checkpoints so far are then as they were.
    pub fn save(
        &self,
        agent: &dyn Agent,
        run: &RunState,
        stack: &[Array3<u8>],
        reasons: BTreeSet<Reason>,
    ) -> Result<()> {
        files::create_folder(&self.checkpoints)?;
        let replay = agent.replay();
        self.save_episodes(agent)?;

        let saved = agent.save()?;
        let summary = Summary {
            format_version: FORMAT_VERSION,
            agent_step: run.agent_step,
            environment_step: run.environment_step,
            reasons,
            episodes: replay.finished().map(|episode| episode.number()).collect(),
        };
        let target = self.folder(run.environment_step);
        let aside = files::aside(&target)?;
        let state = aside.join(STATE);
        files::create_folder(&state)?;
        let write = |path: &Path, tensors: &BTreeMap<_, _>| {
            files::write(path, &hksl_core::to_safetensors(tensors)?)
        };
        write(&aside.join(WEIGHTS), &agent.weights())?;
        write(&state.join(AGENT), &saved.tensors)?;
        write(&state.join(STACK), &state::stack_to_tensors(stack)?)?;
        if let Some(running) = replay.running() {
            write(&state.join(RUNNING), &running.to_tensors(replay.layout())?)?;
        }
        files::write_json(&state.join(RUN), &(run, &saved.rest))?;
        files::write_json(&aside.join(SUMMARY), &summary)?;
        files::publish(&aside, &target)?;
        self.tidy()
    }

    /// Reads the full state at this environment step.
    ///
    /// # Errors
    /// A file that is missing, damaged, or of another format.
    pub fn load(&self, environment_step: u64, layout: &Layout) -> Result<Saved> {
        let folder = self.folder(environment_step);
        let summary: Summary = files::read_json(&folder.join(SUMMARY))?;
        check_version(&folder, summary.format_version)?;
        let state = folder.join(STATE);
        let (run, rest): (RunState, _) = files::read_json(&state.join(RUN))?;
        let tensors = files::read_tensors(&state.join(AGENT))?;
        let stack = state::stack_from_tensors(&files::read_tensors(&state.join(STACK))?)?;
        let episode = |path: &Path| -> Result<Episode> {
            let episode = Episode::from_tensors(&files::read_tensors(path)?, layout);
            episode.map_err(|error| Error::damaged(path, error))
        };
        let finished = summary
            .episodes
            .iter()
            .map(|&number| episode(&self.episode_file(number)))
            .collect::<Result<_>>()?;
        let running = state.join(RUNNING);
        let running = running.is_file().then(|| episode(&running)).transpose()?;
        Ok(Saved { run, agent: AgentState { tensors, rest }, stack, finished, running })
    }

    fn save_episodes(&self, agent: &dyn Agent) -> Result<()> {
        files::create_folder(&self.replay)?;
        let replay = agent.replay();
        for episode in replay.finished() {
            let path = self.episode_file(episode.number());
            if !path.is_file() {
                let bytes = hksl_core::to_safetensors(&episode.to_tensors(replay.layout())?)?;
                files::write_whole(&path, &bytes)?;
            }
        }
        files::sync_folder(&self.replay)
    }

    /// Forgets episodes that no state needs: those that a run cut back to an earlier state recorded after it,
    /// under numbers that will be given again.
    pub fn forget_unneeded_episodes(&self) -> Result<()> {
        let kept = self.list()?;
        let needed: BTreeSet<PathBuf> = kept
            .iter()
            .filter(|(step, _)| self.has_state(**step))
            .flat_map(|(_, summary)| summary.episodes.iter().map(|&n| self.episode_file(n)))
            .collect();
        if !self.replay.is_dir() {
            return Ok(());
        }
        let entries = fs::read_dir(&self.replay).map_err(|e| Error::read(&self.replay, e))?;
        for entry in entries {
            let path = entry.map_err(|source| Error::read(&self.replay, source))?.path();
            if !needed.contains(&path) {
                fs::remove_file(&path).map_err(|source| Error::write(&path, source))?;
            }
        }
        Ok(())
    }

    fn tidy(&self) -> Result<()> {
        let all = self.list()?;
        let with_state: BTreeSet<u64> =
            all.keys().copied().filter(|&step| self.has_state(step)).collect();
        let plan = retention::plan(&all, &with_state);
        for step in plan.states {
            files::remove_folder(&self.folder(step).join(STATE))?;
        }
        for step in plan.whole {
            files::remove_folder(&self.folder(step))?;
        }
        for (step, reasons) in plan.reasons {
            let path = self.folder(step).join(SUMMARY);
            let mut summary = all[&step].clone();
            summary.reasons = reasons;
            files::write_json_whole(&path, &summary)?;
        }
        self.forget_unneeded_episodes()
    }

    fn has_state(&self, environment_step: u64) -> bool {
        self.folder(environment_step).join(STATE).join(RUN).is_file()
    }

    fn folder(&self, environment_step: u64) -> PathBuf {
        self.checkpoints.join(format!("step-{environment_step:09}"))
    }

    fn episode_file(&self, number: u64) -> PathBuf {
        self.replay.join(format!("episode-{number:09}.safetensors"))
    }
}

fn check_version(path: &Path, found: u32) -> Result<()> {
    if found == FORMAT_VERSION {
        return Ok(());
    }
    let reason = format!("format version {found}; this program reads version {FORMAT_VERSION}");
    Err(Error::Damaged { path: path.to_owned(), reason })
}
