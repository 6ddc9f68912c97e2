//! Scatter plots of groups of points, joined in order.

use plotters::prelude::*;

use super::canvas::{CAPTION, COLOURS, FONT, TEXT, colour, label, svg};
use super::error::Result;

/// A group of points.
#[derive(Debug, Clone, PartialEq)]
pub struct ScatterGroup {
    /// Its name.
    pub name: String,
    /// Its points, in order.
    pub points: Vec<(f64, f64)>,
}

/// Draws each group in its own colour. When colours repeat, the shape changes: circles, triangles, crosses.
///
/// # Errors
/// [`Error`](super::Error).
pub fn scatter(title: &str, axes: (&str, &str), groups: &[ScatterGroup]) -> Result<String> {
    let points = || {
        let all = groups.iter().flat_map(|group| &group.points);
        all.filter(|(x, y)| x.is_finite() && y.is_finite())
    };
    let range = |pick: fn(&(f64, f64)) -> f64| {
        let (low, high) = points()
            .map(pick)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        if low > high {
            return 0.0..1.0;
        }
        let room = (0.06 * (high - low)).max(1e-9);
        low - room..high + room
    };
    svg((720, 560), |area| {
        let mut chart = ChartBuilder::on(area)
            .caption(title, (FONT, CAPTION))
            .margin(16)
            .margin_right(32)
            .x_label_area_size(44)
            .y_label_area_size(64)
            .build_cartesian_2d(range(|point| point.0), range(|point| point.1))?;
        chart
            .configure_mesh()
            .x_desc(axes.0)
            .y_desc(axes.1)
            .x_label_formatter(&|value| label(*value))
            .y_label_formatter(&|value| label(*value))
            .label_style((FONT, TEXT))
            .max_light_lines(0)
            .draw()?;
        for (index, group) in groups.iter().enumerate() {
            let colour = colour(index);
            let points = || group.points.iter().copied();
            chart.draw_series(LineSeries::new(points(), colour.mix(0.5)))?;
            match (index / COLOURS.len()) % 3 {
                0 => chart.draw_series(points().map(|at| Circle::new(at, 4, colour.filled())))?,
                1 => chart
                    .draw_series(points().map(|at| TriangleMarker::new(at, 6, colour.filled())))?,
                _ => chart
                    .draw_series(points().map(|at| Cross::new(at, 4, colour.stroke_width(2))))?,
            };
        }
        Ok(())
    })
}
