//! Errors of sweeps.

use std::path::PathBuf;

/// An invalid study, or a failure to launch its runs.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An invalid study file.
    #[error("{}: {}", path.display(), reason.trim_end())]
    Study {
        /// The file.
        path: PathBuf,
        /// The problem and the valid values.
        reason: String,
    },

    /// An invalid run of a study.
    #[error("group {group}, {run}: {reason}")]
    StudyRun {
        /// Number of the group, from 1.
        group: usize,
        /// The run.
        run: String,
        /// Why not.
        reason: Box<crate::Error>,
    },

    /// A run in two groups of a study.
    #[error(
        "groups {} and {} of the study both contain the run {}: remove it from one of them, or give one group its own \
         name (name = \"…\")",
        groups.0,
        groups.1,
        folder.display()
    )]
    StudyCell {
        /// The run's folder.
        folder: PathBuf,
        /// Numbers of both groups, from 1.
        groups: (usize, usize),
    },

    /// Existing runs with other settings.
    #[error(
        "{count} of the study's {runs} runs already exist with other settings; give the group its own name (name = \
         \"…\"), or choose another folder with --runs. The first: {first}"
    )]
    Begun {
        /// Number of these runs.
        count: usize,
        /// Number of all runs.
        runs: usize,
        /// The error of the first run.
        first: Box<crate::Error>,
    },

    /// A process that cannot be started.
    #[error("cannot start {}: {source}", program.display())]
    Launch {
        /// The program.
        program: PathBuf,
        /// Why not.
        source: std::io::Error,
    },

    /// A path that a Slurm job script cannot contain.
    #[error("{what}, {path:?}, cannot be used in a Slurm job: {reason}; {instead}")]
    SlurmPath {
        /// Kind of path.
        what: &'static str,
        /// The path.
        path: PathBuf,
        /// Why not.
        reason: &'static str,
        /// What to do.
        instead: &'static str,
    },

    /// Slurm did not report the status of an earlier submission.
    #[error(
        "nothing was submitted, because Slurm did not report which runs of {} are still queued: {reason}. Try again when \
         `squeue` works; if that submission no longer exists, remove its folder",
        submission.display()
    )]
    Queue {
        /// The submission's folder.
        submission: PathBuf,
        /// The query and its answer.
        reason: String,
    },

    /// Slurm did not confirm a submission.
    #[error(
        "{reason}; the job script is {}: submit it on a machine with Slurm, or repeat the command. If Slurm accepted the \
         job after all, the next call finds it with `squeue`",
        script.display()
    )]
    Sbatch {
        /// The script.
        script: PathBuf,
        /// The problem.
        reason: String,
    },
}

impl Error {
    /// Whether the study file or the arguments caused the error.
    pub fn is_usage(&self) -> bool {
        match self {
            Self::Study { .. }
            | Self::StudyRun { .. }
            | Self::StudyCell { .. }
            | Self::Begun { .. }
            | Self::SlurmPath { .. } => true,
            Self::Launch { .. } | Self::Queue { .. } | Self::Sbatch { .. } => false,
        }
    }
}
