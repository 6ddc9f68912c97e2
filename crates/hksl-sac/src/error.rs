//! The error type of this crate.

/// An error while configuring, building, training, saving or loading an agent.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An ablation that does not exist.
    #[error("unknown ablation `{name}`; the ablations are {}", valid.join(", "))]
    UnknownAblation {
        /// The name asked for.
        name: String,
        /// The ablations defined for the task.
        valid: Vec<&'static str>,
    },

    /// A number of levels for a task on which the paper does not vary it.
    #[error(
        "`{name}` is defined only where the paper varies the number of levels; state the levels' skips, as in \
         --set hksl.skips=[1,3,5]"
    )]
    AblationNotForTask {
        /// The name asked for.
        name: String,
    },

    /// A tensor or buffer has a size other than the agent's.
    #[error("{what} has {got} numbers, expected {expected}")]
    Size {
        /// Name of the tensor or buffer.
        what: &'static str,
        /// Number of elements it has.
        got: usize,
        /// Number of elements expected.
        expected: usize,
    },

    /// A transition was stored while no episode was running.
    #[error("a transition was stored before its episode began: call begin_episode first")]
    NoEpisode,

    /// One episode is longer than the replay's capacity.
    #[error(
        "an episode has more than replay.capacity = {capacity} transitions: a larger capacity or \
         shorter episodes are needed"
    )]
    EpisodeTooLong {
        /// Maximal number of transitions in the replay.
        capacity: usize,
    },

    /// An action or a reward is NaN or infinity.
    #[error("{what} is {value}, not a finite number")]
    NotFinite {
        /// "an action" or "a reward".
        what: &'static str,
        /// The value.
        value: f64,
    },

    /// A saved state lacks a part or has one that does not fit this agent.
    #[error("the saved agent's {part} does not fit: {reason}")]
    SavedState {
        /// The part's name.
        part: String,
        /// The reason why it does not fit.
        reason: String,
    },

    /// A file cannot be read or mapped into memory.
    #[error("{} cannot be read", path.display())]
    Read {
        /// The file's path.
        path: std::path::PathBuf,
        /// The cause.
        source: std::io::Error,
    },

    /// An error of hksl-core.
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
