//! FrameWriter as files: PNG and animated GIF.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use gif::{Encoder, Frame, Repeat};
use ndarray::{Array3, ArrayView3, Axis, concatenate};

/// The longer side of an animation is at least this; pixels.
pub const LONG_SIDE: usize = 252;
/// Milliseconds between two frames where a task has no time of its own.
const MILLISECONDS: u32 = 40;
/// Shortest frame time in milliseconds; browsers slow down shorter ones.
const SHORTEST: u64 = 20;

/// Writes a frame `(C, H, W)` in colour or grey, with at least one channel.
///
/// # Errors
/// A file that cannot be written.
pub fn write_png(path: &Path, picture: ArrayView3<u8>) -> io::Result<()> {
    encode_png(BufWriter::new(File::create(path)?), picture)
}

/// Encodes a frame `(C, H, W)` as PNG.
///
/// # Errors
/// A frame without pixels.
pub fn png_bytes(picture: ArrayView3<u8>) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    encode_png(&mut bytes, picture)?;
    Ok(bytes)
}

fn encode_png(target: impl io::Write, picture: ArrayView3<u8>) -> io::Result<()> {
    let (_, height, width) = picture.dim();
    let mut encoder = png::Encoder::new(target, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    let mut writer = encoder.write_header()?;
    Ok(writer.write_image_data(&interleaved(picture, 1))?)
}

/// Factor by which a frame of this size is magnified for display.
pub fn magnification(height: usize, width: usize) -> usize {
    LONG_SIDE.div_ceil(height.max(width).max(1)).max(1)
}

/// `count` of these equally sized frames `(C, H, W)`, evenly spaced from the first to the last, side by side.
pub fn strip(pictures: &[Array3<u8>], count: usize) -> Option<Array3<u8>> {
    let last = pictures.len().checked_sub(1)?;
    let count = count.clamp(1, pictures.len());
    let chosen: Vec<_> =
        (0..count).map(|i| pictures[i * last / (count - 1).max(1)].view()).collect();
    concatenate(Axis(2), &chosen).ok()
}

/// A looping animated GIF; the file is created with its first frame.
pub struct Animation {
    path: PathBuf,
    encoder: Option<Encoder<BufWriter<File>>>,
    milliseconds: u64,
    added: u64,
}

impl Animation {
    /// An animation for this file, with this many milliseconds per frame; none for a task without a time unit. Frames
    /// that are too fast to display are dropped, so that the animation runs in real time.
    pub fn new(path: &Path, milliseconds: Option<u32>) -> Self {
        let milliseconds = u64::from(milliseconds.unwrap_or(MILLISECONDS).max(1));
        Self { path: path.to_owned(), encoder: None, milliseconds, added: 0 }
    }

    /// Hundredths of a second for which the next frame is shown, if it is.
    fn next_delay(&mut self) -> Option<u16> {
        let (index, shown) = (self.added, SHORTEST.div_ceil(self.milliseconds).max(1));
        self.added += 1;
        // A format of whole hundredths: what one frame loses the next gains.
        let hundredths = |index: u64| (index * self.milliseconds + 5) / 10;
        let delay = hundredths(index + shown) - hundredths(index);
        index.is_multiple_of(shown).then(|| u16::try_from(delay).unwrap_or(u16::MAX))
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Adds a frame `(C, H, W)`, magnified.
    ///
    /// # Errors
    /// A file that cannot be written, or a frame that is too large.
    pub fn add(&mut self, picture: ArrayView3<u8>) -> io::Result<()> {
        let Some(delay) = self.next_delay() else { return Ok(()) };
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
        frame.delay = delay;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn animations_take_the_tasks_time() {
        let delays = |milliseconds: Option<u32>| -> Vec<Option<u16>> {
            let mut animation = Animation::new(Path::new(""), milliseconds);
            (0..6).map(|_| animation.next_delay()).collect()
        };
        assert_eq!(delays(None), [Some(4); 6]);
        assert_eq!(delays(Some(80)), [Some(8); 6]);
        // 25 ms are 2.5 hundredths; 10 ms are too short.
        assert_eq!(delays(Some(25)), [3, 2, 3, 2, 3, 2].map(Some));
        assert_eq!(delays(Some(10)), [Some(2), None, Some(2), None, Some(2), None]);
    }

    #[test]
    fn strips_are_evenly_spread() {
        let pictures: Vec<_> = (0..9u8).map(|i| Array3::from_elem((1, 1, 2), i)).collect();
        let strip = |count: usize| strip(&pictures, count).unwrap().into_raw_vec_and_offset().0;
        assert_eq!(strip(3), [0, 0, 4, 4, 8, 8]);
        assert_eq!(strip(1), [0, 0]);
        assert_eq!(strip(50).len(), 18);
        assert!(super::strip(&[], 3).is_none());
    }

    #[test]
    fn a_png_is_read_back() {
        let picture = Array3::from_shape_fn((3, 2, 4), |(c, h, w)| (c * 50 + h * 10 + w) as u8);
        let bytes = png_bytes(picture.view()).unwrap();
        let mut reader = png::Decoder::new(io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height), (4, 2));
        assert_eq!(&pixels[..6], [0, 50, 100, 1, 51, 101]);
    }
}
