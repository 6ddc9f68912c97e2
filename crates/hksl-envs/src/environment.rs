//! The trait of environments, and their specifications.

use std::borrow::Cow;

use ndarray::Array3;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::Error;

/// The shape of one frame: 8-bit, channels first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameShape {
    /// Colour channels: 3 (red, green, blue) or 1.
    pub channels: usize,
    /// Rows, counted from the top.
    pub height: usize,
    /// Columns, counted from the left.
    pub width: usize,
}

impl FrameShape {
    /// `(channels, height, width)`, as ndarray dimensions.
    pub fn dim(&self) -> (usize, usize, usize) {
        (self.channels, self.height, self.width)
    }

    /// Bytes in one frame.
    pub fn len(&self) -> usize {
        self.channels * self.height * self.width
    }

    /// Whether a frame of this shape has no bytes.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Specification of a ground-truth quantity in [`Environment::readings`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReadingSpec {
    /// Its name in files and reports.
    pub name: Cow<'static, str>,
    /// The unit of its components; empty if unknown.
    pub unit: Cow<'static, str>,
    /// Number of components.
    pub len: usize,
}

impl ReadingSpec {
    /// A reading of a task that is part of this program.
    pub const fn new(name: &'static str, unit: &'static str, len: usize) -> Self {
        Self { name: Cow::Borrowed(name), unit: Cow::Borrowed(unit), len }
    }
}

/// Specification of an environment. It does not change.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    /// The task's name in the registry.
    pub task: String,
    /// The shape of a frame.
    pub frame: FrameShape,
    /// Action dimensions, each in `[-1, 1]`.
    pub action_dims: usize,
    /// Time limit: number of [`Environment::step`] calls per episode.
    pub steps_per_episode: usize,
    /// The ground-truth readings.
    pub readings: Vec<ReadingSpec>,
}

/// Positions and velocities of a simulation.
#[derive(Clone, Debug, PartialEq)]
pub struct PhysicalState {
    /// Generalised positions, m and rad.
    pub qpos: Vec<f64>,
    /// Generalised velocities, m/s and rad/s.
    pub qvel: Vec<f64>,
}

/// Result of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// The reward of the step.
    pub reward: f64,
    /// Whether the new state is terminal: its value is zero, without bootstrapping.
    pub terminal: bool,
    /// Whether the episode ended, by a terminal state or by truncation at the time limit. The next call must be a reset.
    pub last: bool,
}

/// A task for an agent.
pub trait Environment {
    /// Name, shapes and episode length.
    fn spec(&self) -> &Spec;

    /// Starts the next episode. The RNG continues from the previous episode.
    ///
    /// # Errors
    /// A physics warning in the start state; no start state without contacts found.
    fn reset(&mut self) -> Result<(), Error>;

    /// Applies one action with [`Spec::action_dims`] components in [−1, 1]. Components outside are accepted: MuJoCo clips the
    /// control, but a reward may use the unclipped value.
    ///
    /// # Errors
    /// An action of the wrong length, or with NaN or infinity; a step before the first reset, after a failure or after the
    /// last step of an episode; a physics warning.
    fn step(&mut self, action: &[f32]) -> Result<Step, Error>;

    /// Renders the current state as `(channels, height, width)`. Rendering does not change the state.
    ///
    /// # Errors
    /// A frame before the first reset; missing or failing graphics; a frame larger than the driver supports. If the driver
    /// runs out of memory, MuJoCo terminates the process.
    fn frame(&mut self) -> Result<Array3<u8>, Error>;

    /// The ground truth of the current state, in the order of [`Spec::readings`].
    fn readings(&self) -> Vec<Vec<f64>>;

    /// Generalised positions and velocities in the model's order. None for environments without physics.
    fn physical_state(&self) -> Option<PhysicalState> {
        None
    }

    /// The complete state, including the RNG position. An environment with the same settings that restores it continues
    /// bitwise identically.
    ///
    /// # Errors
    /// A state that cannot be serialised.
    fn snapshot(&self) -> Result<Value, Error>;

    /// Restores a state from [`Environment::snapshot`]. The settings do not change.
    ///
    /// # Errors
    /// A snapshot of another task or distractor, outside the settings (grid, episode length, colours, views), or invalid. The
    /// state is then unchanged, or unusable until the next reset.
    fn restore(&mut self, snapshot: &Value) -> Result<(), Error>;

    /// Whether [`Environment::restore`] continues the episode. If not, it restores what the next episode depends on, and
    /// the next call must be a reset: environments of other programs cannot be restored in the middle of an episode.
    fn restores_episodes(&self) -> bool {
        true
    }
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
    fn restores_episodes(&self) -> bool {
        (**self).restores_episodes()
    }
}

/// Checks an action's length and that its components are finite.
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
