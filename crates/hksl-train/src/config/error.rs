//! Errors of configurations.

use std::fmt;
use std::path::PathBuf;

use super::origin::Origin;
use crate::version::this_version;

/// An error in a configuration, its files or its options.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An unknown key.
    #[error("unknown key `{key}` ({origin}){}", did_you_mean(nearest))]
    UnknownKey {
        /// The key, dotted.
        key: String,
        /// Where it was set.
        origin: Origin,
        /// The nearest valid keys.
        nearest: Vec<String>,
    },

    /// A key of another method.
    #[error(
        "{key} = {value} ({origin}) is only used by {}, but the method is {method}, which uses {}; leave it out or change \
         --method",
        owners.join(", "),
        own.iter().map(|section| format!("[{section}]")).collect::<Vec<_>>().join(" and ")
    )]
    ForeignKey {
        /// The key, dotted.
        key: Box<str>,
        /// The value, as TOML.
        value: Box<str>,
        /// Where it was set.
        origin: Origin,
        /// The method chosen.
        method: Box<str>,
        /// The methods that read it.
        owners: Vec<&'static str>,
        /// The sections specific to the chosen method.
        own: Box<[&'static str]>,
    },

    /// A preset of another method.
    #[error(
        "preset `{preset}` (--preset) is only for --method {owner}, but the method is {method}; leave it out for the \
         paper's settings, or change --method"
    )]
    ForeignPreset {
        /// The requested preset.
        preset: String,
        /// The method that has the preset.
        owner: &'static str,
        /// The method chosen.
        method: String,
    },

    /// A value of the wrong type.
    #[error("{key} = {value} ({origin}) has the wrong type: expected {expected}")]
    WrongType {
        /// The key, dotted.
        key: String,
        /// The value, as TOML.
        value: String,
        /// Where it was set.
        origin: Origin,
        /// The key's type, and a hint.
        expected: String,
    },

    /// A value outside its valid range, or in conflict with another one.
    #[error("{key} = {value}{} is not valid: {expected}", in_brackets(origin.as_ref()))]
    OutOfRange {
        /// The key, dotted.
        key: String,
        /// The value, as TOML.
        value: String,
        /// Where it was set, if known.
        origin: Option<Origin>,
        /// The valid values.
        expected: String,
    },

    /// A task, method, distractor, preset or ablation that does not exist.
    #[error("unknown {kind} `{name}` ({origin}){}", all_names(kind, nearest, valid))]
    UnknownName {
        /// `task`, `method`, `distractor`, `preset` or `ablation`.
        kind: &'static str,
        /// The requested name.
        name: String,
        /// Where it was set.
        origin: Origin,
        /// The nearest names.
        nearest: Box<[String]>,
        /// All names.
        valid: Box<[String]>,
    },

    /// An ablation that the task or the method does not support, or that a setting contradicts.
    #[error("ablation {reason} ({origin})")]
    Ablation {
        /// The requested name.
        name: String,
        /// Where it was set.
        origin: Origin,
        /// The reason and what to do.
        reason: String,
    },

    /// A program's own task without a time limit.
    #[error(
        "{task} has no time limit, so its episodes may never end; wrap it in one, such as gymnasium.wrappers.TimeLimit, \
         or set environment.episode_steps to the number of steps after which hksl truncates an episode"
    )]
    NoTimeLimit {
        /// The task.
        task: String,
    },

    /// A `--set` that is not `KEY=VALUE`.
    #[error("--set {text}: {reason}; expected KEY=VALUE, as in --set sac.batch_size=64")]
    SetSyntax {
        /// The given text.
        text: String,
        /// The problem.
        reason: &'static str,
    },

    /// A configuration file that is not TOML.
    #[error("{origin} is not valid TOML: {message}")]
    Syntax {
        /// The file.
        origin: Origin,
        /// The parser's message, with line and column.
        message: String,
    },

    /// A run's configuration lacks keys.
    #[error("{} lacks {}; a run's config.toml must set every key", path.display(), keys.join(", "))]
    MissingKeys {
        /// The file.
        path: PathBuf,
        /// The absent keys, dotted.
        keys: Vec<String>,
    },

    /// A configuration file that cannot be read.
    #[error("cannot read the configuration file {}", path.display())]
    ReadConfig {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },

    /// A run of a version of hksl with different keys.
    #[error(
        "{} was written by {made_by}, but this is {}: {reason}. Use that version for this run, or update config.toml to \
         the current keys",
        path.display(),
        this_version()
    )]
    OtherVersion {
        /// The run's configuration.
        path: PathBuf,
        /// Version and commit.
        made_by: String,
        /// The mismatch.
        reason: String,
    },

    /// A configuration that cannot be written as TOML.
    #[error("cannot write the configuration as TOML")]
    NotToml(#[source] toml::ser::Error),
}

impl Error {
    /// Whether arguments, configuration files or keys caused the error (exit code 2).
    pub fn is_usage(&self) -> bool {
        !matches!(self, Self::OtherVersion { .. } | Self::NotToml(_))
    }
}

/// Shorthand for results of configuring.
pub type Result<T> = std::result::Result<T, Error>;

fn did_you_mean(nearest: &[String]) -> String {
    match nearest {
        [] => String::new(),
        [one] => format!("; did you mean `{one}`?"),
        [several @ .., last] => {
            let several: Vec<_> = several.iter().map(|name| format!("`{name}`")).collect();
            format!("; did you mean {} or `{last}`?", several.join(", "))
        }
    }
}

fn all_names(kind: &str, nearest: &[String], valid: &[String]) -> String {
    let valid = valid.join(", ");
    match nearest {
        [] => format!("; the {kind}s are {valid}"),
        nearest => format!("{} The {kind}s are {valid}", did_you_mean(nearest)),
    }
}

fn in_brackets(origin: Option<&impl fmt::Display>) -> String {
    origin.map(|origin| format!(" ({origin})")).unwrap_or_default()
}
