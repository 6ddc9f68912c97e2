//! Cheetah: a two-legged runner in a plane.

use super::tolerance::{Shape, Tolerance};
use super::{Domain, Draws, Object, Physics};
use crate::{Error, ReadingSpec};

/// Physics steps for the start state to settle.
const SETTLING_STEPS: usize = 200;
/// Speed for a reward of 1, m/s.
const RUN_SPEED: f64 = 10.0;

const RUNNING: Tolerance = Tolerance {
    low: RUN_SPEED,
    high: f64::INFINITY,
    margin: RUN_SPEED,
    value_at_margin: 0.0,
    shape: Shape::Linear,
};

// Positions in `RUN.objects`.
const TORSO: usize = 0;
const TORSO_VELOCITY: usize = 1;

/// Run forward as fast as 10 m/s.
pub(crate) static RUN: Domain = Domain {
    task: "cheetah-run",
    model: "suite/cheetah.xml",
    substeps: 1,
    seen_from_above: false,
    objects: &[Object::Body("torso"), Object::Sensor("torso_subtreelinvel")],
    readings: &[ReadingSpec::new("torso", "m", 3), ReadingSpec::new("speed", "m/s", 1)],
    reset,
    reward,
    probe,
};

/// World coordinates of the torso, and the body's velocity along x.
fn probe(physics: &Physics) -> Vec<Vec<f64>> {
    vec![physics.body_position(TORSO).to_vec(), vec![physics.sensor(TORSO_VELOCITY)]]
}

/// Random positions of the legs' joints in their ranges, followed by settling. The clock starts after settling.
fn reset(physics: &mut Physics, draws: &mut dyn Draws) -> Result<(), Error> {
    physics.randomise_limited_joints(draws);
    physics.settle(SETTLING_STEPS);
    Ok(())
}

/// The speed divided by 10 m/s, clipped to [0, 1].
fn reward(physics: &Physics) -> f64 {
    RUNNING.value(physics.sensor(TORSO_VELOCITY))
}
