//! Figures of a comparison, with their data.

mod returns;

use hksl_files::numbers::grouped;

use super::comparison::Comparison;
use super::error::Result;
use super::figure::{Figure, STEPS};
use super::findings::{Estimates, Findings};
use super::options::Options;
use super::suite::{Question, Suite};
use super::table::Table;
use crate::plot::{Curve, CurvePoint, IntervalPanel, curves, intervals};
use crate::statistics::Estimate;

const ESTIMATE: [&str; 3] = ["point", "low", "high"];

/// All figures of a comparison, the most informative first.
pub(super) fn figures(findings: &Findings<'_>, options: &Options) -> Result<Vec<Figure>> {
    let mut all = Vec::new();
    match findings.comparison.question {
        Question::Methods => {
            all.extend(aggregates(findings)?);
            all.extend(efficiency(findings)?);
            all.extend(profiles(findings, options)?);
            all.extend(improvements(findings)?);
        }
        Question::Ablations => {
            all.extend(by_task(findings)?);
            all.extend(efficiency(findings)?);
        }
    }
    all.extend(returns::figures(findings)?);
    Ok(all)
}

fn names(of: &Comparison<'_>) -> Vec<String> {
    of.variants.iter().map(|variant| (*variant).to_owned()).collect()
}

fn tuple(estimate: Estimate) -> (f64, f64, f64) {
    (estimate.point, estimate.low, estimate.high)
}

/// A table row of names and an estimate.
fn row(names: &[&str], estimate: Estimate) -> Vec<String> {
    let numbers = [estimate.point, estimate.low, estimate.high];
    let names = names.iter().map(|name| (*name).to_owned());
    names.chain(numbers.map(|number| number.to_string())).collect()
}

/// `over 30 tasks`, `on cartpole-swingup`.
fn over(of: &Comparison<'_>) -> String {
    match &of.common[..] {
        [task] => format!("on {task}"),
        tasks => format!("over {} tasks", tasks.len()),
    }
}

fn aggregates(findings: &Findings<'_>) -> Result<Option<Figure>> {
    let of = &findings.comparison;
    let Some((_, first)) = findings.aggregates.first() else {
        return Ok(None);
    };
    let estimate = |variant: &str, kind: usize| {
        let found = findings.aggregates.iter().find(|(of, _)| *of == variant);
        found.map(|(_, estimates)| tuple(estimates[kind].1))
    };
    let panel = |kind: usize| IntervalPanel {
        title: first[kind].0.to_owned(),
        estimates: of.variants.iter().map(|variant| estimate(variant, kind)).collect(),
        scale: None,
    };
    let panels: Vec<IntervalPanel> = (0..first.len()).map(panel).collect();
    let title = format!("Scores {} at {} environment steps", over(of), grouped(of.at));
    let rows = findings.aggregates.iter().flat_map(|(variant, estimates)| {
        estimates.iter().map(move |(kind, estimate)| row(&[variant, kind], *estimate))
    });
    let gap =
        if of.suite == Suite::Control { " For the optimality gap, lower is better." } else { "" };
    Ok(Some(Figure {
        name: format!("{}-aggregates", of.stem()),
        caption: format!(
            "A bar is the 95 % interval of a stratified bootstrap over runs, the mark in it the score itself; a mark \
             alone is of single runs. The median is that of the tasks' means.{gap}"
        ),
        svg: intervals(&title, of.suite.unit(), &names(of), &panels)?,
        table: Table::new(&[&["method", "aggregate"], &ESTIMATE[..]].concat(), rows),
        title,
    }))
}

/// Draws a curve of estimates per method and returns it with its data.
fn estimated(
    of: &Comparison<'_>,
    (title, x_label, y_label): (&str, &str, &str),
    column: &str,
    found: &[(&str, Estimates)],
) -> Result<Option<(String, Table)>> {
    if found.is_empty() {
        return Ok(None);
    }
    let curve = |variant: &&str| {
        let points =
            found.iter().find(|(of, _)| of == variant).map_or(&[][..], |(_, points)| points);
        let point = |(x, estimate): &(f64, Estimate)| CurvePoint {
            step: *x,
            value: estimate.point,
            low: estimate.low,
            high: estimate.high,
        };
        Curve { name: (*variant).to_owned(), points: points.iter().map(point).collect() }
    };
    let drawn: Vec<Curve> = of.variants.iter().map(curve).collect();
    let rows = found.iter().flat_map(|(variant, points)| {
        points.iter().map(move |(x, estimate)| row(&[variant, &x.to_string()], *estimate))
    });
    let table = Table::new(&[&["method", column], &ESTIMATE[..]].concat(), rows);
    Ok(Some((curves(title, x_label, y_label, &drawn, &[])?, table)))
}

