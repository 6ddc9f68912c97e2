//! TensorBoard event files.
//!
//! An event file is a sequence of [records](record), each with one [event]: a time, a step and
//! named values. The first event contains the format version, `brain.Event:2`.

mod event;
mod record;

use std::fs::{File, OpenOptions};
use std::io::{BufReader, ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::{Error, Result};

pub use event::{Colorspace, Picture, Value};

/// An open event file.
///
/// TensorBoard follows a growing file by byte offset. If it has read past the length to which
/// [`EventFile::open`] truncates the file, it keeps showing the removed part, and may miss later
/// events, until it is restarted.
#[derive(Debug)]
pub struct EventFile {
    path: PathBuf,
    file: File,
    length: u64,
}

impl EventFile {
    /// Opens the file and truncates it to `length` bytes, its length at the checkpoint.
    ///
    /// With a `length` of 0, creates the file, and its folder if necessary, or empties it, and
    /// writes the first event at `wall_time`, in seconds since 1970.
    ///
    /// # Errors
    /// A file that cannot be opened or read. A file that is missing, shorter than `length`, or
    /// whose first `length` bytes are not complete records; it is not modified.
    pub fn open(path: &Path, length: u64, wall_time: f64) -> Result<Self> {
        let file = if length == 0 { create(path)? } else { open_written(path, length)? };
        let mut events = Self { path: path.to_owned(), file, length };
        events.cut().map_err(|source| Error::write(path, source))?;
        if length == 0 {
            events.append(&event::version(wall_time))?;
        }
        Ok(events)
    }

    /// Length of the file in bytes.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Appends one event with all `values`. Writes nothing if there are none.
    ///
    /// `wall_time` is in seconds since 1970. All values of a tag must be of one kind, because
    /// TensorBoard uses the kind of the first.
    ///
    /// # Errors
    /// A file that cannot be written. A partially written event is removed if possible.
    pub fn write<'a>(
        &mut self,
        wall_time: f64,
        step: i64,
        values: impl IntoIterator<Item = Value<'a>>,
    ) -> Result<()> {
        match event::summary(wall_time, step, values) {
            Some(data) => self.append(&data),
            None => Ok(()),
        }
    }

    /// Syncs the file to disk.
    pub fn sync(&self) -> Result<()> {
        self.file.sync_data().map_err(|source| Error::write(&self.path, source))
    }

    fn append(&mut self, data: &[u8]) -> Result<()> {
        let record = record::framed(data);
        if let Err(source) = self.file.write_all(&record) {
            // An incomplete record would hide all later ones. If removing it fails too, the first
            // error matters.
            let _ = self.cut();
            return Err(Error::write(&self.path, source));
        }
        self.length += record.len() as u64;
        Ok(())
    }

    /// Truncates the file to `length` bytes and seeks to its end.
    fn cut(&mut self) -> std::io::Result<()> {
        self.file.set_len(self.length)?;
        self.file.seek(SeekFrom::Start(self.length)).map(drop)
    }
}

fn create(path: &Path) -> Result<File> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(|source| Error::write(folder, source))?;
    }
    let opened = OpenOptions::new().write(true).create(true).truncate(false).open(path);
    opened.map_err(|source| Error::write(path, source))
}

/// Opens a file and checks that its first `length` bytes are complete records.
fn open_written(path: &Path, length: u64) -> Result<File> {
    let shorter = |found: u64, note: &str| {
        let reason = format!("{found} bytes long{note}, but its checkpoint records {length}");
        Error::damaged(path, reason)
    };
    let file = match OpenOptions::new().read(true).write(true).open(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Err(shorter(0, " (missing)")),
        opened => opened.map_err(|source| Error::write(path, source))?,
    };
    let found = file.metadata().map_err(|source| Error::read(path, source))?.len();
    if found < length {
        return Err(shorter(found, ""));
    }
    match record::check(&mut BufReader::new(&file), length) {
        Ok(None) => Ok(file),
        Ok(Some(fault)) => Err(Error::damaged(path, fault)),
        Err(source) => Err(Error::read(path, source)),
    }
}

#[cfg(test)]
mod tests {
    use hksl_files::EVENTS_NAME;

    use super::*;

    #[test]
    fn a_failed_write_counts_for_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(EVENTS_NAME);
        let mut events = EventFile::open(&path, 0, 0.0).unwrap();
        let length = events.length();
        events.file = File::open(&path).unwrap();
        let error = events.write(0.0, 1, [Value::Scalar { tag: "a", value: 1.0 }]).unwrap_err();
        assert!(
            matches!(&error, Error::Files(hksl_files::Error::Write { path: named, .. }) if *named == path),
            "{error}"
        );
        assert_eq!(events.length(), length);
        assert_eq!(std::fs::metadata(&path).unwrap().len(), length);
    }
}
