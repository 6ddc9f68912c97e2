//! What can go wrong with a file.

use std::fmt;
use std::path::{Path, PathBuf};

/// What can go wrong while files are read and written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file or folder that cannot be read.
    #[error("{} cannot be read", path.display())]
    Read {
        /// Which one.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },

    /// A file or folder that cannot be written.
    #[error("{} cannot be written", path.display())]
    Write {
        /// Which one.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },

    /// A file that is not what it should be.
    #[error("{} is damaged or belongs to another program: {reason}", path.display())]
    Damaged {
        /// Which file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },

    /// A folder that is no run's.
    #[error("{} is not a run's folder: it has no config.toml", folder.display())]
    NoRun {
        /// The folder.
        folder: PathBuf,
    },

    /// A run that another process is writing.
    #[error(
        "another process is working on {} ({holder}); wait for it, stop it, or choose another --name or --runs folder",
        folder.display()
    )]
    Locked {
        /// The run's folder.
        folder: PathBuf,
        /// What its lock says.
        holder: String,
    },

    /// A folder in which no process can keep others away.
    #[error(
        "{} is on a file system without file locks, which keep two processes from working on one run: choose another \
         --runs folder, or have it mounted with them (Lustre: flock; NFS 3: a running lock service)",
        folder.display()
    )]
    NoLocks {
        /// The run's folder.
        folder: PathBuf,
        /// What the system said.
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

    /// A file that is not what it should be.
    pub fn damaged(path: &Path, reason: impl fmt::Display) -> Self {
        Self::Damaged { path: path.to_owned(), reason: reason.to_string() }
    }

    /// Whether a file is there and could not be read, which says nothing about what is in it.
    pub fn is_unread(&self) -> bool {
        let Self::Read { source, .. } = self else { return false };
        source.kind() != std::io::ErrorKind::NotFound
    }
}

/// `std::result::Result` with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;
