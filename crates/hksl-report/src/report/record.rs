//! What a report knows of one run.

use std::path::{Path, PathBuf};

use hksl_files::{
    ABLATION_NONE, Account, Labels, METHOD_HKSL, Names, RunFolder, Settings, Standing, read_points,
    task_label, text,
};

use super::error::{Error, Result};
use super::suite::Suite;

/// Beyond any return; what is larger is no measurement.
const LARGEST_RETURN: f64 = 1e9;

/// The evaluations of one run, and where they come from.
#[derive(Debug, Clone)]
pub struct Record {
    /// What the report calls the method: its name, with ablation, presets or name of its own, as the run's folder.
    pub variant: String,
    /// The method.
    pub method: String,
    /// The ablation, `none` for none.
    pub ablation: String,
    /// The task.
    pub task: String,
    /// The distractor, `none` for none.
    pub distractor: String,
    /// What the task's returns are averaged with.
    pub suite: Suite,
    /// The run's seed.
    pub seed: u64,
    /// Budget, in environment steps.
    pub budget: u64,
    /// Environment steps and mean returns of the evaluations, in their order.
    pub points: Vec<(u64, f64)>,
    /// The run's folder, or the file of curves.
    pub origin: PathBuf,
    /// What there is of a run, and not of a curve of somebody else's.
    pub run: Option<OwnRun>,
}

/// A run's own words.
#[derive(Debug, Clone)]
pub struct OwnRun {
    /// Where it stands.
    pub standing: Standing,
    /// Its settings; none where another version of hksl wrote it, with other ones.
    pub settings: Option<Settings>,
    /// The commands that worked on it.
    pub commands: Vec<String>,
}

impl Record {
    /// Of a run's folder.
    ///
    /// # Errors
    /// Files that are damaged, evaluations that are another run's, a task that is not ours.
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

    /// Of an `eval.csv` that has left its run's folder: the evaluations of one agent, task, distractor and seed.
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

    /// The task with its distractor, as folders are named.
    pub fn task_label(&self) -> String {
        task_label(&self.task, &self.distractor)
    }

    /// Method, task and seed, in words.
    pub fn cell(&self) -> String {
        format!("{} on {}, seed {}", self.variant, self.task_label(), self.seed)
    }

    /// The return at this environment step.
    pub fn at(&self, step: u64) -> Option<f64> {
        let position = self.points.binary_search_by_key(&step, |point| point.0).ok()?;
        Some(self.points[position].1)
    }

    /// The environment step of the last evaluation.
    pub fn last_step(&self) -> Option<u64> {
        self.points.last().map(|point| point.0)
    }

    /// What follows method and ablation in the variant's name.
    pub(super) fn suffix(&self) -> &str {
        let base = base(&self.method, &self.ablation);
        self.variant.strip_prefix(&base).unwrap_or(&self.variant)
    }
}

/// Which columns of a file are of no concern, in one line; none if there are none.
pub(super) fn ignored_columns(names: &[String]) -> Option<String> {
    let plural = if names.len() == 1 { "" } else { "s" };
    (!names.is_empty()).then(|| format!("the column{plural} {} ignored", listed(names)))
}

fn listed(names: &[String]) -> String {
    let verb = if names.len() == 1 { "is" } else { "are" };
    format!("{} {verb}", names.join(", "))
}

/// Why a task is left out.
pub(super) fn not_ours(task: &str) -> String {
    format!("`{task}` is not a task of `hksl tasks`")
}

fn suite(task: &str, distractor: &str, names: &Names) -> Option<Suite> {
    Suite::of(task, names).filter(|_| names.distractors.contains(&distractor))
}

/// Evaluations by environment step.
///
/// # Errors
/// Two at the same step, a return that is no measurement.
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

/// The name of the folder above `seed-<n>` where it is one that `hksl train` gives, else method and ablation.
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

/// Method and ablation of an agent's name in `eval.csv`.
fn parts(agent: &str, names: &Names) -> (String, String) {
    let ablation = agent.strip_prefix(METHOD_HKSL).and_then(|rest| rest.strip_prefix('-'));
    match ablation {
        Some(ablation) if names.ablations.contains(&ablation) => {
            (METHOD_HKSL.to_owned(), ablation.to_owned())
        }
        _ => {
            let known = names.methods.iter().find(|method| agent == **method).copied();
            (known.unwrap_or(agent).to_owned(), ABLATION_NONE.to_owned())
        }
    }
}
