//! `checkpoint.json`: what a checkpoint is, and what each of its files must be.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde::{Deserialize, Serialize};

use hksl_files::{Error, FileRecord, Result, digest};

use super::retention::Reason;
/// Raised whenever files of an older program can no longer be read.
pub(super) const FORMAT_VERSION: u32 = 2;

/// What `checkpoint.json` says.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Summary {
    /// Agent steps learnt from.
    pub agent_step: u64,
    /// Environment steps learnt from.
    pub environment_step: u64,
    /// Why its weights are kept; none for a state that only serves a resume.
    pub reasons: BTreeSet<Reason>,
    /// The files next to `checkpoint.json`, by relative path.
    pub files: BTreeMap<String, FileRecord>,
    /// The finished episodes in the state's replay, by number.
    pub episodes: BTreeMap<u64, FileRecord>,
}

/// The file around it.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Sealed {
    format_version: u32,
    /// Of `checkpoint`, written as JSON without spaces.
    sha256: String,
    checkpoint: Summary,
}

/// The one part that every version has.
#[derive(Deserialize)]
struct Version {
    format_version: u32,
}

impl Summary {
    /// As a file.
    pub(super) fn to_bytes(&self, path: &Path) -> Result<Vec<u8>> {
        let (format_version, checkpoint) = (FORMAT_VERSION, self.clone());
        let sealed = Sealed { format_version, sha256: self.seal(path)?, checkpoint };
        hksl_files::to_json(path, &sealed)
    }

    /// What these bytes, the file `path`'s, say.
    ///
    /// # Errors
    /// [`hksl_files::Error::Damaged`] for a file of another program or version.
    pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<Self> {
        let Version { format_version: found } = hksl_files::from_json(path, bytes)?;
        if found != FORMAT_VERSION {
            let reason = format!(
                "it has format version {found}, but this program reads version {FORMAT_VERSION}"
            );
            return Err(Error::damaged(path, reason));
        }
        let Sealed { sha256, checkpoint, .. } = hksl_files::from_json(path, bytes)?;
        let expected = checkpoint.seal(path)?;
        if sha256 != expected {
            let reason = format!("its SHA-256 is {expected}, but it records {sha256}");
            return Err(Error::damaged(path, reason));
        }
        Ok(checkpoint)
    }

    fn seal(&self, path: &Path) -> Result<String> {
        let text = serde_json::to_vec(self)
            .map_err(|error| Error::write(path, std::io::Error::other(error)))?;
        Ok(digest::sha256(&text))
    }

    /// The bytes of one of its files in `folder`, as they were written.
    pub(super) fn read(&self, folder: &Path, name: &str) -> Result<Vec<u8>> {
        let path = folder.join(name);
        let unknown = || Error::damaged(&path, "checkpoint.json does not list it");
        self.files.get(name).ok_or_else(unknown)?.read(&path)
    }
}
