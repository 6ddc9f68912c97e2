//! Shared parts of all figures: background, text, colours and labels.

use plotters::backend::SVGBackend;
use plotters::coord::Shift;
use plotters::prelude::*;

use super::error::{Error, Result};

/// Colours that are distinguishable with colour blindness (Okabe and Ito) and visible on white and black.
pub(super) const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(110, 110, 110),
    RGBColor(140, 86, 75),
];
pub(super) const FONT: &str = "sans-serif";
/// Font size of captions, in pixels.
pub(super) const CAPTION: u32 = 20;
pub(super) const TEXT: u32 = 14;
/// Approximate width of a character of [`TEXT`], in pixels.
pub(super) const CHARACTER: i32 = 8;

/// Minimum width of a figure for this caption, in pixels.
pub(super) fn caption_width(title: &str) -> usize {
    40 + 11 * title.chars().count()
}

/// Largest number of characters of a name.
pub(super) const LONGEST_NAME: usize = 32;
/// Height of a legend row, in pixels.
pub(super) const LEGEND_ROW: usize = 22;

/// Width of a legend entry with its colour, in pixels.
pub(super) fn legend_entry(name: &str) -> usize {
    44 + CHARACTER as usize * name.chars().count().min(LONGEST_NAME)
}

/// Splits the entries of a legend into rows of this width.
pub(super) fn legend_rows(names: &[(usize, String)], width: usize) -> Vec<Vec<&(usize, String)>> {
    let mut rows: Vec<Vec<_>> = Vec::new();
    let mut left = 0;
    for entry in names {
        let wide = legend_entry(&entry.1);
        match rows.last_mut() {
            Some(row) if wide <= left => row.push(entry),
            _ => {
                rows.push(vec![entry]);
                left = width.saturating_sub(32);
            }
        }
        left = left.saturating_sub(wide);
    }
    rows
}

/// Height of a legend of this width, in pixels.
pub(super) fn legend_height(names: &[(usize, String)], width: usize) -> usize {
    12 + LEGEND_ROW * legend_rows(names, width).len()
}

/// A label, shortened to fit the figure.
pub(super) fn elided(name: &str) -> String {
    let letters: Vec<char> = name.chars().collect();
    if letters.len() <= LONGEST_NAME {
        return name.to_owned();
    }
    letters[..LONGEST_NAME - 1].iter().chain(&['…']).collect()
}

/// Names with the index of their series, which determines the colour.
pub(super) fn numbered(names: &[String]) -> Vec<(usize, String)> {
    names.iter().cloned().enumerate().collect()
}

pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Draws an SVG of this size, in pixels, on a white background.
pub(super) fn svg(size: (u32, u32), draw: impl FnOnce(&Area) -> Drawn) -> Result<String> {
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        let drawn = area.fill(&WHITE).map_err(Into::into).and_then(|()| draw(&area));
        let drawn = drawn.and_then(|()| area.present().map_err(Into::into));
        drawn.map_err(|error| Error { reason: error.to_string() })?;
    }
    // XML allows no other control characters.
    text.retain(|letter| letter == '\n' || !letter.is_control());
    Ok(text)
}

pub(super) type Drawn = std::result::Result<(), Box<dyn std::error::Error>>;

/// Replaces the colours of an SVG by CSS variables for light and dark pages: `--plot-paper`, `--plot-ink`, and
/// `--plot-1`, `--plot-2`, … for the series.
pub fn themed(svg: &str) -> String {
    let hex = |colour: &RGBColor| format!("\"#{:02X}{:02X}{:02X}\"", colour.0, colour.1, colour.2);
    let mut text = svg.replace(&hex(&WHITE), "\"var(--plot-paper)\"");
    text = text.replace(&hex(&BLACK), "\"var(--plot-ink)\"");
    for (index, colour) in COLOURS.iter().enumerate() {
        text = text.replace(&hex(colour), &format!("\"var(--plot-{})\"", index + 1));
    }
    text
}

/// Whether a series is dashed because an earlier one has the same colour.
pub(super) fn is_dashed(index: usize) -> bool {
    index / COLOURS.len() % 2 == 1
}

/// The colour of a series.
pub(super) fn colour(index: usize) -> RGBColor {
    COLOURS[index % COLOURS.len()]
}

/// Formats a number for an axis.
pub(super) fn label(value: f64) -> String {
    let magnitude = value.abs();
    if value == 0.0 || (1e-3..1e5).contains(&magnitude) {
        let digits = match magnitude {
            _ if value.fract() == 0.0 => 0,
            100.0.. => 1,
            _ => 4,
        };
        let text = format!("{value:.digits$}");
        if text.contains('.') {
            return text.trim_end_matches('0').trim_end_matches('.').to_owned();
        }
        return text;
    }
    format!("{value:.1e}")
}

/// Draws the legend.
pub(super) fn legend(area: &Area, names: &[(usize, String)]) -> Drawn {
    let rows = legend_rows(names, area.dim_in_pixel().0 as usize);
    for (row, entries) in rows.iter().enumerate() {
        let (mut x, y) = (16, 6 + (LEGEND_ROW * row) as i32);
        for (index, name) in entries {
            let square = |from: i32, to: i32| [(x + from, y), (x + to, y + 14)];
            // Two halves for a dashed line.
            let parts = if is_dashed(*index) {
                vec![square(0, 5), square(9, 14)]
            } else {
                vec![square(0, 14)]
            };
            for part in parts {
                area.draw(&Rectangle::new(part, colour(*index).filled()))?;
            }
            area.draw(&Text::new(elided(name), (x + 20, y + 1), (FONT, TEXT)))?;
            x += legend_entry(name) as i32;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        for (value, text) in [
            (0.0, "0"),
            (0.25, "0.25"),
            (-3.0, "-3"),
            (0.0012, "0.0012"),
            (250.5, "250.5"),
            (3.1e-5, "3.1e-5"),
            (2e6, "2.0e6"),
        ] {
            assert_eq!(label(value), text);
        }
    }
}
