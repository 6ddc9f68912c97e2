//! How errors of others, and of files, become ours.

use std::fmt;
use std::path::Path;

use super::Error;

impl Error {
    pub(crate) fn read(path: &Path, source: std::io::Error) -> Self {
        Self::Read { path: path.to_owned(), source }
    }

    pub(crate) fn write(path: &Path, source: std::io::Error) -> Self {
        Self::Write { path: path.to_owned(), source }
    }

    pub(crate) fn damaged(path: &Path, reason: impl fmt::Display) -> Self {
        Self::Damaged { path: path.to_owned(), reason: reason.to_string() }
    }
}

impl From<crate::report::Error> for Error {
    fn from(error: crate::report::Error) -> Self {
        Self::Report(Box::new(error))
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
