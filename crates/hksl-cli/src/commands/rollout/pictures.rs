//! Pictures of a rollout, as files.

use std::borrow::Cow;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use gif::{Encoder, Frame, Repeat};
use hksl_train::{Error, Result};
use ndarray::ArrayView3;

/// The longer side of an animation is at least this; pixels.
const LONG_SIDE: usize = 252;
/// Hundredths of a second between two pictures.
const DELAY: u16 = 4;

/// Where pictures go as they come.
pub struct Pictures {
    folder: Option<PathBuf>,
    animation: Option<(PathBuf, Option<Encoder<BufWriter<File>>>)>,
}

impl Pictures {
    /// Makes the folder, which must not hold anything yet, and the file, which must not be there.
    pub fn create(folder: Option<&Path>, animation: Option<&Path>) -> anyhow::Result<Self> {
        if let Some(folder) = folder {
            fs::create_dir_all(folder)
                .with_context(|| format!("{} cannot be made", folder.display()))?;
            if fs::read_dir(folder)?.next().is_some() {
                bail!("{} is not empty; name a new folder", folder.display());
            }
        }
        if let Some(file) = animation.filter(|file| file.exists()) {
            bail!("{} is there already; name another file", file.display());
        }
        Ok(Self {
            folder: folder.map(Path::to_owned),
            animation: animation.map(|file| (file.to_owned(), None)),
        })
    }

    /// Whether none are asked for.
    pub fn is_empty(&self) -> bool {
        self.folder.is_none() && self.animation.is_none()
    }

    /// Adds a picture `(C, H, W)`, in colour or in grey.
    pub fn add(&mut self, step: usize, picture: ArrayView3<u8>) -> Result<()> {
        if let Some(folder) = &self.folder {
            let file = folder.join(format!("{step:06}.png"));
            write_png(&file, picture).map_err(|source| written(&file, source))?;
        }
        if let Some((file, encoder)) = &mut self.animation {
            add_frame(file, encoder, picture).map_err(|source| written(file, source))?;
        }
        Ok(())
    }
}

fn written(path: &Path, source: std::io::Error) -> Error {
    Error::Write { path: path.to_owned(), source }
}

fn write_png(path: &Path, picture: ArrayView3<u8>) -> std::io::Result<()> {
    let (_, height, width) = picture.dim();
    let file = BufWriter::new(File::create(path)?);
    let mut encoder = png::Encoder::new(file, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    let mut writer = encoder.write_header()?;
    Ok(writer.write_image_data(&interleaved(picture, 1))?)
}

fn add_frame(
    path: &Path,
    encoder: &mut Option<Encoder<BufWriter<File>>>,
    picture: ArrayView3<u8>,
) -> std::io::Result<()> {
    let (_, height, width) = picture.dim();
    let scale = LONG_SIDE.div_ceil(height.max(width)).max(1);
    let side = |side: usize| {
        u16::try_from(side * scale)
            .map_err(|_| std::io::Error::other(format!("{side} pixels are too many for a GIF")))
    };
    let (rows, columns) = (side(height)?, side(width)?);
    let encoder = match encoder {
        Some(encoder) => encoder,
        empty => {
            let file = BufWriter::new(File::create(path)?);
            let mut fresh =
                Encoder::new(file, columns, rows, &[]).map_err(std::io::Error::other)?;
            fresh.set_repeat(Repeat::Infinite).map_err(std::io::Error::other)?;
            empty.insert(fresh)
        }
    };
    let mut frame = Frame::from_rgb_speed(columns, rows, &interleaved(picture, scale), 10);
    frame.delay = DELAY;
    encoder.write_frame(&frame).map_err(std::io::Error::other)
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
    use ndarray::Array3;

    use super::*;

    #[test]
    fn pictures_are_written_whole_and_nothing_is_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let (frames, gif) = (folder.path().join("frames"), folder.path().join("play.gif"));
        let mut pictures = Pictures::create(Some(&frames), Some(&gif)).unwrap();
        for step in [0, 4] {
            let grey = Array3::from_elem((1, 35, 15), 10 * step as u8 + 1);
            pictures.add(step, grey.view()).unwrap();
        }
        drop(pictures);
        let mut decoder = gif::DecodeOptions::new().read_info(File::open(&gif).unwrap()).unwrap();
        assert_eq!((decoder.width(), decoder.height()), (15 * 8, 35 * 8));
        let mut count = 0;
        while decoder.read_next_frame().unwrap().is_some() {
            count += 1;
        }
        assert_eq!(count, 2);
        assert!(frames.join("000000.png").is_file() && frames.join("000004.png").is_file());
        assert!(Pictures::create(Some(&frames), None).is_err());
        assert!(Pictures::create(None, Some(&gif)).is_err());
    }
}
