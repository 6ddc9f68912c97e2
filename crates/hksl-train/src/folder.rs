//! The configuration in a run's folder.

use hksl_files::{Labels, RunFolder, text};
use serde_json::Value;

use crate::checkpoint::Checkpoints;
use crate::config::{self, Config, ablations};
use crate::version::{COMMIT, version};
use crate::{Error, Result};

impl From<&Config> for Labels {
    fn from(config: &Config) -> Self {
        Self {
            task: config.task.clone(),
            method: config.method.clone(),
            ablation: config.ablation.clone(),
            distractor: config.distractor.clone(),
            seed: config.seed,
            environment_steps: config.environment_steps,
        }
    }
}

impl Config {
    /// The configuration of a run.
    ///
    /// # Errors
    /// A file that is missing or does not hold a valid configuration; [`config::Error::OtherVersion`].
    pub fn of_run(folder: &RunFolder) -> Result<Self> {
        let path = folder.config_file();
        let text = text::read(&path).map_err(|source| Error::read(&path, source))?;
        Self::from_toml(&text, &path).map_err(|error| match (&error, made_by(folder)) {
            (
                config::Error::MissingKeys { .. } | config::Error::UnknownKey { .. },
                Some(made_by),
            ) => config::Error::OtherVersion { path, made_by, reason: error.to_string() }.into(),
            _ => Error::damaged(&path, error),
        })
    }
}

impl Checkpoints {
    /// A run's checkpoints.
    pub fn of_run(folder: &RunFolder) -> Self {
        Self::new(folder.path())
    }
}

/// The version of hksl that last wrote the run, if it is known and not this one.
fn made_by(folder: &RunFolder) -> Option<String> {
    let text = text::read(&folder.path().join("environment.json")).ok()?;
    let facts: Value = serde_json::from_str(&text).ok()?;
    let (number, commit) = (facts["hksl"].as_str()?, facts["commit"].as_str()?);
    let other = (number, commit) != (env!("CARGO_PKG_VERSION"), COMMIT);
    other.then(|| version(number, commit))
}

/// Checks a custom name: it must be a valid folder name and must not look like an ablation. It may equal a preset's.
///
/// # Errors
/// The requirement that the name does not meet.
pub fn check_name(name: &str) -> std::result::Result<(), &'static str> {
    let plain = |c: char| c.is_alphanumeric() || matches!(c, '-' | '_' | '.');
    if name.is_empty() || name.starts_with('.') || !name.chars().all(plain) {
        return Err(
            "must consist of letters, digits, '-', '_' and '.', and must not begin with '.'",
        );
    }
    // `hksl-no-c` is the folder of the ablation.
    let is_of = |ablation: &str| {
        name.strip_prefix(ablation).is_some_and(|rest| rest.is_empty() || rest.starts_with('-'))
    };
    if ablations().into_iter().any(is_of) {
        return Err(
            "must not begin with the name of an ablation, because its folder would look like that ablation's",
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use hksl_files::RunId;

    use super::*;
    use crate::config::{Request, resolve};

    #[test]
    fn the_path_says_what_the_run_is() {
        let path = |ablation: &str, id: RunId| {
            let request = Request { ablation: Some(ablation.into()), ..Request::default() };
            let config = resolve(&request).unwrap().config;
            RunFolder::of(Path::new("runs"), &config, &id).path().to_string_lossy().into_owned()
        };
        let presets = |presets: &[&str]| RunId {
            presets: presets.iter().map(|p| p.to_string()).collect(),
            name: None,
        };
        assert_eq!(path("none", RunId::default()), "runs/falling-pixels/hksl/seed-1");
        assert_eq!(
            path("no-c", presets(&["paper", "debug"])),
            "runs/falling-pixels/hksl-no-c-debug/seed-1"
        );
        let id = RunId { name: Some("wide".into()), ..presets(&["debug"]) };
        assert_eq!(path("none", id), "runs/falling-pixels/hksl-wide/seed-1");
    }
}
