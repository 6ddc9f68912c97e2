//! Rasterisation of figures.

use std::sync::{Arc, LazyLock};

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb};

use super::error::{Error, Result};

/// An embedded font, so that figures are identical on all machines, including those without fonts.
static FONTS: LazyLock<Arc<fontdb::Database>> = LazyLock::new(|| {
    let mut fonts = fontdb::Database::new();
    fonts.load_font_data(epaint_default_fonts::UBUNTU_LIGHT.to_vec());
    let family = fonts.faces().next().and_then(|face| face.families.first().cloned());
    if let Some((family, _)) = family {
        fonts.set_sans_serif_family(family);
    }
    Arc::new(fonts)
});

/// Converts an SVG of this module to PNG, with `scale` PNG pixels per SVG pixel.
///
/// ```
/// use hksl_report::plot::{Curve, CurvePoint, curves, png};
///
/// let points = vec![CurvePoint::new(0.0, 1.0, 0.0), CurvePoint::new(1.0, 2.0, 0.0)];
/// let svg = curves("returns", "step", "return", &[Curve { name: "hksl".into(), points }], &[])?;
/// assert!(png(&svg, 2.0)?.starts_with(b"\x89PNG"));
/// # Ok::<(), hksl_report::plot::Error>(())
/// ```
///
/// # Errors
/// [`Error`] for an invalid SVG or an image that is too large.
pub fn png(svg: &str, scale: f32) -> Result<Vec<u8>> {
    let refused = |reason: String| Error { reason };
    let options = Options { fontdb: Arc::clone(&FONTS), ..Options::default() };
    let tree = Tree::from_str(svg, &options).map_err(|error| refused(error.to_string()))?;
    let size = tree.size().to_int_size().scale_by(scale);
    let pixels = size.and_then(|size| Pixmap::new(size.width(), size.height()));
    let mut pixels = pixels
        .ok_or_else(|| refused(format!("an image {scale} times as large is not possible")))?;
    resvg::render(&tree, Transform::from_scale(scale, scale), &mut pixels.as_mut());
    pixels.encode_png().map_err(|error| refused(error.to_string()))
}
