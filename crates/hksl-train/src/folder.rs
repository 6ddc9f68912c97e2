//! A run's folder.

mod labels;
mod lock;

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use serde_json::Value;

pub use labels::Labels;
pub use lock::RunLock;

use crate::checkpoint::{Checkpoints, Files};
use crate::config::{ABLATION_NONE, Config, PRESET_PAPER, ablations};
use crate::error::version;
use crate::metrics::EVENTS_NAME;
use crate::{COMMIT, Error, Result};

/// What names a run's folder, beside its configuration.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RunId {
    /// Presets, in the order in which they were given.
    pub presets: Vec<String>,
    /// A name of the user's own, in place of the presets'.
    pub name: Option<String>,
}

impl RunId {
    /// Whether a name of the user's own makes one folder, and none of an ablation's; a preset's folder it may share.
    ///
    /// # Errors
    /// What it must be made of.
    pub fn check_name(name: &str) -> std::result::Result<(), &'static str> {
        let plain = |c: char| c.is_alphanumeric() || matches!(c, '-' | '_' | '.');
        if name.is_empty() || name.starts_with('.') || !name.chars().all(plain) {
            return Err(
                "must be made of letters, digits, '-', '_' and '.', and not begin with '.'",
            );
        }
        // `hksl-no-c` is where the ablation's run is.
        let is_of = |ablation: &str| {
            name.strip_prefix(ablation).is_some_and(|rest| rest.is_empty() || rest.starts_with('-'))
        };
        if ablations().into_iter().any(is_of) {
            return Err(
                "must not begin with the name of an ablation, which the run would pass for",
            );
        }
        Ok(())
    }
}

/// The folder of one run, with the names of what is in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunFolder {
    path: PathBuf,
}

impl RunFolder {
    /// `<runs>/<task>[-<distractor>]/<method>[-<ablation>][-<preset or name>]/seed-<n>`.
    pub fn of(runs: &Path, config: &Config, id: &RunId) -> Self {
        let mut method = config.method.clone();
        if config.ablation != ABLATION_NONE {
            method.push_str(&format!("-{}", config.ablation));
        }
        let presets = id.presets.iter().filter(|preset| *preset != PRESET_PAPER).cloned();
        let suffixes: Vec<String> =
            id.name.clone().map_or_else(|| presets.collect(), |name| vec![name]);
        for suffix in suffixes {
            method.push_str(&format!("-{suffix}"));
        }
        Self {
            path: runs.join(config.task_label()).join(method).join(format!("seed-{}", config.seed)),
        }
    }

    /// An existing run.
    ///
    /// # Errors
    /// [`Error::NoRun`] if the folder is not one.
    pub fn existing(path: &Path) -> Result<Self> {
        let folder = Self { path: path.to_owned() };
        if folder.config_file().is_file() {
            Ok(folder)
        } else {
            Err(Error::NoRun { folder: folder.path })
        }
    }

    /// All runs in this folder and in those within it, in their paths' order. Runs do not hold others. Folders within
    /// that cannot be read are passed over, with a warning.
    ///
    /// # Errors
    /// A folder that cannot be read.
    pub fn all_under(folder: &Path) -> Result<Vec<Self>> {
        Self::walk(folder, &mut BTreeSet::new())
    }

    /// `seen` are the folders that were looked into: links may lead in circles.
    fn walk(folder: &Path, seen: &mut BTreeSet<PathBuf>) -> Result<Vec<Self>> {
        let place = fs::canonicalize(folder).map_err(|source| Error::read(folder, source))?;
        if !seen.insert(place) {
            return Ok(Vec::new());
        }
        let own = Self { path: folder.to_owned() };
        if own.is_begun() {
            return Ok(vec![own]);
        }
        let wrap = |source| Error::read(folder, source);
        let mut inner = Vec::new();
        for entry in fs::read_dir(folder).map_err(wrap)? {
            let path = entry.map_err(wrap)?.path();
            if path.is_dir() {
                inner.push(path);
            }
        }
        inner.sort();
        let mut runs = Vec::new();
        for path in inner {
            match Self::walk(&path, seen) {
                Ok(found) => runs.extend(found),
                Err(error) => tracing::warn!("passed over: {error}"),
            }
        }
        Ok(runs)
    }

    /// The folder itself.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether a run has begun here.
    pub fn is_begun(&self) -> bool {
        self.config_file().is_file()
    }

    /// `config.toml`: the whole configuration.
    pub fn config_file(&self) -> PathBuf {
        self.path.join("config.toml")
    }

    /// `metrics.jsonl`.
    pub fn metrics_file(&self) -> PathBuf {
        self.path.join("metrics.jsonl")
    }

    /// `eval.csv`.
    pub fn eval_file(&self) -> PathBuf {
        self.path.join("eval.csv")
    }

    /// The event file in `tensorboard`.
    pub fn event_file(&self) -> PathBuf {
        self.path.join("tensorboard").join(EVENTS_NAME)
    }

    /// `videos/step-<environment step>.gif`.
    pub fn video_file(&self, environment_step: u64) -> PathBuf {
        self.path.join(format!("videos/step-{environment_step:09}.gif"))
    }

    /// `physics-failure.json`: the state and action in which a simulation failed, if it did.
    pub fn failure_file(&self) -> PathBuf {
        self.path.join("physics-failure.json")
    }

