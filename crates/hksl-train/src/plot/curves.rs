//! Values against steps, with bands and horizontal lines to compare with.

use plotters::prelude::*;

use super::{CAPTION, FONT, TEXT, colour, label, svg};
use crate::Result;

/// One curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Its name in the legend.
    pub name: String,
    /// Its points, in order.
    pub points: Vec<CurvePoint>,
}

/// One point of a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvePoint {
    /// Position along the axis of steps.
    pub step: f64,
    /// Its value.
    pub value: f64,
    /// Half the height of the band around it; 0 for none.
    pub deviation: f64,
}

/// A horizontal line.
#[derive(Debug, Clone, PartialEq)]
pub struct Anchor {
    /// Its name in the legend.
    pub name: String,
    /// Its height.
    pub value: f64,
}

/// Draws curves against steps. What is not finite is left out.
///
/// # Errors
/// [`crate::Error::Plot`].
pub fn curves(
    title: &str,
    x_label: &str,
    y_label: &str,
    curves: &[Curve],
    anchors: &[Anchor],
) -> Result<String> {
    let finite = |curve: &Curve| -> Vec<CurvePoint> {
        let sound = |point: &&CurvePoint| {
            point.step.is_finite() && point.value.is_finite() && point.deviation.is_finite()
        };
        curve.points.iter().filter(sound).copied().collect()
    };
    let curves: Vec<(&str, Vec<CurvePoint>)> =
        curves.iter().map(|curve| (curve.name.as_str(), finite(curve))).collect();
    let points = || curves.iter().flat_map(|(_, points)| points);
    let last = points().map(|point| point.step).fold(1.0, f64::max);
    let ends = points().flat_map(|p| [p.value - p.deviation, p.value + p.deviation]);
    let ends = ends.chain(anchors.iter().map(|anchor| anchor.value));
    let (low, high) = ends.fold((0f64, 0f64), |(low, high), end| (low.min(end), high.max(end)));
    let room = 0.08 * (high - low).max(1e-9);
    let bottom = if low < 0.0 { low - room } else { 0.0 };

    svg((800, 480), |area| {
        let mut chart = ChartBuilder::on(area)
            .caption(title, (FONT, CAPTION))
            .margin(16)
            .margin_right(32)
            .x_label_area_size(44)
            .y_label_area_size(64)
            .build_cartesian_2d(0.0..last, bottom..high + room)?;
        chart
            .configure_mesh()
            .x_desc(x_label)
            .y_desc(y_label)
            .x_label_formatter(&|step| format!("{step:.0}"))
            // A mark for each of a few whole steps, not between them.
            .x_labels(if last <= 12.0 { last as usize + 1 } else { 10 })
            .y_label_formatter(&|value| label(*value))
            .label_style((FONT, TEXT))
            .light_line_style(WHITE)
            .draw()?;
        for (index, (name, points)) in curves.iter().enumerate() {
            let colour = colour(index);
            let upper = points.iter().map(|p| (p.step, p.value + p.deviation));
            let lower = points.iter().rev().map(|p| (p.step, p.value - p.deviation));
            if points.iter().any(|point| point.deviation > 0.0) {
                let band: Vec<(f64, f64)> = upper.chain(lower).collect();
                chart.draw_series(std::iter::once(Polygon::new(band, colour.mix(0.15))))?;
            }
            let line = points.iter().map(|point| (point.step, point.value));
            let sample =
                move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour.stroke_width(2));
            chart
                .draw_series(LineSeries::new(line, colour.stroke_width(2)))?
                .label(*name)
                .legend(sample);
        }
        for (index, Anchor { name, value }) in anchors.iter().enumerate() {
            let colour = colour(curves.len() + index);
            let line = DashedLineSeries::new([(0.0, *value), (last, *value)], 6, 4, colour.into());
            chart
                .draw_series(line)?
                .label(format!("{name}, {}", label(*value)))
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour));
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperLeft)
            .background_style(WHITE.mix(0.85))
            .label_font((FONT, TEXT))
            .draw()?;
        Ok(())
    })
}
