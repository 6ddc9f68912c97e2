//! Why there is no picture.

/// A picture that cannot be drawn.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("a plot cannot be drawn: {reason}")]
pub struct Error {
    /// Why.
    pub reason: String,
}

/// Shorthand for results of drawing.
pub type Result<T> = std::result::Result<T, Error>;
