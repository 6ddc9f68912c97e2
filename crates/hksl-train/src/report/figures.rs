//! What is drawn of a comparison, and the numbers of each drawing.

use super::comparison::Question;
use super::{Comparison, Figure, Findings, Suite, Table};
use crate::Result;
use crate::config::{DISTRACTOR_NONE, distractors};
use crate::numbers::grouped;
use crate::plot::{Curve, CurvePanel, CurvePoint, IntervalPanel, curve_grid, curves, intervals};
use crate::statistics::Estimate;

const STEPS: &str = "environment steps";
const ESTIMATE: [&str; 3] = ["point", "low", "high"];

/// All figures of a comparison, the ones that say most first.
pub(super) fn figures(findings: &Findings<'_>) -> Result<Vec<Figure>> {
    let mut all = Vec::new();
    match findings.comparison.question {
        Question::Methods => {
            all.extend(aggregates(findings)?);
            all.extend(efficiency(findings)?);
            all.extend(profiles(findings)?);
            all.extend(improvements(findings)?);
        }
        Question::Ablations => {
            all.extend(by_task(findings)?);
            all.extend(efficiency(findings)?);
        }
    }
    all.extend(learning(findings)?);
    Ok(all)
}

/// The start of a figure's file name.
fn stem(of: &Comparison<'_>) -> String {
    let question = match of.question {
        Question::Methods => "methods",
        Question::Ablations => "ablations",
    };
    format!("{}-{question}", of.suite.name())
}

fn names(of: &Comparison<'_>) -> Vec<String> {
    of.variants.iter().map(|variant| (*variant).to_owned()).collect()
}

fn tuple(estimate: Estimate) -> (f64, f64, f64) {
    (estimate.point, estimate.low, estimate.high)
}

fn cells(estimate: Estimate) -> [String; 3] {
    [estimate.point, estimate.low, estimate.high].map(|number| number.to_string())
}

/// `on 30 tasks`, `on cartpole-swingup`.
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
    };
    let panels: Vec<IntervalPanel> = (0..first.len()).map(panel).collect();
    let title = format!("Scores {} at {} environment steps", over(of), grouped(of.at));
    let rows = findings.aggregates.iter().flat_map(|(variant, estimates)| {
        estimates.iter().map(move |(kind, estimate)| {
            [vec![(*variant).to_owned(), (*kind).to_owned()], cells(*estimate).to_vec()].concat()
        })
    });
    let gap =
        if of.suite == Suite::Control { " Of the optimality gap, less is better." } else { "" };
    Ok(Some(Figure {
        name: format!("{}-aggregates", stem(of)),
        caption: format!(
            "Aggregate scores {} at {} environment steps; a bar is the 95 % interval of a stratified bootstrap over \
             runs, the mark in it the score itself.{gap}",
            over(of),
            grouped(of.at)
        ),
        svg: intervals(&title, of.suite.unit(), &names(of), &panels)?,
        table: Table::new(&[&["method", "aggregate"], &ESTIMATE[..]].concat(), rows),
    }))
}

fn efficiency(findings: &Findings<'_>) -> Result<Option<Figure>> {
    let of = &findings.comparison;
    if findings.curves.is_empty() {
        return Ok(None);
    }
    let curve = |variant: &&str| {
        let found = findings.curves.iter().find(|(of, _)| of == variant);
        let points = found.map_or(&[][..], |(_, points)| points);
        let point = |(step, estimate): &(u64, Estimate)| CurvePoint {
            step: *step as f64,
            value: estimate.point,
            low: estimate.low,
            high: estimate.high,
        };
        Curve { name: (*variant).to_owned(), points: points.iter().map(point).collect() }
    };
    let drawn: Vec<Curve> = of.variants.iter().map(curve).collect();
    let title = format!("Sample efficiency {}", over(of));
    let rows = findings.curves.iter().flat_map(|(variant, points)| {
        points.iter().map(move |(step, estimate)| {
            [vec![(*variant).to_owned(), step.to_string()], cells(*estimate).to_vec()].concat()
        })
    });
    Ok(Some(Figure {
        name: format!("{}-efficiency", stem(of)),
        caption: format!(
            "Interquartile mean of all runs {} while they learn, with its pointwise 95 % interval. Only runs that \
             reached {} environment steps.",
            over(of),
            grouped(of.at)
        ),
        svg: curves(&title, STEPS, &format!("IQM of {}", of.suite.unit()), &drawn, &[])?,
        table: Table::new(&[&["method", "environment_step"], &ESTIMATE[..]].concat(), rows),
    }))
}

