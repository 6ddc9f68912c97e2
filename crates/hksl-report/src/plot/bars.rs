//! Grouped bar plots with error bars, several panels side by side.

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::canvas::{
    Area, CAPTION, Drawn, FONT, TEXT, caption_width, colour, label, legend, legend_height,
    numbered, svg,
};
use super::error::Result;

/// One panel of a bar plot.
#[derive(Debug, Clone, PartialEq)]
pub struct BarPanel {
    /// Its title.
    pub title: String,
    /// Mean and deviation of each group, by series. `None` leaves a gap.
    pub values: Vec<Vec<Option<(f64, f64)>>>,
}

/// Fraction of a group's width that the bars occupy.
const FILLED: f64 = 0.8;

/// Draws panels side by side on one scale: groups of bars, one bar per series, with error bars of ± the deviation. The
/// axis starts at 0 and clips negative values.
///
/// # Errors
/// [`Error`](super::Error).
pub fn bars(
    title: &str,
    y_label: &str,
    series: &[String],
    groups: &[String],
    panels: &[BarPanel],
) -> Result<String> {
    let width = 110 + panels.len() * (80 + groups.len() * (30 + 26 * series.len()));
    let width = width.max(caption_width(title)).max(480);
    let cells = panels.iter().flat_map(|panel| panel.values.iter().flatten().flatten());
    let top = cells.map(|(mean, std)| mean + std).filter(|top| top.is_finite());
    let top = top.fold(0f64, f64::max);
    let top = if top > 0.0 { 1.08 * top } else { 1.0 };
    let series_names = numbered(series);
    let height = 388 + legend_height(&series_names, width);
    svg((width as u32, height as u32), |area| {
        let area = area.titled(title, (FONT, CAPTION))?;
        let (charts, names) = area.split_vertically(352);
        for (index, (part, panel)) in
            charts.split_evenly((1, panels.len().max(1))).iter().zip(panels).enumerate()
        {
            draw(part, panel, if index == 0 { y_label } else { "" }, series.len(), groups, top)?;
        }
        legend(&names, &series_names)
    })
}

fn draw(
    area: &Area,
    panel: &BarPanel,
    y_label: &str,
    series: usize,
    groups: &[String],
    top: f64,
) -> Drawn {
    let mut chart = ChartBuilder::on(area)
        .caption(&panel.title, (FONT, TEXT + 2))
        .margin(8)
        .x_label_area_size(28)
        .y_label_area_size(72)
        .build_cartesian_2d(0.0..groups.len().max(1) as f64, 0.0..top)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .x_labels(0)
        .y_desc(y_label)
        .y_label_formatter(&|value| label(*value))
        .label_style((FONT, TEXT))
        .max_light_lines(0)
        .draw()?;
    let bar = FILLED / series.max(1) as f64;
    for (index, values) in panel.values.iter().enumerate() {
        for (group, value) in values.iter().enumerate() {
            let Some((mean, std)) = value.filter(|(mean, std)| (mean + std).is_finite()) else {
                continue;
            };
            let left = group as f64 + 0.5 * (1.0 - FILLED) + bar * index as f64;
            let corners = [(left + 0.05 * bar, 0.0), (left + 0.95 * bar, mean)];
            let whisker =
                [(left + 0.5 * bar, (mean - std).max(0.0)), (left + 0.5 * bar, mean + std)];
            chart.draw_series([Rectangle::new(corners, colour(index).filled())])?;
            chart.draw_series([PathElement::new(whisker, BLACK.stroke_width(1))])?;
        }
    }
    let style = TextStyle::from((FONT, TEXT).into_font()).pos(Pos::new(HPos::Center, VPos::Top));
    let inside = chart.plotting_area();
    let (origin_x, origin_y) = area.get_base_pixel();
    for (group, name) in groups.iter().enumerate() {
        let (x, y) = inside.map_coordinate(&(group as f64 + 0.5, 0.0));
        let place = (x - origin_x, y - origin_y + 8);
        area.draw(&Text::new(name.clone(), place, style.clone()))?;
    }
    Ok(())
}
