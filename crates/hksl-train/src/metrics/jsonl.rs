//! `metrics.jsonl`: one JSON object a line.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;

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
    /// Opens the file and cuts it to its first `length` bytes, those that a checkpoint vouches for.
    ///
    /// # Errors
    /// A file that cannot be opened, or is shorter.
    pub fn open(path: &Path, length: u64) -> Result<Self> {
        let file = open_at(path, length)?;
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

/// Opens a growing file for writing after its first `length` bytes; what is behind them is cut off.
pub(super) fn open_at(path: &Path, length: u64) -> Result<File> {
    let wrap = |source| Error::write(path, source);
    let mut file =
        OpenOptions::new().write(true).create(true).truncate(false).open(path).map_err(wrap)?;
    let found = file.metadata().map_err(wrap)?.len();
    if found < length {
        let reason = format!("{found} bytes long, but its checkpoint vouches for {length}");
        return Err(Error::Damaged { path: path.to_owned(), reason });
    }
    file.set_len(length).map_err(wrap)?;
    file.seek(SeekFrom::End(0)).map_err(wrap)?;
    Ok(file)
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
        assert!(matches!(MetricsFile::open(&path, 1000), Err(Error::Damaged { .. })));
    }
}
