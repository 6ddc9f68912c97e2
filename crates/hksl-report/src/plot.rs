//! Figures as SVG text or PNG: curves, bars, intervals, heat maps and scatter plots in one style.

mod bars;
mod canvas;
mod curves;
mod error;
mod heat_map;
mod intervals;
mod raster;
mod scatter;

pub use bars::{BarPanel, bars};
pub use canvas::themed;
pub use curves::{Anchor, Curve, CurvePanel, CurvePoint, curve_grid, curves};
pub use error::{Error, Result};
pub use heat_map::heat_map;
pub use intervals::{IntervalPanel, intervals};
pub use raster::png;
pub use scatter::{ScatterGroup, scatter};

#[cfg(test)]
mod tests {
    use ndarray::array;

    use super::*;

    /// Draws every kind of figure with a name that XML must escape.
    #[test]
    fn every_picture_is_sound_and_shows_its_names() {
        let name = "a < b".to_owned();
        let point = |step| CurvePoint::new(step, 2.0 * step, 0.5);
        let curve = Curve { name: name.clone(), points: vec![point(0.0), point(10.0)] };
        let anchor = Anchor { name: "random".to_owned(), value: 3.0 };
        let panel = BarPanel {
            title: "none".to_owned(),
            values: vec![vec![Some((0.5, 0.1)), None], vec![Some((0.2, 0.3)), Some((0.0, 0.0))]],
        };
        let group = ScatterGroup { name: name.clone(), points: vec![(0.0, 1.0), (2.0, -1.0)] };
        let names = [name.clone(), "c".to_owned()];
        let estimates = vec![Some((0.5, 0.25, 0.75)), None];
        let estimates =
            IntervalPanel { title: name.clone(), estimates, scale: Some((0.0, 1.0, 0.5)) };
        let grid = CurvePanel { title: "walk".to_owned(), curves: vec![curve.clone()] };
        for svg in [
            curves("title", "steps", "return", &[curve], &[anchor]).unwrap(),
            curve_grid("title", "steps", "return", &[grid.clone(), grid], 2).unwrap(),
            intervals("title", "score", &names, &[estimates.clone(), estimates]).unwrap(),
            bars("title", "error", &names, &names, &[panel.clone(), panel]).unwrap(),
            scatter("title & more", (&name, "y"), &[group]).unwrap(),
            heat_map(&name, "step", array![[0.0, 1.0], [1.0, 0.0]].view()).unwrap(),
        ] {
            assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
            assert!(svg.contains("a &lt; b") && !svg.contains("a < b"));
            let picture = png(&svg, 1.0).unwrap();
            assert_eq!(picture[..8], *b"\x89PNG\r\n\x1a\n");
        }
    }

    #[test]
    fn nothing_to_draw_is_no_error() {
        curves("t", "x", "y", &[], &[]).unwrap();
        bars("t", "y", &[], &[], &[]).unwrap();
        scatter("t", ("x", "y"), &[]).unwrap();
        heat_map("t", "x", ndarray::Array2::zeros((0, 0)).view()).unwrap();
        intervals("t", "x", &[], &[]).unwrap();
        curve_grid("t", "x", "y", &[], 3).unwrap();
        let strange =
            Curve { name: "\u{1}long ".repeat(40), points: vec![CurvePoint::new(0.5, -1.0, 0.0)] };
        let svg = curves("t\u{7}", "x", "y", &vec![strange; 12], &[]).unwrap();
        assert!(svg.contains("long …") && png(&svg, 1.0).is_ok());
        let nan = CurvePoint::new(0.0, f64::NAN, 0.0);
        curves("t", "x", "y", &[Curve { name: "n".into(), points: vec![nan] }], &[]).unwrap();
    }
}
