//! Where an episode's frames lie.

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

/// One frame after the other.
#[derive(Debug, Clone)]
pub(super) enum Frames {
    /// In memory; they can grow.
    Memory(Vec<u8>),
    /// In these bytes of a file that is mapped into memory.
    File(Arc<Mmap>, Range<usize>),
}

impl PartialEq for Frames {
    fn eq(&self, other: &Self) -> bool {
        self.bytes() == other.bytes()
    }
}

impl Frames {
    /// The u8 tensor `name` of a safetensors file, which stays there, and the file's other tensors.
    ///
    /// # Errors
    /// [`Error::Read`]; what is wrong with the file, as [`Error::SavedState`].
    #[allow(unsafe_code)]
    pub(super) fn open(path: &Path, name: &str) -> Result<(Self, BTreeMap<String, Tensor>)> {
        let unread = |source| Error::Read { path: path.to_owned(), source };
        let file = File::open(path).map_err(unread)?;
        // SAFETY: `Episode::open` asks of its callers that the file's bytes stay as they are. A run's episodes are written
        // under another name, renamed when complete, never changed after that, and replaced or removed only by name,
        // which leaves the mapped file as it is.
        let map = unsafe { Mmap::map(&file) }.map_err(unread)?;
        let tensors = SafeTensors::deserialize(&map).map_err(|error| damaged(error.to_string()))?;
        let frames = tensors.tensor(name).map_err(|_| damaged(format!("no `{name}`")))?;
        if frames.dtype() != Dtype::U8 {
            return Err(damaged(format!("`{name}` is {:?}, not U8", frames.dtype())));
        }
        let start = frames.data().as_ptr() as usize - map.as_ptr() as usize;
        let place = start..start + frames.data().len();
        let mut others = BTreeMap::new();
        for (other, view) in tensors.iter().filter(|(other, _)| *other != name) {
            let tensor = view.load(&candle_core::Device::Cpu)?;
            others.insert(other.to_owned(), tensor);
        }
        Ok((Self::File(Arc::new(map), place), others))
    }

    pub(super) fn bytes(&self) -> &[u8] {
        match self {
            Self::Memory(bytes) => bytes,
            Self::File(map, place) => &map[place.clone()],
        }
    }

    /// Adds a frame.
    pub(super) fn extend(&mut self, frame: &[u8]) {
        match self {
            Self::Memory(bytes) => bytes.extend_from_slice(frame),
            Self::File(..) => *self = Self::Memory([self.bytes(), frame].concat()),
        }
    }

    /// Gives back the room that was kept for further frames.
    pub(super) fn shrink(&mut self) {
        if let Self::Memory(bytes) = self {
            bytes.shrink_to_fit();
        }
    }

    /// Bytes of memory that only this takes.
    pub(super) fn memory(&self) -> usize {
        match self {
            Self::Memory(bytes) => bytes.capacity(),
            Self::File(..) => 0,
        }
    }
}

/// A saved replay that is not what it should be.
pub(super) fn damaged(reason: String) -> Error {
    Error::SavedState { part: "replay".to_owned(), reason }
}
