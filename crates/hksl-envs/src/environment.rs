//! What every environment offers, and the shapes it declares.

use ndarray::Array3;
use serde_json::Value;

use crate::Error;

/// The shape of one frame: 8-bit, channels first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameShape {
    /// Colour channels: 3 (red, green, blue) or 1.
    pub channels: usize,
    /// Rows, counted from the top.
    pub height: usize,
    /// Columns, counted from the left.
    pub width: usize,
}

impl FrameShape {
    /// `(channels, height, width)`, as ndarray wants it.
    pub fn dim(&self) -> (usize, usize, usize) {
        (self.channels, self.height, self.width)
    }

    /// Bytes in one frame.
    pub fn len(&self) -> usize {
        self.channels * self.height * self.width
    }

    /// True if a frame of this shape holds nothing.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// One named ground-truth quantity that [`Environment::readings`] reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadingSpec {
    /// Its name, as files and reports write it.
    pub name: &'static str,
    /// The unit of its numbers.
    pub unit: &'static str,
    /// How many numbers it has.
    pub len: usize,
}

/// What an environment is, fixed for its life.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Spec {
    /// The task's name in the registry.
    pub task: String,
    /// The shape of a frame.
    pub frame: FrameShape,
    /// Numbers in an action, each in `[-1, 1]`.
    pub action_dims: usize,
    /// Calls of [`Environment::step`] until the time limit ends an episode.
    pub steps_per_episode: usize,
    /// The ground truth on offer.
    pub readings: Vec<ReadingSpec>,
}

/// Where a simulation is.
#[derive(Clone, Debug, PartialEq)]
pub struct PhysicalState {
    /// Generalised positions, m and rad.
    pub qpos: Vec<f64>,
    /// Generalised velocities, m/s and rad/s.
    pub qvel: Vec<f64>,
}

/// What one step brought.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// The reward of the step.
    pub reward: f64,
    /// The decision process ended here: the value of what follows is zero, do not bootstrap.
    pub terminal: bool,
    /// The episode is over, by a terminal state or by the time limit; reset before the next step.
    pub last: bool,
}

/// A task to act in, one step at a time.
pub trait Environment {
    /// Its name, shapes and length of episode.
    fn spec(&self) -> &Spec;

    /// Starts the next episode. Draws continue from where the previous episode left them.
    ///
    /// # Errors
    /// A physics warning in the start state; no start state in which nothing touches.
    fn reset(&mut self) -> Result<(), Error>;

    /// Applies one action, of [`Spec::action_dims`] numbers in [−1, 1]. Those beyond are not refused: MuJoCo cuts the push
    /// off there, and a reward may see the number as given.
    ///
    /// # Errors
    /// An action of the wrong length or with a number that is not finite, a step before the first
    /// reset (or after a failure and before the next one) or after the last step of an episode, a physics warning.
    fn step(&mut self, action: &[f32]) -> Result<Step, Error>;

    /// Draws the current state: `(channels, height, width)`. Drawing changes no state.
    ///
    /// # Errors
    /// A frame before the first reset; missing or failing graphics; a picture larger than the driver draws. Where the
    /// driver's memory does not hold the picture, MuJoCo ends the process.
    fn frame(&mut self) -> Result<Array3<u8>, Error>;

    /// The ground truth of the current state, aligned with [`Spec::readings`].
    fn readings(&self) -> Vec<Vec<f64>>;

    /// Generalised positions and velocities, in the model's order, where there is physics.
    fn physical_state(&self) -> Option<PhysicalState> {
        None
    }

    /// Everything that the future depends on, position of the random stream included: an
    /// environment of the same settings that restores it goes on bit for bit.
    ///
    /// # Errors
    /// A state that cannot be written down.
    fn snapshot(&self) -> Result<Value, Error>;

    /// Takes over a state that [`Environment::snapshot`] gave; the settings stay this environment's own.
    ///
    /// # Errors
    /// A snapshot that does not fit: of another task or kind of distractor, outside what the settings allow (grid,
    /// length of episode, colours, views), or damaged. The state is then unchanged, or unusable until the next reset.
    fn restore(&mut self, snapshot: &Value) -> Result<(), Error>;
}

impl<E: Environment + ?Sized> Environment for Box<E> {
    fn spec(&self) -> &Spec {
        (**self).spec()
    }
    fn reset(&mut self) -> Result<(), Error> {
        (**self).reset()
    }
    fn step(&mut self, action: &[f32]) -> Result<Step, Error> {
        (**self).step(action)
    }
    fn frame(&mut self) -> Result<Array3<u8>, Error> {
        (**self).frame()
    }
    fn readings(&self) -> Vec<Vec<f64>> {
        (**self).readings()
    }
    fn physical_state(&self) -> Option<PhysicalState> {
        (**self).physical_state()
    }
    fn snapshot(&self) -> Result<Value, Error> {
        (**self).snapshot()
    }
    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        (**self).restore(snapshot)
    }
}

/// Refuses an action of the wrong length or with numbers that are not finite.
pub(crate) fn check_action(action: &[f32], spec: &Spec) -> Result<(), Error> {
    let task = || spec.task.clone();
    if action.len() != spec.action_dims {
        let (expected, got) = (spec.action_dims, action.len());
        return Err(Error::ActionLength { task: task(), expected, got });
    }
    match action.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(Error::ActionNotFinite { task: task(), index, value: action[index] }),
        None => Ok(()),
    }
}
