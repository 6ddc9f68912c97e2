//! How far the critics are from what the last episode brought.

use hksl_core::Trajectories;
use rand_chacha::ChaCha8Rng;

use super::{Learner, PixelAgent};
use crate::Result;
use crate::replay::{Episode, Sampler, Start};

/// Observations of the episode that are looked at.
const TIMES: usize = 64;

impl<L: Learner> PixelAgent<L> {
    /// For each critic, the mean over the last finished episode of its value less what was observed from
    /// there on: the discounted rewards up to the last transition, and for that one, unless it ended the process,
    /// the critic's own value. Nothing if that episode has less than two transitions.
    pub(super) fn value_bias(&self, rng: &mut ChaCha8Rng) -> Result<Vec<(String, f64)>> {
        let Some(index) = self.replay.finished().len().checked_sub(1) else {
            return Ok(Vec::new());
        };
        let episode = self.replay.episode(index);
        let Some(last) = episode.len().checked_sub(1).filter(|last| *last > 0) else {
            return Ok(Vec::new());
        };
        let mut times: Vec<usize> =
            (0..TIMES.min(last)).map(|i| i * last / TIMES.min(last)).collect();
        times.push(last);
        let starts: Vec<Start> = times.iter().map(|&time| Start { episode: index, time }).collect();
        let batch = Sampler::new(0).batch(&self.replay, &starts, 1, rng);
        let (Trajectories { observations, actions }, ..) = batch.to_device(&self.device)?;
        let (observations, actions) = (observations.get(0)?, actions.squeeze(1)?);
        let learner = self.learner();
        let bias = |(name, values): (String, Vec<f64>)| {
            let end = values[times.len() - 1];
            let observed = observed(episode, learner.discount(), end);
            let pairs = times.iter().zip(&values).take(times.len() - 1);
            let sum: f64 = pairs.map(|(&time, value)| value - observed[time]).sum();
            (name, sum / (times.len() - 1) as f64)
        };
        Ok(learner.values(&observations, &actions)?.into_iter().map(bias).collect())
    }
}

/// From each time of an episode on: its discounted rewards, with `end` in place of the last one if the process did
/// not end there.
fn observed(episode: &Episode, discount: f64, end: f64) -> Vec<f64> {
    let rewards = episode.rewards(0, episode.len());
    let ended = episode.not_done(episode.len() - 1, 1).next() == Some(0.0);
    let mut observed: Vec<f64> = rewards.iter().map(|&reward| f64::from(reward)).collect();
    if let (Some(last), false) = (observed.last_mut(), ended) {
        *last = end;
    }
    for time in (0..observed.len() - 1).rev() {
        observed[time] += discount * observed[time + 1];
    }
    observed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay::{Layout, Replay};

    #[test]
    fn rewards_are_discounted_from_the_end() {
        let layout = Layout { frame: [1, 1, 1], stack: 1, action_dims: 1 };
        for (terminal, expected) in [(false, [2.5, 3.0, 4.0]), (true, [2.0, 2.0, 2.0])] {
            let mut replay = Replay::new(layout, 10);
            replay.begin_episode(&[0]).unwrap();
            for time in 0..3 {
                let reward = f32::from(time as u8 == 2) + 1.0;
                replay.push(&[0.0], reward, terminal && time == 2, &[0]).unwrap();
            }
            replay.end_episode();
            assert_eq!(observed(replay.episode(0), 0.5, 4.0), expected);
        }
    }
}
