//! The spaces of another program's environment.

use ndarray::{Array3, ArrayViewD, Axis, Ix3};
use serde::{Deserialize, Serialize};

use crate::{Error, FrameShape};

/// A space as its program declares it.
#[derive(Clone, Debug, PartialEq)]
pub enum Space {
    /// Arrays of one shape.
    Box {
        /// Type of the elements, in NumPy's words.
        dtype: String,
        /// Shape.
        shape: Vec<usize>,
        /// Lower bound of each element in row-major order, or one for all.
        low: Vec<f64>,
        /// Upper bounds, likewise.
        high: Vec<f64>,
    },
    /// Any other kind of space, in its program's words.
    Other(String),
}

/// What a program declares of its environment.
#[derive(Clone, Debug, PartialEq)]
pub struct Declaration {
    /// Name of the task.
    pub task: String,
    /// Space of observations.
    pub observation: Space,
    /// Space of actions.
    pub action: Space,
}

/// The order of a frame's axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Axes {
    /// `(height, width, channels)`.
    ChannelsLast,
    /// `(channels, height, width)`.
    ChannelsFirst,
    /// `(height, width)`.
    Grey,
}

/// Checked spaces: the shape of frames and the bounds of actions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Interface {
    /// Name of the task.
    pub task: String,
    /// The shape of a frame, channels first.
    pub frame: FrameShape,
    axes: Axes,
    /// The shape of an action as the program declares it.
    pub action_shape: Vec<usize>,
    low: Vec<f64>,
    high: Vec<f64>,
}

const RESIZE: &str = "use a wrapper, such as gymnasium.wrappers.ResizeObservation";

impl Interface {
    /// Checks the declaration.
    ///
    /// Frames are `uint8` with 1 or 3 channels. A shape of two axes is `(height, width)`. In a shape of three, the
    /// channels are last if the last axis has 1 or 3 elements, else first.
    ///
    /// # Errors
    /// [`Error::Space`].
    pub fn new(declaration: &Declaration) -> Result<Self, Error> {
        let Declaration { task, observation, action } = declaration;
        let (frame, axes) = frames(task, observation)?;
        let (action_shape, low, high) = bounds(task, action)?;
        Ok(Self { task: task.clone(), frame, axes, action_shape, low, high })
    }

    /// Numbers in an action.
    pub fn action_dims(&self) -> usize {
        self.low.len()
    }

    /// Scales an action from [−1, 1] to the declared bounds.
    pub fn action(&self, action: &[f32]) -> Vec<f64> {
        let bounds = self.low.iter().zip(&self.high);
        let scaled = |(component, (&low, &high)): (&f32, (&f64, &f64))| {
            let share = (f64::from(*component).clamp(-1.0, 1.0) + 1.0) / 2.0;
            (low + share * (high - low)).clamp(low, high)
        };
        action.iter().zip(bounds).map(scaled).collect()
    }

    /// Scales an action within the declared bounds to [−1, 1].
    pub fn scaled(&self, action: &[f64]) -> Vec<f32> {
        let bounds = self.low.iter().zip(&self.high);
        let scaled = |(component, (low, high)): (&f64, (&f64, &f64))| {
            ((2.0 * (component - low) / (high - low) - 1.0) as f32).clamp(-1.0, 1.0)
        };
        action.iter().zip(bounds).map(scaled).collect()
    }

    /// Copies a frame, and moves its channels to the front.
    ///
    /// # Errors
    /// [`Error::ExternalFrame`] for another shape than the declared one.
    pub fn frame(&self, frame: ArrayViewD<u8>) -> Result<Array3<u8>, Error> {
        let wrong = || self.wrong_frame(frame.shape());
        if frame.shape() != self.frame_shape() {
            return Err(wrong());
        }
        let frame = match self.axes {
            Axes::Grey => frame.clone().insert_axis(Axis(0)),
            Axes::ChannelsFirst => frame.clone(),
            Axes::ChannelsLast => frame.clone().permuted_axes(vec![2, 0, 1]),
        };
        let frame = frame.into_dimensionality::<Ix3>().map_err(|_| wrong())?;
        Ok(frame.as_standard_layout().into_owned())
    }

    /// The shape of a frame as the program declares it.
    pub fn frame_shape(&self) -> Vec<usize> {
        let FrameShape { channels, height, width } = self.frame;
        match self.axes {
            Axes::ChannelsLast => vec![height, width, channels],
            Axes::ChannelsFirst => vec![channels, height, width],
            Axes::Grey => vec![height, width],
        }
    }

