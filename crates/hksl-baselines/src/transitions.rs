//! A batch of single transitions.

use candle_core::Tensor;
use hksl_sac::{LearningBatch, Result};

/// A batch of transitions.
#[derive(Debug, Clone)]
pub struct Transitions {
    /// `(B, C, H, W)` u8.
    pub observations: Tensor,
    /// `(B, A)`.
    pub actions: Tensor,
    /// `(B, 1)`.
    pub rewards: Tensor,
    /// `(B, 1)`, 0 for terminal transitions and 1 for all others.
    pub not_done: Tensor,
    /// `(B, C, H, W)` u8.
    pub next_observations: Tensor,
}

impl Transitions {
    /// Takes the first transition of each trajectory.
    ///
    /// # Errors
    /// Trajectories without a transition.
    pub fn first_of(batch: &LearningBatch) -> Result<Self> {
        let LearningBatch { trajectories, rewards, not_done } = batch;
        Ok(Self {
            observations: trajectories.at(0)?,
            actions: trajectories.actions.narrow(1, 0, 1)?.squeeze(1)?,
            rewards: rewards.narrow(1, 0, 1)?,
            not_done: not_done.narrow(1, 0, 1)?,
            next_observations: trajectories.at(1)?,
        })
    }
}
