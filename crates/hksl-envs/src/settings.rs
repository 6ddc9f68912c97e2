//! Settings of environments.

use crate::render::{RenderDevice, RenderSettings};
use crate::{Distractor, Error};

/// Settings of an environment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Rows of a frame, and of the grid in Falling Pixels.
    pub height: usize,
    /// Columns of a frame, and of the grid in Falling Pixels.
    pub width: usize,
    /// The time limit, control steps.
    pub episode_steps: usize,
    /// Distractor of a control task.
    pub distraction: Distractor,
    /// Render settings of a control task.
    pub render: RenderSettings,
    /// EGL device for rendering.
    pub render_device: RenderDevice,
}

impl Settings {
    /// Settings with this frame size and time limit in control steps, no distractor, dm_control's render settings and the
    /// default device.
    pub const fn new(height: usize, width: usize, episode_steps: usize) -> Self {
        Self {
            height,
            width,
            episode_steps,
            distraction: Distractor::None,
            render: RenderSettings::DM_CONTROL,
            render_device: RenderDevice::Auto { cuda: None },
        }
    }
}

/// Checks that a setting is at least `least`.
pub(crate) fn check_setting(
    task: &str,
    name: &'static str,
    value: usize,
    least: usize,
) -> Result<(), Error> {
    if value >= least {
        return Ok(());
    }
    let expected = format!("at least {least}");
    Err(Error::Setting { task: task.to_owned(), name, value: value.to_string(), expected })
}
