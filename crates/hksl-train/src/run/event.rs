//! What a run tells whoever watches it.

use std::path::{Path, PathBuf};

use super::memory::RunMemory;
use crate::Error;
use crate::config::ReplayStorage;
use crate::metrics::EvaluationRow;

/// Something that happened in a run.
#[derive(Debug)]
pub enum Event<'a> {
    /// The run's memory is about to be measured, which takes as long as a learning step.
    Measuring,
    /// A damaged checkpoint is skipped for an older one.
    SkippedCheckpoint {
        /// The problem.
        error: &'a Error,
        /// Its new path.
        moved_to: &'a Path,
    },
    /// The run starts or resumes.
    Started(&'a Summary),
    /// The run resumed with a new episode, because its environment cannot be restored in the middle of one.
    NewEpisode,
    /// A pretraining step is done.
    Pretrained {
        /// Finished steps.
        done: u64,
        /// All such steps.
        of: u64,
    },
    /// An agent step is done.
    Stepped(&'a Progress),
    /// An agent step of an evaluation is done.
    EvaluationStepped,
    /// An episode of an evaluation is done.
    EvaluationEpisode {
        /// Finished episodes.
        done: usize,
        /// All episodes.
        of: usize,
    },
    /// An evaluation is done.
    Evaluated(&'a EvaluationRow),
    /// A checkpoint is on the disk.
    Saved {
        /// Its environment step.
        environment_step: u64,
    },
    /// The run was stopped and can be resumed.
    Stopped(&'a Outcome),
    /// The budget is used up.
    Finished(&'a Outcome),
}

/// Summary of a run, for its first screen.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// Task, with its distractor if there is one.
    pub task: String,
    /// Method.
    pub method: String,
    /// Ablation, `none` for the full method.
    pub ablation: String,
    /// One observation, `(stack·C, H, W)`.
    pub observation: [usize; 3],
    /// Numbers in an action.
    pub action_dims: usize,
    /// Agent steps in an episode.
    pub agent_steps_per_episode: usize,
    /// Parameters by network.
    pub networks: Vec<(String, usize)>,
    /// Transitions that the replay will hold at most.
    pub replay_transitions: usize,
    /// Bytes that they take.
    pub replay_bytes: u64,
    /// Where they are kept.
    pub replay_storage: ReplayStorage,
    /// Bytes that weights, states and replay in the run's folder will take at most, estimated.
    pub disk_bytes: u64,
    /// Memory of the process and of learning; none if the system does not tell.
    pub memory: Option<RunMemory>,
    /// Bytes of memory that are free here, control groups counted, where the system tells.
    pub available_bytes: Option<u64>,
    /// Device of the networks.
    pub device: String,
    /// CPU threads.
    pub threads: usize,
    /// What draws the frames, where something does.
    pub renderer: Option<String>,
    /// Budget in environment steps.
    pub environment_steps: u64,
    /// Budget in agent steps.
    pub agent_steps: u64,
    /// Learning steps that the budget leaves after the initial random steps.
    pub learning_steps: u64,
    /// Where everything is kept, absolute.
    pub folder: PathBuf,
    /// Environment step at which it resumes, if it existed.
    pub resumed_at: Option<u64>,
}

/// How far a run is.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress {
    /// Agent steps taken.
    pub agent_step: u64,
    /// Environment steps taken.
    pub environment_step: u64,
    /// Learning steps taken.
    pub updates: u64,
    /// Return of the last finished training episode.
    pub last_return: Option<f64>,
    /// Mean return of the last evaluation.
    pub last_evaluation: Option<f64>,
}

/// Whether a run's budget is used up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// It is.
    Done,
    /// It was already, and there was nothing left to do.
    DoneBefore,
    /// The run was asked to stop before that, and is saved.
    Stopped,
}

/// How a run ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// In which way.
    pub ending: Ending,
    /// Mean return of the last evaluation; NaN if there was none.
    pub final_return: f64,
    /// Mean return of the best evaluation, and its environment step.
    pub best_evaluation: Option<(f64, u64)>,
    /// Environment steps taken.
    pub environment_step: u64,
    /// Agent steps taken.
    pub agent_step: u64,
    /// Seconds that the run took, pauses left out.
    pub wall_seconds: f64,
}
