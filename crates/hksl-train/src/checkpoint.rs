//! Checkpoints: what a run keeps of itself, written so that none is ever seen half done.
//!
//! ```text
//! checkpoints/step-000010000/weights.safetensors   what acting and the analyses need
//!                            checkpoint.json       steps, why it is kept, what each file must be
//!                            state/                everything else that is needed to go on
//! replay/episode-000000012.safetensors             finished episodes, each written once
//! ```

mod error;
mod retention;
mod state;
mod summary;
#[cfg(test)]
mod tests;
mod tidy;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

pub use hksl_files::FileRecord;
use hksl_files::{Files, damaged};
use hksl_sac::replay::{Episode, Layout, Replay};
use hksl_sac::{AgentState, RecurrentState};
use ndarray::Array3;

pub use error::Error;
pub use retention::Reason;
pub use state::RunState;
pub use summary::Summary;

use crate::Result;
use crate::config::ReplayStorage;

const WEIGHTS: &str = "weights.safetensors";
const SUMMARY: &str = "checkpoint.json";
const STATE: &str = "state";
const AGENT: &str = "state/agent.safetensors";
const RUN: &str = "state/run.json";
const RUNNING: &str = "state/running-episode.safetensors";
const STACK: &str = "state/frame-stack.safetensors";

/// A run's checkpoints and its stored episodes.
#[derive(Debug)]
pub struct Checkpoints {
    checkpoints: PathBuf,
    replay: PathBuf,
    files: Files,
    /// The episodes that this process has written or found sound. A file of another number may be what a run
    /// that was cut back had recorded under it.
    recorded: BTreeMap<u64, FileRecord>,
}

/// What there is.
#[derive(Debug)]
pub struct Listing {
    /// The checkpoints that can be read, by environment step.
    pub sound: BTreeMap<u64, Summary>,
    /// What is wrong with others, oldest first.
    pub damaged: Vec<Damage>,
}

/// A checkpoint that cannot be used.
#[derive(Debug)]
pub struct Damage {
    /// Its folder.
    pub folder: PathBuf,
    /// What is wrong with it.
    pub error: crate::Error,
}

/// What a save takes in.
#[derive(Debug)]
pub struct Content<'a> {
    /// The agent but for its replay.
    pub agent: AgentState,
    /// What the agent has stored.
    pub replay: &'a Replay,
    /// Where the run is.
    pub run: &'a RunState,
    /// The observation's frames, oldest first.
    pub stack: Vec<Array3<u8>>,
    /// What the agent remembers of the running episode.
    pub memory: RecurrentState,
    /// Why the weights are kept.
    pub reasons: BTreeSet<Reason>,
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
    /// What the agent remembered of the running episode.
    pub memory: RecurrentState,
    /// Finished episodes, oldest first.
    pub finished: Vec<Episode>,
    /// The running episode.
    pub running: Option<Episode>,
}

/// Whether a folder is named as a complete checkpoint.
fn is_step(folder: &Path) -> bool {
    hksl_files::name(folder).starts_with("step-")
}

impl Checkpoints {
    /// The checkpoints of the run in this folder.
    pub fn new(run: &Path) -> Self {
        Self::with(run, Files::default())
    }

    fn with(run: &Path, files: Files) -> Self {
        let (checkpoints, replay) = (run.join("checkpoints"), run.join("replay"));
        Self { checkpoints, replay, files, recorded: BTreeMap::new() }
    }

    /// All complete checkpoints.
    ///
    /// # Errors
    /// A folder that cannot be read.
    pub fn list(&self) -> Result<Listing> {
        let mut listing = Listing { sound: BTreeMap::new(), damaged: Vec::new() };
        for folder in hksl_files::entries(&self.checkpoints)? {
            // Other names are incomplete saves or foreign files.
            if !is_step(&folder) || folder.is_file() {
                continue;
            }
            let path = folder.join(SUMMARY);
            match hksl_files::read(&path).and_then(|bytes| Summary::from_bytes(&path, &bytes)) {
                Ok(summary) if self.folder(summary.environment_step) == folder => {
                    listing.sound.insert(summary.environment_step, summary);
                }
                Ok(summary) => {
                    let reason =
                        format!("it records environment step {}", summary.environment_step);
                    listing
                        .damaged
                        .push(Damage { folder, error: crate::Error::damaged(&path, reason) });
                }
                Err(error) => listing.damaged.push(Damage { folder, error: error.into() }),
            }
        }
        Ok(listing)
    }

    /// The same for whoever would act on damage.
    ///
    /// # Errors
    /// As well a file that is there and cannot be read: it may be sound.
    fn list_surely(&self) -> Result<Listing> {
        let mut listing = self.list()?;
        match listing.damaged.iter().position(|damage| damage.error.is_unread()) {
            Some(unread) => Err(listing.damaged.swap_remove(unread).error),
            None => Ok(listing),
        }
    }

