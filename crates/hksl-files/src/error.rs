//! Errors of files.

use std::fmt;
use std::path::{Path, PathBuf};

/// An error in reading or writing files.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file or folder that cannot be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },

    /// A file or folder that cannot be written.
    #[error("cannot write {}", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },

    /// A damaged file, or one of another program.
    #[error("{} is damaged or belongs to another program: {reason}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The problem.
        reason: String,
    },

    /// A folder without a run.
    #[error("{} is not a run folder: it has no config.toml; name a folder that `hksl train` wrote", folder.display())]
    NoRun {
        /// The folder.
        folder: PathBuf,
    },

    /// A run that another process is writing.
    #[error(
        "{} is locked by another process ({holder}); wait for it, stop it, or choose another --name or --runs folder",
        folder.display()
    )]
    Locked {
        /// The run's folder.
        folder: PathBuf,
        /// The contents of the lock file.
        holder: String,
    },

    /// A file system without file locks.
    #[error(
        "{} is on a file system without file locks, which keep two processes from writing one run: choose another \
         --runs folder, or mount this one with locks (Lustre: flock; NFS 3: a running lock service)",
        folder.display()
    )]
    NoLocks {
        /// The run's folder.
        folder: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
}

impl Error {
    /// A file or folder that cannot be read.
    pub fn read(path: &Path, source: std::io::Error) -> Self {
        Self::Read { path: path.to_owned(), source }
    }

    /// A file or folder that cannot be written.
    pub fn write(path: &Path, source: std::io::Error) -> Self {
        Self::Write { path: path.to_owned(), source }
    }

    /// A damaged file, or one of another program.
    pub fn damaged(path: &Path, reason: impl fmt::Display) -> Self {
        Self::Damaged { path: path.to_owned(), reason: reason.to_string() }
    }

    /// Whether an existing file could not be read, so that its contents are unknown.
    pub fn is_unread(&self) -> bool {
        let Self::Read { source, .. } = self else { return false };
        source.kind() != std::io::ErrorKind::NotFound
    }
}

/// `std::result::Result` with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;
