//! Draws columns of `eval.csv` and `metrics.jsonl` files against the environment step, and horizontal lines to
//! compare with.
//!
//! ```text
//! cargo run --release -p hksl-report --example plot_curves -- curve.svg "Falling Pixels" return \
//!     "hksl=eval.csv:episode_return" "uniform random=4.79"
//! ```
//!
//! Where a file has `<column>_std` too, a band of ± that is drawn.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;

use hksl_report::plot::{Anchor, Curve, CurvePoint, curves};

const STEP: &str = "environment_step";

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(svg), Some(title), Some(y)) = (arguments.next(), arguments.next(), arguments.next())
    else {
        return Err(
            "usage: plot_curves OUT.SVG TITLE Y-LABEL [NAME=FILE:COLUMN | NAME=NUMBER]…".into()
        );
    };
    let (mut drawn, mut anchors) = (Vec::new(), Vec::new());
    for argument in arguments {
        let (name, what) = argument.split_once('=').ok_or(format!("`{argument}` is no NAME=…"))?;
        match (what.parse::<f64>(), what.rsplit_once(':')) {
            (Ok(value), _) => anchors.push(Anchor { name: name.to_owned(), value }),
            (_, Some((file, column))) => drawn.push(curve(name, Path::new(file), column)?),
            _ => return Err(format!("`{what}` is neither a number nor FILE:COLUMN").into()),
        }
    }
    std::fs::write(svg, curves(&title, "environment steps", &y, &drawn, &anchors)?)?;
    Ok(())
}

fn curve(name: &str, file: &Path, column: &str) -> Result<Curve, Box<dyn Error>> {
    let deviation = format!("{column}_std");
    let point = |row: &BTreeMap<String, f64>| {
        let (step, value) = (*row.get(STEP)?, *row.get(column)?);
        let deviation = row.get(&deviation).copied().unwrap_or(0.0);
        Some(CurvePoint::new(step, value, deviation))
    };
    let points: Vec<_> = rows(file)?.iter().filter_map(point).collect();
    if points.is_empty() {
        return Err(format!("{} has no `{column}`", file.display()).into());
    }
    Ok(Curve { name: name.to_owned(), points })
}

/// The numbers of each line, by column.
fn rows(file: &Path) -> Result<Vec<BTreeMap<String, f64>>, Box<dyn Error>> {
    let text =
        std::fs::read_to_string(file).map_err(|error| format!("{}: {error}", file.display()))?;
    if file.extension().is_some_and(|extension| extension == "jsonl") {
        return text
            .lines()
            .map(|line| {
                let values: BTreeMap<String, Option<f64>> = serde_json::from_str(line)?;
                Ok(values.into_iter().filter_map(|(name, value)| Some((name, value?))).collect())
            })
            .collect();
    }
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let names = reader.headers()?.clone();
    reader
        .records()
        .map(|record| {
            let record = record?;
            let cells = names.iter().zip(&record);
            Ok(cells
                .filter_map(|(name, cell)| Some((name.to_owned(), cell.parse().ok()?)))
                .collect())
        })
        .collect()
}
