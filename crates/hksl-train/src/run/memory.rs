//! Whether the machine has the memory that a run will take.

use super::Summary;
use super::error::{Error, Result};
use crate::config::ReplayStorage;
use crate::memory::{LimitedBy, SystemMemory};

/// What the process takes before it learns: code, drawing, MuJoCo.
const PROCESS_BYTES: u64 = 150_000_000;
/// What the allocator takes from the system ahead of need, where a limit counts that too.
const AHEAD_BYTES: u64 = 64 << 20;

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
    pub(super) fn check_memory(&self, memory: Option<SystemMemory>) -> Result<()> {
        if self.device != "cpu" {
            return Ok(());
        }
        let mut needed = self.memory_bytes();
        let replay = needed - self.learning_bytes - PROCESS_BYTES;
        let limit = memory.and_then(|memory| memory.binding_limit());
        let by = limit.map(|limit| limit.by);
        if by == Some(LimitedBy::AddressSpace) && self.replay_storage == ReplayStorage::File {
            needed += self.replay_bytes;
        }
        // Beyond these the process is aborted, not slowed down: the estimate and the allocator's own get room.
        if matches!(by, Some(LimitedBy::AddressSpace | LimitedBy::Data)) {
            needed += needed / 8 + AHEAD_BYTES;
        }
        refuse_beyond(needed, replay, memory)
    }
}

/// Refuses what no run can do with, before the first part of one is made.
///
/// # Errors
/// [`Error::Memory`] if less is free than the process takes before it learns.
pub(super) fn check_least(on_cpu: bool, memory: Option<SystemMemory>) -> Result<()> {
    if on_cpu { refuse_beyond(PROCESS_BYTES, 0, memory) } else { Ok(()) }
}

fn refuse_beyond(needed: u64, replay: u64, memory: Option<SystemMemory>) -> Result<()> {
    match memory {
        Some(memory) if memory.available < needed => {
            let limit = memory.binding_limit();
            Err(Error::Memory { needed, replay, available: memory.available, limit })
        }
        _ => Ok(()),
    }
}
