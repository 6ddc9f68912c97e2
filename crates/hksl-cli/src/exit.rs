//! Exit codes and error messages.

use std::fmt;
use std::process::ExitCode;

/// Exit code of the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Code {
    /// Success.
    Done = 0,
    /// Any failure without a code of its own.
    Failure = 1,
    /// Invalid arguments, configuration files or keys.
    Usage = 2,
    /// Graphics, model files or a native library are missing.
    Native = 3,
    /// A run was interrupted and saved, and can be resumed; batch systems requeue on this code (`EX_TEMPFAIL`).
    Stopped = 75,
}

impl From<Code> for ExitCode {
    fn from(code: Code) -> Self {
        Self::from(code as u8)
    }
}

/// An invalid option, or options that conflict.
#[derive(Debug)]
pub struct Misuse(pub String);

impl fmt::Display for Misuse {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.0)
    }
}

impl std::error::Error for Misuse {}

impl Code {
    /// The exit code of an error, decided by the first cause whose type is known.
    pub fn of(error: &anyhow::Error) -> Self {
        error.chain().find_map(Self::of_cause).unwrap_or(Self::Failure)
    }

    fn of_cause(cause: &(dyn std::error::Error + 'static)) -> Option<Self> {
        if cause.is::<Misuse>() {
            return Some(Self::Usage);
        }
        if let Some(error) = cause.downcast_ref::<hksl_train::Error>() {
            return match error {
                error if error.is_usage() => Some(Self::Usage),
                error if error.is_native() => Some(Self::Native),
                _ => None,
            };
        }
        if let Some(error) = cause.downcast_ref::<hksl_train::config::Error>() {
            return error.is_usage().then_some(Self::Usage);
        }
        if let Some(error) = cause.downcast_ref::<hksl_report::report::Error>() {
            return error.is_usage().then_some(Self::Usage);
        }
        if let Some(error) = cause.downcast_ref::<hksl_probe::Error>() {
            use hksl_probe::Error::{Environment, Horizon, NoCoordinates, UnknownCoordinate};
            return match error {
                NoCoordinates { .. } | UnknownCoordinate { .. } | Horizon { .. } => {
                    Some(Self::Usage)
                }
                Environment(error) => Self::of_cause(error),
                _ => None,
            };
        }
        let error = cause.downcast_ref::<hksl_envs::Error>()?;
        match error {
            error if error.is_native() => Some(Self::Native),
            hksl_envs::Error::UnknownTask { .. } | hksl_envs::Error::Setting { .. } => {
                Some(Self::Usage)
            }
            _ => None,
        }
    }
}

/// Formats an error as `error: …`, followed by one line for each cause that adds information.
pub fn describe(error: &anyhow::Error) -> String {
    let mut text = format!("error: {error}");
    for cause in error.chain().skip(1) {
        let cause = cause.to_string();
        if !text.ends_with(&cause) {
            text.push_str(&format!("\n  caused by: {cause}"));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use anyhow::Context;
    use hksl_train::config::{Request, resolve};

    use super::*;

    #[test]
    fn a_fault_of_the_configuration_is_one_of_usage_however_deep() {
        let request = Request { task: Some("chess".into()), ..Request::default() };
        let error = Err::<(), _>(resolve(&request).unwrap_err()).context("no run").unwrap_err();
        assert_eq!(Code::of(&error), Code::Usage);
        let text = describe(&error);
        assert!(text.starts_with("error: no run\n  caused by: unknown task `chess`"), "{text}");
    }

    #[test]
    fn missing_graphics_have_a_code_of_their_own() {
        let graphics = hksl_envs::Error::Graphics { reason: "no display".into() };
        assert_eq!(Code::of(&graphics.into()), Code::Native);
        let physics = hksl_envs::Error::Physics {
            task: "t".into(),
            warning: "BADQACC",
            time: 0.0,
            control_step: 0,
            before: Box::default(),
        };
        assert_eq!(Code::of(&physics.into()), Code::Failure);
        assert_eq!(Code::of(&anyhow::anyhow!("anything")), Code::Failure);
    }

    #[test]
    fn a_cause_that_repeats_its_error_is_said_once() {
        let error = anyhow::anyhow!("no such file").context("reading x: no such file");
        assert_eq!(describe(&error), "error: reading x: no such file");
    }
}
