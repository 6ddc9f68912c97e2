//! The replay buffer: whole episodes, with each frame stored once.

mod episode;
mod frames;
mod sample;

use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;

use rand::Rng;
use rand_chacha::ChaCha8Rng;

pub use episode::Episode;
pub use sample::{Batch, Sampler};

use crate::{Error, Result};

/// Shapes of a replay's frames and actions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Shape of one u8 frame, `(C, H, W)`.
    pub frame: [usize; 3],
    /// Frames in an observation.
    pub stack: usize,
    /// Action dimensions, `A`.
    pub action_dims: usize,
}

impl Layout {
    /// Bytes of one frame.
    pub fn frame_bytes(&self) -> usize {
        self.frame.iter().product()
    }

    /// Shape of one observation, `(stack·C, H, W)`. Frames are ordered oldest first; at an episode's start the first frame
    /// is repeated.
    pub fn observation(&self) -> [usize; 3] {
        let [channels, height, width] = self.frame;
        [self.stack * channels, height, width]
    }

    /// Bytes of one stored transition.
    pub fn transition_bytes(&self) -> usize {
        self.frame_bytes() + 4 * self.action_dims + 4 + 1
    }
}

/// The start of a sampled trajectory. Valid until the next [`Replay::push`] or [`Replay::restore`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Start {
    /// Index of the finished episode, oldest first.
    pub episode: usize,
    /// Time of the trajectory's first observation in the episode.
    pub time: usize,
}

/// A replay buffer of at most `capacity` transitions, in whole episodes.
///
/// Each frame is stored once, as u8, for any number of stacked frames. A finished episode never changes. Trajectories
/// therefore never cross an episode's end or an overwritten part, and a checkpoint writes each finished episode once.
#[derive(Debug)]
pub struct Replay {
    layout: Layout,
    capacity: usize,
    finished: VecDeque<Arc<Episode>>,
    running: Option<Episode>,
    transitions: usize,
    begun: u64,
}

impl Replay {
    /// Creates an empty replay for `capacity` transitions.
    pub fn new(layout: Layout, capacity: usize) -> Self {
        Self {
            layout,
            capacity,
            finished: VecDeque::new(),
            running: None,
            transitions: 0,
            begun: 0,
        }
    }

    /// Shapes of frames and actions.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Number of stored transitions, including the running episode.
    pub fn transitions(&self) -> usize {
        self.transitions
    }

    /// The finished episodes, oldest first.
    pub fn finished(&self) -> impl ExactSizeIterator<Item = &Arc<Episode>> {
        self.finished.iter()
    }

    /// The running episode.
    pub fn running(&self) -> Option<&Episode> {
        self.running.as_ref()
    }

    /// Begins an episode with its first frame, after ending the running one with [`Self::end_episode`].
    ///
    /// # Errors
    /// [`Error::Size`] if the frame has another size.
    pub fn begin_episode(&mut self, frame: &[u8]) -> Result<()> {
        check("frame", frame.len(), self.layout.frame_bytes())?;
        self.end_episode();
        self.running = Some(Episode::new(self.begun, frame));
        self.begun += 1;
        Ok(())
    }

    /// Stores one transition of the running episode: action, reward and next frame. A full replay drops its oldest episode.
    ///
    /// `terminal` is true if the transition ended in a terminal state; time limits truncate, they do not terminate.
    ///
    /// # Errors
    /// [`Error::NoEpisode`], [`Error::Size`], [`Error::NotFinite`] or [`Error::EpisodeTooLong`]. Nothing is stored then.
    pub fn push(
        &mut self,
        action: &[f32],
        reward: f32,
        terminal: bool,
        frame: &[u8],
    ) -> Result<()> {
        check("frame", frame.len(), self.layout.frame_bytes())?;
        check("action", action.len(), self.layout.action_dims)?;
        for (what, number) in
            action.iter().map(|number| ("an action", number)).chain([("a reward", &reward)])
        {
            if !number.is_finite() {
                return Err(Error::NotFinite { what, value: f64::from(*number) });
            }
        }
        let running = self.running.as_mut().ok_or(Error::NoEpisode)?;
        if self.transitions >= self.capacity {
            let oldest = self.finished.pop_front();
            let oldest = oldest.ok_or(Error::EpisodeTooLong { capacity: self.capacity })?;
            self.transitions -= oldest.len();
        }
        running.push(action, reward, terminal, frame);
        self.transitions += 1;
        Ok(())
    }

