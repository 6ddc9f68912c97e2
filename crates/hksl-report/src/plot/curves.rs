//! Line plots over steps with bands and horizontal reference lines; one plot, or several with a shared legend.

use plotters::prelude::*;

use super::canvas::{
    Area, CAPTION, Drawn, FONT, TEXT, caption_width, colour, elided, is_dashed, label, legend,
    legend_height, svg,
};
use super::error::Result;
use hksl_files::numbers::grouped;

/// One curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Its name in the legend.
    pub name: String,
    /// Its points, in order.
    pub points: Vec<CurvePoint>,
}

/// One point of a curve, with the band around it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvePoint {
    /// Position on the x-axis.
    pub step: f64,
    /// Its value.
    pub value: f64,
    /// Lower end of the band; equal to the value without a band.
    pub low: f64,
    /// Upper end of the band; equal to the value without a band.
    pub high: f64,
}

impl CurvePoint {
    /// A point with a band of ± `deviation`, 0 for no band.
    pub fn new(step: f64, value: f64, deviation: f64) -> Self {
        Self { step, value, low: value - deviation, high: value + deviation }
    }

    fn is_finite(&self) -> bool {
        [self.step, self.value, self.low, self.high].iter().all(|number| number.is_finite())
    }
}

/// A horizontal reference line.
#[derive(Debug, Clone, PartialEq)]
pub struct Anchor {
    /// Its name in the legend.
    pub name: String,
    /// Its value.
    pub value: f64,
}

/// One of several plots side by side.
#[derive(Debug, Clone, PartialEq)]
pub struct CurvePanel {
    /// Its title.
    pub title: String,
    /// Its curves, one for each name in the legend. Curves without points are not drawn.
    pub curves: Vec<Curve>,
}

/// Draws curves over steps. Omits NaN and infinite points, and curves without points also from the legend.
///
/// # Errors
/// [`Error`](super::Error).
pub fn curves(
    title: &str,
    x_label: &str,
    y_label: &str,
    curves: &[Curve],
    anchors: &[Anchor],
) -> Result<String> {
    let lines = anchors.iter().map(|anchor| format!("{}, {}", anchor.name, label(anchor.value)));
    let lines = lines.enumerate().map(|(index, name)| (curves.len() + index, name));
    let drawn = curves.iter().enumerate().filter(|(_, curve)| !curve.points.is_empty());
    let names: Vec<(usize, String)> =
        drawn.map(|(index, curve)| (index, curve.name.clone())).chain(lines).collect();
    let height = 448 + legend_height(&names, 800);
    svg((800, height as u32), |area| {
        let (chart, below) = area.split_vertically(448);
        let look = Look { caption: CAPTION, margins: (16, 44), axes: (44, 64), labels: 10 };
        draw(&chart, &look, (title, x_label, y_label), curves, anchors)?;
        legend(&below, &names)
    })
}

/// Draws several plots with the same curves in rows of `columns`, with a shared legend. Each plot has its own scale.
///
/// # Errors
/// [`Error`](super::Error).
pub fn curve_grid(
    title: &str,
    x_label: &str,
    y_label: &str,
    panels: &[CurvePanel],
    columns: usize,
) -> Result<String> {
    let columns = columns.clamp(1, panels.len().max(1));
    let rows = panels.len().div_ceil(columns);
    let count = panels.iter().map(|panel| panel.curves.len()).max().unwrap_or(0);
    let named = |index: usize| {
        let mut curves = panels.iter().filter_map(|panel| panel.curves.get(index));
        curves.find(|curve| !curve.points.is_empty()).map(|curve| (index, curve.name.clone()))
    };
    let names: Vec<(usize, String)> = (0..count).filter_map(named).collect();
    let width = (320 * columns).max(caption_width(title)).max(480);
    let charts_height = 250 * rows.max(1);
    let height = 36 + charts_height + legend_height(&names, width);
    svg((width as u32, height as u32), |area| {
        let area = area.titled(title, (FONT, CAPTION))?;
        let (charts, below) = area.split_vertically(charts_height as i32);
        let look = Look { caption: TEXT + 2, margins: (6, 32), axes: (38, 58), labels: 4 };
        for (index, (part, panel)) in
            charts.split_evenly((rows, columns)).iter().zip(panels).enumerate()
        {
            let y_label = if index % columns == 0 { y_label } else { "" };
            draw(part, &look, (&elided(&panel.title), x_label, y_label), &panel.curves, &[])?;
        }
        legend(&below, &names)
    })
}

