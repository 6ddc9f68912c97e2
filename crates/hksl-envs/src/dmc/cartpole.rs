//! Cartpole: a pole hinged on a cart that slides along x.

use std::f64::consts::PI;

use super::tolerance::{Shape, Tolerance};
use super::{Domain, Draws, Object, Physics};
use crate::{Error, ReadingSpec};

/// Standard deviation of the start state around hanging down at rest: m, rad, m/s, rad/s.
const START_DEVIATION: f64 = 0.01;
/// Control costs up to a fifth of the reward. The maximal control is 1.
const SMALL_CONTROL: Tolerance =
    Tolerance { value_at_margin: 0.0, shape: Shape::Quadratic, ..Tolerance::around_zero(1.0) };
/// An angular velocity of 5 rad/s costs 0.45 of the reward.
const SMALL_VELOCITY: Tolerance = Tolerance::around_zero(5.0);
/// A cart position 2 m from the centre costs 0.45 of the reward.
const CENTRED: Tolerance = Tolerance::around_zero(2.0);

/// Positions in `qpos` and `qvel`: the cart's x (m, m/s), the pole's angle (rad, rad/s; 0 is up).
const SLIDER: usize = 0;
const HINGE: usize = 1;

// Positions in `SWINGUP.objects`.
const CART: usize = 0;
const POLE: usize = 1;
const POLE_GEOM: usize = 2;

/// Swing the pole up from hanging, and balance it with the cart in the middle.
pub(crate) static SWINGUP: Domain = Domain {
    task: "cartpole-swingup",
    model: "suite/cartpole.xml",
    substeps: 1,
    seen_from_above: false,
    objects: &[Object::Body("cart"), Object::Body("pole_1"), Object::Geom("pole_1")],
    readings: &[
        ReadingSpec::new("cart", "m", 3),
        ReadingSpec::new("pole", "m", 3),
        ReadingSpec::new("pole_tip", "m", 3),
    ],
    reset,
    reward,
    probe,
};

/// World coordinates of the cart, the pole's centre and the pole's free end.
fn probe(physics: &Physics) -> Vec<Vec<f64>> {
    // The origin of the pole's body frame is the hinge; the centre is half-way to the tip.
    let hinge = physics.body_position(POLE);
    let centre = physics.geom_position(POLE_GEOM);
    let tip = (0..3).map(|axis| hinge[axis] + 2.0 * (centre[axis] - hinge[axis])).collect();
    vec![physics.body_position(CART).to_vec(), centre.to_vec(), tip]
}

/// Hanging down near the centre, nearly at rest. Draws in the order slider, hinge, both velocities.
fn reset(physics: &mut Physics, draws: &mut dyn Draws) -> Result<(), Error> {
    let slider = START_DEVIATION * draws.standard_normal();
    let hinge = PI + START_DEVIATION * draws.standard_normal();
    physics.set_position(SLIDER, slider);
    physics.set_position(HINGE, hinge);
    for joint in [SLIDER, HINGE] {
        physics.set_velocity(joint, START_DEVIATION * draws.standard_normal());
    }
    Ok(())
}

/// Upright × small control × small velocity × centred, each in `[0, 1]`.
fn reward(physics: &Physics) -> f64 {
    let upright = (physics.body_up(POLE) + 1.0) / 2.0;
    let small_control = (4.0 + SMALL_CONTROL.value(physics.control(0))) / 5.0;
    let small_velocity = (1.0 + SMALL_VELOCITY.value(physics.velocity(HINGE))) / 2.0;
    let centred = (1.0 + CENTRED.value(physics.position(SLIDER))) / 2.0;
    upright * small_control * small_velocity * centred
}
