//! Storage of an episode's frames.

use std::collections::BTreeMap;
use std::fs::File;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use candle_core::Tensor;
use candle_core::safetensors::Load;
use memmap2::Mmap;
use safetensors::{Dtype, SafeTensors};

use crate::{Error, Result};

/// The frames of an episode, concatenated.
#[derive(Debug, Clone)]
pub(super) enum Frames {
    /// In memory.
    Memory(Vec<u8>),
    /// In a byte range of a memory-mapped file.
    File(Arc<Mmap>, Range<usize>),
}

impl PartialEq for Frames {
    fn eq(&self, other: &Self) -> bool {
        self.bytes() == other.bytes()
    }
}

impl Frames {
    /// Maps the u8 tensor `name` of a safetensors file and reads the file's other tensors.
    ///
    /// # Errors
    /// [`Error::Read`] if the file cannot be read or mapped, [`Error::SavedState`] if its content is invalid.
    #[allow(unsafe_code)]
    pub(super) fn open(path: &Path, name: &str) -> Result<(Self, BTreeMap<String, Tensor>)> {
        let unread = |source| Error::Read { path: path.to_owned(), source };
        let file = File::open(path).map_err(unread)?;
        // SAFETY: `Episode::open` requires that the file is not modified. A run writes an episode to a temporary file and
        // renames it when complete. Later it only deletes the file or renames another file to its name, which leaves
        // the mapped bytes unchanged.
        let map = unsafe { Mmap::map(&file) }.map_err(unread)?;
        let tensors =
            SafeTensors::deserialize(&map).map_err(|error| invalid_replay(error.to_string()))?;
        let frames = tensors.tensor(name).map_err(|_| invalid_replay(format!("no `{name}`")))?;
        if frames.dtype() != Dtype::U8 {
            return Err(invalid_replay(format!("`{name}` is {:?}, not U8", frames.dtype())));
        }
        let start = frames.data().as_ptr() as usize - map.as_ptr() as usize;
        let range = start..start + frames.data().len();
        let mut others = BTreeMap::new();
        for (other, view) in tensors.iter().filter(|(other, _)| *other != name) {
            let tensor = view.load(&candle_core::Device::Cpu)?;
            others.insert(other.to_owned(), tensor);
        }
        Ok((Self::File(Arc::new(map), range), others))
    }

    pub(super) fn bytes(&self) -> &[u8] {
        match self {
            Self::Memory(bytes) => bytes,
            Self::File(map, range) => &map[range.clone()],
        }
    }

    /// Appends a frame.
    pub(super) fn extend(&mut self, frame: &[u8]) {
        match self {
            Self::Memory(bytes) => bytes.extend_from_slice(frame),
            Self::File(..) => *self = Self::Memory([self.bytes(), frame].concat()),
        }
    }

    /// Frees the spare capacity.
    pub(super) fn shrink_to_fit(&mut self) {
        if let Self::Memory(bytes) = self {
            bytes.shrink_to_fit();
        }
    }

    /// Bytes of memory that the frames use; 0 for frames in a file.
    pub(super) fn memory(&self) -> usize {
        match self {
            Self::Memory(bytes) => bytes.capacity(),
            Self::File(..) => 0,
        }
    }
}

/// An error for an invalid saved replay.
pub(super) fn invalid_replay(reason: String) -> Error {
    Error::SavedState { part: "replay".to_owned(), reason }
}