    pub(super) fn wrong_frame(&self, got: &[usize]) -> Error {
        let (task, expected) = (self.task.clone(), self.frame_shape());
        Error::ExternalFrame { task, expected, got: got.to_vec() }
    }
}

fn frames(task: &str, space: &Space) -> Result<(FrameShape, Axes), Error> {
    let refused = |got: String, expected: &str| Error::Space {
        task: task.to_owned(),
        space: "observation space",
        got,
        expected: expected.to_owned(),
    };
    let (dtype, shape) = match space {
        Space::Box { dtype, shape, .. } => (dtype, shape.as_slice()),
        Space::Other(got) => {
            return Err(refused(
                got.clone(),
                "a Box of images; select the images of the observation, or see the environment through \
                 gymnasium.wrappers.AddRenderObservation",
            ));
        }
    };
    let (frame, axes) = match *shape {
        [height, width] if height > 1 && width > 1 => {
            (FrameShape { channels: 1, height, width }, Axes::Grey)
        }
        [height, width, channels @ (1 | 3)] => {
            (FrameShape { channels, height, width }, Axes::ChannelsLast)
        }
        [channels @ (1 | 3), height, width] => {
            (FrameShape { channels, height, width }, Axes::ChannelsFirst)
        }
        [_, _, _] => {
            return Err(refused(
                format!("a Box of shape {shape:?}"),
                "single images with 1 or 3 channels; leave frame stacking to hksl, which stacks \
                 environment.frame_stack frames, and drop an alpha channel",
            ));
        }
        _ => {
            return Err(refused(
                format!("a Box of shape {shape:?}"),
                "images, (height, width), (height, width, channels) or (channels, height, width); see the environment \
                 through gymnasium.wrappers.AddRenderObservation",
            ));
        }
    };
    if dtype != "uint8" {
        return Err(refused(
            format!("a Box of {dtype}"),
            "images of uint8, from 0 to 255; convert them with gymnasium.wrappers.TransformObservation",
        ));
    }
    if frame.height < MINIMUM_SIDE || frame.width < MINIMUM_SIDE {
        return Err(refused(
            format!("images of {}×{} pixels", frame.height, frame.width),
            &format!(
                "at least {MINIMUM_SIDE}×{MINIMUM_SIDE} pixels, which the encoder's convolutions need; {RESIZE}"
            ),
        ));
    }
    Ok((frame, axes))
}

/// The smallest side of an image that leaves one pixel after the encoder's convolutions; a test of hksl-train compares it
/// with the encoder's.
pub const MINIMUM_SIDE: usize = 15;

type Bounds = (Vec<usize>, Vec<f64>, Vec<f64>);

fn bounds(task: &str, space: &Space) -> Result<Bounds, Error> {
    let refused = |got: String, expected: &str| Error::Space {
        task: task.to_owned(),
        space: "action space",
        got,
        expected: expected.to_owned(),
    };
    let (dtype, shape, low, high) = match space {
        Space::Box { dtype, shape, low, high } => (dtype, shape, low, high),
        Space::Other(got) => {
            return Err(refused(
                got.clone(),
                "a Box; hksl's methods choose continuous actions, so give the environment a continuous action space",
            ));
        }
    };
    if !dtype.starts_with("float") {
        return Err(refused(
            format!("a Box of {dtype}"),
            "a Box of float32 or float64; round the actions in the environment",
        ));
    }
    let dims: usize = shape.iter().product();
    if dims == 0 {
        return Err(refused(format!("a Box of shape {shape:?}"), "at least one number"));
    }
    let each = |bounds: &[f64]| match bounds {
        [one] => vec![*one; dims],
        bounds => bounds.to_vec(),
    };
    let (low, high) = (each(low), each(high));
    for (index, (low, high)) in low.iter().zip(&high).enumerate() {
        if !low.is_finite() || !high.is_finite() {
            return Err(refused(
                format!("unbounded, from {low} to {high} at index {index}"),
                "finite bounds, to which hksl scales its actions from [-1, 1]; use gymnasium.wrappers.RescaleAction or \
                 declare bounds",
            ));
        }
        if low >= high {
            return Err(refused(
                format!("empty, from {low} to {high} at index {index}"),
                "a lower bound below the upper bound",
            ));
        }
    }
    Ok((shape.clone(), low, high))
}
