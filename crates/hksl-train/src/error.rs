//! The error of this crate: it wraps those of its modules.

use std::fmt;
use std::path::Path;

/// What can go wrong while a run is configured, trained, saved, resumed or evaluated.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A configuration that cannot be.
    #[error(transparent)]
    Config(Box<crate::config::Error>),

    /// A device or a number of threads that cannot be had.
    #[error(transparent)]
    Device(#[from] crate::device::Error),

    /// A checkpoint that is not there, or not this run's.
    #[error(transparent)]
    Checkpoint(#[from] crate::checkpoint::Error),

    /// A run that cannot begin, or ends early.
    #[error(transparent)]
    Run(#[from] crate::run::Error),

    /// A file that cannot be read or written, or is not what it should be.
    #[error(transparent)]
    Files(#[from] hksl_files::Error),

    /// A sweep that cannot be, or cannot be launched.
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

    /// Whether a file is there and could not be read, which says nothing about what is in it.
    pub(crate) fn is_unread(&self) -> bool {
        matches!(self, Self::Files(error) if error.is_unread())
    }

    /// Whether the fault lies in arguments, configuration files or keys (exit code 2).
    pub fn is_usage(&self) -> bool {
        match self {
            Self::Config(error) => error.is_usage(),
            Self::Run(error) => error.is_usage(),
            Self::Sweep(error) => error.is_usage(),
            Self::Device(_) => true,
            Self::Environment(error) => matches!(
                error,
                hksl_envs::Error::UnknownTask { .. } | hksl_envs::Error::Setting { .. }
            ),
            Self::Checkpoint(_) | Self::Files(_) | Self::Agent(_) => false,
        }
    }

    /// Whether a native part is missing: graphics, model files, MuJoCo itself (exit code 3).
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
