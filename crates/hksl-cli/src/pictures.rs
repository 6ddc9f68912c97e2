//! Pictures as files: PNG and animated GIF.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use gif::{Encoder, Frame, Repeat};
use ndarray::ArrayView3;

/// The longer side of an animation is at least this; pixels.
pub const LONG_SIDE: usize = 252;
/// Hundredths of a second between two pictures.
const DELAY: u16 = 4;

/// Writes a picture `(C, H, W)`, in colour or in grey.
pub fn write_png(path: &Path, picture: ArrayView3<u8>) -> io::Result<()> {
    let (_, height, width) = picture.dim();
    let file = BufWriter::new(File::create(path)?);
    let mut encoder = png::Encoder::new(file, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    let mut writer = encoder.write_header()?;
    Ok(writer.write_image_data(&interleaved(picture, 1))?)
}

/// How many times a picture of this size is magnified so that people can see it.
pub fn magnification(height: usize, width: usize) -> usize {
    LONG_SIDE.div_ceil(height.max(width).max(1)).max(1)
}

/// An animated GIF that repeats for ever; the file is made with its first picture.
pub struct Animation {
    path: PathBuf,
    encoder: Option<Encoder<BufWriter<File>>>,
}

impl Animation {
    /// An animation that will be in this file.
    pub fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), encoder: None }
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Adds a picture `(C, H, W)`, each of its pixels a square.
    pub fn add(&mut self, picture: ArrayView3<u8>) -> io::Result<()> {
        let (_, height, width) = picture.dim();
        let scale = magnification(height, width);
        let side = |side: usize| {
            u16::try_from(side * scale)
                .map_err(|_| io::Error::other(format!("{side} pixels are too many for a GIF")))
        };
        let (rows, columns) = (side(height)?, side(width)?);
        let encoder = match &mut self.encoder {
            Some(encoder) => encoder,
            empty => {
                let file = BufWriter::new(File::create(&self.path)?);
                let mut fresh = Encoder::new(file, columns, rows, &[]).map_err(io::Error::other)?;
                fresh.set_repeat(Repeat::Infinite).map_err(io::Error::other)?;
                empty.insert(fresh)
            }
        };
        let mut frame = Frame::from_rgb_speed(columns, rows, &interleaved(picture, scale), 10);
        frame.delay = DELAY;
        encoder.write_frame(&frame).map_err(io::Error::other)
    }
}

/// Red, green and blue of each pixel, row by row, each pixel a square of `scale`.
fn interleaved(picture: ArrayView3<u8>, scale: usize) -> Cow<'static, [u8]> {
    let (channels, height, width) = picture.dim();
    let mut pixels = Vec::with_capacity(3 * height * width * scale * scale);
    for row in (0..height).flat_map(|row| std::iter::repeat_n(row, scale)) {
        for column in (0..width).flat_map(|column| std::iter::repeat_n(column, scale)) {
            let channel = |channel: usize| picture[(channel.min(channels - 1), row, column)];
            pixels.extend([channel(0), channel(1), channel(2)]);
        }
    }
    pixels.into()
}
