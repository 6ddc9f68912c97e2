//! Which runs are compared with which.

use std::collections::{BTreeMap, BTreeSet};

use hksl_files::{ABLATION_NONE, Names};

use super::error::{Error, Result};
use super::options::Options;
use super::record::Record;
use super::rectangle::rectangle;
use super::suite::{Question, Suite};

/// A task with its distractor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Task {
    /// Its name in folder names.
    pub label: String,
    /// The distractor, `none` for none.
    pub distractor: String,
}

/// Runs that are compared with each other.
#[derive(Debug, Clone)]
pub struct Comparison<'a> {
    /// The tasks.
    pub suite: Suite,
    /// The question that it answers.
    pub question: Question,
    /// Variants in the order of their colours: HKSL, its ablations, the shipped baselines, then all others by name.
    pub variants: Vec<&'a str>,
    /// Tasks, those without distractors first.
    pub tasks: Vec<Task>,
    /// Runs by task and variant.
    cells: BTreeMap<(String, &'a str), Vec<&'a Record>>,
    /// Environment steps of the compared evaluations up to `at`: all, or multiples of `Options::every`.
    pub steps: Vec<u64>,
    /// The environment step at which scores are compared.
    pub at: u64,
    /// Variants that aggregates include: those with complete runs on every task of `common`.
    pub compared: Vec<&'a str>,
    /// Labels of the tasks that aggregates include.
    pub common: Vec<String>,
}

impl<'a> Comparison<'a> {
    /// Divides runs into comparisons.
    ///
    /// # Errors
    /// [`Error::SameCell`], [`Error::Budgets`], [`Error::EvaluationPoints`], [`Error::Every`].
    pub fn all(records: &'a [Record], names: &Names, options: &Options) -> Result<Vec<Self>> {
        let mut cells: BTreeMap<_, &Record> = BTreeMap::new();
        for record in records {
            let cell = (record.variant.as_str(), record.task_label(), record.seed);
            if let Some(first) = cells.insert(cell, record) {
                let (first, second) = (first.origin.clone(), record.origin.clone());
                return Err(Error::SameCell { cell: record.cell(), first, second });
            }
        }
        let mut questions: BTreeMap<(Suite, Question), Vec<&Record>> = BTreeMap::new();
        for record in records {
            let question = if record.ablation == ABLATION_NONE {
                Question::Methods
            } else {
                Question::Ablations
            };
            questions.entry((record.suite, question)).or_default().push(record);
        }
        // Ablations are compared with the full method with the same presets or name, on the same task.
        for record in records {
            let ablations = questions.get_mut(&(record.suite, Question::Ablations));
            let is_of = |ablated: &&Record| {
                ablated.method == record.method
                    && ablated.suffix() == record.suffix()
                    && ablated.task_label() == record.task_label()
            };
            if record.ablation == ABLATION_NONE
                && let Some(ablations) = ablations
                && ablations.iter().any(is_of)
            {
                ablations.push(record);
            }
        }
        let comparisons = questions.into_iter();
        let new = |((suite, question), of)| Self::new((suite, question), of, names, options);
        comparisons.map(new).collect()
    }

    fn new(
        (suite, question): (Suite, Question),
        records: Vec<&'a Record>,
        names: &Names,
        options: &Options,
    ) -> Result<Self> {
        let at = match options.at {
            Some(at) => at,
            None => common_budget(&records)?,
        };
        let kept =
            |step: u64| step <= at && options.every.is_none_or(|every| step.is_multiple_of(every));
        let steps = records.iter().flat_map(|record| record.points.iter().map(|point| point.0));
        let steps: BTreeSet<u64> = steps.filter(|&step| kept(step)).collect();
        check_steps(&records, &steps)?;
        if let Some(every) = options.every.filter(|every| !at.is_multiple_of(*every)) {
            // An evaluation at step 0 precedes all learning.
            let latest = steps.last().copied().filter(|&step| step > 0);
            return Err(Error::Every { at, every, latest });
        }
        let (variants, tasks) = (variants(&records, names), tasks(&records, names));
        let mut cells: BTreeMap<_, Vec<&Record>> = BTreeMap::new();
        for record in &records {
            cells.entry((record.task_label(), record.variant.as_str())).or_default().push(record);
        }
        let mut comparison = Self {
            suite,
            question,
            variants,
            tasks,
            cells,
            steps: steps.into_iter().collect(),
            at,
            compared: Vec::new(),
            common: Vec::new(),
        };
        let has = |variant: &&str| {
            let tasks = comparison.tasks.iter();
            tasks.map(|task| comparison.complete(variant, &task.label).next().is_some()).collect()
        };
        let has: Vec<Vec<bool>> = comparison.variants.iter().map(has).collect();
        // Every comparison with the default method shows it, on however few tasks.
        let default_first = records.iter().any(|record| {
            names.methods.first() == Some(&record.method.as_str())
                && Some(&record.variant.as_str()) == comparison.variants.first()
        });
        let (compared, common) = rectangle(&has, default_first);
        comparison.compared =
            compared.into_iter().map(|index| comparison.variants[index]).collect();
        comparison.common =
            common.into_iter().map(|index| comparison.tasks[index].label.clone()).collect();
        Ok(comparison)
    }