    /// Ends the running episode and makes it available for sampling. An episode without transitions is dropped.
    pub fn end_episode(&mut self) {
        if let Some(mut episode) = self.running.take().filter(|episode| !episode.is_empty()) {
            episode.finish();
            self.finished.push_back(Arc::new(episode));
        }
    }

    /// Draws `count` starts of trajectories of `length` transitions: first an episode, uniformly among the finished episodes
    /// that are long enough, then a time, uniformly within the episode. Returns None if no episode is long enough.
    pub fn starts(&self, rng: &mut ChaCha8Rng, count: usize, length: usize) -> Option<Vec<Start>> {
        let eligible: Vec<usize> = (0..self.finished.len())
            .filter(|&index| self.finished[index].len() >= length)
            .collect();
        if eligible.is_empty() {
            return None;
        }
        let draw = |_| {
            let episode = eligible[rng.random_range(0..eligible.len())];
            let time = rng.random_range(0..=self.finished[episode].len() - length);
            Start { episode, time }
        };
        Some((0..count).map(draw).collect())
    }

    /// The finished episode at this index, oldest first.
    ///
    /// # Panics
    /// If `index` is out of range.
    pub fn episode(&self, index: usize) -> &Episode {
        &self.finished[index]
    }

    /// Replaces a finished episode's frames in memory by the memory-mapped file that its tensors were written to. Does
    /// nothing if the episode was dropped or is mapped already. The file must not be modified afterwards; it may be
    /// deleted, or replaced by renaming another file to its name.
    ///
    /// # Errors
    /// [`Error::SavedState`] if the file contains another episode, [`Error::Read`] if it cannot be read or mapped. The
    /// episode then stays in memory.
    pub fn keep_in_file(&mut self, number: u64, path: &Path) -> Result<()> {
        let Some(episode) = self.finished.iter_mut().find(|episode| episode.number() == number)
        else {
            return Ok(());
        };
        if episode.memory_bytes() > 0 {
            let opened = Episode::open(path, &self.layout)?;
            if opened != **episode {
                let reason = format!("{} does not hold episode {number}", path.display());
                return Err(Error::SavedState { part: "replay".to_owned(), reason });
            }
            *episode = Arc::new(opened);
        }
        Ok(())
    }

    /// Restores the finished episodes of a saved replay, oldest first, and its running episode.
    ///
    /// # Errors
    /// [`Error::SavedState`] if their shapes differ from this replay's layout or they exceed its capacity.
    pub fn restore(&mut self, finished: Vec<Episode>, running: Option<Episode>) -> Result<()> {
        for episode in finished.iter().chain(&running) {
            episode.check(&self.layout)?;
        }
        let transitions = finished.iter().chain(&running).map(Episode::len).sum();
        if transitions > self.capacity {
            return Err(Error::SavedState {
                part: "replay".to_owned(),
                reason: format!("{transitions} transitions, but the capacity is {}", self.capacity),
            });
        }
        self.transitions = transitions;
        self.begun = finished.iter().chain(&running).map(|e| e.number() + 1).max().unwrap_or(0);
        self.finished = finished.into_iter().map(Arc::new).collect();
        self.running = running;
        Ok(())
    }
}

fn check(what: &'static str, got: usize, expected: usize) -> Result<()> {
    if got == expected { Ok(()) } else { Err(Error::Size { what, got, expected }) }
}

#[cfg(test)]
mod tests {
    use hksl_core::rng::stream;
    use proptest::prelude::*;

