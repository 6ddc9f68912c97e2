//! Random walk of a camera on a sphere, with a fixed target.
//!
//! The code keeps quirks of the original. The sphere is centred on the world's origin for a fixed camera, and on the
//! tracked body for a tracking camera. The drawn velocity is in metres, but its limit is in quarters of the distance. If
//! the camera may roll over the top, the rotation is not exactly orthonormal and the first step jumps.

use std::f64::consts::{FRAC_PI_2, PI};

use serde::{Deserialize, Serialize};

use super::CameraSettings;
use crate::dmc::{Draws, View};

type Vector = [f64; 3];
/// Row-major.
type Matrix = [Vector; 3];

/// Behaviour of a task's camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct CameraBehaviour {
    /// Whether the camera tracks the body.
    pub(crate) tracking: bool,
    /// Whether the camera stays in front of the scene and above the ground, and does not roll over.
    pub(crate) upper_quadrant: bool,
}

/// The random walk of the camera.
#[derive(Clone, Debug)]
pub(super) struct CameraWalk {
    settings: CameraSettings,
    behaviour: CameraBehaviour,
    episode: Option<CameraState>,
}

/// State of a walk. `place`, `velocity`, `roll` and `roll_velocity` change; all other fields are fixed at its start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct CameraState {
    /// Distance (m), angle about the vertical (rad), angle from the vertical (rad).
    place: Vector,
    /// Minimum and maximum of each.
    limits: [(f64, f64); 3],
    /// m per control step.
    velocity: Vector,
    /// rad.
    roll: f64,
    /// rad per control step.
    roll_velocity: f64,
    /// A quarter of the original distance, m.
    scale: f64,
    /// Target of a fixed camera, m.
    target: Vector,
}

impl CameraWalk {
    pub(super) fn new(settings: CameraSettings, behaviour: CameraBehaviour) -> Self {
        Self { settings, behaviour, episode: None }
    }

    /// Starts an episode at a random place near the original camera and takes the step before the first frame.
    pub(super) fn restart(&mut self, view: &View, draws: &mut dyn Draws) {
        let settings = self.settings;
        let origin = if self.behaviour.tracking { view.centre } else { [0.0; 3] };
        let [radius, horizontal, vertical] = spherical(minus(view.position, origin));
        let around = |middle: f64, delta: f64| (middle - delta, middle + delta);
        let mut limits = [
            distances(settings, radius),
            around(horizontal, settings.horizontal_delta),
            around(vertical, settings.vertical_delta),
        ];
        if self.behaviour.upper_quadrant {
            limits[1] = (limits[1].0.max(-PI), limits[1].1.min(0.0));
            limits[2] = (limits[2].0.max(0.0), limits[2].1.min(FRAC_PI_2));
        }
        let mut uniform = |(low, high): (f64, f64)| draws.uniform(low, high);
        let (horizontal, vertical) = (uniform(limits[1]), uniform(limits[2]));
        let place = [uniform(limits[0]), horizontal, vertical];
        let roll = uniform((-settings.roll_delta, settings.roll_delta));
        let direction = [(); 3].map(|()| draws.standard_normal());
        let speed = draws.uniform(0.0, settings.max_velocity);
        let length = norm(direction);
        let roll_velocity = draws.uniform(-settings.max_roll_velocity, settings.max_roll_velocity);
        self.episode = Some(CameraState {
            place,
            limits,
            velocity: direction.map(|component| component / length * speed),
            roll,
            roll_velocity,
            scale: radius / 4.0,
            target: looked_at(view),
        });
        self.advance(draws);
    }

    /// Takes one control step. Does nothing before the first episode.
    pub(super) fn advance(&mut self, draws: &mut dyn Draws) {
        let settings = self.settings;
        let Some(state) = &mut self.episode else { return };
        let most = settings.max_velocity * state.scale;
        for component in &mut state.velocity {
            *component += draws.standard_normal() * settings.velocity_std * state.scale;
        }
        state.roll_velocity += draws.standard_normal() * settings.roll_velocity_std;
        let speed = norm(state.velocity);
        if speed > most {
            state.velocity = state.velocity.map(|component| component * (most / speed));
        }
        let most = settings.max_roll_velocity;
        state.roll_velocity = state.roll_velocity.clamp(-most, most);

        let old = cartesian(state.place);
        let moved = spherical(plus(old, state.velocity));
        for ((place, moved), (low, high)) in state.place.iter_mut().zip(moved).zip(state.limits) {
            *place = moved.max(low).min(high);
        }
        state.velocity = minus(cartesian(state.place), old);
        let roll = (state.roll + state.roll_velocity).max(-settings.roll_delta);
        let roll = roll.min(settings.roll_delta);
        (state.roll_velocity, state.roll) = (roll - state.roll, roll);
    }

