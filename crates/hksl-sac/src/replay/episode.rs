//! An episode of the replay.

use std::collections::BTreeMap;
use std::path::Path;

use candle_core::{DType, Device, Tensor};

use super::frames::{Frames, invalid_replay};
use crate::Result;
use crate::replay::Layout;

/// Name of the tensor of frames.
const FRAMES: &str = "frames";

/// An episode: `T` transitions and `T + 1` frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Episode {
    number: u64,
    frames: Frames,
    actions: Vec<f32>,
    rewards: Vec<f32>,
    terminal: Vec<u8>,
}

impl Episode {
    pub(super) fn new(number: u64, frame: &[u8]) -> Self {
        let (actions, rewards, terminal) = (Vec::new(), Vec::new(), Vec::new());
        Self { number, frames: Frames::Memory(frame.to_vec()), actions, rewards, terminal }
    }

    pub(super) fn push(&mut self, action: &[f32], reward: f32, terminal: bool, frame: &[u8]) {
        self.frames.extend(frame);
        self.actions.extend_from_slice(action);
        self.rewards.push(reward);
        self.terminal.push(u8::from(terminal));
    }

    /// Frees the spare capacity of the frame buffer.
    pub(super) fn finish(&mut self) {
        self.frames.shrink_to_fit();
    }

    /// The episode's index in the run, from 0.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// Number of transitions, `T`.
    pub fn len(&self) -> usize {
        self.rewards.len()
    }

    /// Whether the episode has no transition.
    pub fn is_empty(&self) -> bool {
        self.rewards.is_empty()
    }

    /// Bytes of memory that the frames use; 0 for frames in a file.
    pub fn memory_bytes(&self) -> usize {
        self.frames.memory()
    }

    /// The frame at a time from 0 to `T`.
    ///
    /// # Panics
    /// If `time` is out of range.
    pub fn frame(&self, time: usize) -> &[u8] {
        let frames = self.frames.bytes();
        let bytes = frames.len() / (self.len() + 1);
        &frames[time * bytes..(time + 1) * bytes]
    }

    /// The actions of `count` transitions starting at `from`, concatenated.
    pub fn actions(&self, from: usize, count: usize) -> &[f32] {
        let dims = self.actions.len() / self.len().max(1);
        &self.actions[from * dims..(from + count) * dims]
    }

    /// The rewards of `count` transitions starting at `from`.
    pub fn rewards(&self, from: usize, count: usize) -> &[f32] {
        &self.rewards[from..from + count]
    }

    /// The not-done flags of `count` transitions starting at `from`: 0 for a terminal transition, 1 otherwise.
    pub fn not_done(&self, from: usize, count: usize) -> impl Iterator<Item = f32> {
        self.terminal[from..from + count].iter().map(|&terminal| f32::from(1 - terminal))
    }

    /// Converts the episode to tensors: `frames` (T+1, C, H, W) u8, `actions` (T, A) and `rewards` (T) f32, `terminal` (T)
    /// u8, `number` (1) i64.
    pub fn to_tensors(&self, layout: &Layout) -> Result<BTreeMap<String, Tensor>> {
        let (device, [c, h, w], length) = (&Device::Cpu, layout.frame, self.len());
        let number = i64::try_from(self.number).unwrap_or(i64::MAX);
        Ok(BTreeMap::from([
            (
                FRAMES.into(),
                Tensor::from_slice(self.frames.bytes(), (length + 1, c, h, w), device)?,
            ),
            (
                "actions".into(),
                Tensor::from_slice(&self.actions, (length, layout.action_dims), device)?,
            ),
            ("rewards".into(), Tensor::from_slice(&self.rewards, length, device)?),
            ("terminal".into(), Tensor::from_slice(&self.terminal, length, device)?),
            ("number".into(), Tensor::new(&[number], device)?),
        ]))
    }

    /// Creates an episode from the tensors of [`Self::to_tensors`].
    ///
    /// # Errors
    /// [`crate::Error::SavedState`] if a tensor is missing, has another type or does not fit the layout.
    pub fn from_tensors(tensors: &BTreeMap<String, Tensor>, layout: &Layout) -> Result<Self> {
        let frames = tensors.get(FRAMES).ok_or_else(|| invalid_replay(format!("no `{FRAMES}`")))?;
        if frames.dtype() != DType::U8 {
            return Err(invalid_replay(format!("`{FRAMES}` is {:?}, not U8", frames.dtype())));
        }
        Self::assemble(tensors, Frames::Memory(frames.flatten_all()?.to_vec1()?), layout)
    }

    /// Opens an episode in a safetensors file of [`Self::to_tensors`]. Its frames stay in the file, mapped into memory. The
    /// file must not be modified while the episode exists; otherwise reading the frames is undefined behaviour. The file
    /// may be deleted, or replaced by renaming another file to its name.
    ///
    /// # Errors
    /// [`crate::Error::Read`] if the file cannot be read or mapped; [`crate::Error::SavedState`] if a tensor is missing, has
    /// another type or does not fit the layout.
    pub fn open(path: &Path, layout: &Layout) -> Result<Self> {
        let (frames, tensors) = Frames::open(path, FRAMES)?;
        Self::assemble(&tensors, frames, layout)
    }

