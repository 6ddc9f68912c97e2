//! Study files.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Deserializer};
use toml::{Table, Value};

use super::Error as SweepError;
use crate::config::{self, ABLATION_NONE, DISTRACTOR_NONE, METHODS};
use crate::folder::check_name;
use crate::{Error, Result};
use hksl_files::numbers::Whole;

/// A study file: groups of runs, each the product of its lists, and how to launch them.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Study {
    /// Name of the study, used for jobs and logs.
    pub name: String,
    /// Folder of all runs.
    #[serde(default = "default_runs")]
    pub runs: PathBuf,
    /// Presets of every run, in order.
    #[serde(default)]
    pub presets: Vec<String>,
    /// Settings of every run, as in a `--config` file.
    #[serde(default)]
    pub settings: Table,
    /// Groups of runs.
    #[serde(default, rename = "group")]
    pub groups: Vec<Group>,
    /// Options for launching on this machine.
    #[serde(default)]
    pub local: LocalSection,
    /// Options for launching with Slurm.
    #[serde(default)]
    pub slurm: SlurmSection,
    /// Text of the file.
    #[serde(skip)]
    pub text: String,
}

/// A group: every combination of the lists is a run.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Group {
    /// Tasks.
    pub tasks: Vec<String>,
    /// Distractors.
    #[serde(default = "no_distractor")]
    pub distractors: Vec<String>,
    /// Methods.
    #[serde(default = "default_methods")]
    pub methods: Vec<String>,
    /// Ablations of HKSL.
    #[serde(default = "no_ablation")]
    pub ablations: Vec<String>,
    /// Seeds.
    #[serde(deserialize_with = "seeds")]
    pub seeds: Vec<u64>,
    /// Name in the runs' folders, as `--name`.
    #[serde(default)]
    pub name: Option<String>,
    /// Presets, applied after the study's.
    #[serde(default)]
    pub presets: Vec<String>,
    /// Settings that override the study's.
    #[serde(default)]
    pub settings: Table,
}

/// Section `[local]`.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LocalSection {
    /// Concurrent runs, which share the cores.
    #[serde(default = "one", deserialize_with = "count")]
    pub jobs: usize,
}

impl Default for LocalSection {
    fn default() -> Self {
        Self { jobs: one() }
    }
}

/// Section `[slurm]`: options that become `#SBATCH` lines. Each run is one job of the array.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SlurmSection {
    /// `--partition`.
    #[serde(default)]
    pub partition: Option<String>,
    /// `--time` of a run, after which it saves and is requeued.
    #[serde(default)]
    pub time: Option<String>,
    /// `--gpus` of a run.
    #[serde(default)]
    pub gpus: Option<String>,
    /// `--cpus-per-task` and threads of the run, 1 by default.
    #[serde(default, deserialize_with = "some_count")]
    pub cpus: Option<usize>,
    /// `--mem`.
    #[serde(default)]
    pub memory: Option<String>,
    /// Concurrent runs, all by default.
    #[serde(default, deserialize_with = "some_count")]
    pub at_once: Option<usize>,
    /// Further options of sbatch, such as `--account=vision`.
    #[serde(default)]
    pub directives: Vec<String>,
    /// Shell lines before the run, such as `module load cuda`.
    #[serde(default)]
    pub setup: Vec<String>,
}

impl Study {
    /// Reads a study file.
    ///
    /// # Errors
    /// [`SweepError::Study`], with the file, the problem and the valid values.
    pub fn read(path: &Path) -> Result<Self> {
        let text = hksl_files::text::read(path)
            .map_err(|source| config::Error::ReadConfig { path: path.to_owned(), source })?;
        Self::parse(&text, path)
    }

    /// Parses the text of a study file.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let refused =
            |reason: String| Error::from(SweepError::Study { path: path.to_owned(), reason });
        let mut study: Self = toml::from_str(text).map_err(|error| refused(error.to_string()))?;
        text.clone_into(&mut study.text);
        if study.groups.is_empty() {
            return Err(refused("it has no [[group]] of runs".to_owned()));
        }
        if let Err(reason) = check_name(&study.name) {
            return Err(refused(format!("name {reason}, and is {:?}", study.name)));
        }
        check_settings(&study.settings).map_err(refused)?;
        if study.local.jobs == 0 {
            return Err(refused("local.jobs is 0; it must be at least 1".to_owned()));
        }
        study.slurm.check().map_err(refused)?;
        for (index, group) in study.groups.iter().enumerate() {
            group.check().map_err(|reason| refused(format!("group {}: {reason}", index + 1)))?;
        }
        Ok(study)
    }
}

/// Keys that a group or the sweep sets must not be in `settings` too, because one of the values would be ignored.
fn check_settings(settings: &Table) -> std::result::Result<(), String> {
    for (key, instead) in [
        ("task", "the group's tasks"),
        ("distractor", "the group's distractors"),
        ("method", "the group's methods"),
        ("ablation", "the group's ablations"),
        ("seed", "the group's seeds"),
        ("threads", "slurm.cpus, or local.jobs, which share the cores"),
    ] {
        if settings.contains_key(key) {
            return Err(format!("settings.{key} has no effect in a study: set it with {instead}"));
        }
    }
    Ok(())
}

