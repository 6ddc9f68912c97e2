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
    /// The environment of a program, whose task has no file.
    Environment,
    /// A preset.
    Preset(String),
    /// An ablation.
    Ablation(String),
    /// A file of the user's.
    File(PathBuf),
    /// `--set`.
    Set,
    /// The argument `config` of a program.
    Program,
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
            Self::Environment => write!(f, "the environment"),
            Self::Preset(name) => write!(f, "preset {name}"),
            Self::Ablation(name) => write!(f, "ablation {name}"),
            Self::File(path) => write!(f, "file {}", path.display()),
            Self::Set => write!(f, "--set"),
            Self::Program => write!(f, "config"),
            Self::Flag(name) => write!(f, "{name}"),
        }
    }
}
