//! Off-screen drawing through EGL, pixel for pixel as dm_control draws.

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

/// How pictures of control tasks are drawn; the defaults are dm_control's. Anything else is another picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RenderSettings {
    /// Whether things cast shadows.
    pub shadows: bool,
    /// Whether the floor mirrors.
    pub reflections: bool,
    /// Samples a pixel; 0: no anti-aliasing.
    pub samples: usize,
    /// Side of the shadow map; pixels.
    pub shadow_map: usize,
}

impl RenderSettings {
    /// dm_control's.
    pub const DM_CONTROL: Self =
        Self { shadows: true, reflections: true, samples: 4, shadow_map: 2048 };
}

/// Which of EGL's devices draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RenderDevice {
    /// What the variable MUJOCO_EGL_DEVICE_ID says; else the one that is this CUDA device; else the first that works.
    Auto {
        /// The number of the CUDA device that trains.
        cuda: Option<usize>,
    },
    /// The device of this number.
    Number(usize),
}