fn efficiency(findings: &Findings<'_>) -> Result<Option<Figure>> {
    let of = &findings.comparison;
    let title = format!("Sample efficiency {}", over(of));
    let labels = (&*title, STEPS, &*format!("IQM of {}", of.suite.unit()));
    let drawn = estimated(of, labels, "environment_step", &findings.curves)?;
    Ok(drawn.map(|(svg, table)| Figure {
        name: format!("{}-efficiency", of.stem()),
        caption: format!(
            "Interquartile mean of all runs while they learn, with its pointwise 95 % interval. Only runs that have \
             been evaluated at {} environment steps.",
            grouped(of.at)
        ),
        svg,
        table,
        title: title.clone(),
    }))
}

fn profiles(findings: &Findings<'_>, options: &Options) -> Result<Option<Figure>> {
    let of = &findings.comparison;
    let title = format!("Performance profiles {}", over(of));
    let labels = (&*title, &*format!("threshold, {}", of.suite.unit()), "share of runs");
    let drawn = estimated(of, labels, "threshold", &findings.profiles)?;
    Ok(drawn.map(|(svg, table)| Figure {
        name: format!("{}-profiles", of.stem()),
        caption: format!(
            "Share of runs that score more than a threshold at {} environment steps, with its pointwise 95 % interval \
             of {} replicates. A curve that lies above another everywhere is better at every threshold.",
            grouped(of.at),
            grouped(options.profile_replicates() as u64)
        ),
        svg,
        table,
        title: title.clone(),
    }))
}

fn improvements(findings: &Findings<'_>) -> Result<Option<Figure>> {
    let of = &findings.comparison;
    let Some((first, ..)) = findings.improvements.first() else {
        return Ok(None);
    };
    let estimate = |variant: &&str| {
        let found = findings.improvements.iter().find(|(_, other, _)| other == variant);
        found.map(|(.., estimate)| tuple(*estimate))
    };
    let panel = IntervalPanel {
        title: format!("P({first} > method)"),
        estimates: of.variants.iter().map(estimate).collect(),
        scale: Some((0.0, 1.0, 0.5)),
    };
    let title = format!("Probability of improvement {}", over(of));
    let rows = findings.improvements.iter();
    let rows = rows.map(|(one, other, estimate)| row(&[one, other], *estimate));
    Ok(Some(Figure {
        name: format!("{}-improvement", of.stem()),
        caption: format!(
            "How probable it is that a run of {first} scores more than one of each other method on the same task, on \
             average over tasks; at 0.5, the dashed line, there is no difference. A mark alone is of single runs."
        ),
        svg: intervals(&title, "probability", &names(of), &[panel])?,
        table: Table::new(&[&["method", "over"], &ESTIMATE[..]].concat(), rows),
        title,
    }))
}

/// The paper's figure of ablations, one panel per task.
fn by_task(findings: &Findings<'_>) -> Result<Option<Figure>> {
    let of = &findings.comparison;
    if findings.scores.is_empty() {
        return Ok(None);
    }
    let scale = of.suite.scale();
    let scaled = |estimate: Estimate| Estimate {
        point: estimate.point / scale,
        low: estimate.low / scale,
        high: estimate.high / scale,
    };
    let of_task = |task: &str, variant: &str| {
        let mut scores = findings.scores.iter();
        let score = scores.find(|score| score.task == task && score.variant == variant)?;
        Some(tuple(scaled(score.iqm)))
    };
    let panels = of.tasks.iter().map(|task| IntervalPanel {
        title: task.label.clone(),
        estimates: of.variants.iter().map(|variant| of_task(&task.label, variant)).collect(),
        scale: None,
    });
    let panels: Vec<IntervalPanel> = panels.collect();
    let title = format!("HKSL and its ablations at {} environment steps", grouped(of.at));
    let rows = findings.scores.iter().map(|score| {
        row(&[&score.task, score.variant, &score.runs.to_string()], scaled(score.iqm))
    });
    Ok(Some(Figure {
        name: format!("{}-by-task", of.stem()),
        caption: "Interquartile mean of the runs of HKSL and of HKSL with a part changed, task by task, with its 95 % \
                  interval; a mark alone is of a single run."
            .to_owned(),
        svg: intervals(&title, &format!("IQM of {}", of.suite.unit()), &names(of), &panels)?,
        table: Table::new(&[&["task", "method", "runs"], &ESTIMATE[..]].concat(), rows),
        title,
    }))
}
