//! Heat maps of square matrices.

use ndarray::ArrayView2;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::canvas::{CAPTION, FONT, TEXT, caption_width, label, svg};
use super::error::Result;

/// Side of a cell, in pixels.
const CELL: i32 = 64;
const LEFT: i32 = 64;
const TOP: i32 = 16;

/// Draws a matrix whose rows and columns are the steps 1, 2, …, each cell coloured from the smallest number (light) to
/// the largest (dark) and labelled with it.
///
/// # Errors
/// [`Error`](super::Error).
pub fn heat_map(title: &str, axis: &str, values: ArrayView2<'_, f64>) -> Result<String> {
    let (rows, columns) = values.dim();
    let (low, high) = values
        .iter()
        .filter(|value| value.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)));
    let shade = |value: f64| if high > low { (value - low) / (high - low) } else { 0.0 };
    let width = (LEFT + CELL * columns as i32 + 24).max(caption_width(title) as i32) as u32;
    let height = (TOP + CELL * rows as i32 + 96) as u32;
    svg((width, height), |area| {
        let area = area.titled(title, (FONT, CAPTION))?;
        let write = |text: String, place: (i32, i32), ink: RGBColor| {
            let middle = Pos::new(HPos::Center, VPos::Center);
            let style = TextStyle::from((FONT, TEXT).into_font()).color(&ink).pos(middle);
            area.draw(&Text::new(text, place, style))
        };
        for ((row, column), &value) in values.indexed_iter() {
            let (x, y) = (LEFT + CELL * column as i32, TOP + CELL * row as i32);
            let dark = if value.is_finite() { shade(value) } else { 0.0 };
            let corners = [(x, y), (x + CELL, y + CELL)];
            area.draw(&Rectangle::new(corners, ramp(dark).filled()))?;
            let ink = if dark > 0.55 { WHITE } else { BLACK };
            let place = (x + CELL / 2, y + CELL / 2);
            write(label(rounded(value)), place, ink)?;
        }
        for index in 0..rows {
            let place = (LEFT - 16, TOP + CELL * index as i32 + CELL / 2);
            write((index + 1).to_string(), place, BLACK)?;
        }
        for index in 0..columns {
            let place = (LEFT + CELL * index as i32 + CELL / 2, TOP + CELL * rows as i32 + 14);
            write((index + 1).to_string(), place, BLACK)?;
        }
        let place = (LEFT + CELL * columns as i32 / 2, TOP + CELL * rows as i32 + 38);
        write(axis.to_owned(), place, BLACK)?;
        let turned = TextStyle::from((FONT, TEXT).into_font().transform(FontTransform::Rotate270))
            .pos(Pos::new(HPos::Center, VPos::Center));
        let place = (16, TOP + CELL * rows as i32 / 2);
        area.draw(&Text::new(axis.to_owned(), place, turned))?;
        Ok(())
    })
}

/// Rounds to three significant digits.
fn rounded(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    let scale = 10f64.powf(2.0 - value.abs().log10().floor());
    (value * scale).round() / scale
}

/// Colour map from near white to dark blue with linearly decreasing lightness.
fn ramp(share: f64) -> RGBColor {
    let between = |from: f64, to: f64| (from + share * (to - from)).round() as u8;
    RGBColor(between(240.0, 8.0), between(246.0, 48.0), between(252.0, 107.0))
}
