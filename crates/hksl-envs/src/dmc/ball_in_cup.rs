//! Ball in cup: a cup that moves in a plane, and a ball on a string.

use super::{Domain, Draws, Object, Physics};
use crate::{Error, ReadingSpec};

/// Range of the ball's start position along x and z, relative to the model, m.
const START_X: (f64, f64) = (-0.2, 0.2);
const START_Z: (f64, f64) = (0.2, 0.5);

/// Positions in `qpos`: the ball's x and z, m.
const BALL_X: usize = 2;
const BALL_Z: usize = 3;

// Positions in `CATCH.objects`.
const BALL: usize = 0;
const CUP: usize = 1;
const TARGET: usize = 2;
const BALL_GEOM: usize = 3;

/// Get the ball into the cup and keep it there.
pub(crate) static CATCH: Domain = Domain {
    task: "ball_in_cup-catch",
    model: "suite/ball_in_cup.xml",
    substeps: 10,
    seen_from_above: false,
    objects: &[
        Object::Body("ball"),
        Object::Body("cup"),
        Object::Site("target"),
        Object::Geom("ball"),
    ],
    readings: &[
        ReadingSpec::new("ball", "m", 3),
        ReadingSpec::new("cup", "m", 3),
        ReadingSpec::new("target", "m", 3),
    ],
    reset,
    reward,
    probe,
};

/// World coordinates of the ball, of the cup and of the target in the cup.
fn probe(physics: &Physics) -> Vec<Vec<f64>> {
    vec![
        physics.body_position(BALL).to_vec(),
        physics.body_position(CUP).to_vec(),
        physics.site_position(TARGET).to_vec(),
    ]
}

/// The ball at a random position above the cup, without contacts. The string's length is ignored.
fn reset(physics: &mut Physics, draws: &mut dyn Draws) -> Result<(), Error> {
    physics.until_nothing_touches(|physics| {
        physics.set_position(BALL_X, draws.uniform(START_X.0, START_X.1));
        physics.set_position(BALL_Z, draws.uniform(START_Z.0, START_Z.1));
    })
}

/// 1 while the whole ball is inside the target in the x–z plane.
fn reward(physics: &Physics) -> f64 {
    let (target, ball) = (physics.site_position(TARGET), physics.body_position(BALL));
    let (size, radius) = (physics.site_size(TARGET), physics.geom_size(BALL_GEOM)[0]);
    let inside = |axis: usize| (target[axis] - ball[axis]).abs() < size[axis] - radius;
    f64::from(u8::from(inside(0) && inside(2)))
}
