//! Learning curves of returns per task, as in the paper.

use hksl_files::DISTRACTOR_NONE;

use crate::plot::{Curve, CurvePanel, CurvePoint, curve_grid};
use crate::report::comparison::Task;
use crate::report::error::Result;
use crate::report::figure::{Figure, STEPS};
use crate::report::findings::Findings;
use crate::report::table::Table;

/// Panels per row.
const COLUMNS: usize = 3;

/// Draws one figure per distractor with one panel per task.
pub(super) fn figures(findings: &Findings<'_>) -> Result<Vec<Figure>> {
    let mut all = Vec::new();
    // Tasks are sorted by distractor.
    for tasks in findings.comparison.tasks.chunk_by(|one, next| one.distractor == next.distractor) {
        all.extend(figure(findings, &tasks[0].distractor, tasks)?);
    }
    Ok(all)
}

fn figure(findings: &Findings<'_>, distractor: &str, tasks: &[Task]) -> Result<Option<Figure>> {
    let of = &findings.comparison;
    let is_of = |task: &str| tasks.iter().any(|of| of.label == task);
    let there = || findings.learning.iter().filter(|learning| is_of(&learning.task));
    if there().next().is_none() {
        return Ok(None);
    }
    let curve = |task: &Task, variant: &str| {
        let found = there().find(|found| found.task == task.label && found.variant == variant);
        let points = found.map_or(&[][..], |found| &found.points);
        let points = points.iter().map(|at| CurvePoint::new(at.step as f64, at.mean, at.deviation));
        Curve { name: variant.to_owned(), points: points.collect() }
    };
    let panels = tasks.iter().map(|task| CurvePanel {
        title: task.label.clone(),
        curves: of.variants.iter().map(|variant| curve(task, variant)).collect(),
    });
    let panels: Vec<CurvePanel> = panels.collect();
    let (title, name) = match distractor {
        DISTRACTOR_NONE => ("Returns without distractors".to_owned(), "undisturbed"),
        name => (format!("Returns with {name}"), name),
    };
    let rows = there().flat_map(|learning| {
        learning.points.iter().map(|at| {
            let start = [&learning.task, learning.variant].map(str::to_owned);
            let counts = [at.step.to_string(), at.runs.to_string()];
            let numbers = [at.mean.to_string(), at.deviation.to_string()];
            [start, counts, numbers].concat()
        })
    });
    let heading = ["task", "method", "environment_step", "runs", "mean", "std"];
    Ok(Some(Figure {
        name: format!("{}-returns-{name}", of.stem()),
        caption: "Mean return of the runs and ± one standard deviation (ddof 0). Runs that are not done count as far as \
                  they have got; the CSV says how many runs a point has."
            .to_owned(),
        svg: curve_grid(&title, STEPS, "return", &panels, COLUMNS)?,
        table: Table::new(&heading, rows),
        title,
    }))
}
