//! The evaluations of one run.

use std::path::{Path, PathBuf};

use hksl_files::{
    ABLATION_NONE, Account, Labels, Names, RunFolder, Settings, Standing, read_points, task_label,
    text,
};

use super::error::{Error, Result};
use super::suite::Suite;

/// Larger returns are treated as damage.
const LARGEST_RETURN: f64 = 1e9;

/// The evaluations of one run and their origin.
#[derive(Debug, Clone)]
pub struct Record {
    /// Name of the method in the report: method, ablation, presets or `--name`, as in the run's folder.
    pub variant: String,
    /// The method.
    pub method: String,
    /// The ablation, or `none`.
    pub ablation: String,
    /// The task.
    pub task: String,
    /// The distractor, or `none`.
    pub distractor: String,
    /// Tasks whose returns are averaged with this one's.
    pub suite: Suite,
    /// The run's seed.
    pub seed: u64,
    /// Budget, in environment steps.
    pub budget: u64,
    /// Environment step and mean return of each evaluation, in order.
    pub points: Vec<(u64, f64)>,
    /// The run's folder, or the CSV file.
    pub origin: PathBuf,
    /// Further data of a run; `None` for a curve from a CSV file.
    pub run: Option<OwnRun>,
}

/// Data that only a run's folder has.
#[derive(Debug, Clone)]
pub struct OwnRun {
    /// Its status.
    pub standing: Standing,
    /// Its settings; `None` if another version of hksl wrote incompatible settings.
    pub settings: Option<Settings>,
    /// The commands that started or resumed it.
    pub commands: Vec<String>,
}

impl Record {
    /// Reads a run's folder.
    ///
    /// # Errors
    /// Damaged files, evaluations of another run, an unknown task.
    pub(super) fn of_run(
        folder: &RunFolder,
        names: &Names,
        account: impl Fn(&RunFolder, u64) -> Account,
    ) -> Result<(Self, Vec<String>)> {
        let labels = folder.labels()?;
        let suite = suite(&labels.task, &labels.distractor, names)
            .ok_or_else(|| Error::damaged(&folder.config_file(), not_ours(&labels.task_label())))?;
        let file = folder.eval_file();
        let (rows, ignored) =
            if file.is_file() { read_points(&file)? } else { (Vec::new(), Vec::new()) };
        let mut remarks = Vec::new();
        remarks.extend(ignored_columns(&ignored).map(|said| format!("its eval.csv: {said}")));
        let agent = base(&labels.method, &labels.ablation);
        let other = |there: &Option<String>, label: &String| {
            there.as_ref().is_some_and(|there| there != label)
        };
        let foreign = rows.iter().find(|row| {
            other(&row.agent, &agent)
                || other(&row.task, &labels.task)
                || other(&row.distractor, &labels.distractor)
                || row.seed.is_some_and(|seed| seed != labels.seed)
        });
        if let Some(row) = foreign {
            let or = |label: &Option<String>, own: &str| label.clone().unwrap_or(own.to_owned());
            let (task, distractor) =
                (or(&row.task, &labels.task), or(&row.distractor, &labels.distractor));
            let reason = format!(
                "it records {} on {}, seed {}, but the run's config.toml differs",
                or(&row.agent, &agent),
                task_label(&task, &distractor),
                row.seed.unwrap_or(labels.seed)
            );
            return Err(Error::damaged(&file, reason));
        }
        let Account { standing, settings } = account(folder, labels.environment_steps);
        if let Err(error) = &settings {
            remarks
                .push(format!("its evaluations are used, but its settings are not shown: {error}"));
        }
        let points = rows.iter().map(|row| (row.environment_step, row.episode_return)).collect();
        let points = in_order(points, &file)?;
        let commands = text::read(&folder.path().join("command.txt")).unwrap_or_default();
        let record = Self {
            variant: variant(folder.path(), &labels),
            method: labels.method,
            ablation: labels.ablation,
            task: labels.task,
            distractor: labels.distractor,
            suite,
            seed: labels.seed,
            budget: labels.environment_steps,
            points,
            origin: folder.path().to_owned(),
            run: Some(OwnRun {
                standing,
                settings: settings.ok(),
                commands: commands.lines().map(str::to_owned).collect(),
            }),
        };
        Ok((record, remarks))
    }

