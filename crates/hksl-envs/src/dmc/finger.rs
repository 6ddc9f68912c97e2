//! Finger: a two-joint finger that hits a spinner on a hinge; no gravity.

use super::tolerance::Tolerance;
use super::{Domain, Draws, Object, Physics};
use crate::{Error, ReadingSpec};

/// Minimal angular velocity of the spinner, in one direction, rad/s.
const SPIN_VELOCITY: f64 = 15.0;
/// Damping of the spinner's hinge in this task, N·m·s/rad. The model file has 0.5.
const HINGE_DAMPING: f64 = 0.03;
/// Opacity of the markers of the other finger tasks: hidden.
const OPACITY: f64 = 0.0;

const SPINNING: Tolerance =
    Tolerance { low: f64::NEG_INFINITY, high: -SPIN_VELOCITY, ..Tolerance::HARD };

// Positions in `SPIN.objects`.
const FINGERTIP: usize = 0;
const TIP: usize = 1;
const TARGET: usize = 2;
const HINGE: usize = 3;
const HINGE_VELOCITY: usize = 4;

/// Keep the spinner turning.
pub(crate) static SPIN: Domain = Domain {
    task: "finger-spin",
    model: "suite/finger.xml",
    substeps: 2,
    seen_from_above: false,
    objects: &[
        Object::Geom("fingertip"),
        Object::Site("tip"),
        Object::Site("target"),
        Object::Joint("hinge"),
        Object::Sensor("hinge_velocity"),
    ],
    readings: &[ReadingSpec::new("fingertip", "m", 3), ReadingSpec::new("spinner_tip", "m", 3)],
    reset,
    reward,
    probe,
};

/// World coordinates of the finger's tip and of the spinner's tip.
fn probe(physics: &Physics) -> Vec<Vec<f64>> {
    vec![physics.geom_position(FINGERTIP).to_vec(), physics.site_position(TIP).to_vec()]
}

/// Random positions of all joints in their ranges and a random angle of the spinner, without contacts.
fn reset(physics: &mut Physics, draws: &mut dyn Draws) -> Result<(), Error> {
    for site in [TARGET, TIP] {
        physics.set_site_opacity(site, OPACITY)?;
    }
    physics.set_joint_damping(HINGE, HINGE_DAMPING)?;
    physics.until_nothing_touches(|physics| physics.randomise_joints(draws))
}

/// 1 while the spinner is fast enough.
fn reward(physics: &Physics) -> f64 {
    SPINNING.value(physics.sensor(HINGE_VELOCITY))
}
