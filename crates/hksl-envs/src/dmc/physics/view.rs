//! Camera and material colours.

use mujoco_rs::prelude::MjtCamLight;

use super::Physics;
use crate::render::CAMERA;

/// The body whose subtree is everything that moves: the first after the world.
const ROOT_BODY: usize = 1;

/// The pose of a camera in the current state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct View {
    /// Position in the world, m.
    pub(crate) position: [f64; 3],
    /// Axes in the world, row-major. The third column points opposite to the viewing direction.
    pub(crate) axes: [f64; 9],
    /// Centre of mass of all moving bodies, m.
    pub(crate) centre: [f64; 3],
}

impl Physics {
    /// The camera of the frames. Each control step and reset restores the model's pose.
    pub(crate) fn view(&self) -> View {
        View {
            position: self.data.cam_xpos()[CAMERA],
            axes: self.data.cam_xmat()[CAMERA],
            centre: self.data.subtree_com()[ROOT_BODY],
        }
    }

    /// Moves the camera for the next frame.
    pub(crate) fn aim(&mut self, position: [f64; 3], axes: [f64; 9]) {
        self.data.cam_xpos_mut()[CAMERA] = position;
        self.data.cam_xmat_mut()[CAMERA] = axes;
    }

    /// Whether the camera tracks the centre of mass.
    pub(crate) fn camera_tracks(&self) -> bool {
        self.data.model().cam_mode()[CAMERA] == MjtCamLight::mjCAMLIGHT_TRACKCOM
    }

    /// Red, green and blue of every material, in the model's order.
    pub(crate) fn colors(&self) -> Vec<[f32; 3]> {
        self.data
            .model()
            .mat_rgba()
            .iter()
            .map(|&[red, green, blue, _]| [red, green, blue])
            .collect()
    }

    /// Sets the materials' colours permanently. Opacities do not change.
    #[allow(unsafe_code)]
    pub(crate) fn paint(&mut self, colors: &[[f64; 3]]) {
        // SAFETY: the model may be modified but not replaced by one of another layout; colours are values that nothing
        // else depends on.
        let model = unsafe { self.data.model_mut() };
        for (material, color) in model.mat_rgba_mut().iter_mut().zip(colors) {
            for (target, component) in material.iter_mut().zip(color) {
                *target = *component as f32;
            }
        }
    }
}
