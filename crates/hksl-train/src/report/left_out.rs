//! What a report leaves out, said aloud.

use super::{Collected, Comparison, Question};
use crate::numbers::grouped;

pub(super) fn left_out(collected: &Collected, comparisons: &[Comparison<'_>]) -> Vec<String> {
    let one = |(path, reason): &(std::path::PathBuf, String)| {
        let path = path.display().to_string();
        if reason.contains(&path) { reason.clone() } else { format!("{path}: {reason}") }
    };
    let mut said: Vec<String> = collected.left_out.iter().map(one).collect();
    for comparison in comparisons {
        said.extend(of(comparison));
    }
    said
}

fn of(comparison: &Comparison<'_>) -> Vec<String> {
    let mut said = Vec::new();
    let Comparison { at, variants, tasks, compared, common, .. } = comparison;
    let name = match comparison.question {
        Question::Methods => comparison.suite.title().to_owned(),
        Question::Ablations => format!("{}, ablations", comparison.suite.title()),
    };
    let runs: Vec<_> = comparison.cells.values().flatten().collect();
    let complete: usize = comparison
        .cells
        .keys()
        .map(|(task, variant)| comparison.complete(variant, task).count())
        .sum();
    let at = grouped(*at);
    if complete == 0 {
        let furthest = runs.iter().filter_map(|run| run.points.last()).map(|point| point.0).max();
        let furthest = furthest.map_or_else(
            || "none has been evaluated".to_owned(),
            |step| format!("the furthest has got to {}; --at compares them earlier", grouped(step)),
        );
        return vec![format!(
            "{name}: no run has an evaluation at environment step {at}, so that there are no scores ({furthest})"
        )];
    }
    if complete < runs.len() {
        said.push(format!(
            "{name}: {} of {} runs have no evaluation at environment step {at} and are in the curves of returns only",
            runs.len() - complete,
            runs.len()
        ));
    }
    let of_variants: Vec<&str> =
        variants.iter().copied().filter(|variant| !compared.contains(variant)).collect();
    if !of_variants.is_empty() {
        said.push(format!(
            "{name}: aggregates are of {}; left out, for the tasks that they have no complete runs on: {}",
            compared.join(", "),
            of_variants.join(", ")
        ));
    }
    let of_tasks: Vec<&str> =
        tasks.iter().filter(|task| !common.contains(task)).map(String::as_str).collect();
    if !of_tasks.is_empty() {
        said.push(format!(
            "{name}: aggregates are over the {} of {} tasks on which {} have complete runs; left out: {}",
            common.len(),
            tasks.len(),
            compared.join(", "),
            of_tasks.join(", ")
        ));
    }
    let counts: std::collections::BTreeSet<usize> = compared
        .iter()
        .flat_map(|variant| common.iter().map(|task| comparison.complete(variant, task).count()))
        .collect();
    if let (Some(least), Some(most)) = (counts.first(), counts.last())
        && least != most
    {
        said.push(format!(
            "{name}: methods and tasks have from {least} to {most} complete runs; in the interquartile mean, tasks with \
             more runs weigh more"
        ));
    }
    said
}
