//! What is wrong with a configuration.

use std::fmt;
use std::path::PathBuf;

use super::origin::Origin;
use crate::version::this_version;

/// What can be wrong with a configuration, its files and its options.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A key that no configuration has.
    #[error("unknown key `{key}` ({origin}){}", did_you_mean(nearest))]
    UnknownKey {
        /// The key, dotted.
        key: String,
        /// Where it stands.
        origin: Origin,
        /// The nearest valid keys.
        nearest: Vec<String>,
    },

    /// A key of another method.
    #[error(
        "{key} = {value} ({origin}) is read by {} alone, and the method is {method}, whose own sections are {}",
        owners.join(", "),
        own.iter().map(|section| format!("[{section}]")).collect::<Vec<_>>().join(" and ")
    )]
    ForeignKey {
        /// The key, dotted.
        key: Box<str>,
        /// The value, as TOML.
        value: Box<str>,
        /// Where it stands.
        origin: Origin,
        /// The method chosen.
        method: Box<str>,
        /// The methods that read it.
        owners: Vec<&'static str>,
        /// The sections that the chosen method has to itself.
        own: Box<[&'static str]>,
    },

    /// A preset of another method.
    #[error(
        "preset `{preset}` (--preset) is for --method {owner}, and the method is {method}; without a preset it runs as \
         in the paper"
    )]
    ForeignPreset {
        /// The preset asked for.
        preset: String,
        /// The method that it is for.
        owner: &'static str,
        /// The method chosen.
        method: String,
    },

    /// A value of another type than the key's.
    #[error("{key} = {value} ({origin}) has the wrong type: expected {expected}")]
    WrongType {
        /// The key, dotted.
        key: String,
        /// The value, as TOML.
        value: String,
        /// Where it stands.
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
        /// Where it comes from, where known.
        origin: Option<Origin>,
        /// What would be valid.
        expected: String,
    },

    /// A task, method, distractor, preset or ablation that does not exist.
    #[error("unknown {kind} `{name}` ({origin}){}", all_names(kind, nearest, valid))]
    UnknownName {
        /// `task`, `method`, `distractor`, `preset` or `ablation`.
        kind: &'static str,
        /// The name asked for.
        name: String,
        /// Where it stands.
        origin: Origin,
        /// The nearest names.
        nearest: Box<[String]>,
        /// All names.
        valid: Box<[String]>,
    },

    /// An ablation that the task or the method does not have, or that a setting undoes.
    #[error("ablation {reason} ({origin})")]
    Ablation {
        /// The name asked for.
        name: String,
        /// Where it stands.
        origin: Origin,
        /// Why not, and the way out.
        reason: String,
    },

    /// A `--set` that is not `KEY=VALUE`.
    #[error("--set {text}: {reason}; expected KEY=VALUE, as in --set sac.batch_size=64")]
    SetSyntax {
        /// What was given.
        text: String,
        /// What is wrong with it.
        reason: &'static str,
    },

    /// A configuration file that is not TOML.
    #[error("{origin} is not valid TOML: {message}")]
    Syntax {
        /// Which file.
        origin: Origin,
        /// The parser's message, with line and column.
        message: String,
    },

    /// A complete configuration lacks keys.
    #[error("{} lacks {}; a run's configuration states every key", path.display(), keys.join(", "))]
    MissingKeys {
        /// Which file.
        path: PathBuf,
        /// The absent keys, dotted.
        keys: Vec<String>,
    },

    /// A configuration file that cannot be read.
    #[error("the configuration file {} cannot be read", path.display())]
    ReadConfig {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },

    /// A run of a version of hksl that had other settings.
    #[error(
        "{} was written by {made_by}, and this is {}: {reason}. That version goes on with the run and looks into it; \
         here the file would have to be brought up to this one's settings",
        path.display(),
        this_version()
    )]
    OtherVersion {
        /// The run's configuration.
        path: PathBuf,
        /// Version and commit.
        made_by: String,
        /// What does not fit.
        reason: String,
    },

    /// A configuration that does not fit TOML.
    #[error("the configuration cannot be written as TOML")]
    NotToml(#[source] toml::ser::Error),
}

impl Error {
    /// Whether the fault lies in arguments, configuration files or keys (exit code 2).
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
