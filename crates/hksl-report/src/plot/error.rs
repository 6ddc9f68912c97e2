//! Error of plots.

/// A plot that cannot be drawn.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("cannot draw the plot: {reason}")]
pub struct Error {
    /// The cause.
    pub reason: String,
}

/// Shorthand for results of drawing.
pub type Result<T> = std::result::Result<T, Error>;
