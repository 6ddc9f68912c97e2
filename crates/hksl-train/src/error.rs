//! The error type of this crate, which wraps those of its modules.

use std::fmt;
use std::path::Path;

/// An error in configuring, training, saving, resuming or evaluating a run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An invalid configuration.
    #[error(transparent)]
    Config(Box<crate::config::Error>),

    /// An unavailable device or number of threads.
    #[error(transparent)]
    Device(#[from] crate::device::Error),

    /// A missing or unsuitable checkpoint.
    #[error(transparent)]
    Checkpoint(#[from] crate::checkpoint::Error),

    /// A run that cannot start, or ends early.
    #[error(transparent)]
    Run(#[from] crate::run::Error),

    /// A file that cannot be read or written, or is damaged.
    #[error(transparent)]
    Files(#[from] hksl_files::Error),

    /// An invalid sweep, or one that cannot be launched.
    #[error(transparent)]
    Sweep(Box<crate::sweep::Error>),

    /// An error of the environment.
    #[error(transparent)]
    Environment(#[from] hksl_envs::Error),

    /// An error of the agent.
    #[error(transparent)]
    Agent(#[from] hksl_sac::Error),
}

impl Error {
    pub(crate) fn read(path: &Path, source: std::io::Error) -> Self {
        hksl_files::Error::read(path, source).into()
    }

    pub(crate) fn write(path: &Path, source: std::io::Error) -> Self {
        hksl_files::Error::write(path, source).into()
    }

    pub(crate) fn damaged(path: &Path, reason: impl fmt::Display) -> Self {
        hksl_files::Error::damaged(path, reason).into()
    }

    /// Whether an existing file could not be read, so that its contents are unknown.
    pub(crate) fn is_unread(&self) -> bool {
        matches!(self, Self::Files(error) if error.is_unread())
    }

    /// Whether arguments, configuration files or keys caused the error (exit code 2).
    pub fn is_usage(&self) -> bool {
        match self {
            Self::Config(error) => error.is_usage(),
            Self::Run(error) => error.is_usage(),
            Self::Sweep(error) => error.is_usage(),
            Self::Device(_) => true,
            Self::Environment(error) => matches!(
                error,
                hksl_envs::Error::UnknownTask { .. }
                    | hksl_envs::Error::Setting { .. }
                    | hksl_envs::Error::Space { .. }
            ),
            Self::Checkpoint(_) | Self::Files(_) | Self::Agent(_) => false,
        }
    }

    /// Whether a native component is missing: graphics, model files or MuJoCo (exit code 3).
    pub fn is_native(&self) -> bool {
        matches!(self, Self::Environment(error) if error.is_native())
    }
}

impl From<crate::config::Error> for Error {
    fn from(error: crate::config::Error) -> Self {
        Self::Config(Box::new(error))
    }
}

impl From<crate::sweep::Error> for Error {
    fn from(error: crate::sweep::Error) -> Self {
        Self::Sweep(Box::new(error))
    }
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
