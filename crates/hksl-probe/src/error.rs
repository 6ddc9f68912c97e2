//! The one error type of this crate.

use std::path::PathBuf;

/// What can go wrong while episodes are collected and looked at.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A task that the paper's probe does not define coordinates for.
    #[error(
        "{task} has no coordinates of its own to predict; name some: --coordinates {example} (its readings are {})",
        readings.join(", ")
    )]
    NoCoordinates {
        /// The task.
        task: String,
        /// Some that it has.
        example: String,
        /// Its readings.
        readings: Vec<String>,
    },

    /// A coordinate that the task does not have.
    #[error("{task} has no coordinate `{name}`; it has {}", valid.join(", "))]
    UnknownCoordinate {
        /// The task.
        task: String,
        /// The coordinate asked for.
        name: String,
        /// All there are.
        valid: Vec<String>,
    },

    /// A horizon longer than an episode.
    #[error(
        "a horizon of {horizon} agent steps is longer than an episode of {task}, which has {steps}; choose one up to {steps}"
    )]
    Horizon {
        /// The task.
        task: String,
        /// The horizon asked for; agent steps.
        horizon: usize,
        /// Agent steps in an episode, by its time limit.
        steps: usize,
    },

    /// An HKSL agent whose levels tell each other nothing.
    #[error("{reason}, so there is no communication to look at")]
    NoCommunication {
        /// Why.
        reason: String,
    },

    /// Episodes too short for a single trajectory.
    #[error(
        "no trajectory of {length} transitions fits into these episodes, whose longest has {longest} agent steps"
    )]
    NoTrajectory {
        /// Transitions in a trajectory.
        length: usize,
        /// Agent steps in the longest episode.
        longest: usize,
    },

    /// Numbers that are none.
    #[error(
        "{what} hold numbers that are not finite, so nothing can be said of them; look at an earlier checkpoint"
    )]
    NotFinite {
        /// Which ones.
        what: &'static str,
    },

    /// Numbers that do not fit together.
    #[error("{what}: {got}, expected {expected}")]
    Shape {
        /// What was given.
        what: &'static str,
        /// Its size.
        got: String,
        /// What it should be.
        expected: String,
    },

    /// A least-squares problem without a unique solution.
    #[error(
        "the linear map cannot be fitted: with penalty {penalty} its equations have no unique solution; a larger \
         penalty is needed"
    )]
    Singular {
        /// The penalty.
        penalty: f64,
    },

    /// A cached data set that cannot be written or read.
    #[error("the cached data set {} cannot be used", path.display())]
    Cache {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },

    /// An error of the environment.
    #[error(transparent)]
    Environment(#[from] hksl_envs::Error),

    /// An error of the agent.
    #[error(transparent)]
    Agent(#[from] hksl_sac::Error),
}

impl From<hksl_core::Error> for Error {
    fn from(error: hksl_core::Error) -> Self {
        Self::Agent(error.into())
    }
}

impl From<candle_core::Error> for Error {
    fn from(error: candle_core::Error) -> Self {
        Self::Agent(error.into())
    }
}

/// `std::result::Result` with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;