fn profiles(findings: &Findings<'_>) -> Result<Option<Figure>> {
    let of = &findings.comparison;
    if findings.profiles.is_empty() {
        return Ok(None);
    }
    let curve = |variant: &&str| {
        let found = findings.profiles.iter().find(|(of, _)| of == variant);
        let points = found.map_or(&[][..], |(_, points)| points);
        let point = |(threshold, estimate): &(f64, Estimate)| CurvePoint {
            step: *threshold,
            value: estimate.point,
            low: estimate.low,
            high: estimate.high,
        };
        Curve { name: (*variant).to_owned(), points: points.iter().map(point).collect() }
    };
    let drawn: Vec<Curve> = of.variants.iter().map(curve).collect();
    let title = format!("Performance profiles {}", over(of));
    let rows = findings.profiles.iter().flat_map(|(variant, points)| {
        points.iter().map(move |(threshold, estimate)| {
            [vec![(*variant).to_owned(), threshold.to_string()], cells(*estimate).to_vec()].concat()
        })
    });
    Ok(Some(Figure {
        name: format!("{}-profiles", stem(of)),
        caption: format!(
            "Share of runs {} that score more than a threshold at {} environment steps, with its pointwise 95 % \
             interval. A curve that lies above another everywhere is better at every threshold.",
            over(of),
            grouped(of.at)
        ),
        svg: curves(
            &title,
            &format!("threshold, {}", of.suite.unit()),
            "share of runs",
            &drawn,
            &[],
        )?,
        table: Table::new(&[&["method", "threshold"], &ESTIMATE[..]].concat(), rows),
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
    };
    let title = format!("Probability of improvement {}", over(of));
    let rows = findings.improvements.iter().map(|(one, other, estimate)| {
        [vec![(*one).to_owned(), (*other).to_owned()], cells(*estimate).to_vec()].concat()
    });
    Ok(Some(Figure {
        name: format!("{}-improvement", stem(of)),
        caption: format!(
            "How probable it is that a run of {first} scores more than one of each other method on the same task, on \
             average {}; 0.5 is no difference.",
            over(of)
        ),
        svg: intervals(&title, "probability", &names(of), &[panel])?,
        table: Table::new(&[&["method", "over"], &ESTIMATE[..]].concat(), rows),
    }))
}

/// One panel a task: the paper's figure of ablations.
fn by_task(findings: &Findings<'_>) -> Result<Option<Figure>> {
    let of = &findings.comparison;
    let scale = of.suite.scale();
    let of_task = |task: &str, variant: &str| {
        let score =
            findings.scores.iter().find(|score| score.task == task && score.variant == variant)?;
        Some((score.iqm.point / scale, score.iqm.low / scale, score.iqm.high / scale))
    };
    let panel = |task: &String| IntervalPanel {
        title: task.clone(),
        estimates: of.variants.iter().map(|variant| of_task(task, variant)).collect(),
    };
    let panels: Vec<IntervalPanel> = of.tasks.iter().map(panel).collect();
    if findings.scores.is_empty() {
        return Ok(None);
    }
    let title = format!("HKSL and its ablations at {} environment steps", grouped(of.at));
    let rows = findings.scores.iter().map(|score| {
        let numbers = [score.iqm.point, score.iqm.low, score.iqm.high]
            .map(|number| (number / scale).to_string());
        [
            vec![score.task.clone(), score.variant.to_owned(), score.runs.to_string()],
            numbers.to_vec(),
        ]
        .concat()
    });
    Ok(Some(Figure {
        name: format!("{}-by-task", stem(of)),
        caption: format!(
            "Interquartile mean of the runs of HKSL and of HKSL with a part changed, task by task, at {} environment \
             steps, with its 95 % interval.",
            grouped(of.at)
        ),
        svg: intervals(&title, &format!("IQM of {}", of.suite.unit()), &names(of), &panels)?,
        table: Table::new(&[&["task", "method", "runs"], &ESTIMATE[..]].concat(), rows),
    }))
}

/// One figure a distractor, one panel a task: the paper's figures of individual returns.
fn learning(findings: &Findings<'_>) -> Result<Vec<Figure>> {
    let of = &findings.comparison;
    let mut all = Vec::new();
    for distractor in std::iter::once(DISTRACTOR_NONE)
        .chain(distractors().into_iter().filter(|name| *name != DISTRACTOR_NONE))
    {
        let ending = format!("-{distractor}");
        let is_of = |task: &&String| match distractor {
            DISTRACTOR_NONE => {
                !distractors().iter().any(|name| task.ends_with(&format!("-{name}")))
            }
            _ => task.ends_with(&ending),
        };
        let tasks: Vec<&String> = of.tasks.iter().filter(is_of).collect();
        let there = findings.learning.iter().filter(|learning| tasks.contains(&&learning.task));
        if there.clone().next().is_none() {
            continue;
        }
        let panel = |task: &&String| {
            let curve = |variant: &&str| {
                let found = findings
                    .learning
                    .iter()
                    .find(|found| found.task == **task && found.variant == *variant);
                let points = found.map_or(&[][..], |found| &found.points);
                let points =
                    points.iter().map(|at| CurvePoint::new(at.step as f64, at.mean, at.deviation));
                Curve { name: (*variant).to_owned(), points: points.collect() }
            };
            CurvePanel { title: (*task).clone(), curves: of.variants.iter().map(curve).collect() }
        };
        let panels: Vec<CurvePanel> = tasks.iter().map(panel).collect();
        let (title, name) = match distractor {
            DISTRACTOR_NONE => ("Returns without distractors".to_owned(), "undisturbed"),
            name => (format!("Returns with {name}"), name),
        };
        let rows = there.flat_map(|learning| {
            learning.points.iter().map(|at| {
                let numbers = [
                    at.step.to_string(),
                    at.runs.to_string(),
                    at.mean.to_string(),
                    at.deviation.to_string(),
                ];
                [vec![learning.task.clone(), learning.variant.to_owned()], numbers.to_vec()]
                    .concat()
            })
        });
        all.push(Figure {
            name: format!("{}-returns-{name}", stem(of)),
            caption: "Mean return of the runs and ± one standard deviation (ddof 0). Runs that are not done count as far \
                      as they have got."
                .to_owned(),
            svg: curve_grid(&title, STEPS, "return", &panels, 3)?,
            table: Table::new(&["task", "method", "environment_step", "runs", "mean", "std"], rows),
        });
    }
    Ok(all)
}
