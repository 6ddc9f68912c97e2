//! The error type of this crate; those of files and sweeps are part of it. One type has one list, hence
//! this file's length: what is more than a list lies in the files below.

mod conversions;
mod kind;
mod wording;

use std::path::PathBuf;

use wording::{
    all_names, did_you_mean, gigabytes, in_brackets, listed, steps_there, under, ways_out,
};

use crate::config::{Difference, Origin};
use crate::memory::MemoryLimit;
use crate::version::this_version;

/// What can go wrong while a run is configured, trained, saved, resumed or evaluated.
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
        owners: &'static [&'static str],
        /// The sections that the chosen method has to itself.
        own: Box<[&'static str]>,
    },

    /// A file that cannot be read or written, or is not what it should be.
    #[error(transparent)]
    Files(#[from] hksl_files::Error),

    /// A sweep that cannot be, or cannot be launched.
    #[error(transparent)]
    Sweep(Box<crate::sweep::Error>),

    /// Weights that are not those of a run's agent.
    #[error(
        "the checkpoint at {environment_step} does not hold the weights of a {method} agent of this run's sizes: \
         {reason}; a run's checkpoints and its config.toml belong together"
    )]
    OtherWeights {
        /// Its environment step.
        environment_step: u64,
        /// The run's method.
        method: String,
        /// What does not fit.
        reason: String,
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

    /// A device that cannot be opened.
    #[error("the device {name} cannot be opened ({reason}); --device cpu always can")]
    Device {
        /// Its name.
        name: String,
        /// Why not.
        reason: String,
    },

    /// A number of threads that cannot be had.
    #[error("threads = {threads} cannot be set: {reason}")]
    Threads {
        /// The number asked for.
        threads: usize,
        /// Why not.
        reason: String,
    },

    /// The run's folder holds a run of another configuration.
    #[error(
        "{} holds a run of another configuration: {}; choose another --name or --runs folder, or \
         repeat the run's own settings",
        folder.display(),
        listed(differences)
    )]
    OtherConfig {
        /// The run's folder.
        folder: PathBuf,
        /// The keys that differ and may not.
        differences: Vec<Difference>,
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

    /// A smaller budget than the run has used up.
    #[error(
        "{} has taken {done} environment steps already, more than environment_steps = {budget}; a \
         run can be continued, not shortened",
        folder.display()
    )]
    SmallerBudget {
        /// The run's folder.
        folder: PathBuf,
        /// Environment steps it has taken.
        done: u64,
        /// Environment steps asked for.
        budget: u64,
    },

    /// A run's folder that must not be touched.
    #[error(
        "{} exists already and --resume never leaves it untouched; choose another --name or --runs \
         folder, or leave the option out to go on with it",
        folder.display()
    )]
    RunExists {
        /// The run's folder.
        folder: PathBuf,
    },

    /// A checkpoint that is not there.
    #[error("there is no checkpoint at environment step {step}; {}", steps_there(*step, steps))]
    NoCheckpoint {
        /// The step asked for.
        step: u64,
        /// The steps there are.
        steps: Vec<u64>,
    },

    /// A run that has not saved anything yet.
    #[error("{} holds no checkpoint; a run saves its first with its first evaluation", folder.display())]
    NoCheckpoints {
        /// Where they would be.
        folder: PathBuf,
    },

    /// Checkpoints without any state to go on from.
    #[error(
        "{} holds weights, but no state to go on from (no checkpoint has a folder `state`); choose another --name or \
         --runs folder to begin anew",
        folder.display()
    )]
    NoState {
        /// The checkpoints' folder.
        folder: PathBuf,
    },

    /// A number that is no number.
    #[error(
        "{quantity} became {value} in agent step {agent_step} (environment step {environment_step}), and nothing that \
         follows would mean anything; {} holds what is known. What was saved before is intact",
        post_mortem.display()
    )]
    NotFinite {
        /// Which one.
        quantity: String,
        /// What it became.
        value: f64,
        /// When, in agent steps.
        agent_step: u64,
        /// When, in environment steps.
        environment_step: u64,
        /// The file that says more.
        post_mortem: PathBuf,
    },

    /// A run that needs more memory than there is.
    #[error(
        "the run needs up to {} of memory and {} are free{}: {}",
        gigabytes(*needed), gigabytes(*available), under(limit.as_ref()),
        ways_out(*needed, *available, *replay, limit.as_ref())
    )]
    Memory {
        /// Bytes it needs at most.
        needed: u64,
        /// Bytes of those that a replay in files would not need.
        replay: u64,
        /// Bytes there are.
        available: u64,
        /// The limit that decides how many there are, where it is not the machine.
        limit: Option<MemoryLimit>,
    },

    /// The simulation failed; what led there is kept.
    #[error(
        "the state before it and its action are in {}: hksl rollout --from plays them again; the running episode is \
         not stored, and the same command goes on from the last save",
        path.display()
    )]
    Simulation {
        /// The file that holds them.
        path: PathBuf,
        /// What failed.
        source: Box<hksl_envs::Error>,
    },

    /// An error of the environment.
    #[error(transparent)]
    Environment(#[from] hksl_envs::Error),

    /// An error of the agent.
    #[error(transparent)]
    Agent(#[from] hksl_sac::Error),

    /// A configuration that does not fit TOML.
    #[error("the configuration cannot be written as TOML")]
    NotToml(#[source] toml::ser::Error),
}

impl Error {
    /// Whether a file is there and could not be read, which says nothing about what is in it.
    pub(crate) fn is_unread(&self) -> bool {
        matches!(self, Self::Files(error) if error.is_unread())
    }

    /// Whether a native part is missing: graphics, model files, MuJoCo itself (exit code 3).
    pub fn is_native(&self) -> bool {
        matches!(self, Self::Environment(error) if error.is_native())
    }
}

/// `std::result::Result` with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;