    use super::*;
    use crate::config::{AugmentationConfig, ShiftPer};

    const LAYOUT: Layout = Layout { frame: [1, 1, 2], stack: 3, action_dims: 1 };

    /// Episodes of these lengths; frame `t` of episode `e` holds `[e, t]`, its action and reward `t`.
    fn replay(capacity: usize, lengths: &[usize]) -> Replay {
        let mut replay = Replay::new(LAYOUT, capacity);
        for (episode, &length) in lengths.iter().enumerate() {
            replay.begin_episode(&[episode as u8, 0]).unwrap();
            for time in 0..length {
                let frame = [episode as u8, time as u8 + 1];
                replay.push(&[time as f32], time as f32, false, &frame).unwrap();
            }
            replay.end_episode();
        }
        replay
    }

    #[test]
    fn the_oldest_episodes_are_dropped_whole() {
        let replay = replay(10, &[4, 4, 3]);
        assert_eq!(replay.transitions(), 7);
        assert_eq!(replay.finished().map(|e| e.number()).collect::<Vec<_>>(), [1, 2]);
    }

    #[test]
    fn an_episode_must_fit() {
        let mut replay = replay(3, &[3]);
        replay.begin_episode(&[0, 0]).unwrap();
        for _ in 0..3 {
            replay.push(&[0.], 0., false, &[0, 0]).unwrap();
        }
        let error = replay.push(&[0.], 0., false, &[0, 0]).unwrap_err();
        assert!(matches!(error, Error::EpisodeTooLong { capacity: 3 }));
    }

    /// With one shift per trajectory, all observations of a trajectory are shifted alike.
    #[test]
    fn a_trajectory_can_share_its_shift() {
        let layout = Layout { frame: [1, 1, 9], stack: 1, action_dims: 1 };
        let mut replay = Replay::new(layout, 100);
        let frame = |time: u8| (0..9).map(|column| 10 * time + column).collect::<Vec<u8>>();
        replay.begin_episode(&frame(0)).unwrap();
        (1..9).for_each(|time| replay.push(&[0.], 0., false, &frame(time)).unwrap());
        replay.end_episode();
        let starts = replay.starts(&mut stream(1, "replay"), 40, 4).unwrap();
        let middles = |shift_per| {
            let sampler = Sampler::configured(&AugmentationConfig { pad: 4, shift_per });
            let batch = sampler.batch(&replay, &starts, 4, &mut stream(1, "augment"));
            let middles: Vec<u8> = batch.observations.chunks(9).map(|row| row[4] % 10).collect();
            middles
        };
        let shared = middles(ShiftPer::Trajectory);
        assert!(shared.chunks(40).all(|time| time == &shared[..40]));
        assert!((0..9).all(|column| shared.contains(&column)));
        let own = middles(ShiftPer::Observation);
        assert!(own.chunks(40).skip(1).all(|time| time != &own[..40]));
    }

    #[test]
    fn episodes_in_files_give_the_same_batches() {
        let folder = tempfile::tempdir().unwrap();
        let (memory, mut files) = (replay(100, &[9, 8, 7]), replay(100, &[9, 8, 7]));
        for episode in files.finished().cloned().collect::<Vec<_>>() {
            let path = folder.path().join(episode.number().to_string());
            let tensors = episode.to_tensors(&LAYOUT).unwrap();
            std::fs::write(&path, hksl_core::to_safetensors(&tensors).unwrap()).unwrap();
            files.keep_in_file(episode.number(), &path).unwrap();
        }
        assert!(files.finished().all(|episode| episode.memory_bytes() == 0));
        let sample = |replay: &Replay| {
            let starts = replay.starts(&mut stream(1, "replay"), 20, 4).unwrap();
            Sampler::new(1).batch(replay, &starts, 4, &mut stream(1, "augment")).observations
        };
        assert_eq!(sample(&memory), sample(&files));
        files.keep_in_file(99, Path::new("nowhere")).unwrap();
    }

