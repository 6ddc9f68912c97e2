//! A run's folder.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::{ABLATION_NONE, Error, Files, Labels, PRESET_PAPER, Result, RunLock, text};

/// Name of a run's event file.
///
/// TensorBoard takes a file for an event file if its name contains `tfevents`. Where a folder has
/// several, it reads them in the order of their names, which is why names usually have the time of
/// their making in seconds, in ten digits, and the host's name after it. A run has one file, whose
/// name is to stay the same when the run is resumed, at another time and perhaps on another host:
/// both places are filled with constants.
pub const EVENTS_NAME: &str = "events.out.tfevents.0000000000.hksl";

/// Parts of a run folder's name that are not in its configuration.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RunId {
    /// Presets, in the order in which they were given.
    pub presets: Vec<String>,
    /// A custom name, instead of the presets' names.
    pub name: Option<String>,
}

/// The folder of one run, with the names of what is in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunFolder {
    path: PathBuf,
}

impl RunFolder {
    /// `<runs>/<task>[-<distractor>]/<method>[-<ablation>][-<preset or name>]/seed-<n>`.
    pub fn of(runs: &Path, run: impl Into<Labels>, id: &RunId) -> Self {
        let run: Labels = run.into();
        let mut method = run.method.clone();
        if run.ablation != ABLATION_NONE {
            method.push_str(&format!("-{}", run.ablation));
        }
        let presets = id.presets.iter().filter(|preset| *preset != PRESET_PAPER).cloned();
        let suffixes: Vec<String> =
            id.name.clone().map_or_else(|| presets.collect(), |name| vec![name]);
        for suffix in suffixes {
            method.push_str(&format!("-{suffix}"));
        }
        Self { path: runs.join(run.task_label()).join(method).join(format!("seed-{}", run.seed)) }
    }

    /// A folder for a run, whatever its name.
    pub fn new(path: &Path) -> Self {
        Self { path: path.to_owned() }
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

    /// All runs in this folder and its subfolders, sorted by path. Runs are not nested. Subfolders that cannot be read
    /// are skipped with a warning.
    ///
    /// # Errors
    /// A folder that cannot be read.
    pub fn all_under(folder: &Path) -> Result<Vec<Self>> {
        Self::walk(folder, &mut BTreeSet::new())
    }

    /// `seen` are the visited folders, because links may form cycles.
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
                Err(error) => tracing::warn!("skipped: {error}"),
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

    /// `failed`: the error that ended the run, if it has not been resumed since.
    pub fn failed_file(&self) -> PathBuf {
        self.path.join("failed")
    }

    /// The error that ended the run, if any.
    pub fn failure(&self) -> Option<String> {
        Some(fs::read_to_string(self.failed_file()).ok()?.trim().to_owned())
    }

    /// Whether a process is working on the run.
    pub fn is_locked(&self) -> bool {
        RunLock::is_taken(&self.path)
    }

    /// Records the error that ended the run. Write failures are ignored, because the original error matters more.
    pub fn mark_failed(&self, error: &dyn std::error::Error) {
        let _ = fs::write(self.failed_file(), format!("{error}\n"));
    }

    /// Removes the record of an error.
    ///
    /// # Errors
    /// A folder that cannot be written.
    pub fn mark_going(&self) -> Result<()> {
        remove(&self.failed_file())
    }

    /// `done`: exists once the budget is used up.
    pub fn done_file(&self) -> PathBuf {
        self.path.join("done")
    }

    /// The environment steps of a finished run: those of its newest state or, if its states were removed, those of its
    /// configuration.
    ///
    /// # Errors
    /// As [`Self::labels`].
    pub fn reached(&self, newest_state: Option<u64>) -> Result<u64> {
        match newest_state {
            Some(step) => Ok(step),
            None => Ok(self.labels()?.environment_steps),
        }
    }

    /// The labels of the run, for any version of hksl.
    ///
    /// # Errors
    /// A configuration file that is missing or lacks the labels.
    pub fn labels(&self) -> Result<Labels> {
        let path = self.config_file();
        let text = text::read(&path).map_err(|source| Error::read(&path, source))?;
        Labels::parse(&text).map_err(|reason| Error::damaged(&path, reason))
    }

    /// Creates the folder if it is missing, and locks it against other processes while the lock is alive.
    ///
    /// # Errors
    /// [`Error::Locked`]; [`Error::NoLocks`]; a folder that cannot be written.
    pub fn lock(&self) -> Result<RunLock> {
        fs::create_dir_all(&self.path).map_err(|source| Error::write(&self.path, source))?;
        RunLock::take(&self.path)
    }

    /// Writes `config.toml` and `environment.json`, and adds a line to `command.txt`.
    ///
    /// # Errors
    /// A folder that cannot be written.
    pub fn describe(
        &self,
        config: &str,
        command: &str,
        environment: &BTreeMap<String, Value>,
    ) -> Result<()> {
        let text = serde_json::to_string_pretty(environment).unwrap_or_default() + "\n";
        write(&self.path.join("environment.json"), &text)?;
        let path = self.path.join("command.txt");
        let file = OpenOptions::new().create(true).append(true).open(&path);
        let added = file.and_then(|mut file| writeln!(file, "{command}"));
        added.map_err(|source| Error::write(&path, source))?;
        // Written last, because it marks a started run.
        write(&self.config_file(), config)
    }

    /// Creates or removes the [`Self::done_file`].
    ///
    /// # Errors
    /// A folder that cannot be written.
    pub fn mark_done(&self, done: bool) -> Result<()> {
        let path = self.done_file();
        if done {
            return write(&path, "");
        }
        remove(&path)
    }
}

/// Removes a file, if it exists.
fn remove(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(Error::write(path, error))
        }
        _ => Ok(()),
    }
}

/// Writes atomically: a full disk or a power loss must not destroy the old file.
fn write(path: &Path, text: &str) -> Result<()> {
    if fs::read_to_string(path).is_ok_and(|there| there == text) {
        return Ok(());
    }
    Files::default().write_whole(path, text.as_bytes()).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
