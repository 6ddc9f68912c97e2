//! Pictures of numbers, as SVG text: curves, bars, heat maps and scatters in one look.

mod bars;
mod curves;
mod heat_map;
mod scatter;

use plotters::backend::SVGBackend;
use plotters::coord::Shift;
use plotters::prelude::*;

pub use bars::{BarPanel, bars};
pub use curves::{Anchor, Curve, CurvePoint, curves};
pub use heat_map::heat_map;
pub use scatter::{ScatterGroup, scatter};

use crate::{Error, Result};

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
const FONT: &str = "sans-serif";
/// Of captions, and of everything else; pixels.
const CAPTION: u32 = 20;
const TEXT: u32 = 14;
/// About how wide a character of [`TEXT`] is; pixels.
const CHARACTER: i32 = 8;

/// Pixels that a picture must be wide for this caption.
fn caption_width(title: &str) -> usize {
    40 + 11 * title.chars().count()
}

/// Pixels that a picture must be wide for this legend.
fn legend_width(names: &[String]) -> usize {
    names.iter().map(|name| 44 + CHARACTER as usize * name.chars().count()).sum::<usize>() + 32
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// An SVG of this size, in pixels, on white.
fn svg(size: (u32, u32), draw: impl FnOnce(&Area) -> Drawn) -> Result<String> {
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        let drawn = area.fill(&WHITE).map_err(Into::into).and_then(|()| draw(&area));
        let drawn = drawn.and_then(|()| area.present().map_err(Into::into));
        drawn.map_err(|error| Error::Plot { reason: error.to_string() })?;
    }
    Ok(text)
}

type Drawn = std::result::Result<(), Box<dyn std::error::Error>>;

/// The colour of a series.
fn colour(index: usize) -> RGBColor {
    COLOURS[index % COLOURS.len()]
}

/// A number beside an axis: short, whatever its size.
fn label(value: f64) -> String {
    let magnitude = value.abs();
    if value == 0.0 || (1e-3..1e5).contains(&magnitude) {
        let digits = if magnitude >= 100.0 || value.fract() == 0.0 { 0 } else { 4 };
        let text = format!("{value:.digits$}");
        if text.contains('.') {
            return text.trim_end_matches('0').trim_end_matches('.').to_owned();
        }
        return text;
    }
    format!("{value:.1e}")
}

/// A row of names with their colours.
fn legend(area: &Area, names: &[String]) -> Drawn {
    let mut x = 16;
    for (index, name) in names.iter().enumerate() {
        area.draw(&Rectangle::new([(x, 6), (x + 14, 20)], colour(index).filled()))?;
        area.draw(&Text::new(name.clone(), (x + 20, 7), (FONT, TEXT)))?;
        x += 44 + CHARACTER * name.chars().count() as i32;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use ndarray::array;

    use super::*;

    #[test]
    fn numbers_are_short() {
        for (value, text) in [
            (0.0, "0"),
            (0.25, "0.25"),
            (-3.0, "-3"),
            (0.0012, "0.0012"),
            (250.5, "250"),
            (3.1e-5, "3.1e-5"),
            (2e6, "2.0e6"),
        ] {
            assert_eq!(label(value), text);
        }
    }

    /// Every picture with a name that XML must not see as it is.
    #[test]
    fn every_picture_is_sound_and_shows_its_names() {
        let name = "a < b".to_owned();
        let point = |step| CurvePoint { step, value: 2.0 * step, deviation: 0.5 };
        let curve = Curve { name: name.clone(), points: vec![point(0.0), point(10.0)] };
        let anchor = Anchor { name: "random".to_owned(), value: 3.0 };
        let panel = BarPanel {
            title: "none".to_owned(),
            values: vec![vec![Some((0.5, 0.1)), None], vec![Some((0.2, 0.3)), Some((0.0, 0.0))]],
        };
        let group = ScatterGroup { name: name.clone(), points: vec![(0.0, 1.0), (2.0, -1.0)] };
        let names = [name.clone(), "c".to_owned()];
        for svg in [
            curves("title", "steps", "return", &[curve], &[anchor]).unwrap(),
            bars("title", "error", &names, &names, &[panel.clone(), panel]).unwrap(),
            scatter("title & more", (&name, "y"), &[group]).unwrap(),
            heat_map(&name, "step", array![[0.0, 1.0], [1.0, 0.0]].view()).unwrap(),
        ] {
            assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
            assert!(svg.contains("a &lt; b") && !svg.contains("a < b"));
        }
    }

    #[test]
    fn nothing_to_draw_is_no_error() {
        curves("t", "x", "y", &[], &[]).unwrap();
        bars("t", "y", &[], &[], &[]).unwrap();
        scatter("t", ("x", "y"), &[]).unwrap();
        heat_map("t", "x", ndarray::Array2::zeros((0, 0)).view()).unwrap();
        let nan = CurvePoint { step: 0.0, value: f64::NAN, deviation: 0.0 };
        curves("t", "x", "y", &[Curve { name: "n".into(), points: vec![nan] }], &[]).unwrap();
    }
}
