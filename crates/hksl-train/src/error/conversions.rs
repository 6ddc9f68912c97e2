//! How errors of others, and of files, become ours.

use std::fmt;
use std::path::Path;

use super::Error;

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
