//! What is compared with what.

use std::collections::{BTreeMap, BTreeSet};

use super::rectangle::rectangle;
use super::{Error, Options, Record};
use crate::Result;
use crate::config::{ABLATION_NONE, METHOD_HKSL, methods};

/// Returns that can be averaged over tasks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Suite {
    /// The control tasks: returns between 0 and 1,000, so that a score is a return divided by 1,000.
    Control,
    /// Falling Pixels, whose returns stand for themselves.
    FallingPixels,
}

impl Suite {
    fn of(task: &str) -> Self {
        if hksl_envs::tasks().iter().any(|info| info.name == task && info.needs_mujoco) {
            Self::Control
        } else {
            Self::FallingPixels
        }
    }

    /// Its name in a heading.
    pub fn title(self) -> &'static str {
        match self {
            Self::Control => "Control tasks",
            Self::FallingPixels => "Falling Pixels",
        }
    }

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Control => "control",
            Self::FallingPixels => "falling-pixels",
        }
    }

    /// The return that is a score of 1.
    pub fn scale(self) -> f64 {
        match self {
            Self::Control => 1000.0,
            Self::FallingPixels => 1.0,
        }
    }

    /// What a score is.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Control => "return / 1,000",
            Self::FallingPixels => "return",
        }
    }
}

/// Which question a comparison answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Question {
    /// Which method is better.
    Methods,
    /// What each part of HKSL is worth; on Falling Pixels, how many levels are.
    Ablations,
}

/// Runs that are compared with each other.
#[derive(Debug, Clone)]
pub struct Comparison<'a> {
    /// Of which tasks.
    pub suite: Suite,
    /// To answer what.
    pub question: Question,
    /// The variants, in the order of their colours: HKSL, the other methods as shipped, then by name.
    pub variants: Vec<&'a str>,
    /// The tasks with their distractors, undisturbed ones first.
    pub tasks: Vec<String>,
    /// The runs of a task and variant.
    pub cells: BTreeMap<(String, &'a str), Vec<&'a Record>>,
    /// Environment steps of the evaluations up to `at`.
    pub steps: Vec<u64>,
    /// The environment step at which scores are compared.
    pub at: u64,
    /// The variants that have complete runs on each of the tasks of `common`: those that aggregates are of.
    pub compared: Vec<&'a str>,
    /// The tasks that aggregates are over.
    pub common: Vec<String>,
}

impl<'a> Comparison<'a> {
    /// Divides runs into comparisons.
    ///
    /// # Errors
    /// [`Error::SameCell`], [`Error::Budgets`], [`Error::EvaluationPoints`].
    pub fn all(records: &'a [Record], options: &Options) -> Result<Vec<Self>> {
        let mut cells: BTreeMap<_, &Record> = BTreeMap::new();
        for record in records {
            let cell = (record.variant.as_str(), record.task_label(), record.seed);
            if let Some(first) = cells.insert(cell, record) {
                let (first, second) = (first.origin.clone(), record.origin.clone());
                return Err(Error::SameCell { cell: record.cell(), first, second }.into());
            }
        }
        let mut questions: BTreeMap<(Suite, Question), Vec<&Record>> = BTreeMap::new();
        for record in records {
            let suite = Suite::of(&record.task);
            if record.ablation == ABLATION_NONE {
                questions.entry((suite, Question::Methods)).or_default().push(record);
            } else {
                questions.entry((suite, Question::Ablations)).or_default().push(record);
            }
        }
        // Ablations are of the full method with the same presets or name, on the same task.
        for record in records.iter().filter(|record| record.method == METHOD_HKSL) {
            let ablations = questions.get_mut(&(Suite::of(&record.task), Question::Ablations));
            let is_of = |ablated: &&Record| {
                ablated.suffix() == record.suffix() && ablated.task_label() == record.task_label()
            };
            if record.ablation == ABLATION_NONE
                && let Some(ablations) = ablations
                && ablations.iter().any(is_of)
            {
                ablations.push(record);
            }
        }
        let comparisons = questions.into_iter();
        comparisons.map(|((suite, question), of)| Self::new(suite, question, of, options)).collect()
    }

