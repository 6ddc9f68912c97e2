//! Cache of collected episodes. Collecting takes most of the time of an analysis.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use hksl_files::Files;
use hksl_files::digest::{Sha256, sha256};
use ndarray::{Array2, Array4};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde_json::Value;

use crate::episodes::Episode;
use crate::{Error, Result};

/// A directory of data sets. Each file is named by the SHA-256 of the data set's description.
#[derive(Debug, Clone)]
pub struct Cache {
    folder: PathBuf,
}

impl Cache {
    /// Creates a cache in this directory. The directory is created with the first data set.
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned() }
    }

    /// The path of the data set with this description.
    ///
    /// The description must contain everything that the data set depends on.
    pub fn file(&self, description: &Value) -> PathBuf {
        self.folder.join(format!("episodes-{}.safetensors", &Self::key(description)[..24]))
    }

    /// Fingerprint of episodes: the SHA-256 of their content in hexadecimal, independent of where they were collected.
    pub fn fingerprint(episodes: &[Episode]) -> String {
        let mut sha = Sha256::default();
        for (index, episode) in episodes.iter().enumerate() {
            for (name, _, shape, bytes) in write(index, episode) {
                sha.update(format!("{name} {shape:?}"));
                sha.update(bytes);
            }
        }
        sha.finish()
    }

    /// The SHA-256 of a description in hexadecimal.
    fn key(description: &Value) -> String {
        sha256(description.to_string())
    }

    /// Loads the data set with this description. Returns None if it is missing or damaged.
    pub fn load(&self, description: &Value) -> Option<Vec<Episode>> {
        let bytes = fs::read(self.file(description)).ok()?;
        let (_, metadata) = SafeTensors::read_metadata(&bytes).ok()?;
        let metadata = metadata.metadata().as_ref()?;
        let tensors = SafeTensors::deserialize(&bytes).ok()?;
        let intact = metadata.get(DESCRIPTION) == Some(&description.to_string())
            && metadata.get(DIGEST) == Some(&digest(&tensors)?);
        if !intact {
            return None;
        }
        let count = tensors.len() / PARTS.len();
        (0..count).map(|index| read(&tensors, index)).collect()
    }

    /// Stores a data set under its description.
    ///
    /// # Errors
    /// A directory that cannot be written.
    pub fn store(&self, description: &Value, episodes: &[Episode]) -> Result<()> {
        let path = self.file(description);
        let failed = |source| Error::Cache { path: path.clone(), source };
        let parts: Vec<(String, Dtype, Vec<usize>, Vec<u8>)> = episodes
            .iter()
            .enumerate()
            .flat_map(|(index, episode)| write(index, episode))
            .collect();
        let views = parts.iter().map(|(name, dtype, shape, bytes)| {
            Ok((name.clone(), TensorView::new(*dtype, shape.clone(), bytes)?))
        });
        let views: Vec<_> = views
            .collect::<std::result::Result<_, safetensors::SafeTensorError>>()
            .map_err(|error| failed(std::io::Error::other(error)))?;
        let serialize = |metadata| {
            safetensors::serialize(views.clone(), metadata)
                .map_err(|error| failed(std::io::Error::other(error)))
        };
        let plain = serialize(None)?;
        let tensors = SafeTensors::deserialize(&plain)
            .map_err(|error| failed(std::io::Error::other(error)))?;
        let metadata = HashMap::from([
            (DESCRIPTION.to_owned(), description.to_string()),
            (DIGEST.to_owned(), digest(&tensors).unwrap_or_default()),
        ]);
        let bytes = serialize(Some(metadata))?;
        fs::create_dir_all(&self.folder).map_err(failed)?;
        match Files::default().write_whole(&path, &bytes) {
            Err(hksl_files::Error::Write { source, .. }) => Err(failed(source)),
            Err(error) => Err(failed(std::io::Error::other(error))),
            Ok(_) => Ok(()),
        }
    }
}

const DESCRIPTION: &str = "description";
const DIGEST: &str = "sha256";
const PARTS: [&str; 3] = ["frames", "actions", "readings"];

fn name(index: usize, part: &str) -> String {
    format!("{index:06}.{part}")
}

