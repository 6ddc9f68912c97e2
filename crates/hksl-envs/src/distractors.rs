//! Distractors of the Distracting Control Suite (Stone et al., arXiv 2101.02722): pictures change in ways that
//! have nothing to do with the task. Physics and rewards never see them.
//!
//! A distractor draws from a stream of its own, so that a task's episodes are the same with and without it. It is
//! drawn anew at each reset and advances once a control step.

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

/// What distracts in a task's pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Distraction {
    /// Nothing.
    #[default]
    None,
    /// The materials' colours walk.
    Color(ColorSettings),
    /// The camera wanders.
    Camera(CameraSettings),
}

/// How far and how fast colours walk; components of a colour run from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColorSettings {
    /// Largest distance of a component from its own value.
    pub max_delta: f64,
    /// Standard deviation of a component's step, once a control step; 0: still colours.
    pub step_std: f64,
}

impl ColorSettings {
    /// Refuses what no walk can be made of.
    #[cfg(feature = "mujoco")]
    fn check(&self, task: &str) -> Result<(), Error> {
        check(task, "max_delta", self.max_delta, 1.0)?;
        check(task, "step_std", self.step_std, MANY)
    }

    /// The same colours, standing still during an episode.
    pub fn still(self) -> Self {
        Self { step_std: 0.0, ..self }
    }
}

/// How far and how fast the camera wanders on the sphere around the scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraSettings {
    /// Largest turn about the vertical, either way; rad.
    pub horizontal_delta: f64,
    /// Largest turn up or down; rad.
    pub vertical_delta: f64,
    /// Largest roll about the line of sight, either way; rad.
    pub roll_delta: f64,
    /// Standard deviation of a change of velocity, in quarters of the camera's distance, once a control step.
    pub velocity_std: f64,
    /// Largest velocity, in quarters of the camera's distance a control step.
    pub max_velocity: f64,
    /// Standard deviation of a change of the roll's velocity; rad a control step.
    pub roll_velocity_std: f64,
    /// Largest velocity of the roll; rad a control step.
    pub max_roll_velocity: f64,
    /// Largest approach, as a share of the camera's distance.
    pub max_zoom_in: f64,
    /// Largest retreat, as a share of the camera's distance.
    pub max_zoom_out: f64,
}

impl CameraSettings {
    /// Refuses what no walk can be made of: at a zoom of 1 the sphere may shrink to its centre, where no direction is
    /// left.
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
            check(task, name, value, MANY)?;
        }
        Ok(())
    }

    /// The same views, standing still during an episode.
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

/// Far beyond what makes sense, and far from where rounding would.
#[cfg(feature = "mujoco")]
const MANY: f64 = 1000.0;

/// Refuses NaN and a number outside 0 to `most`.
#[cfg(feature = "mujoco")]
fn check(task: &str, name: &'static str, value: f64, most: f64) -> Result<(), Error> {
    if (0.0..=most).contains(&value) {
        return Ok(());
    }
    let expected = format!("a number from 0 to {most}");
    Err(Error::Setting { task: task.to_owned(), name, value: value.to_string(), expected })
}
