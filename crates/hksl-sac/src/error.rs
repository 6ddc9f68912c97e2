//! The one error type of this crate.

/// What can go wrong while an agent is described, built, trained, saved or loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An ablation that does not exist.
    #[error("unknown ablation `{name}`; the ablations are {}", valid.join(", "))]
    UnknownAblation {
        /// The name asked for.
        name: String,
        /// The names that the task has.
        valid: Vec<&'static str>,
    },

    /// An ablation that the paper defines for another task.
    #[error(
        "`{name}` is defined for falling-pixels alone; for {task} state the levels' skips, as in \
         --set hksl.skips=[1,3,5]"
    )]
    AblationNotForTask {
        /// The name asked for.
        name: String,
        /// The task it was asked for.
        task: String,
    },

    /// Something does not have the size that the agent was built for.
    #[error("{what} has {got} numbers, expected {expected}")]
    Size {
        /// What was given.
        what: &'static str,
        /// How many numbers it has.
        got: usize,
        /// How many it should have.
        expected: usize,
    },

    /// A transition without an episode to belong to.
    #[error("a transition was stored before its episode began: call begin_episode first")]
    NoEpisode,

    /// One episode alone is longer than the replay.
    #[error(
        "an episode has more than replay.capacity = {capacity} transitions: a larger capacity or \
         shorter episodes are needed"
    )]
    EpisodeTooLong {
        /// Transitions that the replay holds.
        capacity: usize,
    },

    /// An action or a reward that nothing can be learnt from.
    #[error("{what} is {value}, not a finite number")]
    NotFinite {
        /// Which.
        what: &'static str,
        /// What it is.
        value: f64,
    },

    /// A saved state lacks a part, or holds one that does not belong to this agent.
    #[error("the saved agent's {part} does not fit: {reason}")]
    SavedState {
        /// Which part.
        part: String,
        /// What is wrong with it.
        reason: String,
    },

    /// A file that is there and cannot be read, or mapped into memory.
    #[error("{} cannot be read", path.display())]
    Read {
        /// Which file.
        path: std::path::PathBuf,
        /// Why.
        source: std::io::Error,
    },

    /// An error of the model.
    #[error(transparent)]
    Core(#[from] hksl_core::Error),
}

impl From<candle_core::Error> for Error {
    fn from(error: candle_core::Error) -> Self {
        Self::Core(error.into())
    }
}

/// `std::result::Result` with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;
