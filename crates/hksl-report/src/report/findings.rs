//! Statistics of a comparison.

use rayon::prelude::*;

use super::comparison::Comparison;
use super::error::Result;
use super::options::Options;
use super::suite::Suite;
use crate::statistics::{
    Aggregate, Bootstrap, Estimate, ProfileOf, Scores, aggregate_intervals, curve,
    improvement_interval, profile_intervals,
};

/// Number of thresholds of a performance profile.
const THRESHOLDS: usize = 101;

/// A value for each compared variant.
pub type ByVariant<'a, T> = Vec<(&'a str, T)>;

/// Estimates along an axis.
pub type Estimates = Vec<(f64, Estimate)>;

/// Results of a comparison.
#[derive(Debug, Clone)]
pub struct Findings<'a> {
    /// The comparison.
    pub comparison: Comparison<'a>,
    /// Aggregates of each compared variant.
    pub aggregates: ByVariant<'a, Vec<(&'static str, Estimate)>>,
    /// Interquartile mean of each compared variant at each step.
    pub curves: ByVariant<'a, Estimates>,
    /// Fraction of runs of each compared variant above each threshold.
    pub profiles: ByVariant<'a, Estimates>,
    /// Probability that a run of the first variant scores higher than a run of the second.
    pub improvements: Vec<(&'a str, &'a str, Estimate)>,
    /// Returns at the comparison's step of each task and variant with complete runs.
    pub scores: Vec<TaskScore<'a>>,
    /// Returns of each task and variant at each step, including incomplete runs.
    pub learning: Vec<Learning<'a>>,
}

/// Returns (not scores) of one variant on one task at the comparison's step.
#[derive(Debug, Clone)]
pub struct TaskScore<'a> {
    /// The task with its distractor.
    pub task: String,
    /// The variant.
    pub variant: &'a str,
    /// Number of runs.
    pub runs: usize,
    /// Mean.
    pub mean: f64,
    /// Their standard deviation (ddof 0).
    pub deviation: f64,
    /// Interquartile mean.
    pub iqm: Estimate,
}

/// Learning curve of returns of one variant on one task.
#[derive(Debug, Clone)]
pub struct Learning<'a> {
    /// The task with its distractor.
    pub task: String,
    /// The variant.
    pub variant: &'a str,
    /// One point for each step at which a run was evaluated.
    pub points: Vec<LearningPoint>,
}

/// Returns of all runs at one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearningPoint {
    /// Environment step.
    pub step: u64,
    /// Number of runs that were evaluated at this step.
    pub runs: usize,
    /// Mean of their returns.
    pub mean: f64,
    /// Their standard deviation (ddof 0).
    pub deviation: f64,
}

impl<'a> Findings<'a> {
    /// Computes all statistics.
    ///
    /// # Errors
    /// [`Error::Statistics`](super::Error::Statistics), for an invalid number of replicates.
    pub fn new(comparison: Comparison<'a>, options: &Options) -> Result<Self> {
        let with = Computing { of: &comparison, options };
        let scores_at = |variant: &&'a str| Ok((*variant, with.scores_at(variant, comparison.at)?));
        let last: Vec<(&str, Scores)> =
            comparison.compared.iter().map(scores_at).collect::<Result<_>>()?;
        let (aggregates, curves) = (with.aggregates(&last)?, with.curves()?);
        let (profiles, improvements) = (with.profiles(&last)?, with.improvements(&last)?);
        let (scores, learning) = (with.task_scores()?, with.learning());
        Ok(Self { comparison, aggregates, curves, profiles, improvements, scores, learning })
    }
}

struct Computing<'c, 'a> {
    of: &'c Comparison<'a>,
    options: &'c Options,
}

