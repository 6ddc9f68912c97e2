//! Frame stacking.

use std::collections::VecDeque;

use ndarray::{Array3, Axis, concatenate};

use crate::{Error, FrameShape};

/// Stacks the last `count` frames into an observation, oldest first.
#[derive(Clone, Debug)]
pub struct FrameStack {
    count: usize,
    shape: FrameShape,
    frames: VecDeque<Array3<u8>>,
}

impl FrameStack {
    /// Creates a stack of `count` frames, black until the first [`FrameStack::reset`]. A count of 0 is treated as 1.
    pub fn new(count: usize, shape: FrameShape) -> Self {
        let count = count.max(1);
        let frames = std::iter::repeat_n(Array3::zeros(shape.dim()), count).collect();
        Self { count, shape, frames }
    }

    /// The shape of an observation, with `count` times the channels of a frame.
    pub fn shape(&self) -> FrameShape {
        FrameShape { channels: self.count * self.shape.channels, ..self.shape }
    }

    /// Starts an episode: fills the stack with the first frame.
    ///
    /// # Errors
    /// A frame of another shape.
    pub fn reset(&mut self, frame: &Array3<u8>) -> Result<(), Error> {
        self.check(frame)?;
        self.frames = std::iter::repeat_n(frame.clone(), self.count).collect();
        Ok(())
    }

    /// Adds a frame and drops the oldest.
    ///
    /// # Errors
    /// A frame of another shape.
    pub fn push(&mut self, frame: &Array3<u8>) -> Result<(), Error> {
        self.check(frame)?;
        self.frames.pop_front();
        self.frames.push_back(frame.clone());
        Ok(())
    }

    /// The observation `(count · channels, height, width)`, oldest frame first.
    pub fn observation(&self) -> Array3<u8> {
        let views: Vec<_> = self.frames.iter().map(|frame| frame.view()).collect();
        // All frames have the stack's shape, so concatenation cannot fail.
        concatenate(Axis(0), &views).unwrap_or_else(|_| Array3::zeros(self.shape().dim()))
    }

    /// The frames, oldest first, as checkpoints save them.
    pub fn frames(&self) -> impl ExactSizeIterator<Item = &Array3<u8>> {
        self.frames.iter()
    }

    /// Restores frames from [`FrameStack::frames`].
    ///
    /// # Errors
    /// Another number of frames, or a frame of another shape.
    pub fn restore(&mut self, frames: Vec<Array3<u8>>) -> Result<(), Error> {
        if frames.len() != self.count {
            return Err(Error::Snapshot {
                task: "the frame stack".to_owned(),
                reason: format!("{} frames, expected {}", frames.len(), self.count),
            });
        }
        frames.iter().try_for_each(|frame| self.check(frame))?;
        self.frames = frames.into();
        Ok(())
    }

    fn check(&self, frame: &Array3<u8>) -> Result<(), Error> {
        if frame.dim() == self.shape.dim() {
            return Ok(());
        }
        Err(Error::FrameShape { expected: self.shape.dim(), got: frame.dim() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPE: FrameShape = FrameShape { channels: 2, height: 1, width: 2 };

    fn frame(value: u8) -> Array3<u8> {
        Array3::from_shape_fn(SHAPE.dim(), |(c, _, x)| value + 10 * c as u8 + x as u8)
    }

    #[test]
    fn reset_fills_every_place_and_push_keeps_the_order() {
        let mut stack = FrameStack::new(3, SHAPE);
        stack.reset(&frame(0)).unwrap();
        assert_eq!(
            stack.observation().iter().copied().collect::<Vec<_>>(),
            [0, 1, 10, 11].repeat(3)
        );
        stack.push(&frame(100)).unwrap();
        let seen: Vec<u8> = stack.observation().iter().copied().collect();
        assert_eq!(seen, [0, 1, 10, 11, 0, 1, 10, 11, 100, 101, 110, 111]);
        assert_eq!(stack.observation().dim(), stack.shape().dim());
    }

    #[test]
    fn rejects_other_shapes_and_counts() {
        let mut stack = FrameStack::new(3, SHAPE);
        assert!(matches!(stack.push(&Array3::zeros((1, 1, 2))), Err(Error::FrameShape { .. })));
        assert!(stack.restore(vec![frame(1); 2]).is_err());
        assert!(stack.restore(vec![Array3::zeros((3, 1, 2)); 3]).is_err());
    }

    #[test]
    fn restored_frames_are_the_saved_ones() {
        let mut stack = FrameStack::new(3, SHAPE);
        stack.reset(&frame(0)).unwrap();
        stack.push(&frame(50)).unwrap();
        let mut other = FrameStack::new(3, SHAPE);
        other.restore(stack.frames().cloned().collect()).unwrap();
        assert_eq!(other.observation(), stack.observation());
    }
}
