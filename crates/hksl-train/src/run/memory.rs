//! Whether the machine has the memory that a run will take.

use super::Summary;
use crate::config::ReplayStorage;
use crate::{Error, Result};

/// What the process takes before it learns: code, drawing, MuJoCo.
const PROCESS_BYTES: u64 = 150_000_000;

impl Summary {
    /// Bytes of memory that the run will take at most, estimated; on a GPU most of it there.
    pub fn memory_bytes(&self) -> u64 {
        let replay = match self.replay_storage {
            ReplayStorage::Memory => self.replay_bytes,
            ReplayStorage::File => 0,
        };
        replay + self.learning_bytes + PROCESS_BYTES
    }

    /// # Errors
    /// [`Error::Memory`] if a run on the CPU needs more than is free.
    pub(super) fn check_memory(&self) -> Result<()> {
        match self.available_bytes {
            Some(available) if self.device == "cpu" && available < self.memory_bytes() => {
                let needed = self.memory_bytes();
                let replay = needed - self.learning_bytes - PROCESS_BYTES;
                Err(Error::Memory { needed, replay, available })
            }
            _ => Ok(()),
        }
    }
}
