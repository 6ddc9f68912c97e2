//! Why there is no device to compute on.

/// A device or a number of threads that cannot be had.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A device that cannot be opened.
    #[error("the device {name} cannot be opened ({reason}); --device cpu always can")]
    Device {
        /// Its name.
        name: String,
        /// Why not.
        reason: String,
    },

    /// A number of threads that cannot be had.
    #[error("threads = {threads} cannot be set: {reason}")]
    Threads {
        /// The number asked for.
        threads: usize,
        /// Why not.
        reason: String,
    },
}
