//! The one error type of this crate.

/// What can go wrong while a hierarchy is described, built, trained, saved or loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A setting lies outside its valid range.
    #[error("{name} = {value} is not valid: {expected}")]
    Setting {
        /// The setting's name, as it stands in a configuration file where it is of one.
        name: &'static str,
        /// The offending value.
        value: String,
        /// What would be valid.
        expected: String,
    },

    /// An image loses all its pixels before the last convolution.
    #[error(
        "a {height}×{width} image is too small for the encoder: {convolutions} convolutions without \
         padding need at least {minimum}×{minimum} pixels"
    )]
    ImageTooSmall {
        /// Rows of the image.
        height: usize,
        /// Columns of the image.
        width: usize,
        /// How many convolutions the encoder has.
        convolutions: usize,
        /// The smallest side that leaves one pixel at the end.
        minimum: usize,
    },

    /// A tensor does not have the shape that the computation needs.
    #[error("{what} has shape {got:?}, expected {expected}")]
    Shape {
        /// Which tensor.
        what: &'static str,
        /// Its shape.
        got: Vec<usize>,
        /// The shape it should have, in the notation of the crate's documentation.
        expected: String,
    },

    /// A parameter of that name exists already.
    #[error("the parameter `{0}` is defined twice")]
    DuplicateParameter(String),

    /// A layer without inputs or outputs.
    #[error("the parameter `{name}` would have shape {shape:?}: every size must be at least 1")]
    EmptyParameter {
        /// The parameter's name.
        name: String,
        /// The shape asked for.
        shape: Vec<usize>,
    },

    /// Loaded weights lack a parameter that the model has.
    #[error("the weights lack the parameter `{0}`: they belong to another model or configuration")]
    MissingParameter(String),

    /// Loaded weights hold a tensor that the model does not know.
    #[error("the weights hold `{0}`, which this model does not have: they belong to another model")]
    UnknownParameter(String),

    /// A loaded parameter does not fit the model's.
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

    /// A loaded parameter holds another type of number than the model's.
    #[error("the parameter `{name}` is {got} in the weights and {expected} in the model")]
    ParameterType {
        /// The parameter's name.
        name: String,
        /// The type in the file.
        got: &'static str,
        /// The type in the model.
        expected: &'static str,
    },

    /// Gradients that cannot be followed; no weight was moved.
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
    /// A setting out of its range, and what would be valid.
    pub fn setting(name: &'static str, value: impl ToString, expected: impl ToString) -> Self {
        Self::Setting { name, value: value.to_string(), expected: expected.to_string() }
    }
}

/// `std::result::Result` with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

/// Checks a count that must not be 0.
///
/// # Errors
/// [`Error::Setting`] if it is.
pub fn at_least_one(name: &'static str, value: u64) -> Result<()> {
    if value == 0 { Err(Error::setting(name, value, "must be at least 1")) } else { Ok(()) }
}
