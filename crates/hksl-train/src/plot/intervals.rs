//! Estimates with their intervals, several panels side by side.

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::{Area, CAPTION, CHARACTER, FONT, TEXT, caption_width, colour, label, svg};
use crate::Result;

/// One panel: a row for each name.
#[derive(Debug, Clone, PartialEq)]
pub struct IntervalPanel {
    /// What it shows.
    pub title: String,
    /// For each name, point, lower and upper bound; none leaves its row empty.
    pub estimates: Vec<Option<(f64, f64, f64)>>,
}

/// Height of a row; pixels.
const ROW: usize = 30;
/// Share of it that the interval takes.
const FILLED: f64 = 0.6;

/// Draws panels side by side, each with a scale of its own: for every name a bar over its interval, and a mark at the
/// point. Names whose row is empty in all panels are left out.
///
/// # Errors
/// [`crate::Error::Plot`].
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
    let longest = rows.iter().map(|&row| names[row].chars().count()).max().unwrap_or(0);
    let left = 24 + CHARACTER * longest as i32;
    let width = (left as usize + 250 * panels.len() + 16).max(caption_width(title)).max(480);
    let height = 36 + 28 + ROW * rows.len().max(1) + 52;
    svg((width as u32, height as u32), |area| {
        let area = area.titled(title, (FONT, CAPTION))?;
        let (beside, charts) = area.split_horizontally(left);
        let mut heights = Vec::new();
        for (part, panel) in charts.split_evenly((1, panels.len().max(1))).iter().zip(panels) {
            heights = draw(part, panel, axis, &rows)?;
        }
        let style = (FONT, TEXT).into_font();
        let style = TextStyle::from(style).pos(Pos::new(HPos::Right, VPos::Center));
        let (_, top) = beside.get_base_pixel();
        for (&row, y) in rows.iter().zip(heights) {
            beside.draw(&Text::new(names[row].clone(), (left - 10, y - top), style.clone()))?;
        }
        Ok(())
    })
}

/// Draws a panel; gives where the middle of each row is, in pixels of the whole picture.
fn draw(
    area: &Area,
    panel: &IntervalPanel,
    axis: &str,
    rows: &[usize],
) -> std::result::Result<Vec<i32>, Box<dyn std::error::Error>> {
    let estimate = |row: usize| panel.estimates.get(row).copied().flatten();
    let finite = |&(point, low, high): &(f64, f64, f64)| (point + low + high).is_finite();
    let all = rows.iter().filter_map(|&row| estimate(row)).filter(finite);
    let (low, high) = all
        .flat_map(|(point, low, high)| [point, low, high])
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), end| (low.min(end), high.max(end)));
    let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
    let room = (0.08 * (high - low)).max(1e-3 * high.abs()).max(1e-9);
    let mut chart = ChartBuilder::on(area)
        .caption(&panel.title, (FONT, TEXT + 2))
        .margin(6)
        .margin_left(10)
        .margin_right(14)
        .x_label_area_size(40)
        .build_cartesian_2d(low - room..high + room, rows.len().max(1) as f64..0.0)?;
    chart
        .configure_mesh()
        .disable_y_mesh()
        .y_labels(0)
        .x_labels(4)
        .x_desc(axis)
        .x_label_formatter(&|value| label(*value))
        .label_style((FONT, TEXT))
        .light_line_style(WHITE)
        .draw()?;
    for (position, &row) in rows.iter().enumerate() {
        let Some((point, low, high)) = estimate(row).filter(finite) else {
            continue;
        };
        let middle = position as f64 + 0.5;
        let (top, bottom) = (middle - 0.5 * FILLED, middle + 0.5 * FILLED);
        let bar = Rectangle::new([(low, top), (high, bottom)], colour(row).mix(0.55).filled());
        chart.draw_series([bar])?;
        let mark = PathElement::new([(point, top), (point, bottom)], BLACK.stroke_width(2));
        chart.draw_series([mark])?;
    }
    let inside = chart.plotting_area();
    let middle = |position: usize| inside.map_coordinate(&(low, position as f64 + 0.5)).1;
    Ok((0..rows.len()).map(middle).collect())
}