    /// The environment step of the newest checkpoint with a full state whose `checkpoint.json` can be read; the other
    /// files are not looked at.
    ///
    /// # Errors
    /// A file or folder that cannot be read, and may be sound.
    pub fn newest_state(&self) -> Result<Option<u64>> {
        Ok(self.with_state(&self.list_surely()?.sound)?.last().copied())
    }

    /// The environment step of the newest checkpoint that can be read.
    ///
    /// # Errors
    /// [`Error::NoCheckpoints`] if there is none; what is wrong with the oldest if all are damaged.
    pub fn newest(&self) -> Result<u64> {
        let Listing { sound, damaged } = self.list()?;
        for Damage { error, .. } in &damaged {
            tracing::warn!("skipped: {error}");
        }
        match (sound.last_key_value(), damaged.into_iter().next()) {
            (Some((step, _)), _) => Ok(*step),
            (None, Some(damage)) => Err(damage.error),
            (None, None) => Err(Error::NoCheckpoints { folder: self.checkpoints.clone() }.into()),
        }
    }

    /// The weights at this environment step, as safetensors.
    ///
    /// # Errors
    /// [`Error::NoCheckpoint`] names the nearest steps that there are; [`hksl_files::Error::Damaged`].
    pub fn weights(&self, environment_step: u64) -> Result<Vec<u8>> {
        let Listing { sound, damaged } = self.list()?;
        let folder = self.folder(environment_step);
        if let Some(damage) = damaged.into_iter().find(|damage| damage.folder == folder) {
            return Err(damage.error);
        }
        let Some(summary) = sound.get(&environment_step) else {
            let steps = sound.into_keys().collect();
            return Err(Error::NoCheckpoint { step: environment_step, steps }.into());
        };
        Ok(summary.read(&folder, WEIGHTS)?)
    }

    /// Saves weights and full state, then lets go of what is no longer kept: states but for the last two,
    /// weights that no reason keeps, episodes that no state needs.
    ///
    /// # Errors
    /// A disk that cannot be written; the checkpoints so far are then as they were.
    pub fn save(&mut self, content: &Content) -> Result<()> {
        let Content { agent, replay, run, stack, memory, reasons } = content;
        // What an interrupted save has left may be what fills the disk.
        self.clean()?;
        let episodes = self.save_episodes(replay)?;
        self.files.create_folder(&self.checkpoints)?;
        let target = self.folder(run.environment_step);
        let aside = self.files.aside(&target)?;
        self.files.create_folder(&aside.join(STATE))?;
        let (weights, reasons) = match self.kept(run.environment_step) {
            // Weights that are kept stay as they were for that reason, though the agent may have learnt since.
            Some(kept) if reasons.is_empty() => kept,
            _ => (hksl_core::to_safetensors(&agent.weights())?, reasons.clone()),
        };
        let mut files = BTreeMap::new();
        // Each file is written before the next one's bytes are made.
        let mut write = |name: &str, bytes: Vec<u8>| -> Result<()> {
            files.insert(name.to_owned(), self.files.write(&aside.join(name), &bytes)?);
            Ok(())
        };
        write(WEIGHTS, weights)?;
        write(AGENT, hksl_core::to_safetensors(&agent.tensors)?)?;
        write(STACK, hksl_core::to_safetensors(&state::seen_to_tensors(stack, memory)?)?)?;
        write(RUN, hksl_files::to_json(&aside.join(RUN), &(run, &agent.rest))?)?;
        if let Some(running) = replay.running() {
            let tensors = running.to_tensors(replay.layout())?;
            write(RUNNING, hksl_core::to_safetensors(&tensors)?)?;
        }
        let summary = Summary {
            agent_step: run.agent_step,
            environment_step: run.environment_step,
            reasons,
            files,
            episodes,
        };
        let path = aside.join(SUMMARY);
        self.files.write(&path, &summary.to_bytes(&path)?)?;
        self.files.publish(&aside, &target)?;
        self.tidy()
    }

    /// The weights at this environment step that some reason keeps, with all reasons.
    fn kept(&self, environment_step: u64) -> Option<(Vec<u8>, BTreeSet<Reason>)> {
        let folder = self.folder(environment_step);
        let path = folder.join(SUMMARY);
        let summary = Summary::from_bytes(&path, &hksl_files::read(&path).ok()?).ok()?;
        let weights = summary.read(&folder, WEIGHTS).ok()?;
        (!summary.reasons.is_empty()).then_some((weights, summary.reasons))
    }

