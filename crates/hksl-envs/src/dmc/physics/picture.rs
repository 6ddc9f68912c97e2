//! What a picture depends on beside the state: the camera and the materials' colours.

use mujoco_rs::prelude::MjtCamLight;

use super::Physics;
use crate::render::CAMERA;

/// The body whose mass is everything that moves: the first after the world.
const WHOLE: usize = 1;

/// A camera in the current state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct View {
    /// Its position in the world; m.
    pub(crate) position: [f64; 3],
    /// Its axes in the world, row-major; the third column points away from what it sees.
    pub(crate) axes: [f64; 9],
    /// Centre of mass of all that moves; m.
    pub(crate) centre: [f64; 3],
}

impl Physics {
    /// The pictures' camera. Each control step and reset puts it back to where the model has it.
    pub(crate) fn view(&self) -> View {
        View {
            position: self.data.cam_xpos()[CAMERA],
            axes: self.data.cam_xmat()[CAMERA],
            centre: self.data.subtree_com()[WHOLE],
        }
    }

    /// Moves the camera of the next picture.
    pub(crate) fn aim(&mut self, position: [f64; 3], axes: [f64; 9]) {
        self.data.cam_xpos_mut()[CAMERA] = position;
        self.data.cam_xmat_mut()[CAMERA] = axes;
    }

    /// Whether the camera moves with the centre of mass.
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

    /// Gives the materials other colours, for good; their opacity stays.
    #[allow(unsafe_code)]
    pub(crate) fn paint(&mut self, colors: &[[f64; 3]]) {
        // SAFETY: the model may be changed but not replaced by one of another layout; colours are numbers that
        // nothing else depends on.
        let model = unsafe { self.data.model_mut() };
        for (material, color) in model.mat_rgba_mut().iter_mut().zip(colors) {
            for (target, component) in material.iter_mut().zip(color) {
                *target = *component as f32;
            }
        }
    }
}
