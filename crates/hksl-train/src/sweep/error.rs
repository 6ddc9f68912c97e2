//! Why a sweep cannot be.

use std::path::PathBuf;

/// What is wrong with a study, or keeps its runs from being launched.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A study's file that says something wrong.
    #[error("{}: {}", path.display(), reason.trim_end())]
    Study {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what would be valid.
        reason: String,
    },

    /// A run of a study that cannot be.
    #[error("group {group}, {run}: {reason}")]
    StudyRun {
        /// Which group, counted from 1.
        group: usize,
        /// The run.
        run: String,
        /// Why not.
        reason: Box<crate::Error>,
    },

    /// Two runs of a study that are one.
    #[error(
        "groups {} and {} of the study both have the run {}: take it out of one, or give one group a name of its own \
         (name = \"…\")",
        groups.0,
        groups.1,
        folder.display()
    )]
    StudyCell {
        /// The run's folder.
        folder: PathBuf,
        /// Both groups, counted from 1.
        groups: (usize, usize),
    },

    /// Runs that have begun with other settings.
    #[error(
        "{count} of the study's {runs} runs have begun with other settings; give the group a name of its own (name = \
         \"…\"), or keep its runs elsewhere (--runs). The first: {first}"
    )]
    Begun {
        /// How many.
        count: usize,
        /// Of how many.
        runs: usize,
        /// What is wrong with the first.
        first: Box<crate::Error>,
    },

    /// A process that cannot be started.
    #[error("{} cannot be run: {source}", program.display())]
    Launch {
        /// The program.
        program: PathBuf,
        /// Why not.
        source: std::io::Error,
    },

    /// A path that cannot be written into a job for Slurm.
    #[error("{what}, {path:?}, cannot be written into a job for Slurm: {reason}; {instead}")]
    SlurmPath {
        /// What is there.
        what: &'static str,
        /// The path.
        path: PathBuf,
        /// Why not.
        reason: &'static str,
        /// What to do.
        instead: &'static str,
    },

    /// Slurm did not say what it has of an earlier submission.
    #[error(
        "nothing was submitted, for Slurm did not say which runs of {} are still in its queue: {reason}. Try again once \
         `squeue` answers; if that submission is surely gone, remove its folder",
        submission.display()
    )]
    Queue {
        /// The submission's folder.
        submission: PathBuf,
        /// What was asked and what came back.
        reason: String,
    },

    /// Slurm did not take a job, as far as it said.
    #[error(
        "{reason}; the job is written to {}, to be submitted where Slurm is. A submission that Slurm took all the same \
         is found by `squeue` the next time",
        script.display()
    )]
    Sbatch {
        /// The script.
        script: PathBuf,
        /// What went wrong.
        reason: String,
    },
}

impl Error {
    /// Whether the fault lies in the study.
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