    /// Its name in a heading.
    pub fn title(&self) -> String {
        match (self.question, self.suite) {
            (Question::Methods, suite) => suite.title().to_owned(),
            (Question::Ablations, Suite::FallingPixels) => {
                "Levels and ablations on Falling Pixels".to_owned()
            }
            (Question::Ablations, Suite::Control) => "Ablations on control tasks".to_owned(),
        }
    }

    /// Its name in files.
    pub fn stem(&self) -> String {
        let question = match self.question {
            Question::Methods => "methods",
            Question::Ablations => "ablations",
        };
        format!("{}-{question}", self.suite.name())
    }

    /// All runs.
    pub fn records(&self) -> impl Iterator<Item = &'a Record> {
        self.cells.values().flatten().copied()
    }

    /// Runs of a variant on a task.
    pub fn runs(&self, variant: &str, task: &str) -> &[&'a Record] {
        // Looks up the known name first: a key must live as long as the runs, `variant` need not.
        let variant = self.variants.iter().find(|known| **known == variant);
        let runs = variant.and_then(|variant| self.cells.get(&(task.to_owned(), *variant)));
        runs.map_or(&[], |runs| runs)
    }

    /// Runs of a variant on a task that were evaluated at `at`.
    pub fn complete(&self, variant: &str, task: &str) -> impl Iterator<Item = &'a Record> {
        let at = self.at;
        self.runs(variant, task).iter().copied().filter(move |record| record.at(at).is_some())
    }

    /// Scores of the complete runs at this step.
    pub fn scores(&self, variant: &str, task: &str, step: u64) -> Vec<f64> {
        let returns = self.complete(variant, task).filter_map(|record| record.at(step));
        returns.map(|value| value / self.suite.scale()).collect()
    }
}

/// Common budget of all runs. Published curves count only if there are no runs; otherwise they are cut at the budget.
fn common_budget(records: &[&Record]) -> Result<u64> {
    let own = records.iter().filter(|record| record.run.is_some());
    let of: Vec<&&Record> =
        if own.clone().next().is_some() { own.collect() } else { records.iter().collect() };
    let first = of[0];
    match of.iter().find(|record| record.budget != first.budget) {
        None => Ok(first.budget),
        Some(other) => {
            let named = |record: &Record| (record.cell(), record.origin.clone(), record.budget);
            let evaluated = |record: &Record, step| record.at(step).is_some();
            let mut steps: Vec<u64> = first.points.iter().map(|point| point.0).collect();
            steps.retain(|&step| {
                (1..=first.budget.min(other.budget)).contains(&step) && evaluated(other, step)
            });
            let both = steps.into_iter().max();
            let (first, second) = (named(first), Box::new(named(other)));
            Err(Error::Budgets { first, second, both })
        }
    }
}

/// Checks that every run was evaluated at each of the steps up to its last one.
fn check_steps(records: &[&Record], steps: &BTreeSet<u64>) -> Result<()> {
    for record in records {
        let Some(last) = record.points.last() else {
            continue;
        };
        let lacking = steps.range(..=last.0).find(|&&step| record.at(step).is_none());
        if let Some(&step) = lacking {
            let with = records.iter().find(|other| other.at(step).is_some());
            let named = |record: &Record| (record.cell(), record.origin.clone());
            let with = with.map_or_else(|| named(record), |other| named(other));
            return Err(Error::EvaluationPoints { step, with, without: named(record) });
        }
    }
    Ok(())
}

fn variants<'a>(records: &[&'a Record], names: &Names) -> Vec<&'a str> {
    let mut variants: Vec<&Record> = Vec::new();
    for record in records {
        if !variants.iter().any(|known| known.variant == record.variant) {
            variants.push(record);
        }
    }
    let place = |names: &[&str], name: &str| {
        names.iter().position(|known| *known == name).unwrap_or(names.len())
    };
    variants.sort_by_key(|record| {
        let method = place(&names.methods, &record.method);
        let ablation = if record.ablation == ABLATION_NONE {
            0
        } else {
            1 + place(&names.ablations, &record.ablation)
        };
        (method, ablation, record.variant.clone())
    });
    variants.into_iter().map(|record| record.variant.as_str()).collect()
}

fn tasks(records: &[&Record], names: &Names) -> Vec<Task> {
    let place = |distractor: &str| names.distractors.iter().position(|known| *known == distractor);
    let tasks: BTreeSet<_> = records
        .iter()
        .map(|record| (place(&record.distractor), record.task_label(), record.distractor.clone()))
        .collect();
    tasks.into_iter().map(|(_, label, distractor)| Task { label, distractor }).collect()
}