    /// A run from an `eval.csv` outside its folder: the evaluations of one agent, task, distractor and seed.
    pub(super) fn of_points(
        [agent, task, distractor]: [String; 3],
        seed: u64,
        points: Vec<(u64, f64)>,
        file: &Path,
        names: &Names,
    ) -> Result<Self> {
        let points = in_order(points, file)?;
        let (method, ablation) = parts(&agent, names);
        let suite = suite(&task, &distractor, names)
            .ok_or_else(|| Error::damaged(file, not_ours(&task_label(&task, &distractor))))?;
        Ok(Self {
            variant: agent,
            method,
            ablation,
            task,
            distractor,
            suite,
            seed,
            budget: points.last().map_or(0, |point| point.0),
            points,
            origin: file.to_owned(),
            run: None,
        })
    }

    /// The task with its distractor, as in folder names.
    pub fn task_label(&self) -> String {
        task_label(&self.task, &self.distractor)
    }

    /// Method, task and seed, for messages.
    pub fn cell(&self) -> String {
        format!("{} on {}, seed {}", self.variant, self.task_label(), self.seed)
    }

    /// The mean return at this environment step.
    pub fn at(&self, step: u64) -> Option<f64> {
        let position = self.points.binary_search_by_key(&step, |point| point.0).ok()?;
        Some(self.points[position].1)
    }

    /// The environment step of the last evaluation.
    pub fn last_step(&self) -> Option<u64> {
        self.points.last().map(|point| point.0)
    }

    /// The part of the variant's name after method and ablation.
    pub(super) fn suffix(&self) -> &str {
        let base = base(&self.method, &self.ablation);
        self.variant.strip_prefix(&base).unwrap_or(&self.variant)
    }
}

/// A sentence on the ignored columns of a file; `None` without any.
pub(super) fn ignored_columns(names: &[String]) -> Option<String> {
    let plural = if names.len() == 1 { "" } else { "s" };
    (!names.is_empty()).then(|| format!("the column{plural} {} ignored", listed(names)))
}

fn listed(names: &[String]) -> String {
    let verb = if names.len() == 1 { "is" } else { "are" };
    format!("{} {verb}", names.join(", "))
}

/// Reason to leave out a task.
pub(super) fn not_ours(task: &str) -> String {
    format!("`{task}` is not a task of `hksl tasks`")
}

fn suite(task: &str, distractor: &str, names: &Names) -> Option<Suite> {
    Suite::of(task, names).filter(|_| names.distractors.contains(&distractor))
}

/// Sorts evaluations by environment step.
///
/// # Errors
/// Two evaluations at the same step, an impossible return.
pub(super) fn in_order(mut points: Vec<(u64, f64)>, file: &Path) -> Result<Vec<(u64, f64)>> {
    points.sort_by_key(|point| point.0);
    if let Some(twice) = points.windows(2).find(|two| two[0].0 == two[1].0) {
        let reason =
            format!("it has two evaluations of one run at environment step {}", twice[0].0);
        return Err(Error::damaged(file, reason));
    }
    let sound = |value: f64| value.abs() <= LARGEST_RETURN;
    if let Some((step, value)) = points.iter().find(|point| !sound(point.1)) {
        let reason = format!("the return at environment step {step} is {value}");
        return Err(Error::damaged(file, reason));
    }
    Ok(points)
}

fn base(method: &str, ablation: &str) -> String {
    if ablation == ABLATION_NONE { method.to_owned() } else { format!("{method}-{ablation}") }
}

/// Name of the folder above `seed-<n>` if `hksl train` could have created it, else method and ablation.
fn variant(folder: &Path, labels: &Labels) -> String {
    let base = base(&labels.method, &labels.ablation);
    let seed = format!("seed-{}", labels.seed);
    let own = folder.file_name().is_some_and(|name| name == seed.as_str());
    let above = folder.parent().and_then(Path::file_name);
    match above.map(|name| name.to_string_lossy().into_owned()) {
        Some(name) if own && (name == base || name.starts_with(&format!("{base}-"))) => name,
        _ => base,
    }
}

/// Splits an agent name of `eval.csv` into method and ablation.
fn parts(agent: &str, names: &Names) -> (String, String) {
    let ablated = names.methods.iter().find_map(|method| {
        let ablation = agent.strip_prefix(method)?.strip_prefix('-')?;
        names.ablations.contains(&ablation).then_some((*method, ablation))
    });
    let (method, ablation) = ablated.unwrap_or((agent, ABLATION_NONE));
    (method.to_owned(), ablation.to_owned())
}