struct Look {
    caption: u32,
    /// Margin, and right margin, into which half of a tick label extends, in pixels.
    margins: (u32, u32),
    /// Space for the tick labels below and on the left, in pixels.
    axes: (u32, u32),
    /// Approximate number of tick labels.
    labels: usize,
}

fn draw(
    area: &Area,
    look: &Look,
    (title, x_label, y_label): (&str, &str, &str),
    curves: &[Curve],
    anchors: &[Anchor],
) -> Drawn {
    let finite = |curve: &Curve| -> Vec<CurvePoint> {
        curve.points.iter().filter(|point| point.is_finite()).copied().collect()
    };
    let curves: Vec<Vec<CurvePoint>> = curves.iter().map(finite).collect();
    let points = || curves.iter().flatten();
    // Steps are integers from 0. Other values get the range of the data.
    let steps = points().all(|point| point.step >= 0.0 && point.step.fract() == 0.0);
    let first = points().map(|point| point.step).fold(0.0, f64::min);
    let last =
        points().map(|point| point.step).fold(if steps { 1.0 } else { first + 1e-9 }, f64::max);
    let ends = points().flat_map(|point| [point.low, point.high]);
    let ends = ends.chain(anchors.iter().map(|anchor| anchor.value));
    let (low, high) = ends.fold((0f64, 0f64), |(low, high), end| (low.min(end), high.max(end)));
    let high = if low == high { low + 1.0 } else { high };
    let room = 0.08 * (high - low).max(1e-9);
    let bottom = if low < 0.0 { low - room } else { 0.0 };
    // With few steps, ticks only at integers.
    let marks = if steps && last <= 12.0 { last as usize + 1 } else { look.labels };
    let mut chart = ChartBuilder::on(area)
        .caption(title, (FONT, look.caption))
        .margin(look.margins.0)
        .margin_right(look.margins.1)
        .x_label_area_size(look.axes.0)
        .y_label_area_size(look.axes.1)
        .build_cartesian_2d(first..last, bottom..high + room)?;
    chart
        .configure_mesh()
        .x_desc(x_label)
        .y_desc(y_label)
        .x_label_formatter(&|x| if steps { grouped(x.round() as u64) } else { label(*x) })
        .x_labels(marks)
        .y_labels(look.labels + 2)
        .y_label_formatter(&|value| label(*value))
        .label_style((FONT, TEXT))
        .max_light_lines(0)
        .draw()?;
    // The first curve is drawn last, on top.
    for (index, points) in curves.iter().enumerate().rev() {
        let colour = colour(index);
        if let [point] = &points[..] {
            let at = (point.step, point.value);
            chart.draw_series([Circle::new(at, 4, colour.filled())])?;
        }
        if points.len() < 2 {
            continue;
        }
        if points.iter().any(|point| point.high > point.low) {
            let upper = points.iter().map(|point| (point.step, point.high));
            let lower = points.iter().rev().map(|point| (point.step, point.low));
            let band: Vec<(f64, f64)> = upper.chain(lower).collect();
            chart.draw_series(std::iter::once(Polygon::new(band, colour.mix(0.15))))?;
        }
        let line = points.iter().map(|point| (point.step, point.value));
        if is_dashed(index) {
            chart.draw_series(DashedLineSeries::new(line, 6, 4, colour.stroke_width(2)))?;
        } else {
            chart.draw_series(LineSeries::new(line, colour.stroke_width(2)))?;
        }
    }
    for (index, Anchor { value, .. }) in anchors.iter().enumerate() {
        let colour = colour(curves.len() + index);
        let ends = [(first, *value), (last, *value)];
        chart.draw_series(DashedLineSeries::new(ends, 6, 4, colour.into()))?;
    }
    Ok(())
}