impl<'a> Computing<'_, 'a> {
    /// The stream name depends only on the suite and `what`, so equal scores get equal intervals in every comparison.
    fn bootstrap(&self, replicates: usize, what: &str) -> Bootstrap {
        Bootstrap::drawn(replicates, self.options.seed, &format!("{} {what}", self.of.suite.name()))
    }

    fn scores_at(&self, variant: &str, step: u64) -> Result<Scores> {
        let tasks = self.of.common.iter();
        let scores = tasks.map(|task| (task.as_str(), self.of.scores(variant, task, step)));
        Ok(Scores::new(scores)?)
    }

    fn aggregates(
        &self,
        last: &[(&'a str, Scores)],
    ) -> Result<ByVariant<'a, Vec<(&'static str, Estimate)>>> {
        let kinds = aggregates(self.of.suite);
        let which: Vec<Aggregate> = kinds.iter().map(|(_, aggregate)| *aggregate).collect();
        let of = |(variant, scores): &(&'a str, Scores)| {
            let bootstrap = self.bootstrap(self.options.replicates, variant);
            let estimates = aggregate_intervals(scores, &which, &bootstrap)?;
            Ok((*variant, kinds.iter().map(|(name, _)| *name).zip(estimates).collect()))
        };
        last.iter().map(of).collect()
    }

    fn curves(&self) -> Result<ByVariant<'a, Estimates>> {
        let of = |variant: &&'a str| {
            let checkpoints = self.of.steps.iter().map(|&step| self.scores_at(variant, step));
            let checkpoints: Vec<Scores> = checkpoints.collect::<Result<_>>()?;
            let bootstrap = self.bootstrap(self.options.replicates, &format!("{variant} curve"));
            let estimates = curve(&checkpoints, Aggregate::Iqm, &bootstrap)?;
            let steps = self.of.steps.iter().map(|&step| step as f64);
            Ok((*variant, steps.zip(estimates).collect()))
        };
        self.of.compared.iter().map(of).collect()
    }

    fn profiles(&self, last: &[(&'a str, Scores)]) -> Result<ByVariant<'a, Estimates>> {
        let values = || last.iter().flat_map(|(_, scores)| scores.values());
        let (least, most) =
            values().fold((0f64, 1f64), |(low, high), &value| (low.min(value), high.max(value)));
        // The lowest threshold is below all scores, so the profile starts at 1.
        let low = if least < 0.0 { least - 0.02 * (most - least) } else { 0.0 };
        let threshold = |index: usize| low + (most - low) * index as f64 / (THRESHOLDS - 1) as f64;
        let thresholds: Vec<f64> = (0..THRESHOLDS).map(threshold).collect();
        let replicates = self.options.profile_replicates();
        let of = |(variant, scores): &(&'a str, Scores)| {
            let bootstrap = self.bootstrap(replicates, &format!("{variant} profile"));
            let estimates = profile_intervals(scores, &thresholds, ProfileOf::Runs, &bootstrap)?;
            Ok((*variant, thresholds.iter().copied().zip(estimates).collect()))
        };
        last.iter().map(of).collect()
    }

    fn improvements(
        &self,
        last: &[(&'a str, Scores)],
    ) -> Result<Vec<(&'a str, &'a str, Estimate)>> {
        let Some(((first, x), others)) = last.split_first() else {
            return Ok(Vec::new());
        };
        let of = |(other, y): &(&'a str, Scores)| {
            let bootstrap =
                self.bootstrap(self.options.replicates, &format!("{first} over {other}"));
            Ok((*first, *other, improvement_interval(x, y, &bootstrap)?))
        };
        others.iter().map(of).collect()
    }

    fn task_scores(&self) -> Result<Vec<TaskScore<'a>>> {
        let of = |(task, variant): (&str, &'a str)| {
            let runs = self.of.complete(variant, task);
            let returns: Vec<f64> = runs.filter_map(|run| run.at(self.of.at)).collect();
            if returns.is_empty() {
                return Ok(None);
            }
            let (mean, deviation) = moments(&returns);
            let runs = returns.len();
            let bootstrap = self.bootstrap(self.options.replicates, &format!("{task} {variant}"));
            let scores = Scores::new([(task, returns)])?;
            let iqm = aggregate_intervals(&scores, &[Aggregate::Iqm], &bootstrap)?[0];
            Ok(Some(TaskScore { task: task.to_owned(), variant, runs, mean, deviation, iqm }))
        };
        let scores: Vec<Option<TaskScore>> =
            self.cells().into_par_iter().map(of).collect::<Result<_>>()?;
        Ok(scores.into_iter().flatten().collect())
    }

    fn learning(&self) -> Vec<Learning<'a>> {
        let of = |(task, variant): (&str, &'a str)| {
            let runs = self.of.runs(variant, task);
            let point = |&step: &u64| {
                let returns: Vec<f64> = runs.iter().filter_map(|run| run.at(step)).collect();
                let (mean, deviation) = moments(&returns);
                let point = LearningPoint { step, runs: returns.len(), mean, deviation };
                (!returns.is_empty()).then_some(point)
            };
            let points: Vec<LearningPoint> = self.of.steps.iter().filter_map(point).collect();
            (!points.is_empty()).then(|| Learning { task: task.to_owned(), variant, points })
        };
        self.cells().into_iter().filter_map(of).collect()
    }

    /// All pairs of task and variant.
    fn cells(&self) -> Vec<(&str, &'a str)> {
        let tasks = self.of.tasks.iter();
        tasks
            .flat_map(|task| self.of.variants.iter().map(|variant| (task.label.as_str(), *variant)))
            .collect()
    }
}

fn aggregates(suite: Suite) -> Vec<(&'static str, Aggregate)> {
    let mut list =
        vec![("IQM", Aggregate::Iqm), ("median", Aggregate::Median), ("mean", Aggregate::Mean)];
    // Returns without a maximum have no optimality gap.
    if suite == Suite::Control {
        list.push(("optimality gap", Aggregate::OptimalityGap { gamma: 1.0 }));
    }
    list
}

/// Mean and standard deviation (ddof 0).
fn moments(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let squares = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
    (mean, (squares / values.len() as f64).sqrt())
}