    /// `failed`: what the run ended with, if that was an error and it has not gone on since.
    pub fn failed_file(&self) -> PathBuf {
        self.path.join("failed")
    }

    /// What the run ended with, if that was an error.
    pub fn failure(&self) -> Option<String> {
        Some(fs::read_to_string(self.failed_file()).ok()?.trim().to_owned())
    }

    /// Whether a process works on the run.
    pub fn is_locked(&self) -> bool {
        RunLock::is_taken(&self.path)
    }

    /// Writes down what the run ended with; why it did matters more than that this could not be written.
    pub(crate) fn mark_failed(&self, error: &Error) {
        let _ = fs::write(self.failed_file(), format!("{error}\n"));
    }

    /// Takes that mark away.
    pub(crate) fn mark_going(&self) -> Result<()> {
        remove(&self.failed_file())
    }

    /// `done`: there once the budget is used up.
    pub fn done_file(&self) -> PathBuf {
        self.path.join("done")
    }

    /// The environment steps that a run with a [`Self::done_file`] has done: those of its newest state or, where its
    /// states were removed, as one may, those that it was to do.
    ///
    /// # Errors
    /// As [`Self::config`].
    pub(crate) fn reached(&self, newest_state: Option<u64>) -> Result<u64> {
        match newest_state {
            Some(step) => Ok(step),
            None => Ok(self.labels()?.environment_steps),
        }
    }

    /// Its checkpoints.
    pub fn checkpoints(&self) -> Checkpoints {
        Checkpoints::new(&self.path)
    }

    /// The configuration that the run has.
    ///
    /// # Errors
    /// A file that is missing or does not hold a valid configuration; [`Error::OtherVersion`].
    pub fn config(&self) -> Result<Config> {
        let path = self.config_file();
        let text = crate::text::read(&path).map_err(|source| Error::read(&path, source))?;
        Config::from_toml(&text, &path).map_err(|error| match (&error, self.made_by()) {
            (Error::MissingKeys { .. } | Error::UnknownKey { .. }, Some(made_by)) => {
                Error::OtherVersion { path, made_by, reason: error.to_string() }
            }
            _ => Error::damaged(&path, error),
        })
    }

    /// What the run is, whatever version of hksl wrote it.
    ///
    /// # Errors
    /// A file that is missing, or does not say so.
    pub fn labels(&self) -> Result<Labels> {
        let path = self.config_file();
        let text = crate::text::read(&path).map_err(|source| Error::read(&path, source))?;
        Labels::parse(&text).map_err(|reason| Error::damaged(&path, reason))
    }

    /// The version of hksl that wrote the run last, if it is known and another than this.
    fn made_by(&self) -> Option<String> {
        let text = crate::text::read(&self.path.join("environment.json")).ok()?;
        let facts: Value = serde_json::from_str(&text).ok()?;
        let (number, commit) = (facts["hksl"].as_str()?, facts["commit"].as_str()?);
        let other = (number, commit) != (env!("CARGO_PKG_VERSION"), COMMIT);
        other.then(|| version(number, commit))
    }

    /// Makes the folder if need be, and keeps other processes from writing into it for as long as the lock lives.
    ///
    /// # Errors
    /// [`Error::Locked`]; [`Error::NoLocks`]; a folder that cannot be written.
    pub fn lock(&self) -> Result<RunLock> {
        fs::create_dir_all(&self.path).map_err(|source| Error::write(&self.path, source))?;
        RunLock::take(&self.path)
    }

    /// Writes `config.toml` and `environment.json`, and adds a line to `command.txt`.
    pub(crate) fn describe(
        &self,
        config: &Config,
        command: &str,
        environment: &BTreeMap<String, Value>,
    ) -> Result<()> {
        let text = serde_json::to_string_pretty(environment).unwrap_or_default() + "\n";
        write(&self.path.join("environment.json"), &text)?;
        let path = self.path.join("command.txt");
        let file = OpenOptions::new().create(true).append(true).open(&path);
        let added = file.and_then(|mut file| writeln!(file, "{command}"));
        added.map_err(|source| Error::write(&path, source))?;
        // Last: it is the mark of a run that has begun.
        write(&self.config_file(), &config.to_toml()?)
    }

    pub(crate) fn mark_done(&self, done: bool) -> Result<()> {
        let path = self.done_file();
        if done {
            return write(&path, "");
        }
        remove(&path)
    }
}

/// Removes a file that may not be there.
fn remove(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(Error::write(path, error))
        }
        _ => Ok(()),
    }
}

/// Aside first, and onto the disk: neither a full disk nor a loss of power must empty what was there.
fn write(path: &Path, text: &str) -> Result<()> {
    if fs::read_to_string(path).is_ok_and(|there| there == text) {
        return Ok(());
    }
    Files::new().write_whole(path, text.as_bytes()).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Request, resolve};

    #[cfg(unix)]
    #[test]
    fn links_in_circles_are_followed_once() {
        let runs = tempfile::tempdir().unwrap();
        let run = runs.path().join("task/hksl/seed-1");
        fs::create_dir_all(&run).unwrap();
        fs::write(run.join("config.toml"), "").unwrap();
        std::os::unix::fs::symlink(runs.path(), runs.path().join("task/again")).unwrap();
        let found = RunFolder::all_under(runs.path()).unwrap();
        assert_eq!(found.iter().map(RunFolder::path).collect::<Vec<_>>(), [run]);
    }

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
