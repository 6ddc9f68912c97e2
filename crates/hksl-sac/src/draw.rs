//! Batches and noise for a learning step.

use std::time::Instant;

use candle_core::{DType, Device, Tensor};
use hksl_core::{Trajectories, rng};
use rand::Rng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use crate::Result;
use crate::replay::{Replay, Sampler, Start};
use crate::update_report::{Phase, UpdateReport};

/// A batch of trajectories of `k` transitions.
#[derive(Debug, Clone)]
pub struct LearningBatch {
    /// Observations and actions.
    pub trajectories: Trajectories,
    /// `(B, k)`.
    pub rewards: Tensor,
    /// `(B, k)`, 0 for terminal transitions and 1 for all others.
    pub not_done: Tensor,
}

/// Sequences of observations, each with the action and the reward that preceded it. Time is the first dimension.
#[derive(Debug, Clone)]
pub struct ArrivingSequences {
    /// `(T, B, C, H, W)` u8.
    pub observations: Tensor,
    /// `(T, B, A)`: the action before each observation. Zeros at the first time.
    pub arriving_actions: Tensor,
    /// `(T, B)`: the reward before each observation. 0 at an episode's first observation.
    pub arriving_rewards: Tensor,
}

/// Draws batches and noise for a learner and measures the time that drawing takes.
#[derive(Debug)]
pub struct Draw<'a> {
    replay: &'a Replay,
    sampler: &'a Sampler,
    device: &'a Device,
    random: Random<'a>,
    timings: UpdateReport,
}

