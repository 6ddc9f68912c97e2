//! Interval plots, one panel or several.

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::canvas::{
    Area, CAPTION, CHARACTER, FONT, LONGEST_NAME, TEXT, caption_width, colour, elided, label, svg,
};
use super::error::Result;

/// One panel: a row for each name.
#[derive(Debug, Clone, PartialEq)]
pub struct IntervalPanel {
    /// Its title.
    pub title: String,
    /// Point estimate, lower and upper bound for each name. `None` leaves the row empty.
    pub estimates: Vec<Option<(f64, f64, f64)>>,
    /// Ends of the axis and position of a dashed line. `None` fits the axis to the estimates.
    pub scale: Option<(f64, f64, f64)>,
}

/// Panels per row.
const COLUMNS: usize = 4;
/// Width of a panel, in pixels.
const PANEL: usize = 250;
/// Height of a row, in pixels; `AROUND` is the height of everything else in a panel.
const ROW: usize = 30;
const AROUND: usize = 80;
/// Fraction of a row's height that the bar occupies.
const FILLED: f64 = 0.6;
/// Minimum width of a bar as a fraction of the axis, so that narrow intervals are visible.
const LEAST: f64 = 0.012;

/// Draws panels with separate scales. Each name has a bar for its interval, if any, and a mark at its point estimate.
/// Omits names that are empty in all panels.
///
/// # Errors
/// [`Error`](super::Error).
pub fn intervals(
    title: &str,
    axis: &str,
    names: &[String],
    panels: &[IntervalPanel],
) -> Result<String> {
    let there = |index: usize| {
        panels.iter().any(|panel| panel.estimates.get(index).is_some_and(Option::is_some))
    };
    let rows: Vec<usize> = (0..names.len()).filter(|&index| there(index)).collect();
    let longest = rows.iter().map(|&row| names[row].chars().count().min(LONGEST_NAME)).max();
    let left = 24 + CHARACTER * longest.unwrap_or(0) as i32;
    let columns = panels.len().clamp(1, COLUMNS);
    let width = (left as usize + PANEL * columns + 16).max(caption_width(title)).max(480);
    let band = AROUND + ROW * rows.len().max(1);
    let bands = panels.len().div_ceil(columns).max(1);
    svg((width as u32, (36 + band * bands) as u32), |area| {
        let area = area.titled(title, (FONT, CAPTION))?;
        for (part, panels) in area.split_evenly((bands, 1)).iter().zip(panels.chunks(columns)) {
            let (beside, charts) = part.split_horizontally(left);
            let mut heights = Vec::new();
            for (part, panel) in charts.split_evenly((1, columns)).iter().zip(panels) {
                heights = draw(part, panel, axis, &rows)?;
            }
            let style = (FONT, TEXT).into_font();
            let style = TextStyle::from(style).pos(Pos::new(HPos::Right, VPos::Center));
            let (_, top) = beside.get_base_pixel();
            for (&row, y) in rows.iter().zip(heights) {
                beside.draw(&Text::new(
                    elided(&names[row]),
                    (left - 10, y - top),
                    style.clone(),
                ))?;
            }
        }
        Ok(())
    })
}

/// Draws a panel and returns the vertical centre of each row, in pixels of the figure.
fn draw(
    area: &Area,
    panel: &IntervalPanel,
    axis: &str,
    rows: &[usize],
) -> std::result::Result<Vec<i32>, Box<dyn std::error::Error>> {
    let finite = |&(point, low, high): &(f64, f64, f64)| (point + low + high).is_finite();
    let estimate = |row: usize| panel.estimates.get(row).copied().flatten().filter(finite);
    let (low, high) = range(panel, rows.iter().filter_map(|&row| estimate(row)));
    let mut chart = ChartBuilder::on(area)
        .caption(elided(&panel.title), (FONT, TEXT + 2))
        .margin(6)
        .margin_left(10)
        .margin_right(14)
        .x_label_area_size(40)
        .build_cartesian_2d(low..high, rows.len().max(1) as f64..0.0)?;
    // Enough digits to distinguish neighbouring ticks.
    let digits = (-(0.2 * (high - low)).log10()).ceil().clamp(0.0, 9.0) as usize;
    let written = |value: &f64| {
        if value.abs() >= 1e5 { label(*value) } else { format!("{value:.digits$}") }
    };
    chart
        .configure_mesh()
        .disable_y_mesh()
        .y_labels(0)
        .x_labels(4)
        .x_desc(axis)
        .x_label_formatter(&written)
        .label_style((FONT, TEXT))
        .max_light_lines(0)
        .draw()?;
    if let Some((.., line)) = panel.scale {
        let ends = [(line, 0.0), (line, rows.len().max(1) as f64)];
        chart.draw_series(DashedLineSeries::new(ends, 5, 4, BLACK.stroke_width(1)))?;
    }
    for (position, &row) in rows.iter().enumerate() {
        let Some((point, from, to)) = estimate(row) else {
            continue;
        };
        let middle = position as f64 + 0.5;
        let (top, bottom) = (middle - 0.5 * FILLED, middle + 0.5 * FILLED);
        // A single run has no interval, so it gets no bar.
        if to > from {
            let wider = (0.5 * (LEAST * (high - low) - (to - from))).max(0.0);
            let bar = [((from - wider).max(low), top), ((to + wider).min(high), bottom)];
            chart.draw_series([Rectangle::new(bar, colour(row).mix(0.7).filled())])?;
        }
        let mark = PathElement::new([(point, top), (point, bottom)], BLACK.stroke_width(2));
        chart.draw_series([mark])?;
    }
    let inside = chart.plotting_area();
    let middle = |position: usize| inside.map_coordinate(&(low, position as f64 + 0.5)).1;
    Ok((0..rows.len()).map(middle).collect())
}

/// Ends of a panel's axis.
fn range(panel: &IntervalPanel, estimates: impl Iterator<Item = (f64, f64, f64)>) -> (f64, f64) {
    if let Some((low, high, _)) = panel.scale {
        return (low, high);
    }
    let ends = estimates.flat_map(|(point, low, high)| [point, low, high]);
    let (low, high) = ends
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), end| (low.min(end), high.max(end)));
    if low > high || (low, high) == (0.0, 0.0) {
        return (0.0, 1.0);
    }
    let room = (0.08 * (high - low)).max(1e-2 * high.abs()).max(1e-9);
    (low - room, high + room)
}
