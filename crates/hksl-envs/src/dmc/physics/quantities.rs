//! Quantities for rewards and readings.

use super::Physics;

impl Physics {
    /// Number of actuators.
    pub(crate) fn control_dims(&self) -> usize {
        self.data.ctrl().len()
    }

    /// All generalised positions.
    pub(crate) fn qpos(&self) -> &[f64] {
        self.data.qpos()
    }

    /// All generalised velocities.
    pub(crate) fn qvel(&self) -> &[f64] {
        self.data.qvel()
    }

    /// One generalised position, m or rad.
    pub(crate) fn position(&self, index: usize) -> f64 {
        self.data.qpos()[index]
    }

    /// One generalised velocity, m/s or rad/s.
    pub(crate) fn velocity(&self, index: usize) -> f64 {
        self.data.qvel()[index]
    }

    /// The control of one actuator as given, not clipped.
    pub(crate) fn control(&self, index: usize) -> f64 {
        self.data.ctrl()[index]
    }

    /// World position of the domain's object number `object`, a body; m.
    pub(crate) fn body_position(&self, object: usize) -> [f64; 3] {
        self.data.xpos()[self.objects[object].index]
    }

    /// World z component of a body's own z axis: 1 when upright.
    pub(crate) fn body_up(&self, object: usize) -> f64 {
        self.data.xmat()[self.objects[object].index][8]
    }

    /// World position of the domain's object number `object`, a geom; m.
    pub(crate) fn geom_position(&self, object: usize) -> [f64; 3] {
        self.data.geom_xpos()[self.objects[object].index]
    }

    /// World position of the domain's object number `object`, a site; m.
    pub(crate) fn site_position(&self, object: usize) -> [f64; 3] {
        self.data.site_xpos()[self.objects[object].index]
    }

    /// The first value of the domain's object number `object`, a sensor, in the sensor's unit.
    pub(crate) fn sensor(&self, object: usize) -> f64 {
        self.data.sensordata()[self.objects[object].index]
    }

    /// Sizes of the domain's object number `object`, a geom; m.
    pub(crate) fn geom_size(&self, object: usize) -> [f64; 3] {
        self.data.model().geom_size()[self.objects[object].index]
    }

    /// Position of the domain's object number `object`, a geom, in its body's frame; m.
    pub(crate) fn geom_offset(&self, object: usize) -> [f64; 3] {
        self.data.model().geom_pos()[self.objects[object].index]
    }

    /// Sizes of the domain's object number `object`, a site; m.
    pub(crate) fn site_size(&self, object: usize) -> [f64; 3] {
        self.data.model().site_size()[self.objects[object].index]
    }
}
