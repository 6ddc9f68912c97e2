//! Building blocks of resets.

use std::f64::consts::PI;

use mujoco_rs::prelude::MjtJoint;

use super::{Physics, Place};
use crate::Error;
use crate::dmc::{Draws, ModelEdits};

/// Maximal number of start states to draw until one has no contacts. dm_control has this limit for finger and none for
/// ball-in-cup. Either task rejects less than one state in five.
const TRIES: usize = 1000;

impl Physics {
    /// Writes one generalised position.
    pub(crate) fn set_position(&mut self, index: usize, value: f64) {
        self.data.qpos_mut()[index] = value;
    }

    /// Writes one generalised velocity.
    pub(crate) fn set_velocity(&mut self, index: usize, value: f64) {
        self.data.qvel_mut()[index] = value;
    }

    /// Draws a uniform position within the range of each limited joint, and an angle for each unlimited hinge, in the model's
    /// order.
    pub(crate) fn randomise_joints(&mut self, draws: &mut dyn Draws) {
        self.randomise(draws, |limited, hinge| limited || hinge);
    }

    /// Draws a uniform position within the range of each limited joint.
    pub(crate) fn randomise_limited_joints(&mut self, draws: &mut dyn Draws) {
        self.randomise(draws, |limited, _| limited);
    }

    fn randomise(&mut self, draws: &mut dyn Draws, chosen: fn(bool, bool) -> bool) {
        let joints = self.data.model().jnt_limited().len();
        for joint in 0..joints {
            let model = self.data.model();
            let limited = model.jnt_limited()[joint];
            let hinge = model.jnt_type()[joint] == MjtJoint::mjJNT_HINGE;
            if chosen(limited, hinge) {
                let [low, high] = if limited { model.jnt_range()[joint] } else { [-PI, PI] };
                let position = model.jnt_qposadr()[joint] as usize;
                self.set_position(position, draws.uniform(low, high));
            }
        }
    }

    /// Draws start states until one has no contacts.
    ///
    /// # Errors
    /// No such state found.
    pub(crate) fn until_nothing_touches(
        &mut self,
        mut draw: impl FnMut(&mut Self),
    ) -> Result<(), Error> {
        for _ in 0..TRIES {
            draw(self);
            self.forward_without_actuation();
            if self.data.ncon() == 0 {
                return Ok(());
            }
        }
        Err(Error::NoStart { task: self.task.to_owned(), tries: TRIES })
    }

    /// Takes physics steps without controls, then resets the clock to 0.
    ///
    /// As in dm_control, the first half of the first step was computed before the joints were set, which affects the state.
    pub(crate) fn settle(&mut self, steps: usize) {
        self.steps(steps);
        self.data.set_time(0.0);
    }

    /// Writes the opacity of the domain's object number `object`, a site.
    pub(crate) fn set_site_opacity(&mut self, object: usize, opacity: f64) -> Result<(), Error> {
        let place = self.objects[object];
        let [red, green, blue, _] = self.data.model().site_rgba()[place.index].map(f64::from);
        self.edit("site_rgba", place, vec![red, green, blue, opacity])
    }

    /// Writes the damping of the domain's object number `object`, a joint; N·m·s/rad or N·s/m.
    pub(crate) fn set_joint_damping(&mut self, object: usize, damping: f64) -> Result<(), Error> {
        self.edit("dof_damping", self.objects[object], vec![damping])
    }

    /// Writes the sizes of the domain's object number `object`, a geom; m.
    pub(crate) fn set_geom_size(&mut self, object: usize, size: [f64; 3]) -> Result<(), Error> {
        self.edit("geom_size", self.objects[object], size.to_vec())
    }

    /// Writes the position of the domain's object number `object`, a geom, in its body's frame; m.
    pub(crate) fn set_geom_offset(&mut self, object: usize, offset: [f64; 3]) -> Result<(), Error> {
        self.edit("geom_pos", self.objects[object], offset.to_vec())
    }

    fn edit(&mut self, field: &str, place: Place, row: Vec<f64>) -> Result<(), Error> {
        let objects = [(place.name.to_owned(), row)].into();
        let edits: ModelEdits = [(field.to_owned(), objects)].into();
        self.edit_model(&edits).map_err(|(field, reason)| Error::Start { field, reason })
    }
}
