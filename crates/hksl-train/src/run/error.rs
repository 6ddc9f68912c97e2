//! Errors that keep a run from starting, or end it early.

use std::path::PathBuf;

use crate::config::Difference;
use crate::memory::{LimitedBy, MemoryLimit};

/// An error that keeps a run from starting, or ends it before its budget is used up.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The run's folder holds a run of another configuration.
    #[error(
        "{} contains a run of another configuration: {}; use the run's own settings, or choose \
         another --name or --runs folder",
        folder.display(),
        listed(differences)
    )]
    OtherConfig {
        /// The run's folder.
        folder: PathBuf,
        /// The keys that differ and may not.
        differences: Vec<Difference>,
    },

    /// A smaller budget than the run has used up.
    #[error(
        "environment_steps = {budget} is less than the {done} environment steps that {} has already \
         taken; a run can be extended but not shortened, so set it to at least {done}",
        folder.display()
    )]
    SmallerBudget {
        /// The run's folder.
        folder: PathBuf,
        /// Environment steps it has taken.
        done: u64,
        /// Environment steps asked for.
        budget: u64,
    },

    /// The run's folder exists and `--resume never` was given.
    #[error(
        "{} already exists, and `--resume never` does not modify an existing run; leave the option \
         out to resume the run, or choose another --name or --runs folder",
        folder.display()
    )]
    RunExists {
        /// The run's folder.
        folder: PathBuf,
    },

    /// NaN or infinity in the training.
    #[error(
        "{quantity} became {value} in agent step {agent_step} (environment step {environment_step}); it must be finite, \
         so training stopped. See {} for details; earlier checkpoints are intact",
        post_mortem.display()
    )]
    NotFinite {
        /// The quantity.
        quantity: String,
        /// Its value.
        value: f64,
        /// The agent step.
        agent_step: u64,
        /// The environment step.
        environment_step: u64,
        /// The file with details.
        post_mortem: PathBuf,
    },

    /// A run that needs more memory than there is.
    #[error(
        "the run needs about {} of memory, but only {} is free{}: {}",
        gigabytes(*needed), gigabytes(*available), under(limit.as_ref()),
        ways_out(*needed, *available, *replay, limit.as_ref())
    )]
    Memory {
        /// Bytes that it needs, measured or estimated.
        needed: u64,
        /// Bytes of the replay buffer, which `replay.storage = "file"` would save.
        replay: u64,
        /// Free bytes.
        available: u64,
        /// The limit below the machine's memory, if there is one.
        limit: Option<MemoryLimit>,
    },

    /// The simulation failed; its last state and action are saved.
    #[error(
        "the state and action before the failure are in {}: play them with `hksl rollout --from`. The unfinished episode \
         is not stored; repeat the command to resume from the last save",
        path.display()
    )]
    Simulation {
        /// The file with the state and action.
        path: PathBuf,
        /// The failure.
        source: Box<hksl_envs::Error>,
    },
}

impl Error {
    /// Whether arguments or configuration caused the error (exit code 2).
    pub fn is_usage(&self) -> bool {
        matches!(
            self,
            Self::OtherConfig { .. } | Self::SmallerBudget { .. } | Self::RunExists { .. }
        )
    }
}

/// Shorthand for results that can only fail so.
pub(super) type Result<T> = std::result::Result<T, Error>;

fn listed(differences: &[Difference]) -> String {
    let one = |d: &Difference| format!("{} is {} in that run, not {}", d.key, d.saved, d.requested);
    differences.iter().map(one).collect::<Vec<_>>().join(", ")
}

/// Gigabytes, or megabytes where that is less than one.
fn gigabytes(bytes: u64) -> String {
    match bytes {
        ..1_000_000_000 => format!("{:.0} MB", bytes as f64 / 1e6),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}

/// Describes the limit that applies.
fn under(limit: Option<&MemoryLimit>) -> String {
    limit.map_or_else(String::new, |MemoryLimit { bytes, by }| {
        format!(" under {by}, which is {}", gigabytes(*bytes))
    })
}

fn ways_out(needed: u64, available: u64, replay: u64, limit: Option<&MemoryLimit>) -> String {
    let files_count = limit.is_some_and(|limit| limit.by == LimitedBy::AddressSpace);
    let way = match needed - replay.min(needed) <= available {
        true if files_count => "reduce the replay buffer with --set replay.capacity=…",
        true => {
            "keep the replay buffer in files with --set replay.storage=file, with identical results, or reduce replay.capacity"
        }
        false if files_count => "reduce the batch with --set sac.batch_size=…",
        false => {
            "reduce the batch with --set sac.batch_size=… and keep the replay buffer in files with --set replay.storage=file"
        }
    };
    match limit {
        Some(limit) => format!("raise {}, or {way}", limit.by),
        None => way.to_owned(),
    }
}