    /// The newest intact state, and the damaged ones that were skipped, newest first. None if there is no checkpoint.
    ///
    /// # Errors
    /// Damage to every state there is, the newest's told; [`Error::NoState`] if there are weights alone; a file that
    /// cannot be read, and may be sound.
    pub fn load_newest(
        &mut self,
        layout: &Layout,
        storage: ReplayStorage,
    ) -> Result<(Option<Saved>, Vec<Damage>)> {
        self.clean()?;
        let Listing { sound, damaged } = self.list_surely()?;
        let weights_alone = damaged.is_empty() && !sound.is_empty();
        let mut skipped = damaged;
        for step in self.with_state(&sound)?.into_iter().rev() {
            let summary = &sound[&step];
            match self.load(step, summary, layout, storage) {
                Ok(saved) => {
                    let folder = self.folder(step);
                    skipped.retain(|damage| damage.folder > folder);
                    self.recorded = summary.episodes.clone();
                    return Ok((Some(saved), skipped));
                }
                Err(error) if error.is_unread() => return Err(error),
                Err(error) => skipped.push(Damage { folder: self.folder(step), error }),
            }
        }
        skipped.sort_by(|one, other| other.folder.cmp(&one.folder));
        match skipped.into_iter().next() {
            Some(newest) => Err(newest.error),
            None if weights_alone => {
                Err(Error::NoState { folder: self.checkpoints.clone() }.into())
            }
            None => Ok((None, Vec::new())),
        }
    }

    /// Gives a damaged checkpoint's folder a name that is no checkpoint's, and returns it.
    pub fn set_aside(&self, damage: &Damage) -> Result<PathBuf> {
        let path = damaged(&self.checkpoints, hksl_files::name(&damage.folder));
        self.files.rename(&damage.folder, &path)?;
        Ok(path)
    }

    fn load(
        &self,
        environment_step: u64,
        summary: &Summary,
        layout: &Layout,
        storage: ReplayStorage,
    ) -> Result<Saved> {
        let folder = self.folder(environment_step);
        let tensors =
            |name: &str| state::tensors(&folder.join(name), &summary.read(&folder, name)?);
        summary.read(&folder, WEIGHTS)?;
        let (run, rest): (RunState, _) =
            hksl_files::from_json(&folder.join(RUN), &summary.read(&folder, RUN)?)?;
        let (stack, memory) = state::seen_from_tensors(&tensors(STACK)?)?;
        let finished = summary.episodes.iter().map(|(&number, record)| {
            let path = self.episode_file(number);
            let bytes = record.read(&path)?;
            let episode = match storage {
                ReplayStorage::Memory => {
                    Episode::from_tensors(&state::tensors(&path, &bytes)?, layout)
                }
                ReplayStorage::File => Episode::open(&path, layout),
            };
            episode.map_err(|error| match error {
                hksl_sac::Error::Read { path, source } => crate::Error::read(&path, source),
                error => crate::Error::damaged(&path, error),
            })
        });
        let finished = finished.collect::<Result<_>>()?;
        let running = summary.files.contains_key(RUNNING).then(|| {
            let episode = Episode::from_tensors(&tensors(RUNNING)?, layout);
            episode.map_err(|error| crate::Error::damaged(&folder.join(RUNNING), error))
        });
        let agent = AgentState { tensors: tensors(AGENT)?, rest };
        Ok(Saved { run, agent, stack, memory, finished, running: running.transpose()? })
    }

    /// The files of all finished episodes, by number; those that are not there yet are written.
    fn save_episodes(&mut self, replay: &Replay) -> Result<BTreeMap<u64, FileRecord>> {
        self.files.create_folder(&self.replay)?;
        let mut records = BTreeMap::new();
        for episode in replay.finished() {
            let number = episode.number();
            let record = match self.recorded.get(&number) {
                Some(record) => record.clone(),
                None => {
                    let tensors = episode.to_tensors(replay.layout())?;
                    let bytes = hksl_core::to_safetensors(&tensors)?;
                    self.files.write_whole(&self.episode_file(number), &bytes)?
                }
            };
            self.recorded.insert(number, record.clone());
            records.insert(number, record);
        }
        Ok(records)
    }

    /// Those of these checkpoints that have a full state.
    ///
    /// # Errors
    /// A folder that cannot be looked at, and may have one.
    fn with_state(&self, all: &BTreeMap<u64, Summary>) -> Result<BTreeSet<u64>> {
        let mut found = BTreeSet::new();
        for &step in all.keys() {
            let path = self.folder(step).join(STATE);
            if path.try_exists().map_err(|source| crate::Error::read(&path, source))? {
                found.insert(step);
            }
        }
        Ok(found)
    }

    fn folder(&self, environment_step: u64) -> PathBuf {
        self.checkpoints.join(format!("step-{environment_step:09}"))
    }

    /// Where a finished episode is kept.
    pub fn episode_file(&self, number: u64) -> PathBuf {
        self.replay.join(format!("episode-{number:09}.safetensors"))
    }
}
