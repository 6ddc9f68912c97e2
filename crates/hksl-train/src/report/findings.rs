//! The numbers of a comparison.

use super::comparison::value_at;
use super::{Comparison, Options, Suite};
use crate::Result;
use crate::statistics::{
    Aggregate, Bootstrap, Estimate, PROFILE_REPLICATES, ProfileOf, Scores, aggregate_intervals,
    curve, improvement_interval, profile_intervals,
};

/// Thresholds of a performance profile.
const THRESHOLDS: usize = 101;

/// What a comparison found.
#[derive(Debug, Clone)]
pub struct Findings<'a> {
    /// What was compared.
    pub comparison: Comparison<'a>,
    /// For each of the compared variants, its aggregates.
    pub aggregates: Vec<(&'a str, Vec<(&'static str, Estimate)>)>,
    /// For each of them, the interquartile mean at each step.
    pub curves: Vec<(&'a str, Vec<(u64, Estimate)>)>,
    /// For each of them, the share of runs above each threshold.
    pub profiles: Vec<(&'a str, Vec<(f64, Estimate)>)>,
    /// How probable it is that a run of the first does better than one of the second.
    pub improvements: Vec<(&'a str, &'a str, Estimate)>,
    /// Of each task and variant that has complete runs.
    pub scores: Vec<TaskScore<'a>>,
    /// Of each task and variant, at each step, whatever its runs have got to.
    pub learning: Vec<Learning<'a>>,
}

/// The returns of one variant on one task at the comparison's step; returns, not scores.
#[derive(Debug, Clone)]
pub struct TaskScore<'a> {
    /// The task with its distractor.
    pub task: String,
    /// The variant.
    pub variant: &'a str,
    /// Runs.
    pub runs: usize,
    /// Their mean.
    pub mean: f64,
    /// Their standard deviation (ddof 0).
    pub deviation: f64,
    /// Their interquartile mean.
    pub iqm: Estimate,
}

/// The returns of one variant on one task while its runs learn.
#[derive(Debug, Clone)]
pub struct Learning<'a> {
    /// The task with its distractor.
    pub task: String,
    /// The variant.
    pub variant: &'a str,
    /// One for each step that a run has been evaluated at.
    pub points: Vec<LearningPoint>,
}

/// One evaluation, over runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearningPoint {
    /// Environment step.
    pub step: u64,
    /// Runs that have got there.
    pub runs: usize,
    /// The mean of their returns.
    pub mean: f64,
    /// Their standard deviation (ddof 0).
    pub deviation: f64,
}

