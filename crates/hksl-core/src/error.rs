//! The error type of this crate.

/// An error while configuring, building, training, saving or loading a hierarchy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A setting is outside its valid range.
    #[error("{name} = {value} is not valid: {expected}")]
    Setting {
        /// The setting's key in the configuration, or its name.
        name: &'static str,
        /// The invalid value.
        value: String,
        /// The valid range.
        expected: String,
    },

    /// An image is too small for the encoder's convolutions.
    #[error(
        "a {height}×{width} image is too small for the encoder: {convolutions} convolutions without \
         padding need at least {minimum}×{minimum} pixels"
    )]
    ImageTooSmall {
        /// Rows of the image.
        height: usize,
        /// Columns of the image.
        width: usize,
        /// Number of convolutions of the encoder.
        convolutions: usize,
        /// Minimal number of rows and columns.
        minimum: usize,
    },

    /// A tensor has the wrong shape.
    #[error("{what} has shape {got:?}, expected {expected}")]
    Shape {
        /// Name of the tensor.
        what: &'static str,
        /// Its shape.
        got: Vec<usize>,
        /// The expected shape, in the notation of the crate's documentation.
        expected: String,
    },

    /// A parameter with the same name exists already.
    #[error("the parameter `{0}` is defined twice")]
    DuplicateParameter(String),

    /// A parameter with a dimension of size 0.
    #[error("the parameter `{name}` would have shape {shape:?}: every size must be at least 1")]
    EmptyParameter {
        /// The parameter's name.
        name: String,
        /// The requested shape.
        shape: Vec<usize>,
    },

    /// Loaded weights lack a parameter of the model.
    #[error("the weights lack the parameter `{0}`: they belong to another model or configuration")]
    MissingParameter(String),

    /// Loaded weights contain a tensor that the model does not have.
    #[error("the weights hold `{0}`, which this model does not have: they belong to another model")]
    UnknownParameter(String),

    /// A loaded parameter has another shape than the model's.
    #[error(
        "the parameter `{name}` has shape {got:?} in the weights and {expected:?} in the model"
    )]
    ParameterShape {
        /// The parameter's name.
        name: String,
        /// The shape in the file.
        got: Vec<usize>,
        /// The shape in the model.
        expected: Vec<usize>,
    },

    /// A loaded parameter has another data type than the model's.
    #[error("the parameter `{name}` is {got} in the weights and {expected} in the model")]
    ParameterType {
        /// The parameter's name.
        name: String,
        /// The type in the file.
        got: &'static str,
        /// The type in the model.
        expected: &'static str,
    },

    /// A gradient is NaN or infinity. No weight was changed.
    #[error("the norm of the gradients is {0}, not a finite number: training has diverged")]
    GradientNotFinite(f64),

    /// A safetensors buffer could not be written or read.
    #[error("safetensors: {0}")]
    SafeTensors(String),

    /// An error of the tensor library.
    #[error(transparent)]
    Candle(#[from] candle_core::Error),
}

impl Error {
    /// Creates an [`Error::Setting`].
    pub fn setting(name: &'static str, value: impl ToString, expected: impl ToString) -> Self {
        Self::Setting { name, value: value.to_string(), expected: expected.to_string() }
    }
}

/// `std::result::Result` with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

/// Checks that a setting is at least 1.
///
/// # Errors
/// [`Error::Setting`] if the value is 0.
pub fn at_least_one(name: &'static str, value: u64) -> Result<()> {
    if value == 0 { Err(Error::setting(name, value, "must be at least 1")) } else { Ok(()) }
}
