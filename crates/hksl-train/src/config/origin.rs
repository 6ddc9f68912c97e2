//! Where a value comes from.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

/// The layer that gave a key its value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Origin {
    /// `default.toml`.
    Default,
    /// The file of a method.
    Method(String),
    /// The file of a task.
    Task(String),
    /// The file of a distractor.
    Distractor(String),
    /// A preset.
    Preset(String),
    /// An ablation.
    Ablation(String),
    /// A file of the user's.
    File(PathBuf),
    /// `--set`.
    Set,
    /// An argument or a flag, by its name.
    Flag(&'static str),
}

/// Every key of a configuration, dotted, and where its value comes from.
pub type Origins = BTreeMap<String, Origin>;

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Default => write!(f, "default.toml"),
            Self::Method(name) => write!(f, "methods/{name}.toml"),
            Self::Task(name) => write!(f, "tasks/{name}.toml"),
            Self::Distractor(name) => write!(f, "distractors/{name}.toml"),
            Self::Preset(name) => write!(f, "preset {name}"),
            Self::Ablation(name) => write!(f, "ablation {name}"),
            Self::File(path) => write!(f, "file {}", path.display()),
            Self::Set => write!(f, "--set"),
            Self::Flag(name) => write!(f, "{name}"),
        }
    }
}