    fn new(
        suite: Suite,
        question: Question,
        records: Vec<&'a Record>,
        options: &Options,
    ) -> Result<Self> {
        let at = match options.at {
            Some(at) => at,
            None => common_budget(&records)?,
        };
        let kept =
            |step: u64| step <= at && options.every.is_none_or(|every| step.is_multiple_of(every));
        let steps: BTreeSet<u64> = records
            .iter()
            .flat_map(|record| record.points.iter().map(|point| point.0))
            .filter(|&step| kept(step))
            .collect();
        check_steps(&records, &steps)?;
        let mut variants: Vec<&Record> = Vec::new();
        let mut tasks: BTreeSet<(&str, &str)> = BTreeSet::new();
        let mut cells: BTreeMap<_, Vec<&Record>> = BTreeMap::new();
        for record in records {
            if !variants.iter().any(|known| known.variant == record.variant) {
                variants.push(record);
            }
            tasks.insert((&record.distractor, &record.task));
            let cell = (record.task_label(), record.variant.as_str());
            cells.entry(cell).or_default().push(record);
        }
        variants.sort_by_key(|record| (rank(record), record.variant.clone()));
        let variants: Vec<&str> = variants.iter().map(|record| record.variant.as_str()).collect();
        let mut tasks: Vec<_> = tasks.into_iter().collect();
        tasks.sort_by_key(|&(distractor, task)| (distractor_rank(distractor), task));
        let tasks: Vec<String> = tasks
            .iter()
            .map(|(distractor, task)| crate::config::task_label(task, distractor))
            .collect();
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
        let has = |variant: &str, task: &str| comparison.complete(variant, task).next().is_some();
        let (compared, common) = rectangle(&comparison.variants, &comparison.tasks, has);
        (comparison.compared, comparison.common) = (compared, common);
        Ok(comparison)
    }

    /// The runs of a variant on a task.
    pub fn runs(&self, variant: &str, task: &str) -> &[&'a Record] {
        // Keys live as long as runs do, and names asked for need not.
        let variant = self.variants.iter().find(|known| **known == variant);
        let runs = variant.and_then(|variant| self.cells.get(&(task.to_owned(), *variant)));
        runs.map_or(&[], |runs| runs)
    }

    /// Those of them that have been evaluated at `at`.
    pub fn complete(&self, variant: &str, task: &str) -> impl Iterator<Item = &'a Record> {
        let at = self.at;
        let runs = self.runs(variant, task).iter().copied();
        runs.filter(move |record| value_at(record, at).is_some())
    }

    /// Their scores at this step.
    pub fn scores(&self, variant: &str, task: &str, step: u64) -> Vec<f64> {
        let runs = self.complete(variant, task);
        runs.filter_map(|record| value_at(record, step))
            .map(|value| value / self.suite.scale())
            .collect()
    }
}

/// The return of a run at this environment step.
pub(super) fn value_at(record: &Record, step: u64) -> Option<f64> {
    let position = record.points.binary_search_by_key(&step, |point| point.0).ok()?;
    Some(record.points[position].1)
}

fn common_budget(records: &[&Record]) -> Result<u64> {
    let first = records[0];
    match records.iter().find(|record| record.budget != first.budget) {
        None => Ok(first.budget),
        Some(other) => Err(Error::Budgets {
            first: (first.origin.clone(), first.budget),
            second: (other.origin.clone(), other.budget),
        }
        .into()),
    }
}

/// Every run must have been evaluated at each of the steps up to its own last one.
fn check_steps(records: &[&Record], steps: &BTreeSet<u64>) -> Result<()> {
    for record in records {
        let Some(last) = record.points.last() else {
            continue;
        };
        let lacking = steps.range(..=last.0).find(|&&step| value_at(record, step).is_none());
        if let Some(&step) = lacking {
            let has = |other: &&&Record| value_at(other, step).is_some();
            let with = records
                .iter()
                .find(has)
                .map_or_else(Default::default, |other| other.origin.clone());
            return Err(
                Error::EvaluationPoints { step, with, without: record.origin.clone() }.into()
            );
        }
    }
    Ok(())
}

/// HKSL in full first, its ablations as the paper lists them, the other methods as they are shipped, then whatever
/// else.
fn rank(record: &Record) -> (usize, usize, usize) {
    let place = |names: Vec<&str>, name: &str| {
        names.iter().position(|known| *known == name).unwrap_or(names.len())
    };
    let method =
        if record.method == METHOD_HKSL { 0 } else { 1 + place(methods(), &record.method) };
    let ablation = if record.ablation == ABLATION_NONE {
        0
    } else {
        1 + place(crate::config::ablations(), &record.ablation)
    };
    (method, ablation, record.suffix().len())
}

fn distractor_rank(distractor: &str) -> usize {
    if distractor == crate::config::DISTRACTOR_NONE {
        return 0;
    }
    let all = crate::config::distractors();
    1 + all.iter().position(|known| *known == distractor).unwrap_or(all.len())
}