#[derive(Debug)]
enum Random<'a> {
    /// The agent's generators for trajectories, shifts and noise.
    Streams { replay: &'a mut ChaCha8Rng, augment: &'a mut ChaCha8Rng, noise: &'a mut ChaCha8Rng },
    /// One separate generator, so that diagnostics do not advance the agent's generators.
    One(&'a mut ChaCha8Rng),
}

impl<'a> Draw<'a> {
    /// Draws with the agent's generators `[replay, augment, noise]`.
    pub(crate) fn for_learning(
        replay: &'a Replay,
        sampler: &'a Sampler,
        device: &'a Device,
        [of_replay, augment, noise]: [&'a mut ChaCha8Rng; 3],
    ) -> Self {
        let random = Random::Streams { replay: of_replay, augment, noise };
        Self { replay, sampler, device, random, timings: UpdateReport::default() }
    }

    /// Draws with one separate generator.
    pub fn for_diagnosis(
        replay: &'a Replay,
        sampler: &'a Sampler,
        device: &'a Device,
        random: &'a mut ChaCha8Rng,
    ) -> Self {
        let (random, timings) = (Random::One(random), UpdateReport::default());
        Self { replay, sampler, device, random, timings }
    }

    /// The device of the learner's tensors.
    pub fn device(&self) -> &Device {
        self.device
    }

    /// Draws `count` starts of trajectories of `length` transitions with [`Replay::starts`]. Returns None if no finished
    /// episode is long enough.
    pub fn starts(&mut self, count: usize, length: usize) -> Option<Vec<Start>> {
        let mut clock = Instant::now();
        let random = match &mut self.random {
            Random::Streams { replay, .. } => replay,
            Random::One(random) => random,
        };
        let starts = self.replay.starts(random, count, length);
        self.timings.lap(Phase::Sample, &mut clock);
        starts
    }

    /// The augmented trajectories of `length` transitions from these starts ([`Sampler::batch`]).
    pub fn batch(&mut self, starts: &[Start], length: usize) -> Result<LearningBatch> {
        let mut clock = Instant::now();
        let random = match &mut self.random {
            Random::Streams { augment, .. } => augment,
            Random::One(random) => random,
        };
        let batch = self.sampler.batch(self.replay, starts, length, random);
        self.timings.lap(Phase::Augment, &mut clock);
        let (trajectories, rewards, not_done) = self.sampler.to_device(batch, self.device)?;
        self.timings.lap(Phase::Sample, &mut clock);
        Ok(LearningBatch { trajectories, rewards, not_done })
    }

    /// Sequences of `length ≥ 1` observations from these starts. All observations of a sequence share one random shift.
    pub fn sequences(&mut self, starts: &[Start], length: usize) -> Result<ArrivingSequences> {
        let mut clock = Instant::now();
        let random = match &mut self.random {
            Random::Streams { augment, .. } => augment,
            Random::One(random) => random,
        };
        let batch = self.sampler.sequences(self.replay, starts, length - 1, random);
        self.timings.lap(Phase::Augment, &mut clock);
        let (trajectories, rewards, _) = self.sampler.to_device(batch, self.device)?;
        let count = starts.len();
        let first: Vec<f32> = starts
            .iter()
            .map(|&Start { episode, time }| match time {
                0 => 0.0,
                time => self.replay.episode(episode).rewards(time - 1, 1)[0],
            })
            .collect();
        let first = Tensor::from_vec(first, (1, count), self.device)?;
        let dims = self.replay.layout().action_dims;
        let nothing = Tensor::zeros((1, count, dims), DType::F32, self.device)?;
        let actions = trajectories.actions.transpose(0, 1)?;
        let sequences = ArrivingSequences {
            observations: trajectories.observations,
            arriving_actions: Tensor::cat(&[nothing, actions.contiguous()?], 0)?,
            arriving_rewards: Tensor::cat(&[first, rewards.t()?.contiguous()?], 0)?,
        };
        self.timings.lap(Phase::Sample, &mut clock);
        Ok(sequences)
    }

    /// Draws standard normal noise.
    pub fn normal(&mut self, shape: &[usize]) -> Result<Tensor> {
        let (device, mut clock) = (self.device, Instant::now());
        let noise = rng::standard_normal(self.noise(), shape, device)?;
        self.timings.lap(Phase::Sample, &mut clock);
        Ok(noise)
    }

    /// Draws numbers uniformly from [0, 1).
    pub fn uniform(&mut self, shape: &[usize]) -> Result<Tensor> {
        let (count, mut clock) = (shape.iter().product(), Instant::now());
        let random = self.noise();
        let numbers: Vec<f32> = (0..count).map(|_| random.random()).collect();
        let noise = Tensor::from_vec(numbers, shape, self.device)?;
        self.timings.lap(Phase::Sample, &mut clock);
        Ok(noise)
    }

    /// A random permutation of `0 … count − 1`.
    pub fn permutation(&mut self, count: usize) -> Vec<u32> {
        let mut order: Vec<u32> = (0..count as u32).collect();
        order.shuffle(self.noise());
        order
    }

    /// Draws an index uniformly from `0 … count − 1`.
    ///
    /// # Panics
    /// If `count` is 0.
    pub fn index(&mut self, count: usize) -> usize {
        self.noise().random_range(0..count)
    }

    /// Adds the time that drawing took to the report of a learning step.
    pub fn add_timings(self, step: UpdateReport) -> UpdateReport {
        self.timings.merge(step)
    }

    fn noise(&mut self) -> &mut ChaCha8Rng {
        match &mut self.random {
            Random::Streams { noise, .. } => noise,
            Random::One(random) => random,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay::Layout;

    #[test]
    fn sequences_have_the_preceding_actions_and_rewards() {
        let layout = Layout { frame: [1, 1, 1], stack: 1, action_dims: 1 };
        let mut replay = Replay::new(layout, 100);
        replay.begin_episode(&[0]).unwrap();
        for time in 0..8u8 {
            replay.push(&[f32::from(time)], f32::from(time) + 0.5, false, &[time + 1]).unwrap();
        }
        replay.end_episode();
        let starts: Vec<Start> = [0, 3].map(|time| Start { episode: 0, time }).into();
        let (sampler, mut random) = (Sampler::new(0), rng::stream(1, "test"));
        let mut draw = Draw::for_diagnosis(&replay, &sampler, &Device::Cpu, &mut random);
        let sequences = draw.sequences(&starts, 4).unwrap();
        assert_eq!(sequences.observations.dims(), [4, 2, 1, 1, 1]);
        let seen = sequences.observations.flatten_all().unwrap().to_vec1::<u8>().unwrap();
        assert_eq!(seen, [0, 3, 1, 4, 2, 5, 3, 6]);
        let actions = sequences.arriving_actions.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        assert_eq!(actions, [0., 0., 0., 3., 1., 4., 2., 5.]);
        let rewards = sequences.arriving_rewards.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        assert_eq!(rewards, [0., 2.5, 0.5, 3.5, 1.5, 4.5, 2.5, 5.5]);
    }

    #[test]
    fn permutations_hold_each_index_once() {
        let layout = Layout { frame: [1, 1, 1], stack: 1, action_dims: 1 };
        let (replay, sampler) = (Replay::new(layout, 1), Sampler::new(0));
        let mut random = rng::stream(1, "test");
        let mut draw = Draw::for_diagnosis(&replay, &sampler, &Device::Cpu, &mut random);
        let mut order = draw.permutation(50);
        assert!(order != (0..50).collect::<Vec<u32>>());
        order.sort_unstable();
        assert_eq!(order, (0..50).collect::<Vec<u32>>());
        assert!((0..100).all(|_| draw.index(3) < 3));
    }
}