    fn assemble(
        tensors: &BTreeMap<String, Tensor>,
        frames: Frames,
        layout: &Layout,
    ) -> Result<Self> {
        let find = |name: &str, dtype: DType| {
            let tensor = tensors.get(name).ok_or_else(|| invalid_replay(format!("no `{name}`")))?;
            if tensor.dtype() == dtype {
                Ok(tensor.flatten_all()?)
            } else {
                Err(invalid_replay(format!("`{name}` is {:?}, not {dtype:?}", tensor.dtype())))
            }
        };
        let number = match find("number", DType::I64)?.to_vec1::<i64>()?[..] {
            [number] => u64::try_from(number)
                .map_err(|_| invalid_replay(format!("`number` is {number}, not a count")))?,
            ref numbers => return Err(invalid_replay(format!("`number` is {numbers:?}, not one"))),
        };
        let episode = Self {
            number,
            frames,
            actions: find("actions", DType::F32)?.to_vec1()?,
            rewards: find("rewards", DType::F32)?.to_vec1()?,
            terminal: find("terminal", DType::U8)?.to_vec1()?,
        };
        episode.check(layout)?;
        Ok(episode)
    }

    pub(super) fn check(&self, layout: &Layout) -> Result<()> {
        let length = self.len();
        for (what, got, expected) in [
            ("bytes of frames", self.frames.bytes().len(), (length + 1) * layout.frame_bytes()),
            ("numbers of actions", self.actions.len(), length * layout.action_dims),
            ("terminal flags", self.terminal.len(), length),
        ] {
            if got != expected {
                return Err(invalid_replay(format!(
                    "episode {} has {got} {what}, expected {expected}",
                    self.number
                )));
            }
        }
        let numbers = self.actions.iter().chain(&self.rewards);
        if let Some(number) = numbers.into_iter().find(|number| !number.is_finite()) {
            let reason = format!("episode {} has an action or reward {number}", self.number);
            return Err(invalid_replay(reason));
        }
        if self.terminal.iter().any(|&flag| flag > 1) {
            return Err(invalid_replay(format!(
                "episode {} has a terminal flag above 1",
                self.number
            )));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAYOUT: Layout = Layout { frame: [1, 1, 2], stack: 3, action_dims: 2 };

    fn episode() -> Episode {
        let mut episode = Episode::new(7, &[1, 2]);
        episode.push(&[0.5, -0.5], 1.0, false, &[3, 4]);
        episode.push(&[0.25, 0.0], 2.0, true, &[5, 6]);
        episode
    }

    #[test]
    fn round_trips_through_tensors() {
        let tensors = episode().to_tensors(&LAYOUT).unwrap();
        assert_eq!(Episode::from_tensors(&tensors, &LAYOUT).unwrap(), episode());
        assert_eq!(episode().not_done(0, 2).collect::<Vec<_>>(), [1.0, 0.0]);
    }

    #[test]
    fn round_trips_through_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("episode");
        let bytes = hksl_core::to_safetensors(&episode().to_tensors(&LAYOUT).unwrap()).unwrap();
        std::fs::write(&path, &bytes).unwrap();
        let opened = Episode::open(&path, &LAYOUT).unwrap();
        // The mapping remains valid after the file is deleted.
        std::fs::remove_file(&path).unwrap();
        assert_eq!(opened, episode());
        for cut in [0, 7, 40, bytes.len() - 1] {
            std::fs::write(&path, &bytes[..cut]).unwrap();
            assert!(Episode::open(&path, &LAYOUT).is_err(), "cut to {cut} bytes");
        }
    }

    #[test]
    fn invalid_tensors_are_errors() {
        let mut tensors = episode().to_tensors(&LAYOUT).unwrap();
        tensors.insert("rewards".into(), Tensor::zeros(3, DType::F32, &Device::Cpu).unwrap());
        let message = Episode::from_tensors(&tensors, &LAYOUT).unwrap_err().to_string();
        assert!(message.contains("episode 7"), "{message}");
        tensors.remove("frames");
        let message = Episode::from_tensors(&tensors, &LAYOUT).unwrap_err().to_string();
        assert!(message.contains("no `frames`"), "{message}");
        for (name, values) in
            [("rewards", vec![f32::NAN, 0.0]), ("actions", vec![f32::INFINITY; 4])]
        {
            let mut tensors = episode().to_tensors(&LAYOUT).unwrap();
            let shape = tensors[name].shape().clone();
            tensors.insert(name.into(), Tensor::from_vec(values, shape, &Device::Cpu).unwrap());
            assert!(Episode::from_tensors(&tensors, &LAYOUT).is_err(), "{name}");
        }
        let mut tensors = episode().to_tensors(&LAYOUT).unwrap();
        tensors.insert("number".into(), Tensor::new(&[-1i64], &Device::Cpu).unwrap());
        assert!(Episode::from_tensors(&tensors, &LAYOUT).is_err());
    }
}