    /// The camera's current position and axes. None before the first episode.
    pub(super) fn pose(&self, view: &View) -> Option<(Vector, [f64; 9])> {
        let state = self.episode.as_ref()?;
        let place = cartesian(state.place);
        let (position, target) = if self.behaviour.tracking {
            (plus(place, view.centre), looked_at(view))
        } else {
            (place, state.target)
        };
        let sight = minus(target, position);
        let length = norm(sight);
        let sight = sight.map(|component| component / length);
        let facing = if self.behaviour.upper_quadrant { upright(sight) } else { shortest(sight) };
        let axes = product(facing, about_z(state.roll));
        let [[a, b, c], [d, e, f], [g, h, i]] = axes;
        Some((position, [a, b, c, d, e, f, g, h, i]))
    }

    pub(super) fn state(&self) -> Option<CameraState> {
        self.episode.clone()
    }

    /// Restores a state if these settings allow its place and limits.
    pub(super) fn restore(&mut self, state: Option<CameraState>) -> Result<(), String> {
        if let Some(state) = &state {
            let settings = self.settings;
            let [distance, horizontal, vertical] = state.limits;
            let at_most = |(low, high): (f64, f64), delta: f64| high - low <= 2.0 * delta + 1e-9;
            let fits = distance == distances(settings, 4.0 * state.scale)
                && at_most(horizontal, settings.horizontal_delta)
                && at_most(vertical, settings.vertical_delta)
                && state.roll.abs() <= settings.roll_delta
                && state
                    .place
                    .iter()
                    .zip(state.limits)
                    .all(|(x, (low, high))| (low..=high).contains(x));
            if !fits {
                return Err("its camera is where these settings do not let it go".to_owned());
            }
        }
        self.episode = state;
        Ok(())
    }
}

/// Minimal and maximal distance of a camera whose original distance is `radius`, m.
fn distances(settings: CameraSettings, radius: f64) -> (f64, f64) {
    ((radius - radius * settings.max_zoom_in).max(0.0), radius + radius * settings.max_zoom_out)
}

/// The camera's target: the point on its axis at the distance of the body's centre of mass.
fn looked_at(view: &View) -> Vector {
    let distance = norm(minus(view.position, view.centre));
    let backwards = [view.axes[2], view.axes[5], view.axes[8]];
    minus(view.position, backwards.map(|component| component * distance))
}

/// The axes of a camera that looks along `sight`, with a horizontal x axis.
fn upright([x, y, z]: Vector) -> Matrix {
    product(about_z(-x.atan2(y)), about_x(z.atan2(x.hypot(y)) + FRAC_PI_2))
}

/// The shortest rotation from straight down to `sight`. It is not an exact rotation because of the original's small term
/// in the divisor.
fn shortest([x, y, z]: Vector) -> Matrix {
    const DIVISOR: f64 = 1e-4;
    // (0, 0, −1) × sight.
    let axis: Vector = [y, -x, 0.0];
    let (sine, cosine) = (norm(axis), -z);
    let axis = axis.map(|component| component / (sine + DIVISOR));
    let [a, b, c] = axis;
    let cross = [[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]];
    let mut matrix = [[0.0; 3]; 3];
    for (row, numbers) in matrix.iter_mut().enumerate() {
        for (column, number) in numbers.iter_mut().enumerate() {
            let identity = if row == column { cosine } else { 0.0 };
            *number =
                identity + (1.0 - cosine) * axis[row] * axis[column] + sine * cross[row][column];
        }
    }
    matrix
}

fn about_x(angle: f64) -> Matrix {
    let (sine, cosine) = angle.sin_cos();
    [[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]]
}

fn about_z(angle: f64) -> Matrix {
    let (sine, cosine) = angle.sin_cos();
    [[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]
}

fn product(a: Matrix, b: Matrix) -> Matrix {
    a.map(|row| std::array::from_fn(|column| (0..3).map(|term| row[term] * b[term][column]).sum()))
}

/// Distance, angle about the vertical, angle from the vertical.
fn spherical([x, y, z]: Vector) -> Vector {
    [norm([x, y, z]), y.atan2(x), x.hypot(y).atan2(z)]
}

fn cartesian([radius, horizontal, vertical]: Vector) -> Vector {
    let level = radius * vertical.sin();
    [level * horizontal.cos(), level * horizontal.sin(), radius * vertical.cos()]
}

fn plus(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|axis| a[axis] + b[axis])
}

fn minus(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

fn norm([x, y, z]: Vector) -> f64 {
    (x * x + y * y + z * z).sqrt()
}
