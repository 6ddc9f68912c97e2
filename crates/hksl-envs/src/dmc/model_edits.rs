//! Model fields that tasks of the suite modify, as part of a start state.

use std::collections::BTreeMap;

use mujoco_rs::prelude::{MjModel, MjtObjBase};

/// Modified rows of a model, by field and name of the object.
pub type ModelEdits = BTreeMap<String, BTreeMap<String, Vec<f64>>>;

/// A modifiable field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Field {
    /// Damping of a joint's one degree of freedom, N·m·s/rad (hinge) or N·s/m (slide).
    DofDamping,
    /// Colour and opacity of a site.
    SiteRgba,
    /// Position of a geom in its body's frame, m.
    GeomPos,
    /// Sizes of a geom, m.
    GeomSize,
}

const FIELDS: [(&str, Field); 4] = [
    ("dof_damping", Field::DofDamping),
    ("site_rgba", Field::SiteRgba),
    ("geom_pos", Field::GeomPos),
    ("geom_size", Field::GeomSize),
];

impl Field {
    fn object_kind(self) -> (&'static str, MjtObjBase) {
        match self {
            Field::DofDamping => ("joint", MjtObjBase::mjOBJ_JOINT),
            Field::SiteRgba => ("site", MjtObjBase::mjOBJ_SITE),
            Field::GeomPos | Field::GeomSize => ("geom", MjtObjBase::mjOBJ_GEOM),
        }
    }

    fn row_len(self) -> usize {
        match self {
            Field::DofDamping => 1,
            Field::SiteRgba => 4,
            Field::GeomPos | Field::GeomSize => 3,
        }
    }
}

/// Writes `edits` to `model` and returns the previous rows. Writes nothing on an error.
///
/// # Errors
/// The path of the first invalid edit (such as `model.geom_pos.target`) and the reason.
pub(super) fn apply(
    model: &mut MjModel,
    edits: &ModelEdits,
) -> Result<ModelEdits, (String, String)> {
    let mut rows = Vec::new();
    let mut before = ModelEdits::new();
    for (name, objects) in edits {
        let field = field(name).map_err(|reason| (format!("model.{name}"), reason))?;
        for (object, row) in objects {
            let fault = |reason| (format!("model.{name}.{object}"), reason);
            let id = check(model, field, object, row).map_err(fault)?;
            before.entry(name.clone()).or_default().insert(object.clone(), read(model, field, id));
            rows.push((field, id, row));
        }
    }
    for (field, id, row) in rows {
        write(model, field, id, row);
    }
    Ok(before)
}

fn field(name: &str) -> Result<Field, String> {
    let known = || FIELDS.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
    FIELDS
        .iter()
        .find(|(known, _)| *known == name)
        .map(|(_, field)| *field)
        .ok_or_else(|| format!("unknown field; valid: {}", known()))
}

/// Checks a row and returns the id of `object`.
fn check(model: &MjModel, field: Field, object: &str, row: &[f64]) -> Result<usize, String> {
    let (kind, object_kind) = field.object_kind();
    // MuJoCo takes names as C strings.
    let id = if object.contains('\0') { None } else { model.name_to_id(object_kind, object) };
    let Some(id) = id else {
        return Err(format!("the model has no {kind} of this name"));
    };
    if row.len() != field.row_len() {
        return Err(format!("{} numbers, expected {}", row.len(), field.row_len()));
    }
    match row.iter().find(|value| !value.is_finite()) {
        Some(value) => Err(format!("{value} is not a finite number")),
        None => Ok(id),
    }
}

fn read(model: &MjModel, field: Field, id: usize) -> Vec<f64> {
    match field {
        Field::DofDamping => vec![model.dof_damping()[model.jnt_dofadr()[id] as usize]],
        Field::SiteRgba => model.site_rgba()[id].map(f64::from).to_vec(),
        Field::GeomPos => model.geom_pos()[id].to_vec(),
        Field::GeomSize => model.geom_size()[id].to_vec(),
    }
}

/// Writes one row whose length was checked.
fn write(model: &mut MjModel, field: Field, id: usize, row: &[f64]) {
    match field {
        Field::DofDamping => {
            let address = model.jnt_dofadr()[id] as usize;
            model.dof_damping_mut()[address] = row[0];
        }
        Field::SiteRgba => {
            for (target, value) in model.site_rgba_mut()[id].iter_mut().zip(row) {
                *target = *value as f32;
            }
        }
        Field::GeomPos => model.geom_pos_mut()[id].copy_from_slice(row),
        Field::GeomSize => model.geom_size_mut()[id].copy_from_slice(row),
    }
}
