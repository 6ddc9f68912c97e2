//! Sampling of augmented trajectories from the replay.

use std::sync::{Mutex, PoisonError};

use candle_core::{Device, Tensor};
use hksl_core::Trajectories;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::Result;
use crate::augment::Shift;
use crate::config::{AugmentationConfig, ShiftPer};
use crate::replay::{Replay, Start};

/// Stacks frames into observations and applies random shifts.
#[derive(Debug)]
pub struct Sampler {
    pad: usize,
    shift_per: ShiftPer,
    /// The buffer of the last batch that was copied to another device, reused for the next batch.
    spare: Mutex<Vec<u8>>,
}

/// A batch of trajectories of `k` transitions in host memory.
#[derive(Debug)]
pub struct Batch {
    /// `(k+1, B, stack·C, H, W)`. The frames of each observation are ordered oldest first.
    pub observations: Vec<u8>,
    /// `(B, k, A)`.
    pub actions: Vec<f32>,
    /// `(B, k)`.
    pub rewards: Vec<f32>,
    /// `(B, k)`, 0 for terminal transitions and 1 for all others.
    pub not_done: Vec<f32>,
    shape: Shape,
}

#[derive(Debug, Clone, Copy)]
struct Shape {
    batch: usize,
    length: usize,
    observation: [usize; 3],
    action_dims: usize,
}

impl Sampler {
    /// Creates a sampler that shifts each observation by at most `pad` pixels in each direction.
    pub fn new(pad: usize) -> Self {
        Self { pad, shift_per: ShiftPer::Observation, spare: Mutex::default() }
    }

    /// Creates a sampler from the configuration.
    pub fn configured(augmentation: &AugmentationConfig) -> Self {
        let &AugmentationConfig { pad, shift_per } = augmentation;
        Self { shift_per, ..Self::new(pad) }
    }

    /// Builds the trajectories of `length` transitions from these starts. Each observation or each trajectory has its own
    /// random shift, depending on the configuration.
    ///
    /// # Panics
    /// If a trajectory crosses its episode's end.
    pub fn batch(
        &self,
        replay: &Replay,
        starts: &[Start],
        length: usize,
        rng: &mut ChaCha8Rng,
    ) -> Batch {
        if self.shift_per == ShiftPer::Trajectory {
            return self.sequences(replay, starts, length, rng);
        }
        // Drawn sequentially, so that the shifts do not depend on the order in which threads run.
        let shifts: Vec<Shift> =
            (0..(length + 1) * starts.len()).map(|_| Shift::random(rng, self.pad)).collect();
        self.shifted(replay, starts, length, &shifts)
    }

    /// Builds the trajectories of `length` transitions from these starts. All observations of a trajectory share one
    /// random shift.
    ///
    /// # Panics
    /// If a trajectory crosses its episode's end.
    pub fn sequences(
        &self,
        replay: &Replay,
        starts: &[Start],
        length: usize,
        rng: &mut ChaCha8Rng,
    ) -> Batch {
        let shifts: Vec<Shift> = starts.iter().map(|_| Shift::random(rng, self.pad)).collect();
        self.shifted(replay, starts, length, &shifts.repeat(length + 1))
    }

    /// Builds the trajectories with given shifts: one for each observation, time first.
    fn shifted(&self, replay: &Replay, starts: &[Start], length: usize, shifts: &[Shift]) -> Batch {
        let layout = replay.layout();
        let [_, height, width] = layout.frame;
        let frame_bytes = layout.frame_bytes();
        let mut observations = std::mem::take(&mut *self.spare());
        observations.resize(shifts.len() * layout.stack * frame_bytes, 0);
        observations.par_chunks_mut(layout.stack * frame_bytes).zip(shifts).enumerate().for_each(
            |(index, (observation, shift))| {
                let (step, start) = (index / starts.len(), starts[index % starts.len()]);
                let episode = replay.episode(start.episode);
                for (position, frame) in observation.chunks_exact_mut(frame_bytes).enumerate() {
                    let age = layout.stack - 1 - position;
                    let time = (start.time + step).saturating_sub(age);
                    shift.apply(episode.frame(time), height, width, frame);
                }
            },
        );
        let (mut actions, mut rewards, mut not_done) = (Vec::new(), Vec::new(), Vec::new());
        for start in starts {
            let episode = replay.episode(start.episode);
            actions.extend_from_slice(episode.actions(start.time, length));
            rewards.extend_from_slice(episode.rewards(start.time, length));
            not_done.extend(episode.not_done(start.time, length));
        }
        let shape = Shape {
            batch: starts.len(),
            length,
            observation: layout.observation(),
            action_dims: layout.action_dims,
        };
        Batch { observations, actions, rewards, not_done, shape }
    }

    /// Copies the batch to a device like [`Batch::to_device`]. For devices other than the CPU, keeps the batch's buffer for
    /// the next batch.
    pub fn to_device(
        &self,
        batch: Batch,
        device: &Device,
    ) -> Result<(Trajectories, Tensor, Tensor)> {
        if device.is_cpu() {
            return batch.to_device(device);
        }
        let Batch { observations, actions, rewards, not_done, shape } = batch;
        let on_device = Tensor::from_slice(&observations, shape.observations(), device)?;
        *self.spare() = observations;
        shape.tensors(on_device, actions, rewards, not_done)
    }

    fn spare(&self) -> std::sync::MutexGuard<'_, Vec<u8>> {
        self.spare.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Batch {
    /// Copies the batch to a device. Returns the trajectories, rewards `(B, k)` and not-done flags `(B, k)`.
    pub fn to_device(self, device: &Device) -> Result<(Trajectories, Tensor, Tensor)> {
        let Self { observations, actions, rewards, not_done, shape } = self;
        let observations = Tensor::from_vec(observations, shape.observations(), device)?;
        shape.tensors(observations, actions, rewards, not_done)
    }
}

impl Shape {
    /// `(k+1, B, stack·C, H, W)`.
    fn observations(&self) -> (usize, usize, usize, usize, usize) {
        let [channels, height, width] = self.observation;
        (self.length + 1, self.batch, channels, height, width)
    }

    /// Creates the batch's tensors on the device of the observations.
    fn tensors(
        self,
        observations: Tensor,
        actions: Vec<f32>,
        rewards: Vec<f32>,
        not_done: Vec<f32>,
    ) -> Result<(Trajectories, Tensor, Tensor)> {
        let Self { batch, length, action_dims, .. } = self;
        let device = observations.device();
        let actions = Tensor::from_vec(actions, (batch, length, action_dims), device)?;
        let rewards = Tensor::from_vec(rewards, (batch, length), device)?;
        let not_done = Tensor::from_vec(not_done, (batch, length), device)?;
        Ok((Trajectories { observations, actions }, rewards, not_done))
    }
}
