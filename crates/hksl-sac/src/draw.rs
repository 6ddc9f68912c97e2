//! What a learning step draws.

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
    /// `(B, k)`, 0 where the decision process ended.
    pub not_done: Tensor,
}

/// Sequences of observations with what led to them, times first.
#[derive(Debug, Clone)]
pub struct ArrivingSequences {
    /// `(T, B, C, H, W)` u8.
    pub observations: Tensor,
    /// `(T, B, A)`; zeros at the first time.
    pub arriving_actions: Tensor,
    /// `(T, B)`; at an episode's first observation 0.
    pub arriving_rewards: Tensor,
}

/// Draws batches and noise for a learner, and takes the time of it.
#[derive(Debug)]
pub struct Draw<'a> {
    replay: &'a Replay,
    sampler: &'a Sampler,
    device: &'a Device,
    random: Random<'a>,
    spent: UpdateReport,
}

#[derive(Debug)]
enum Random<'a> {
    /// Of a run: what the replay yields, how it is shifted, and noise.
    Streams { replay: &'a mut ChaCha8Rng, augment: &'a mut ChaCha8Rng, noise: &'a mut ChaCha8Rng },
    /// For a look at the learner that leaves the run's streams alone.
    One(&'a mut ChaCha8Rng),
}

impl<'a> Draw<'a> {
    /// From the streams `[replay, augment, noise]` of a run.
    pub(crate) fn learning(
        replay: &'a Replay,
        sampler: &'a Sampler,
        device: &'a Device,
        [of_replay, augment, noise]: [&'a mut ChaCha8Rng; 3],
    ) -> Self {
        let random = Random::Streams { replay: of_replay, augment, noise };
        Self { replay, sampler, device, random, spent: UpdateReport::default() }
    }

    /// All from one stream.
    pub fn looking(
        replay: &'a Replay,
        sampler: &'a Sampler,
        device: &'a Device,
        random: &'a mut ChaCha8Rng,
    ) -> Self {
        let (random, spent) = (Random::One(random), UpdateReport::default());
        Self { replay, sampler, device, random, spent }
    }

    /// Where the learner's tensors are.
    pub fn device(&self) -> &Device {
        self.device
    }

    /// `count` starts of trajectories of `length` transitions, as [`Replay::starts`]; none if there are none.
    pub fn starts(&mut self, count: usize, length: usize) -> Option<Vec<Start>> {
        let mut clock = Instant::now();
        let random = match &mut self.random {
            Random::Streams { replay, .. } => replay,
            Random::One(random) => random,
        };
        let starts = self.replay.starts(random, count, length);
        self.spent.lap(Phase::Sample, &mut clock);
        starts
    }

    /// The trajectories of `length` transitions from these starts, every observation shifted on its own.
    pub fn batch(&mut self, starts: &[Start], length: usize) -> Result<LearningBatch> {
        let mut clock = Instant::now();
        let random = match &mut self.random {
            Random::Streams { augment, .. } => augment,
            Random::One(random) => random,
        };
        let batch = self.sampler.batch(self.replay, starts, length, random);
        self.spent.lap(Phase::Augment, &mut clock);
        let (trajectories, rewards, not_done) = self.sampler.to_device(batch, self.device)?;
        self.spent.lap(Phase::Sample, &mut clock);
        Ok(LearningBatch { trajectories, rewards, not_done })
    }

    /// Sequences of `length` observations, one at least, from these starts, each sequence shifted as a whole, with what led to every
    /// observation.
    pub fn sequences(&mut self, starts: &[Start], length: usize) -> Result<ArrivingSequences> {
        let mut clock = Instant::now();
        let random = match &mut self.random {
            Random::Streams { augment, .. } => augment,
            Random::One(random) => random,
        };
        let batch = self.sampler.sequences(self.replay, starts, length - 1, random);
        self.spent.lap(Phase::Augment, &mut clock);
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
        self.spent.lap(Phase::Sample, &mut clock);
        Ok(sequences)
    }

    /// Standard normal noise.
    pub fn normal(&mut self, shape: &[usize]) -> Result<Tensor> {
        let (device, mut clock) = (self.device, Instant::now());
        let drawn = rng::standard_normal(self.noise(), shape, device)?;
        self.spent.lap(Phase::Sample, &mut clock);
        Ok(drawn)
    }

    /// Numbers that are equally likely anywhere in [0, 1).
    pub fn uniform(&mut self, shape: &[usize]) -> Result<Tensor> {
        let (count, mut clock) = (shape.iter().product(), Instant::now());
        let random = self.noise();
        let numbers: Vec<f32> = (0..count).map(|_| random.random()).collect();
        let drawn = Tensor::from_vec(numbers, shape, self.device)?;
        self.spent.lap(Phase::Sample, &mut clock);
        Ok(drawn)
    }

    /// `0 … count − 1` in a random order.
    pub fn permutation(&mut self, count: usize) -> Vec<u32> {
        let mut order: Vec<u32> = (0..count as u32).collect();
        order.shuffle(self.noise());
        order
    }

    /// One of `0 … count − 1`; panics if there is none.
    pub fn index(&mut self, count: usize) -> usize {
        self.noise().random_range(0..count)
    }

    /// The seconds that drawing has taken, and what `step` reports.
    pub fn and(self, step: UpdateReport) -> UpdateReport {
        self.spent.merge(step)
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

    /// What led to each observation of a sequence: nothing to an episode's first.
    #[test]
    fn sequences_say_what_led_to_each_observation() {
        let layout = Layout { frame: [1, 1, 1], stack: 1, action_dims: 1 };
        let mut replay = Replay::new(layout, 100);
        replay.begin_episode(&[0]).unwrap();
        for time in 0..8u8 {
            replay.push(&[f32::from(time)], f32::from(time) + 0.5, false, &[time + 1]).unwrap();
        }
        replay.end_episode();
        let starts: Vec<Start> = [0, 3].map(|time| Start { episode: 0, time }).into();
        let (sampler, mut random) = (Sampler::new(0), rng::stream(1, "test"));
        let mut draw = Draw::looking(&replay, &sampler, &Device::Cpu, &mut random);
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
        let mut draw = Draw::looking(&replay, &sampler, &Device::Cpu, &mut random);
        let mut order = draw.permutation(50);
        assert!(order != (0..50).collect::<Vec<u32>>());
        order.sort_unstable();
        assert_eq!(order, (0..50).collect::<Vec<u32>>());
        assert!((0..100).all(|_| draw.index(3) < 3));
    }
}
