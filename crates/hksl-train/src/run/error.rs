//! Why a run does not begin, or ends early.

use std::path::PathBuf;

use crate::config::Difference;
use crate::memory::{LimitedBy, MemoryLimit};

/// What keeps a run from beginning, or ends it before its budget is used up.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The run's folder holds a run of another configuration.
    #[error(
        "{} holds a run of another configuration: {}; choose another --name or --runs folder, or \
         repeat the run's own settings",
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
        "{} has taken {done} environment steps already, more than environment_steps = {budget}; a \
         run can be continued, not shortened",
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

    /// A run's folder that must not be touched.
    #[error(
        "{} exists already and --resume never leaves it untouched; choose another --name or --runs \
         folder, or leave the option out to go on with it",
        folder.display()
    )]
    RunExists {
        /// The run's folder.
        folder: PathBuf,
    },

    /// A number that is no number.
    #[error(
        "{quantity} became {value} in agent step {agent_step} (environment step {environment_step}), and nothing that \
         follows would mean anything; {} holds what is known. What was saved before is intact",
        post_mortem.display()
    )]
    NotFinite {
        /// Which one.
        quantity: String,
        /// What it became.
        value: f64,
        /// When, in agent steps.
        agent_step: u64,
        /// When, in environment steps.
        environment_step: u64,
        /// The file that says more.
        post_mortem: PathBuf,
    },

    /// A run that needs more memory than there is.
    #[error(
        "the run needs up to {} of memory and {} are free{}: {}",
        gigabytes(*needed), gigabytes(*available), under(limit.as_ref()),
        ways_out(*needed, *available, *replay, limit.as_ref())
    )]
    Memory {
        /// Bytes it needs at most.
        needed: u64,
        /// Bytes of those that a replay in files would not need.
        replay: u64,
        /// Bytes there are.
        available: u64,
        /// The limit that decides how many there are, where it is not the machine.
        limit: Option<MemoryLimit>,
    },

    /// The simulation failed; what led there is kept.
    #[error(
        "the state before it and its action are in {}: hksl rollout --from plays them again; the running episode is \
         not stored, and the same command goes on from the last save",
        path.display()
    )]
    Simulation {
        /// The file that holds them.
        path: PathBuf,
        /// What failed.
        source: Box<hksl_envs::Error>,
    },
}

impl Error {
    /// Whether the fault lies in what was asked for (exit code 2).
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
    let one = |d: &Difference| format!("{} is {} there, not {}", d.key, d.saved, d.requested);
    differences.iter().map(one).collect::<Vec<_>>().join(", ")
}

/// Gigabytes, or megabytes where that is less than one.
fn gigabytes(bytes: u64) -> String {
    match bytes {
        ..1_000_000_000 => format!("{:.0} MB", bytes as f64 / 1e6),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}

/// Which limit decides what is free.
fn under(limit: Option<&MemoryLimit>) -> String {
    limit.map_or_else(String::new, |MemoryLimit { bytes, by }| {
        format!(" under {by}, {} in all", gigabytes(*bytes))
    })
}

fn ways_out(needed: u64, available: u64, replay: u64, limit: Option<&MemoryLimit>) -> String {
    let files_count = limit.is_some_and(|limit| limit.by == LimitedBy::AddressSpace);
    let way = match needed - replay.min(needed) <= available {
        true if files_count => "--set replay.capacity=… makes the replay smaller",
        true => {
            "--set replay.storage=file keeps the replay in files, for the same results; replay.capacity makes it smaller"
        }
        false if files_count => "--set sac.batch_size=… makes a learning step smaller",
        false => {
            "--set sac.batch_size=… makes a learning step smaller, replay.storage=file keeps the replay in files"
        }
    };
    match limit {
        Some(limit) => format!("raise {}; {way}", limit.by),
        None => way.to_owned(),
    }
}
