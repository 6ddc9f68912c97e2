//! Walker: two legs under a torso, in a plane.

use super::tolerance::{Shape, Tolerance};
use super::{Domain, Draws, Object, Physics};
use crate::{Error, ReadingSpec};

/// Minimal height of a standing torso, m.
const STAND_HEIGHT: f64 = 1.2;
/// Speed for the full walking reward, m/s.
const WALK_SPEED: f64 = 1.0;

const STANDING: Tolerance = Tolerance {
    low: STAND_HEIGHT,
    high: f64::INFINITY,
    ..Tolerance::around_zero(STAND_HEIGHT / 2.0)
};
const WALKING: Tolerance = Tolerance {
    low: WALK_SPEED,
    high: f64::INFINITY,
    margin: WALK_SPEED / 2.0,
    value_at_margin: 0.5,
    shape: Shape::Linear,
};

// Positions in `WALK.objects`.
const TORSO: usize = 0;
const TORSO_VELOCITY: usize = 1;

/// Stand up and walk forward.
pub(crate) static WALK: Domain = Domain {
    task: "walker-walk",
    model: "suite/walker.xml",
    substeps: 10,
    seen_from_above: false,
    objects: &[Object::Body("torso"), Object::Sensor("torso_subtreelinvel")],
    readings: &[
        ReadingSpec::new("torso", "m", 3),
        ReadingSpec::new("speed", "m/s", 1),
        ReadingSpec::new("torso_zz", "1", 1),
    ],
    reset,
    reward,
    probe,
};

/// World coordinates of the torso, the body's velocity along x, and the uprightness of the torso (1: fully upright).
fn probe(physics: &Physics) -> Vec<Vec<f64>> {
    vec![
        physics.body_position(TORSO).to_vec(),
        vec![physics.sensor(TORSO_VELOCITY)],
        vec![physics.body_up(TORSO)],
    ]
}

/// Random positions of all joints in their ranges and a random angle of the torso, with contacts allowed.
fn reset(physics: &mut Physics, draws: &mut dyn Draws) -> Result<(), Error> {
    physics.randomise_joints(draws);
    Ok(())
}

/// The standing reward (3/4 height, 1/4 uprightness) times the walking reward (1/6 to 1, depending on speed).
fn reward(physics: &Physics) -> f64 {
    let standing = STANDING.value(physics.body_position(TORSO)[2]);
    let upright = (1.0 + physics.body_up(TORSO)) / 2.0;
    let stand = (3.0 * standing + upright) / 4.0;
    let moving = WALKING.value(physics.sensor(TORSO_VELOCITY));
    stand * (5.0 * moving + 1.0) / 6.0
}