impl<'a> Findings<'a> {
    /// Computes everything.
    ///
    /// # Errors
    /// [`crate::Error::Statistics`], for a number of replicates that is none.
    pub fn new(comparison: Comparison<'a>, options: &Options) -> Result<Self> {
        let mut findings = Self {
            aggregates: Vec::new(),
            curves: Vec::new(),
            profiles: Vec::new(),
            improvements: Vec::new(),
            scores: Vec::new(),
            learning: learning(&comparison),
            comparison,
        };
        let of = &findings.comparison;
        let question = format!("{} {:?}", of.suite.name(), of.question);
        let bootstrap = |replicates: usize, what: &str| {
            Bootstrap::drawn(replicates, options.seed, &format!("{question} {what}"))
        };
        let replicates = options.replicates;
        for task in &of.tasks {
            for &variant in &of.variants {
                let returns: Vec<f64> =
                    of.complete(variant, task).filter_map(|run| value_at(run, of.at)).collect();
                if returns.is_empty() {
                    continue;
                }
                let (mean, deviation) = moments(&returns);
                let bootstrap = bootstrap(replicates, &format!("{task} {variant}"));
                let scores = Scores::new([(task.as_str(), returns.clone())])?;
                let iqm = aggregate_intervals(&scores, &[Aggregate::Iqm], &bootstrap)?[0];
                let task = task.clone();
                findings.scores.push(TaskScore {
                    task,
                    variant,
                    runs: returns.len(),
                    mean,
                    deviation,
                    iqm,
                });
            }
        }
        let scores_at = |variant: &str, step: u64| {
            Scores::new(
                of.common.iter().map(|task| (task.as_str(), of.scores(variant, task, step))),
            )
        };
        let mut final_scores: Vec<(&str, Scores)> = Vec::new();
        for &variant in &of.compared {
            let scores = scores_at(variant, of.at)?;
            let kinds = aggregates(of.suite);
            let which: Vec<Aggregate> = kinds.iter().map(|(_, aggregate)| *aggregate).collect();
            let estimates = aggregate_intervals(&scores, &which, &bootstrap(replicates, variant))?;
            let named = kinds.iter().map(|(name, _)| *name).zip(estimates).collect();
            findings.aggregates.push((variant, named));
            let checkpoints = of.steps.iter().map(|&step| scores_at(variant, step));
            let checkpoints: Vec<Scores> = checkpoints.collect::<std::result::Result<_, _>>()?;
            let estimates = curve(
                &checkpoints,
                Aggregate::Iqm,
                &bootstrap(replicates, &format!("{variant} curve")),
            )?;
            findings.curves.push((variant, of.steps.iter().copied().zip(estimates).collect()));
            final_scores.push((variant, scores));
        }
        let values = final_scores.iter().flat_map(|(_, scores)| scores.values());
        let (low, high) = match of.suite {
            Suite::Control => (0.0, 1.0),
            Suite::FallingPixels => {
                values.fold((0.0, 0f64), |(low, high), &value| (value.min(low), value.max(high)))
            }
        };
        let threshold = |index: usize| low + (high - low) * index as f64 / (THRESHOLDS - 1) as f64;
        let thresholds: Vec<f64> = (0..THRESHOLDS).map(threshold).collect();
        for (variant, scores) in &final_scores {
            let bootstrap =
                bootstrap(replicates.min(PROFILE_REPLICATES), &format!("{variant} profile"));
            let estimates = profile_intervals(scores, &thresholds, ProfileOf::Runs, &bootstrap)?;
            findings.profiles.push((variant, thresholds.iter().copied().zip(estimates).collect()));
        }
        if let Some(((first, x), others)) = final_scores.split_first() {
            for (other, y) in others {
                let bootstrap = bootstrap(replicates, &format!("{first} over {other}"));
                findings.improvements.push((first, other, improvement_interval(x, y, &bootstrap)?));
            }
        }
        Ok(findings)
    }
}

fn aggregates(suite: Suite) -> Vec<(&'static str, Aggregate)> {
    let mut list =
        vec![("IQM", Aggregate::Iqm), ("median", Aggregate::Median), ("mean", Aggregate::Mean)];
    // Returns without a best value have no gap to it.
    if suite == Suite::Control {
        list.push(("optimality gap", Aggregate::OptimalityGap { gamma: 1.0 }));
    }
    list
}

fn learning<'a>(comparison: &Comparison<'a>) -> Vec<Learning<'a>> {
    let mut all = Vec::new();
    for task in &comparison.tasks {
        for &variant in &comparison.variants {
            let runs = comparison.runs(variant, task);
            let point = |&step: &u64| {
                let returns: Vec<f64> = runs.iter().filter_map(|run| value_at(run, step)).collect();
                let (mean, deviation) = moments(&returns);
                (!returns.is_empty()).then_some(LearningPoint {
                    step,
                    runs: returns.len(),
                    mean,
                    deviation,
                })
            };
            let points: Vec<LearningPoint> = comparison.steps.iter().filter_map(point).collect();
            if !points.is_empty() {
                all.push(Learning { task: task.clone(), variant, points });
            }
        }
    }
    all
}

/// Mean and standard deviation.
fn moments(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let squares = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
    (mean, (squares / values.len() as f64).sqrt())
}
