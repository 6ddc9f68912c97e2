//! Errors as exceptions of Python.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// An error of a library call, or of the values that Python passed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// An error of training, configuration, files or environments.
    #[error(transparent)]
    Train(#[from] hksl_train::Error),
    /// An error of an analysis.
    #[error(transparent)]
    Probe(#[from] hksl_probe::Error),
    /// An array that does not fit.
    #[error("{what} has shape {got:?} and type {dtype}; expected {expected}")]
    Array {
        /// Which array.
        what: &'static str,
        /// Its shape.
        got: Vec<usize>,
        /// The type of its elements.
        dtype: String,
        /// What would be valid.
        expected: String,
    },
    /// A setting of a type that no setting has.
    #[error(
        "config[{key:?}] = {value} is of type {kind}; settings are bool, int, float, str or lists of these"
    )]
    Setting {
        /// The key.
        key: String,
        /// The value, as Python writes it.
        value: String,
        /// Its type.
        kind: String,
    },
    /// An object that another thread is using.
    #[error(
        "another thread is using this {what}; give each thread a {what} of its own, or guard it with a lock"
    )]
    Busy {
        /// The kind of object.
        what: &'static str,
    },
    /// An exception of Python.
    #[error(transparent)]
    Python(#[from] PyErr),
}

/// `std::result::Result` with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

impl From<hksl_envs::Error> for Error {
    fn from(error: hksl_envs::Error) -> Self {
        Self::Train(error.into())
    }
}

impl From<hksl_train::config::Error> for Error {
    fn from(error: hksl_train::config::Error) -> Self {
        Self::Train(error.into())
    }
}

impl From<Error> for PyErr {
    fn from(error: Error) -> Self {
        Python::attach(|py| match error {
            Error::Python(exception) => exception,
            Error::Train(hksl_train::Error::Environment(error)) => of_environment(py, error),
            Error::Probe(hksl_probe::Error::Environment(error)) => of_environment(py, error),
            error => exception(py, class(&error), &error),
        })
    }
}

/// The exception that a Python environment raised, as it was; else one of hksl.
fn of_environment(py: Python, error: hksl_envs::Error) -> PyErr {
    if let hksl_envs::Error::External { source, .. } = error {
        return match source.downcast::<PyErr>() {
            Ok(exception) => *exception,
            Err(source) => exception(py, "TaskError", source.as_ref()),
        };
    }
    let class = match &error {
        error if error.is_native() => "NativeError",
        hksl_envs::Error::UnknownTask { .. }
        | hksl_envs::Error::Setting { .. }
        | hksl_envs::Error::Distractor { .. }
        | hksl_envs::Error::Space { .. } => "ConfigError",
        hksl_envs::Error::ActionLength { .. } | hksl_envs::Error::ActionNotFinite { .. } => {
            "ArrayError"
        }
        _ => "TaskError",
    };
    exception(py, class, &error)
}

/// The name of the exception's class in `hksl.errors`.
fn class(error: &Error) -> &'static str {
    use hksl_train::{Error as Train, RunError};
    match error {
        Error::Array { .. } => "ArrayError",
        Error::Setting { .. } => "ConfigError",
        Error::Busy { .. } => "BusyError",
        Error::Train(error) if error.is_usage() => "ConfigError",
        Error::Train(Train::Run(RunError::NotFinite { .. })) => "NotFiniteError",
        Error::Train(Train::Agent(error)) | Error::Probe(hksl_probe::Error::Agent(error)) => {
            of_agent(error)
        }
        Error::Train(Train::Run(_) | Train::Files(_) | Train::Checkpoint(_)) => "RunError",
        Error::Probe(
            hksl_probe::Error::NoCoordinates { .. }
            | hksl_probe::Error::UnknownCoordinate { .. }
            | hksl_probe::Error::Horizon { .. },
        ) => "ConfigError",
        _ => "Error",
    }
}

fn of_agent(error: &hksl_sac::Error) -> &'static str {
    use hksl_core::Error as Core;
    match error {
        hksl_sac::Error::NotFinite { .. } | hksl_sac::Error::Core(Core::GradientNotFinite(_)) => {
            "NotFiniteError"
        }
        hksl_sac::Error::Size { .. } | hksl_sac::Error::Core(Core::Shape { .. }) => "ArrayError",
        hksl_sac::Error::Core(Core::Setting { .. } | Core::ImageTooSmall { .. }) => "ConfigError",
        _ => "Error",
    }
}

/// An exception of `hksl.errors`, whose message has one line for each cause that adds something.
fn exception(py: Python, class: &str, error: &(dyn std::error::Error + 'static)) -> PyErr {
    let mut message = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let text = error.to_string();
        if !message.ends_with(&text) {
            message.push_str(&format!("\n  caused by: {text}"));
        }
        cause = error.source();
    }
    let made = py
        .import("hksl.errors")
        .and_then(|errors| errors.getattr(class))
        .and_then(|class| class.call1(PyTuple::new(py, [&message])?));
    match made {
        Ok(exception) => PyErr::from_value(exception),
        Err(_) => PyTypeError::new_err(message),
    }
}
