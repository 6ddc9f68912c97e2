//! Reacher: a two-link arm in a plane.

use std::f64::consts::TAU;

use super::tolerance::Tolerance;
use super::{Domain, Draws, Object, Physics};
use crate::{Error, ReadingSpec};

/// Radius of the target, m.
const TARGET_SIZE: f64 = 0.05;
/// Range of the target's distance from the arm's root, m. The distance is uniform.
const TARGET_DISTANCE: (f64, f64) = (0.05, 0.20);

// Positions in `EASY.objects`.
const FINGER: usize = 0;
const TARGET: usize = 1;

/// Bring the arm's end to a target. The target of this task is large.
pub(crate) static EASY: Domain = Domain {
    task: "reacher-easy",
    model: "suite/reacher.xml",
    substeps: 1,
    seen_from_above: true,
    objects: &[Object::Geom("finger"), Object::Geom("target")],
    readings: &[ReadingSpec::new("finger", "m", 3), ReadingSpec::new("target", "m", 3)],
    reset,
    reward,
    probe,
};

/// World coordinates of the arm's end and of the target.
fn probe(physics: &Physics) -> Vec<Vec<f64>> {
    vec![physics.geom_position(FINGER).to_vec(), physics.geom_position(TARGET).to_vec()]
}

/// Random positions of the joints in their ranges, and a random target around the root.
fn reset(physics: &mut Physics, draws: &mut dyn Draws) -> Result<(), Error> {
    let [_, width, height] = physics.geom_size(TARGET);
    physics.set_geom_size(TARGET, [TARGET_SIZE, width, height])?;
    physics.randomise_joints(draws);
    let angle = draws.uniform(0.0, TAU);
    let distance = draws.uniform(TARGET_DISTANCE.0, TARGET_DISTANCE.1);
    // As in dm_control, x is the sine.
    let [_, _, z] = physics.geom_offset(TARGET);
    physics.set_geom_offset(TARGET, [distance * angle.sin(), distance * angle.cos(), z])
}

/// 1 while the arm's end touches the target.
fn reward(physics: &Physics) -> f64 {
    let ([x, y, _], [finger_x, finger_y, _]) =
        (physics.geom_position(TARGET), physics.geom_position(FINGER));
    let distance = (x - finger_x).hypot(y - finger_y);
    let reach = physics.geom_size(TARGET)[0] + physics.geom_size(FINGER)[0];
    Tolerance { low: 0.0, high: reach, ..Tolerance::HARD }.value(distance)
}
