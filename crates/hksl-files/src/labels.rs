//! What a run is: the part of its `config.toml` that every version of hksl has.

use serde::Deserialize;

use crate::numbers::Whole;
use crate::{ABLATION_NONE, DISTRACTOR_NONE, task_label};

/// What names a run, and how long it is to be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Labels {
    /// Task.
    pub task: String,
    /// Method.
    pub method: String,
    /// Ablation, `none` for none.
    pub ablation: String,
    /// Distractor, `none` for none.
    pub distractor: String,
    /// Seed.
    pub seed: u64,
    /// Budget, in environment steps.
    pub environment_steps: u64,
}

/// All else in the file is left aside.
#[derive(Deserialize)]
struct File {
    task: String,
    method: String,
    ablation: Option<String>,
    distractor: Option<String>,
    seed: Whole,
    environment_steps: Whole,
}

impl Labels {
    /// Reads the text of a `config.toml`.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let file: File = toml::from_str(text).map_err(|error| error.message().to_owned())?;
        Ok(Self {
            task: file.task,
            method: file.method,
            ablation: file.ablation.unwrap_or_else(|| ABLATION_NONE.to_owned()),
            distractor: file.distractor.unwrap_or_else(|| DISTRACTOR_NONE.to_owned()),
            seed: file.seed.0,
            environment_steps: file.environment_steps.0,
        })
    }

    /// The task, and its distractor if there is one.
    pub fn task_label(&self) -> String {
        task_label(&self.task, &self.distractor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_older_versions_file_is_enough() {
        let text = "task = \"walker-walk\"\nmethod = \"drq\"\nseed = 2\nenvironment_steps = 1e5\n[gone]\nkey = 1\n";
        let labels = Labels::parse(text).unwrap();
        assert_eq!((labels.task_label().as_str(), labels.seed), ("walker-walk", 2));
        assert_eq!((labels.ablation.as_str(), labels.environment_steps), ("none", 100_000));
        assert!(Labels::parse("task = \"walker-walk\"").unwrap_err().contains("method"));
    }
}
