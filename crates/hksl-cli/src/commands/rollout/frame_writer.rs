//! Frames of a rollout, as PNG files and as an animation.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use hksl_train::{Error, Result};
use ndarray::ArrayView3;

use hksl_train::images::{Animation, write_png};

use crate::output::check_new_gif;

/// Writer of the frames.
pub struct FrameWriter {
    folder: Option<PathBuf>,
    animation: Option<Animation>,
    last: Option<usize>,
}

impl FrameWriter {
    /// Creates the folder, which must be new or empty, and the animation, which must be a new file with this many
    /// milliseconds per frame.
    pub fn create(
        folder: Option<&Path>,
        animation: Option<&Path>,
        milliseconds: Option<u32>,
    ) -> anyhow::Result<Self> {
        animation.map_or(Ok(()), |animation| check_new_gif(animation, "--gif"))?;
        if let Some(folder) = folder {
            fs::create_dir_all(folder)
                .with_context(|| format!("cannot create {}", folder.display()))?;
            if fs::read_dir(folder)?.next().is_some() {
                bail!(
                    "{} is not empty; choose a new or empty folder with --frames",
                    folder.display()
                );
            }
        }
        let animation = animation.map(|path| Animation::new(path, milliseconds));
        Ok(Self { folder: folder.map(Path::to_owned), animation, last: None })
    }

    /// Whether no frames are written.
    pub fn is_empty(&self) -> bool {
        self.folder.is_none() && self.animation.is_none()
    }

    /// Adds a frame `(C, H, W)`, in colour or grey. A second frame of the same step begins an episode.
    pub fn add(&mut self, step: usize, frame: ArrayView3<u8>) -> Result<()> {
        if let Some(folder) = &self.folder {
            let reset = if self.last == Some(step) { "_reset" } else { "" };
            let file = folder.join(format!("{step:06}{reset}.png"));
            write_png(&file, frame).map_err(|source| written(&file, source))?;
        }
        if let Some(animation) = &mut self.animation {
            animation.add(frame).map_err(|source| written(animation.path(), source))?;
        }
        self.last = Some(step);
        Ok(())
    }
}

fn written(path: &Path, source: std::io::Error) -> Error {
    hksl_files::Error::write(path, source).into()
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use ndarray::Array3;

    use super::*;

    #[test]
    fn frames_are_written_whole_and_nothing_is_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let (frames, gif) = (folder.path().join("frames"), folder.path().join("play.gif"));
        let mut writer = FrameWriter::create(Some(&frames), Some(&gif), None).unwrap();
        for step in [0, 4, 4] {
            let grey = Array3::from_elem((1, 35, 15), 10 * step as u8 + 1);
            writer.add(step, grey.view()).unwrap();
        }
        drop(writer);
        let mut decoder = gif::DecodeOptions::new().read_info(File::open(&gif).unwrap()).unwrap();
        assert_eq!((decoder.width(), decoder.height()), (15 * 8, 35 * 8));
        let mut count = 0;
        while decoder.read_next_frame().unwrap().is_some() {
            count += 1;
        }
        assert_eq!(count, 3);
        for name in ["000000.png", "000004.png", "000004_reset.png"] {
            assert!(frames.join(name).is_file(), "no {name}");
        }
        assert!(FrameWriter::create(Some(&frames), None, None).is_err());
        assert!(FrameWriter::create(None, Some(&gif), None).is_err());
    }
}
