//! Named objects of a model.

use std::fmt;

use mujoco_rs::prelude::{MjModel, MjtObjBase};

/// An object of a model, by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Object {
    /// A body.
    Body(&'static str),
    /// A geom.
    Geom(&'static str),
    /// A site.
    Site(&'static str),
    /// A joint with one degree of freedom.
    Joint(&'static str),
    /// A sensor.
    Sensor(&'static str),
}

/// Location of an object in the model.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub(super) name: &'static str,
    /// Id among objects of its kind; for a sensor, the index of its first value.
    pub(super) index: usize,
}

impl Object {
    fn kind(self) -> (MjtObjBase, &'static str, &'static str) {
        match self {
            Object::Body(name) => (MjtObjBase::mjOBJ_BODY, "body", name),
            Object::Geom(name) => (MjtObjBase::mjOBJ_GEOM, "geom", name),
            Object::Site(name) => (MjtObjBase::mjOBJ_SITE, "site", name),
            Object::Joint(name) => (MjtObjBase::mjOBJ_JOINT, "joint", name),
            Object::Sensor(name) => (MjtObjBase::mjOBJ_SENSOR, "sensor", name),
        }
    }

    /// The object's location, if the model has it.
    pub(super) fn find(self, model: &MjModel) -> Option<Place> {
        let (kind, _, name) = self.kind();
        let id = model.name_to_id(kind, name)?;
        let index = match self {
            Object::Sensor(_) => usize::try_from(model.sensor_adr()[id]).ok()?,
            _ => id,
        };
        Some(Place { name, index })
    }
}

impl fmt::Display for Object {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (_, kind, name) = self.kind();
        write!(formatter, "{kind} '{name}'")
    }
}
