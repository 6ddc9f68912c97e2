//! Distractors of the Distracting Control Suite (Stone et al., arXiv 2101.02722): changes of the frames that are unrelated
//! to the task and do not affect physics and rewards.
//!
//! A distractor has its own RNG stream, so a task's episodes are the same with and without it. It is drawn anew at each
//! reset and advances once per control step.

#[cfg(feature = "mujoco")]
mod camera;
#[cfg(feature = "mujoco")]
mod color;
#[cfg(feature = "mujoco")]
mod distracted;
#[cfg(all(test, feature = "mujoco"))]
mod tests;

use serde::{Deserialize, Serialize};

#[cfg(feature = "mujoco")]
use crate::Error;
#[cfg(feature = "mujoco")]
pub use distracted::Distracted;

/// The distractor of a task.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Distractor {
    /// No distractor.
    #[default]
    None,
    /// Random walk of the materials' colours.
    Color(ColorSettings),
    /// Random walk of the camera.
    Camera(CameraSettings),
}

/// Settings of the colour walk. Colour components range from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColorSettings {
    /// Maximal distance of a component from its original value.
    pub max_delta: f64,
    /// Standard deviation of a component's change per control step. 0 keeps colours constant during an episode.
    pub step_std: f64,
}

impl ColorSettings {
    /// Checks that the settings are in range.
    #[cfg(feature = "mujoco")]
    fn check(&self, task: &str) -> Result<(), Error> {
        check(task, "max_delta", self.max_delta, 1.0)?;
        check(task, "step_std", self.step_std, MAX_SETTING)
    }

    /// The same settings with colours constant during an episode.
    pub fn still(self) -> Self {
        Self { step_std: 0.0, ..self }
    }
}

/// Settings of the camera walk on a sphere around the scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraSettings {
    /// Maximal rotation about the vertical in either direction, rad.
    pub horizontal_delta: f64,
    /// Maximal rotation up or down, rad.
    pub vertical_delta: f64,
    /// Maximal roll about the line of sight in either direction, rad.
    pub roll_delta: f64,
    /// Standard deviation of the change of velocity per control step, in quarters of the camera's distance.
    pub velocity_std: f64,
    /// Maximal velocity, in quarters of the camera's distance per control step.
    pub max_velocity: f64,
    /// Standard deviation of the change of the roll velocity, rad per control step.
    pub roll_velocity_std: f64,
    /// Maximal roll velocity, rad per control step.
    pub max_roll_velocity: f64,
    /// Maximal zoom in, as a fraction of the camera's distance.
    pub max_zoom_in: f64,
    /// Maximal zoom out, as a fraction of the camera's distance.
    pub max_zoom_out: f64,
}

impl CameraSettings {
    /// Checks that the settings are in range. At a zoom of 1 the camera could reach the sphere's centre, where it has no
    /// direction.
    #[cfg(feature = "mujoco")]
    fn check(&self, task: &str) -> Result<(), Error> {
        let zoom = self.max_zoom_in;
        if !(0.0..1.0).contains(&zoom) {
            let expected = "a number from 0 to below 1".to_owned();
            let (task, value) = (task.to_owned(), zoom.to_string());
            return Err(Error::Setting { task, name: "max_zoom_in", value, expected });
        }
        for (name, value) in [
            ("horizontal_delta", self.horizontal_delta),
            ("vertical_delta", self.vertical_delta),
            ("roll_delta", self.roll_delta),
            ("velocity_std", self.velocity_std),
            ("max_velocity", self.max_velocity),
            ("roll_velocity_std", self.roll_velocity_std),
            ("max_roll_velocity", self.max_roll_velocity),
            ("max_zoom_out", self.max_zoom_out),
        ] {
            check(task, name, value, MAX_SETTING)?;
        }
        Ok(())
    }

    /// The same settings with a camera that does not move during an episode.
    pub fn still(self) -> Self {
        Self {
            velocity_std: 0.0,
            max_velocity: 0.0,
            roll_velocity_std: 0.0,
            max_roll_velocity: 0.0,
            ..self
        }
    }
}

/// Upper limit of settings: beyond all useful values, and small enough for exact arithmetic.
#[cfg(feature = "mujoco")]
const MAX_SETTING: f64 = 1000.0;

/// Checks that a value lies in [0, `most`] and is not NaN.
#[cfg(feature = "mujoco")]
fn check(task: &str, name: &'static str, value: f64, most: f64) -> Result<(), Error> {
    if (0.0..=most).contains(&value) {
        return Ok(());
    }
    let expected = format!("a number from 0 to {most}");
    Err(Error::Setting { task: task.to_owned(), name, value: value.to_string(), expected })
}
