//! The exclusions and caveats of a report.

use std::collections::{BTreeMap, BTreeSet};

use hksl_files::numbers::grouped;
use hksl_files::{Outline, Settings};

use super::collected::{Collected, sentence};
use super::comparison::Comparison;
use super::missing::{Cell, cell};

/// With fewer runs, intervals mean little.
const FEW_RUNS: usize = 3;

pub(super) fn skipped(
    collected: &Collected,
    comparisons: &[Comparison<'_>],
    study: Option<&Outline>,
) -> Vec<String> {
    let mut said: Vec<String> = collected.skipped.iter().map(sentence).collect();
    if let Some(Outline { name, runs: planned, .. }) = study {
        let planned: BTreeSet<Cell> = planned.iter().cloned().collect();
        let runs: BTreeSet<Cell> =
            comparisons.iter().flat_map(Comparison::records).map(cell).collect();
        let others = runs.difference(&planned).count();
        if others > 0 {
            said.push(format!(
                "{others} of {} runs are not part of the study {name}, but are included",
                runs.len()
            ));
        }
    }
    for comparison in comparisons {
        let title = comparison.title();
        said.extend(of(comparison).into_iter().map(|remark| format!("{title}: {remark}")));
    }
    said
}

fn of(comparison: &Comparison<'_>) -> Vec<String> {
    let runs = comparison.records().count();
    let complete = comparison.records().filter(|run| run.at(comparison.at).is_some()).count();
    if complete == 0 {
        return vec![no_scores(comparison)];
    }
    let mut said = Vec::new();
    let at = grouped(comparison.at);
    let budget = comparison.records().filter(|run| run.run.is_some()).map(|run| run.budget).max();
    if let Some(budget) = budget.filter(|budget| *budget > comparison.at) {
        said.push(format!("compared at {at} of a budget of {} environment steps", grouped(budget)));
    }
    if complete < runs {
        said.push(format!(
            "{} of {runs} runs have no evaluation at environment step {at} and appear only in the curves of returns",
            runs - complete
        ));
    }
    said.extend(outside(comparison));
    said.extend(unlike(comparison));
    let counts: BTreeSet<usize> = comparison
        .compared
        .iter()
        .flat_map(|variant| {
            comparison.common.iter().map(|task| comparison.complete(variant, task).count())
        })
        .collect();
    if let (Some(least), Some(most)) = (counts.first(), counts.last()) {
        if least != most {
            said.push(format!(
                "methods and tasks have from {least} to {most} complete runs; tasks with more runs have more weight in the \
                 interquartile mean"
            ));
        }
        if *least < FEW_RUNS {
            let runs = if *least == 1 { "a single run" } else { "two runs" };
            said.push(format!(
                "some methods have {runs} per task: intervals do not show the variation between seeds"
            ));
        }
    }
    said
}

/// Warns of averaged runs of one method and task that differ in more than their seeds.
fn unlike(comparison: &Comparison<'_>) -> Vec<String> {
    let mut first: BTreeMap<(&str, String), &Settings> = BTreeMap::new();
    let mut keys: BTreeMap<(&str, String), BTreeSet<String>> = BTreeMap::new();
    for record in comparison.records() {
        let Some(settings) = record.run.as_ref().and_then(|run| run.settings.as_ref()) else {
            continue;
        };
        let cell = (record.variant.as_str(), record.task_label());
        let known = *first.entry(cell.clone()).or_insert(settings);
        for key in known.unlike(settings) {
            keys.entry(cell.clone()).or_default().insert(key.to_owned());
        }
    }
    let said = |((variant, task), keys): ((&str, String), BTreeSet<String>)| {
        let keys: Vec<String> = keys.into_iter().collect();
        format!(
            "the runs of {variant} on {task} do not have the same settings ({}), but are averaged",
            keys.join(", ")
        )
    };
    keys.into_iter().map(said).collect()
}

/// Methods and tasks that aggregates exclude.
fn outside(comparison: &Comparison<'_>) -> Vec<String> {
    let Comparison { variants, tasks, compared, common, .. } = comparison;
    let mut said = Vec::new();
    let lacking = |variant: &str| {
        let lacks = |task: &&String| comparison.complete(variant, task).next().is_none();
        let names: Vec<&str> = common.iter().filter(lacks).map(String::as_str).collect();
        format!("{variant} (no complete run on {})", names.join(", "))
    };
    let dropped = variants.iter().filter(|variant| !compared.contains(variant));
    let dropped: Vec<String> = dropped.map(|variant| lacking(variant)).collect();
    if !dropped.is_empty() {
        said.push(format!("aggregates exclude {}", dropped.join("; ")));
    }
    let others = tasks.iter().filter(|task| !common.contains(&task.label));
    let others: Vec<&str> = others.map(|task| task.label.as_str()).collect();
    if !others.is_empty() {
        said.push(format!(
            "aggregates are over {} of {} tasks, on which each of {} has complete runs; excluded: {}",
            common.len(),
            tasks.len(),
            compared.join(", "),
            others.join(", ")
        ));
    }
    said
}

fn no_scores(comparison: &Comparison<'_>) -> String {
    let at = comparison.at;
    let lasts: Vec<u64> = comparison.records().map(|run| run.last_step().unwrap_or(0)).collect();
    let all = lasts.iter().copied().min().unwrap_or(0);
    let hint = if lasts.iter().any(|last| *last > at) {
        let steps = comparison.records().flat_map(|run| run.points.iter().map(|point| point.0));
        let (before, after) = steps.fold((0, u64::MAX), |(before, after), step| {
            if step < at { (before.max(step), after) } else { (before, after.min(step)) }
        });
        format!("the nearest evaluations are at {} and {}", grouped(before), grouped(after))
    } else if all > 0 {
        format!("all runs have evaluations up to {}: use --at {all}", grouped(all))
    } else {
        "some runs have no evaluation after the start of learning".to_owned()
    };
    format!(
        "no run has an evaluation at environment step {}, so there are no scores ({hint})",
        grouped(at)
    )
}
