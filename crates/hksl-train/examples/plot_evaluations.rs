//! Draws one run's `eval.csv`: mean return by environment step, with ± one standard deviation over the
//! episodes, and horizontal lines to compare with.
//!
//! ```text
//! cargo run --release -p hksl-train --example plot_evaluations -- eval.csv curve.svg "uniform random=4.79"
//! ```

use std::error::Error;
use std::path::PathBuf;

use hksl_train::metrics::read_evaluations;
use plotters::prelude::*;

const CURVE: RGBColor = RGBColor(0, 90, 181);
const ANCHORS: [RGBColor; 3] = [RGBColor(220, 50, 32), RGBColor(90, 90, 90), RGBColor(230, 159, 0)];

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(csv), Some(svg)) = (arguments.next(), arguments.next()) else {
        return Err("usage: plot_evaluations EVAL.CSV OUT.SVG [NAME=RETURN]…".into());
    };
    let anchors = arguments
        .map(|anchor| {
            let (name, value) = anchor.split_once('=').ok_or("an anchor is NAME=RETURN")?;
            Ok((name.to_owned(), value.parse::<f64>()?))
        })
        .collect::<Result<Vec<_>, Box<dyn Error>>>()?;
    let rows = read_evaluations(&PathBuf::from(csv))?;
    let first = rows.first().ok_or("the file has no evaluation")?;
    let steps = |index: usize| rows[index].environment_step as f64;
    let last = steps(rows.len() - 1).max(1.0);
    let highest = rows
        .iter()
        .map(|row| row.episode_return + row.episode_return_std)
        .chain(anchors.iter().map(|(_, value)| *value))
        .fold(0.0, f64::max);

    let area = SVGBackend::new(&svg, (800, 480)).into_drawing_area();
    area.fill(&WHITE)?;
    let title = format!("{} on {}, seed {}", first.agent, first.task, first.seed);
    let mut chart = ChartBuilder::on(&area)
        .caption(title, ("sans-serif", 20))
        .margin(16)
        .x_label_area_size(44)
        .y_label_area_size(56)
        .build_cartesian_2d(0.0..last, 0.0..1.1 * highest)?;
    chart
        .configure_mesh()
        .x_desc("environment steps")
        .y_desc(format!("return, mean of {} episodes", first.episodes))
        .x_label_formatter(&|step| format!("{step:.0}"))
        .label_style(("sans-serif", 14))
        .light_line_style(WHITE)
        .draw()?;
    let edge = |sign: f64| {
        rows.iter().map(move |row| {
            (row.environment_step as f64, row.episode_return + sign * row.episode_return_std)
        })
    };
    let band: Vec<(f64, f64)> =
        edge(1.0).chain(edge(-1.0).collect::<Vec<_>>().into_iter().rev()).collect();
    chart.draw_series(std::iter::once(Polygon::new(band, CURVE.mix(0.18))))?;
    let points = rows.iter().map(|row| (row.environment_step as f64, row.episode_return));
    chart
        .draw_series(LineSeries::new(points, CURVE.stroke_width(2)))?
        .label("evaluation (band: ± one standard deviation)")
        .legend(|(x, y)| PathElement::new([(x, y), (x + 20, y)], CURVE.stroke_width(2)));
    for ((name, value), colour) in anchors.into_iter().zip(ANCHORS.into_iter().cycle()) {
        chart
            .draw_series(LineSeries::new([(0.0, value), (last, value)], colour.stroke_width(1)))?
            .label(format!("{name}, {value}"))
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::MiddleRight)
        .background_style(WHITE.mix(0.85))
        .label_font(("sans-serif", 14))
        .draw()?;
    area.present()?;
    Ok(())
}
