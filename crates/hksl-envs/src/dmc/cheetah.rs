//! Cheetah: a two-legged runner in a plane.

use super::tolerance::{Shape, Tolerance};
use super::{Domain, Draws, Object, Physics};
use crate::{Error, ReadingSpec};

/// Physics steps in which the start state comes to rest.
const SETTLING_STEPS: usize = 200;
/// From this speed on the reward is 1; m/s.
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
    readings: &[
        ReadingSpec { name: "torso", unit: "m", len: 3 },
        ReadingSpec { name: "speed", unit: "m/s", len: 1 },
    ],
    reset,
    reward,
    probe,
};

/// World coordinates of the torso, and the whole body's speed along x.
fn probe(physics: &Physics) -> Vec<Vec<f64>> {
    vec![physics.body_position(TORSO).to_vec(), vec![physics.sensor(TORSO_VELOCITY)]]
}

/// The legs' joints anywhere in their ranges, then left to settle; the clock starts after it.
fn reset(physics: &mut Physics, draws: &mut dyn Draws) -> Result<(), Error> {
    physics.randomise_limited_joints(draws);
    physics.settle(SETTLING_STEPS);
    Ok(())
}

/// The speed as a share of 10 m/s; nothing for running backwards.
fn reward(physics: &Physics) -> f64 {
    RUNNING.value(physics.sensor(TORSO_VELOCITY))
}
