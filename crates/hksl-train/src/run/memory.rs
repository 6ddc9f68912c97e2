//! Checks whether a run fits into memory.

use super::Summary;
use super::error::{Error, Result};
use crate::config::ReplayStorage;
use crate::memory::{LimitedBy, SystemMemory};

/// Memory of the process before training: code, rendering, MuJoCo.
const PROCESS_BYTES: u64 = 150_000_000;
/// Memory that the allocator reserves ahead of need, for limits that count it.
const AHEAD_BYTES: u64 = 64 << 20;

impl Summary {
    /// Upper estimate of the run's memory in bytes; with a GPU, most of it is GPU memory.
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
        // Exceeding these limits aborts the process, so leave a margin for the estimate and the allocator.
        if matches!(by, Some(LimitedBy::AddressSpace | LimitedBy::Data)) {
            needed += needed / 8 + AHEAD_BYTES;
        }
        refuse_beyond(needed, replay, memory)
    }
}

/// Refuses to start if not even the process fits.
///
/// # Errors
/// [`Error::Memory`] if less is free than the process needs before training.
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
