//! `metrics.jsonl`: one JSON object a line.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;

use hksl_files::damaged;

use crate::{Error, Result};

/// An open `metrics.jsonl`.
#[derive(Debug)]
pub struct MetricsFile {
    path: PathBuf,
    file: File,
    length: u64,
}

#[derive(Serialize)]
struct Line<'a> {
    agent_step: u64,
    environment_step: u64,
    #[serde(flatten)]
    values: &'a BTreeMap<String, f64>,
}

impl MetricsFile {
    /// Opens the file and truncates it to its first `length` bytes, as recorded by a checkpoint. A damaged file is moved
    /// aside with a warning, and a new one is started, so that the run can continue.
    ///
    /// # Errors
    /// A file that cannot be read or written.
    pub fn open(path: &Path, length: u64) -> Result<Self> {
        let Opened { file, length, .. } = open_at(path, length)?;
        Ok(Self { path: path.to_owned(), file, length })
    }

    /// Bytes written so far.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Appends one line: the two step counts first, then the values in their names' order. A number that is
    /// not finite becomes `null`, which JSON has in its place.
    pub fn write(
        &mut self,
        agent_step: u64,
        environment_step: u64,
        values: &BTreeMap<String, f64>,
    ) -> Result<()> {
        let line = Line { agent_step, environment_step, values };
        let mut text = serde_json::to_string(&line)
            .map_err(|error| Error::write(&self.path, std::io::Error::other(error)))?;
        text.push('\n');
        let written = self.file.write_all(text.as_bytes()).and_then(|()| self.file.flush());
        written.map_err(|source| Error::write(&self.path, source))?;
        self.length += text.len() as u64;
        Ok(())
    }

    /// Waits until everything is on the disk.
    pub fn sync(&self) -> Result<()> {
        self.file.sync_data().map_err(|source| Error::write(&self.path, source))
    }
}

/// A growing file of lines.
pub(super) struct Opened {
    /// To be written at its end.
    pub file: File,
    /// Bytes that it has.
    pub length: u64,
    /// Where what was there is, if it did not have the bytes that it should.
    pub aside: Option<PathBuf>,
}

/// Opens a file of lines to append after its first `length` bytes and truncates the rest. A shorter or modified file
/// is moved aside and a new one is started.
pub(super) fn open_at(path: &Path, mut length: u64) -> Result<Opened> {
    let wrap = |source| Error::write(path, source);
    let mut aside = None;
    if let Some(fault) = fault(path, length)? {
        length = 0;
        let folder = path.parent().unwrap_or(Path::new(""));
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let free = damaged(folder, &name);
        let kept = match std::fs::rename(path, &free) {
            Ok(()) => {
                let kept = format!("; the old file was moved to {}", free.display());
                aside = Some(free);
                kept
            }
            Err(error) if error.kind() == ErrorKind::NotFound => String::new(),
            Err(error) => return Err(wrap(error)),
        };
        tracing::warn!("starting a new {}: {fault}{kept}", path.display());
    }
    let mut file =
        OpenOptions::new().write(true).create(true).truncate(false).open(path).map_err(wrap)?;
    file.set_len(length).map_err(wrap)?;
    file.seek(SeekFrom::End(0)).map_err(wrap)?;
    Ok(Opened { file, length, aside })
}

/// The reason why a file does not begin with the `length` bytes of lines that the checkpoint records, if so.
fn fault(path: &Path, length: u64) -> Result<Option<&'static str>> {
    if length == 0 {
        return Ok(None);
    }
    let bytes = match std::fs::read(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            return Ok(Some("the file is missing"));
        }
        read => read.map_err(|source| Error::read(path, source))?,
    };
    let Some(lines) = bytes.get(..length as usize) else {
        return Ok(Some("the file is shorter than at the last save"));
    };
    // Another program may have rewritten the file with other line endings.
    let same_lines = lines.ends_with(b"\n") && !lines.contains(&b'\r');
    Ok((!same_lines).then_some("the file was modified by another program"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reopened_file_forgets_what_no_checkpoint_vouches_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.jsonl");
        let mut metrics = MetricsFile::open(&path, 0).unwrap();
        metrics.write(1, 8, &BTreeMap::from([("b".into(), 0.1), ("a".into(), f64::NAN)])).unwrap();
        let length = metrics.length();
        metrics.write(2, 16, &BTreeMap::new()).unwrap();
        let mut metrics = MetricsFile::open(&path, length).unwrap();
        metrics.write(3, 24, &BTreeMap::new()).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let expected = "{\"agent_step\":1,\"environment_step\":8,\"a\":null,\"b\":0.1}\n\
                        {\"agent_step\":3,\"environment_step\":24}\n";
        assert_eq!(text, expected);
    }

    #[test]
    fn a_file_that_was_changed_is_put_aside_and_begun_anew() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.jsonl");
        let mut metrics = MetricsFile::open(&path, 0).unwrap();
        metrics.write(1, 8, &BTreeMap::new()).unwrap();
        let (line, length) = (std::fs::read_to_string(&path).unwrap(), metrics.length());
        let changed = [line[1..].to_owned(), line.replace('\n', "\r\n"), format!("{line} ")];
        for (index, text) in changed.iter().enumerate() {
            std::fs::write(&path, text).unwrap();
            // The last one is whole, with something behind it.
            let kept = index == 2;
            let metrics = MetricsFile::open(&path, length).unwrap();
            assert_eq!(metrics.length(), if kept { length } else { 0 });
            assert_eq!(std::fs::read_to_string(&path).unwrap(), if kept { &line } else { "" });
        }
        for (name, text) in [("damaged-metrics.jsonl", 0), ("damaged-metrics.jsonl-2", 1)] {
            assert_eq!(std::fs::read_to_string(folder.path().join(name)).unwrap(), changed[text]);
        }
        std::fs::remove_file(&path).unwrap();
        assert_eq!(MetricsFile::open(&path, length).unwrap().length(), 0);
    }
}
