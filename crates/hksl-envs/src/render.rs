//! Off-screen rendering with EGL. Frames equal dm_control's pixel for pixel.

#[cfg(feature = "mujoco")]
mod context;
#[cfg(feature = "mujoco")]
mod description;
#[cfg(feature = "mujoco")]
mod renderer;

use serde::{Deserialize, Serialize};

#[cfg(feature = "mujoco")]
pub use context::devices;
#[cfg(feature = "mujoco")]
pub use description::{RendererDescription, renderer_description};
#[cfg(feature = "mujoco")]
pub(crate) use renderer::{CAMERA, Renderer};

/// Render settings of control tasks. Values other than dm_control's defaults change the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RenderSettings {
    /// Whether to render shadows.
    pub shadows: bool,
    /// Whether to render reflections in the floor.
    pub reflections: bool,
    /// Samples per pixel; 0 disables anti-aliasing.
    pub samples: usize,
    /// Size of the shadow map, pixels.
    pub shadow_map: usize,
}

impl RenderSettings {
    /// dm_control's settings.
    pub const DM_CONTROL: Self =
        Self { shadows: true, reflections: true, samples: 4, shadow_map: 2048 };
}

/// The EGL device for rendering.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RenderDevice {
    /// The device in MUJOCO_EGL_DEVICE_ID if set, else the EGL device of this CUDA device, else the first usable device.
    Auto {
        /// Index of the CUDA device used for training.
        cuda: Option<usize>,
    },
    /// The device with this index.
    Number(usize),
}