    #[test]
    fn wrong_sizes_and_missing_episodes_are_errors() {
        let mut replay = Replay::new(LAYOUT, 10);
        assert!(matches!(replay.push(&[0.], 0., false, &[0, 0]), Err(Error::NoEpisode)));
        assert!(matches!(replay.begin_episode(&[0]), Err(Error::Size { got: 1, expected: 2, .. })));
        replay.begin_episode(&[0, 0]).unwrap();
        assert!(replay.push(&[0., 0.], 0., false, &[0, 0]).is_err());
    }

    #[test]
    fn the_file_of_another_episode_is_rejected() {
        let folder = tempfile::tempdir().unwrap();
        let mut replay = replay(100, &[4, 4]);
        let path = folder.path().join("1");
        let tensors = replay.episode(1).to_tensors(&LAYOUT).unwrap();
        std::fs::write(&path, hksl_core::to_safetensors(&tensors).unwrap()).unwrap();
        let message = replay.keep_in_file(0, &path).unwrap_err().to_string();
        assert!(message.contains("does not hold episode 0"), "{message}");
        assert!(replay.episode(0).memory_bytes() > 0);
        replay.keep_in_file(1, &path).unwrap();
    }

    #[test]
    fn short_and_running_episodes_are_not_sampled() {
        let mut replay = replay(100, &[2]);
        assert!(replay.starts(&mut stream(1, "replay"), 1, 3).is_none());
        replay.begin_episode(&[1, 0]).unwrap();
        for _ in 0..5 {
            replay.push(&[0.], 0., false, &[1, 0]).unwrap();
        }
        assert!(replay.starts(&mut stream(1, "replay"), 1, 3).is_none());
        replay.end_episode();
        assert!(replay.starts(&mut stream(1, "replay"), 1, 3).is_some());
    }

    /// Episodes of any length are equally likely, and so are the starts within an episode.
    #[test]
    fn episodes_then_starts_are_uniform() {
        let replay = replay(100, &[3, 10]);
        let starts = replay.starts(&mut stream(1, "replay"), 8000, 3).unwrap();
        let mut counts = [0usize; 9];
        for Start { episode, time } in starts {
            counts[if episode == 0 { 8 } else { time }] += 1;
            assert!(episode == 1 || time == 0);
        }
        assert!((3800..4200).contains(&counts[8]), "{counts:?}");
        assert!(counts[..8].iter().all(|count| (420..580).contains(count)), "{counts:?}");
    }

    proptest! {
        /// A trajectory lies within one stored episode. Each of its observations stacks the frames up to its time, with
        /// the first frame repeated.
        #[test]
        fn trajectories_stay_within_episodes(
            lengths in prop::collection::vec(1usize..12, 1..12),
            capacity in 12usize..40,
            length in 1usize..6,
        ) {
            let replay = replay(capacity, &lengths);
            prop_assert!(replay.transitions() <= capacity);
            let Some(starts) = replay.starts(&mut stream(1, "replay"), 20, length) else {
                return Ok(());
            };
            let sampler = Sampler::new(0);
            let batch = sampler.batch(&replay, &starts, length, &mut stream(1, "augment"));
            for (index, start) in starts.iter().enumerate() {
                let number = replay.episode(start.episode).number() as u8;
                for step in 0..=length {
                    let at = (step * starts.len() + index) * 6;
                    let time = (start.time + step) as u8;
                    let frames = [time.saturating_sub(2), time.saturating_sub(1), time];
                    let expected: Vec<u8> = frames.iter().flat_map(|&t| [number, t]).collect();
                    prop_assert_eq!(&batch.observations[at..at + 6], &expected[..]);
                }
                let actions: Vec<f32> = (0..length).map(|s| (start.time + s) as f32).collect();
                prop_assert_eq!(&batch.actions[index * length..(index + 1) * length], &actions[..]);
            }
        }
    }
}