fn write(index: usize, episode: &Episode) -> [(String, Dtype, Vec<usize>, Vec<u8>); 3] {
    let Episode { frames, actions, readings } = episode;
    let bytes = [
        frames.iter().copied().collect(),
        actions.iter().flat_map(|number| number.to_le_bytes()).collect(),
        readings.iter().flat_map(|number| number.to_le_bytes()).collect(),
    ];
    let shapes = [frames.shape(), actions.shape(), readings.shape()];
    let [a, b, c] = bytes;
    let part = |position: usize, dtype, bytes| {
        (name(index, PARTS[position]), dtype, shapes[position].to_vec(), bytes)
    };
    [part(0, Dtype::U8, a), part(1, Dtype::F32, b), part(2, Dtype::F64, c)]
}

fn read(tensors: &SafeTensors, index: usize) -> Option<Episode> {
    let part = |position: usize| tensors.tensor(&name(index, PARTS[position])).ok();
    let (frames, actions, readings) = (part(0)?, part(1)?, part(2)?);
    let matrix = |view: &TensorView| -> Option<(usize, usize)> {
        let &[rows, columns] = view.shape() else { return None };
        Some((rows, columns))
    };
    let &[times, channels, height, width] = frames.shape() else { return None };
    let actions_f32 =
        actions.data().chunks_exact(4).map(|bytes| bytes.try_into().map(f32::from_le_bytes));
    let readings_f64 =
        readings.data().chunks_exact(8).map(|bytes| bytes.try_into().map(f64::from_le_bytes));
    Some(Episode {
        frames: Array4::from_shape_vec((times, channels, height, width), frames.data().to_vec())
            .ok()?,
        actions: Array2::from_shape_vec(
            matrix(&actions)?,
            actions_f32.collect::<std::result::Result<_, _>>().ok()?,
        )
        .ok()?,
        readings: Array2::from_shape_vec(
            matrix(&readings)?,
            readings_f64.collect::<std::result::Result<_, _>>().ok()?,
        )
        .ok()?,
    })
}

/// The SHA-256 of the bytes of all tensors, ordered by name.
fn digest(tensors: &SafeTensors) -> Option<String> {
    let mut names = tensors.names();
    names.sort_unstable();
    let mut sha = Sha256::default();
    for name in names {
        sha.update(name.as_bytes());
        sha.update(tensors.tensor(name).ok()?.data());
    }
    Some(sha.finish())
}

#[cfg(test)]
mod tests {
    use ndarray::Array;
    use serde_json::json;

    use super::*;

    #[test]
    fn stored_data_sets_load_and_damaged_ones_do_not() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(&folder.path().join("deep"));
        let description = json!({ "task": "walker-walk", "seed": 1 });
        assert!(cache.load(&description).is_none());
        let episodes: Vec<Episode> = (0..2u8)
            .map(|index| Episode {
                frames: Array::from_shape_fn((3, 1, 2, 2), |(t, ..)| t as u8 + index),
                actions: Array::from_shape_fn((2, 1), |(t, _)| 0.5 * t as f32),
                readings: Array::from_shape_fn((3, 2), |(t, c)| (t * 10 + c) as f64),
            })
            .collect();
        cache.store(&description, &episodes).unwrap();
        assert_eq!(cache.load(&description).unwrap(), episodes);
        let reversed: Vec<Episode> = episodes.iter().rev().cloned().collect();
        assert_ne!(Cache::fingerprint(&episodes), Cache::fingerprint(&reversed));
        assert!(cache.load(&json!({ "task": "walker-walk", "seed": 2 })).is_none());

        let path = cache.file(&description);
        let sound = fs::read(&path).unwrap();
        for position in [9, sound.len() / 2, sound.len() - 1] {
            let mut bytes = sound.clone();
            bytes[position] ^= 1;
            fs::write(&path, bytes).unwrap();
            assert!(cache.load(&description).is_none(), "{position}");
        }
        fs::write(&path, &sound[..sound.len() - 3]).unwrap();
        assert!(cache.load(&description).is_none());
        assert_eq!(fs::read_dir(folder.path().join("deep")).unwrap().count(), 1);
    }
}
