//! Draws columns of `eval.csv` and `metrics.jsonl` files against the environment step, and horizontal lines to
//! compare with.
//!
//! ```text
//! cargo run --release -p hksl-train --example plot_curves -- curve.svg "Falling Pixels" return \
//!     "hksl=eval.csv:episode_return" "uniform random=4.79"
//! ```
//!
//! Where a file has `<column>_std` too, a band of ± that is drawn.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;

use plotters::prelude::*;

/// Told apart by the colour-blind too (Okabe and Ito).
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(90, 90, 90),
];
const STEP: &str = "environment_step";

/// One curve: environment step, value, deviation.
struct Curve {
    name: String,
    points: Vec<(f64, f64, f64)>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(svg), Some(title), Some(y)) = (arguments.next(), arguments.next(), arguments.next())
    else {
        return Err(
            "usage: plot_curves OUT.SVG TITLE Y-LABEL [NAME=FILE:COLUMN | NAME=NUMBER]…".into()
        );
    };
    let (mut curves, mut anchors) = (Vec::new(), Vec::new());
    for argument in arguments {
        let (name, what) = argument.split_once('=').ok_or(format!("`{argument}` is no NAME=…"))?;
        match (what.parse::<f64>(), what.rsplit_once(':')) {
            (Ok(value), _) => anchors.push((name.to_owned(), value)),
            (_, Some((file, column))) => curves.push(curve(name, Path::new(file), column)?),
            _ => return Err(format!("`{what}` is neither a number nor FILE:COLUMN").into()),
        }
    }
    draw(&svg, &title, &y, &curves, &anchors)
}

fn curve(name: &str, file: &Path, column: &str) -> Result<Curve, Box<dyn Error>> {
    let deviation = format!("{column}_std");
    let point = |row: &BTreeMap<String, f64>| {
        let std = row.get(&deviation).copied().unwrap_or(0.0);
        Some((*row.get(STEP)?, *row.get(column)?, std))
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

fn draw(
    svg: &str,
    title: &str,
    y: &str,
    curves: &[Curve],
    anchors: &[(String, f64)],
) -> Result<(), Box<dyn Error>> {
    let points = || curves.iter().flat_map(|curve| &curve.points);
    let last = points().map(|point| point.0).fold(1.0, f64::max);
    let ends = points().flat_map(|(_, value, std)| [value - std, value + std]);
    let ends = ends.chain(anchors.iter().map(|(_, value)| *value));
    let (low, high) = ends.fold((0f64, 0f64), |(low, high), end| (low.min(end), high.max(end)));
    let room = 0.08 * (high - low).max(1e-9);

    let area = SVGBackend::new(svg, (800, 480)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .caption(title, ("sans-serif", 20))
        .margin(16)
        .x_label_area_size(44)
        .y_label_area_size(64)
        .build_cartesian_2d(0.0..last, (if low < 0.0 { low - room } else { 0.0 })..high + room)?;
    chart
        .configure_mesh()
        .x_desc("environment steps")
        .y_desc(y)
        .x_label_formatter(&|step| format!("{step:.0}"))
        .label_style(("sans-serif", 14))
        .light_line_style(WHITE)
        .draw()?;
    let colours = COLOURS.into_iter().cycle();
    for (Curve { name, points }, colour) in curves.iter().zip(colours.clone()) {
        let upper = points.iter().map(|(step, value, std)| (*step, value + std));
        let lower = points.iter().rev().map(|(step, value, std)| (*step, value - std));
        if points.iter().any(|(_, _, std)| *std > 0.0) {
            let band: Vec<(f64, f64)> = upper.chain(lower).collect();
            chart.draw_series(std::iter::once(Polygon::new(band, colour.mix(0.15))))?;
        }
        let line = points.iter().map(|(step, value, _)| (*step, *value));
        chart
            .draw_series(LineSeries::new(line, colour.stroke_width(2)))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour.stroke_width(2)));
    }
    for ((name, value), colour) in anchors.iter().zip(colours.skip(curves.len())) {
        let line = DashedLineSeries::new([(0.0, *value), (last, *value)], 6, 4, colour.into());
        chart
            .draw_series(line)?
            .label(format!("{name}, {value}"))
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .background_style(WHITE.mix(0.85))
        .label_font(("sans-serif", 14))
        .draw()?;
    area.present()?;
    Ok(())
}
