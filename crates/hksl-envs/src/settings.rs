//! What is chosen about an environment.

use crate::render::{RenderDevice, RenderSettings};
use crate::{Distraction, Error};

/// What the caller chooses about an environment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Rows of a frame; of the grid itself in Falling Pixels.
    pub height: usize,
    /// Columns of a frame; of the grid itself in Falling Pixels.
    pub width: usize,
    /// The time limit, control steps.
    pub episode_steps: usize,
    /// What distracts in the pictures of a control task.
    pub distraction: Distraction,
    /// How the pictures of a control task are drawn.
    pub render: RenderSettings,
    /// What draws them.
    pub render_device: RenderDevice,
}

impl Settings {
    /// Frames of this size, episodes of this many control steps; nothing that distracts, drawn as dm_control
    /// draws on whatever there is.
    pub const fn new(height: usize, width: usize, episode_steps: usize) -> Self {
        Self {
            height,
            width,
            episode_steps,
            distraction: Distraction::None,
            render: RenderSettings::DM_CONTROL,
            render_device: RenderDevice::Auto { cuda: None },
        }
    }
}

/// Refuses a setting below `least`.
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
