//! Errors of devices and threads.

/// An unavailable device or number of threads.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A device that cannot be opened.
    #[error(
        "cannot open device {name}: {reason}; choose another with --device, or use --device cpu"
    )]
    Device {
        /// Its name.
        name: String,
        /// Why not.
        reason: String,
    },

    /// A number of threads that cannot be set.
    #[error("cannot set threads = {threads}: {reason}")]
    Threads {
        /// The requested number.
        threads: usize,
        /// Why not.
        reason: String,
    },
}
