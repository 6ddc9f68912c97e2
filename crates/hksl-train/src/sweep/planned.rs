//! The runs of a study.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::study::sets;
use super::{Error as SweepError, Standing, Study, standing};
use crate::config::{ABLATION_NONE, Config, DISTRACTOR_NONE, Request, default_method, resolve};
use crate::{Error, Result, run};
use hksl_files::{RunFolder, RunId};

/// One run of a study.
#[derive(Debug, Clone)]
pub struct PlannedRun {
    /// Number of its group in the study, from 1.
    pub group: usize,
    /// Its configuration.
    pub config: Config,
    /// Its folder.
    pub folder: RunFolder,
    /// Arguments of `hksl train`, without `--runs` and options of the machine.
    pub arguments: Vec<String>,
}

impl PlannedRun {
    /// Status of the run. Failed if its folder contains a run with other settings.
    pub fn standing(&self) -> Standing {
        let standing = standing(&self.folder, self.config.environment_steps);
        match (self.other(), &standing) {
            (Ok(Some(error)), _) => Standing::Failed { reason: error.to_string() },
            // A finished run may have another version's settings, and a running one may be writing its settings.
            (Ok(None), _) | (Err(_), Standing::Done { .. } | Standing::Running { .. }) => standing,
            (Err(error), _) => Standing::Failed { reason: error.to_string() },
        }
    }

    /// The error that prevents resuming the run in its folder, if any.
    fn other(&self) -> Result<Option<Error>> {
        if !self.folder.is_begun() {
            return Ok(None);
        }
        let mut differences = Config::of_run(&self.folder)?.difference(&self.config)?;
        differences.retain(|difference| !difference.may_change);
        let folder = self.folder.path().to_owned();
        Ok((!differences.is_empty())
            .then_some(run::Error::OtherConfig { folder, differences }.into()))
    }

    /// Path of its folder relative to the folder of all runs: task, method and seed.
    pub fn label(&self, runs: &Path) -> String {
        let path = self.folder.path();
        path.strip_prefix(runs).unwrap_or(path).to_string_lossy().into_owned()
    }
}

/// All runs of a study, ordered by group, task, distractor, method, ablation and seed.
#[derive(Debug, Clone)]
pub struct Sweep {
    /// The study.
    pub study: Study,
    /// Absolute path of the folder of all runs.
    pub runs_folder: PathBuf,
    /// The runs.
    pub runs: Vec<PlannedRun>,
}

impl Sweep {
    /// Lists the runs of a study. `runs` replaces its folder of runs.
    ///
    /// # Errors
    /// [`SweepError::StudyRun`] for a run with an invalid configuration; [`SweepError::StudyCell`] for a run in two
    /// groups.
    pub fn plan(study: Study, runs: Option<&Path>) -> Result<Self> {
        let folder = runs.unwrap_or(&study.runs);
        let runs_folder =
            std::path::absolute(folder).map_err(|source| Error::write(folder, source))?;
        let mut planned: Vec<PlannedRun> = Vec::new();
        let mut seen: BTreeMap<PathBuf, usize> = BTreeMap::new();
        for (index, group) in study.groups.iter().enumerate() {
            for task in &group.tasks {
                for distractor in &group.distractors {
                    for method in &group.methods {
                        for ablation in &group.ablations {
                            for &seed in &group.seeds {
                                let cell = Cell { task, distractor, method, ablation, seed };
                                let run = cell.plan(&study, index, &runs_folder)?;
                                let path = run.folder.path().to_owned();
                                if let Some(first) = seen.insert(path.clone(), index + 1) {
                                    let groups = (first, index + 1);
                                    return Err(
                                        SweepError::StudyCell { folder: path, groups }.into()
                                    );
                                }
                                planned.push(run);
                            }
                        }
                    }
                }
            }
        }
        Ok(Self { study, runs_folder, runs: planned })
    }

    /// Checks that existing runs have the study's settings. Otherwise, results of the old settings would pass for
    /// results of the new ones.
    ///
    /// # Errors
    /// [`SweepError::Begun`] with the first differing run and their number.
    pub fn check_begun(&self) -> Result<()> {
        // A run that cannot be inspected fails on its own and does not stop the others.
        let mut others = self.runs.iter().filter_map(|run| run.other().ok().flatten());
        let Some(first) = others.next() else { return Ok(()) };
        let (first, count) = (Box::new(first), 1 + others.count());
        Err(SweepError::Begun { count, runs: self.runs.len(), first }.into())
    }

    /// Folder for the study's own files, such as logs.
    pub fn own_folder(&self) -> PathBuf {
        self.runs_folder.join("sweeps").join(&self.study.name)
    }
}

struct Cell<'a> {
    task: &'a str,
    distractor: &'a str,
    method: &'a str,
    ablation: &'a str,
    seed: u64,
}

impl Cell<'_> {
    fn plan(&self, study: &Study, index: usize, runs: &Path) -> Result<PlannedRun> {
        let group = &study.groups[index];
        let presets = [study.presets.clone(), group.presets.clone()].concat();
        let mut settings = study.settings.clone();
        overlay(&mut settings, &group.settings);
        let sets = sets(&settings);
        let named = |name: &str| Some(name.to_owned());
        let request = Request {
            task: named(self.task),
            method: named(self.method),
            ablation: named(self.ablation),
            distractor: named(self.distractor),
            presets: presets.clone(),
            sets: [sets.clone(), vec![format!("seed={}", self.seed)]].concat(),
            ..Request::default()
        };
        let resolved = resolve(&request).map_err(|error| SweepError::StudyRun {
            group: index + 1,
            run: self.to_string(),
            reason: Box::new(error.into()),
        })?;
        let id = RunId { presets: resolved.presets, name: group.name.clone() };
        let folder = RunFolder::of(runs, &resolved.config, &id);
        let mut arguments = vec![self.task.to_owned()];
        let mut option = |name: &str, value: &str| {
            arguments.extend([name.to_owned(), value.to_owned()]);
        };
        if self.method != default_method() {
            option("--method", self.method);
        }
        if self.ablation != ABLATION_NONE {
            option("--ablation", self.ablation);
        }
        if self.distractor != DISTRACTOR_NONE {
            option("--distractor", self.distractor);
        }
        for preset in &presets {
            option("--preset", preset);
        }
        if let Some(name) = &group.name {
            option("--name", name);
        }
        for set in &sets {
            option("--set", set);
        }
        option("--seed", &self.seed.to_string());
        Ok(PlannedRun { group: index + 1, config: resolved.config, folder, arguments })
    }
}

impl std::fmt::Display for Cell<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { task, distractor, method, ablation, seed } = self;
        write!(f, "{method}")?;
        if *ablation != ABLATION_NONE {
            write!(f, " ({ablation})")?;
        }
        write!(f, " on {task}")?;
        if *distractor != DISTRACTOR_NONE {
            write!(f, " with {distractor}")?;
        }
        write!(f, ", seed {seed}")
    }
}

/// Merges `upper` into `lower`, recursively.
fn overlay(lower: &mut toml::Table, upper: &toml::Table) {
    for (name, value) in upper {
        match (lower.get_mut(name), value) {
            (Some(toml::Value::Table(lower)), toml::Value::Table(upper)) => overlay(lower, upper),
            _ => {
                lower.insert(name.clone(), value.clone());
            }
        }
    }
}