impl SlurmSection {
    /// Refuses values that Slurm or the job script cannot contain.
    fn check(&self) -> std::result::Result<(), String> {
        for (name, count) in [("at_once", self.at_once), ("cpus", self.cpus)] {
            if count == Some(0) {
                return Err(format!("slurm.{name} is 0; it must be at least 1, or left out"));
            }
        }
        for (name, text) in [
            ("partition", &self.partition),
            ("time", &self.time),
            ("gpus", &self.gpus),
            ("memory", &self.memory),
        ] {
            let Some(text) = text else { continue };
            if text.is_empty() || text.contains(['"', '\\']) || text.contains(char::is_control) {
                return Err(format!(
                    "slurm.{name} is {text:?}; it must be one line without quotes and backslashes, or left out"
                ));
            }
        }
        for (index, text) in self.directives.iter().enumerate() {
            let place = format!("slurm.directives[{index}] is {text:?}");
            if !text.starts_with('-') || text.contains(char::is_control) {
                return Err(format!(
                    "{place}; it must be one sbatch option on one line, as in \"--account=vision\""
                ));
            }
            let option = text.split(['=', ' ']).next().unwrap_or_default();
            if option == "--array" || (option.starts_with("-a") && !option.starts_with("--")) {
                return Err(format!(
                    "{place}; the study sets the array, so leave it out; at_once limits the concurrent jobs"
                ));
            }
        }
        Ok(())
    }
}

impl Group {
    fn check(&self) -> std::result::Result<(), String> {
        check_settings(&self.settings)?;
        if let Some(name) = &self.name {
            let refused = |reason| format!("name {reason}, and is {name:?}");
            check_name(name).map_err(refused)?;
        }
        let lists = [
            ("tasks", self.tasks.is_empty()),
            ("distractors", self.distractors.is_empty()),
            ("methods", self.methods.is_empty()),
            ("ablations", self.ablations.is_empty()),
            ("seeds", self.seeds.is_empty()),
        ];
        if let Some((name, _)) = lists.iter().find(|(_, empty)| *empty) {
            return Err(format!("{name} is empty; it must list at least one value"));
        }
        let twice = [
            ("tasks", duplicate(&self.tasks)),
            ("distractors", duplicate(&self.distractors)),
            ("methods", duplicate(&self.methods)),
            ("ablations", duplicate(&self.ablations)),
            ("seeds", duplicate(&self.seeds)),
        ];
        if let Some((name, value)) =
            twice.into_iter().find_map(|(name, value)| Some((name, value?)))
        {
            return Err(format!(
                "{name} has {value} twice; each value must be listed once: remove one"
            ));
        }
        let all = [
            ("task", &self.tasks, config::tasks()),
            ("distractor", &self.distractors, config::distractors()),
            ("method", &self.methods, config::methods()),
            ("ablation", &self.ablations, config::ablations()),
        ];
        for (kind, names, valid) in all {
            for name in names {
                if !valid.contains(&name.as_str()) {
                    let near = hksl_envs::nearest(name, valid.iter().copied());
                    let near =
                        near.first().map_or(String::new(), |n| format!("; did you mean `{n}`?"));
                    let valid = valid.join(", ");
                    return Err(format!("unknown {kind} `{name}`{near} (valid: {valid})"));
                }
            }
        }
        let ablated = self.ablations.iter().find(|ablation| *ablation != ABLATION_NONE);
        let whole = METHODS.iter().filter(|method| !method.has_ablations).map(|method| method.name);
        let other = whole.into_iter().find(|name| self.methods.iter().any(|method| method == name));
        if let (Some(ablation), Some(method)) = (ablated, other) {
            return Err(format!(
                "`{ablation}` takes a part of hksl away, and {method} is among the methods: ablations need a group \
                 of their own"
            ));
        }
        Ok(())
    }
}

/// The first item that occurs twice.
fn duplicate<T: std::fmt::Display + PartialEq>(items: &[T]) -> Option<String> {
    let again = items.iter().enumerate().find(|(index, item)| items[..*index].contains(item));
    again.map(|(_, item)| item.to_string())
}

/// Leaves of a table as `KEY=VALUE`, sorted by key.
pub(super) fn sets(table: &Table) -> Vec<String> {
    fn walk(prefix: &str, table: &Table, sets: &mut Vec<String>) {
        let mut names: Vec<&String> = table.keys().collect();
        names.sort();
        for name in names {
            let key = if prefix.is_empty() { name.clone() } else { format!("{prefix}.{name}") };
            match &table[name] {
                Value::Table(inner) => walk(&key, inner, sets),
                value => sets.push(format!("{key}={value}")),
            }
        }
    }
    let mut list = Vec::new();
    walk("", table, &mut list);
    list
}

fn default_runs() -> PathBuf {
    PathBuf::from("runs")
}

fn no_distractor() -> Vec<String> {
    vec![DISTRACTOR_NONE.to_owned()]
}

fn default_methods() -> Vec<String> {
    vec![config::default_method().to_owned()]
}

fn no_ablation() -> Vec<String> {
    vec![ABLATION_NONE.to_owned()]
}

fn one() -> usize {
    1
}

fn seeds<'de, D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Vec<u64>, D::Error> {
    let seeds = Vec::<Whole>::deserialize(deserializer)?;
    Ok(seeds.into_iter().map(|Whole(seed)| seed).collect())
}

fn count<'de, D: Deserializer<'de>>(deserializer: D) -> std::result::Result<usize, D::Error> {
    Ok(Whole::deserialize(deserializer)?.0 as usize)
}

fn some_count<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> std::result::Result<Option<usize>, D::Error> {
    count(deserializer).map(Some)
}
