//! Both walks replayed from draws that the original's took, and what fresh ones do.

#![allow(clippy::unwrap_used)] // A test that cannot go on should stop.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::Deserialize;

use super::camera::{CameraBehaviour, CameraWalk};
use super::color::ColorWalk;
use super::{CameraSettings, ColorSettings};
use crate::dmc::{Draws, View};

#[derive(Deserialize)]
struct Fixture {
    camera: Vec<CameraRun>,
    color: Vec<ColorRun>,
}

#[derive(Deserialize)]
struct CameraRun {
    scale: f64,
    dynamic: bool,
    episodes: Vec<CameraEpisode>,
}

#[derive(Deserialize)]
struct CameraEpisode {
    tracking: bool,
    draws: Vec<Draw>,
    steps: Vec<CameraStep>,
}

#[derive(Deserialize)]
struct CameraStep {
    view: RecordedView,
    normals: Vec<f64>,
    position: [f64; 3],
    axes: [f64; 9],
}

#[derive(Clone, Deserialize)]
struct RecordedView {
    position: [f64; 3],
    axes: [f64; 9],
    centre: [f64; 3],
}

#[derive(Deserialize)]
struct ColorRun {
    scale: f64,
    dynamic: bool,
    original: Vec<[f32; 3]>,
    bounds: [Vec<[f64; 3]>; 2],
    episodes: Vec<ColorEpisode>,
}

#[derive(Deserialize)]
struct ColorEpisode {
    uniforms: Vec<[f64; 3]>,
    start: Vec<Vec<f64>>,
    steps: Vec<ColorStep>,
}

#[derive(Deserialize)]
struct ColorStep {
    normals: Vec<[f64; 3]>,
    colors: Vec<Vec<f64>>,
}

/// A recorded draw, in order; a uniform one by its value, or by its share of the way.
#[derive(Clone, Copy, Deserialize)]
#[serde(untagged)]
enum Draw {
    Normal { normal: f64 },
    Uniform { low: f64, high: f64, value: f64 },
    Share { share: f64 },
}

struct Replay(std::vec::IntoIter<Draw>);

impl Draws for Replay {
    fn standard_normal(&mut self) -> f64 {
        match self.0.next() {
            Some(Draw::Normal { normal }) => normal,
            _ => panic!("no normal number was drawn here"),
        }
    }

    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        match self.0.next() {
            Some(Draw::Uniform { low: its_low, high: its_high, value }) => {
                assert!((low - its_low).abs() < 1e-12 && (high - its_high).abs() < 1e-12);
                value
            }
            Some(Draw::Share { share }) => low + share * (high - low),
            _ => panic!("no uniform number was drawn here"),
        }
    }
}

fn normals(numbers: impl IntoIterator<Item = f64>) -> Vec<Draw> {
    numbers.into_iter().map(|normal| Draw::Normal { normal }).collect()
}

fn fixtures() -> Vec<(String, Fixture)> {
    let folder =
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/distractors");
    let mut read = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        read.push((name, serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()));
    }
    assert_eq!(read.len(), 6);
    read
}

/// The settings of a difficulty, from its scale.
fn camera_settings(scale: f64, dynamic: bool) -> CameraSettings {
    use std::f64::consts::{FRAC_PI_2, PI};
    let settings = CameraSettings {
        horizontal_delta: FRAC_PI_2 * scale,
        vertical_delta: FRAC_PI_2 * scale,
        roll_delta: FRAC_PI_2 * scale,
        velocity_std: 0.1 * scale,
        max_velocity: 0.4 * scale,
        roll_velocity_std: PI / 300.0 * scale,
        max_roll_velocity: PI / 50.0 * scale,
        max_zoom_in: 0.5 * scale,
        max_zoom_out: 1.5 * scale,
    };
    if dynamic { settings } else { settings.still() }
}

fn color_settings(scale: f64, dynamic: bool) -> ColorSettings {
    let settings = ColorSettings { max_delta: scale, step_std: 0.03 * scale };
    if dynamic { settings } else { settings.still() }
}

fn difference(got: f64, expected: f64) -> f64 {
    let difference = (got - expected).abs();
    assert!(difference.is_finite(), "{got} against {expected}"); // A maximum passes over NaN.
    difference
}

#[test]
fn cameras_wander_as_recorded() {
    for (task, Fixture { camera, .. }) in fixtures() {
        assert_eq!(camera.len(), 3);
        let mut largest: f64 = 0.0;
        for CameraRun { scale, dynamic, episodes } in camera {
            for CameraEpisode { tracking, draws, steps } in episodes {
                let behaviour =
                    CameraBehaviour { tracking, upper_quadrant: task != "reacher-easy" };
                let mut walk = CameraWalk::new(camera_settings(scale, dynamic), behaviour);
                let mut draws = Some(draws);
                for CameraStep { view, normals: numbers, position, axes } in steps {
                    let RecordedView { position: from, axes: undistorted, centre } = view;
                    let view = View { position: from, axes: undistorted, centre };
                    let mut all = draws.take();
                    let started = all.is_some();
                    let mut replay = all.take().unwrap_or_default();
                    replay.extend(normals(numbers));
                    let mut replay = Replay(replay.into_iter());
                    if started {
                        walk.restart(&view, &mut replay);
                    } else {
                        walk.advance(&mut replay);
                    }
                    assert_eq!(replay.0.len(), 0, "{task}: draws left over");
                    let (got_position, got_axes) = walk.pose(&view).unwrap();
                    for (got, expected) in got_position.iter().zip(position) {
                        largest = largest.max(difference(*got, expected));
                    }
                    for (got, expected) in got_axes.iter().zip(axes) {
                        largest = largest.max(difference(*got, expected));
                    }
                }
            }
        }
        println!("{task}: camera off by at most {largest:e}");
        assert!(largest <= 1e-12, "{task}: off by {largest:e}");
    }
}

#[test]
fn colors_walk_as_recorded() {
    for (task, Fixture { color, .. }) in fixtures() {
        let mut largest: f64 = 0.0;
        for ColorRun { scale, dynamic, original, bounds, episodes } in color {
            let mut walk = ColorWalk::new(color_settings(scale, dynamic), &original);
            let mut compare = |walk: &ColorWalk, colors: &[Vec<f64>]| {
                assert_eq!(walk.current().len(), colors.len());
                for (got, expected) in walk.current().iter().zip(colors) {
                    for (got, expected) in got.iter().zip(expected) {
                        largest = largest.max(difference(*got, *expected));
                    }
                }
            };
            for (share, bound) in [(0.0, &bounds[0]), (1.0, &bounds[1])] {
                let shares = vec![Draw::Share { share }; 3 * original.len()];
                walk.restart(&mut Replay(shares.into_iter()));
                let bound: Vec<Vec<f64>> = bound.iter().map(|row| row.to_vec()).collect();
                compare(&walk, &bound);
            }
            for ColorEpisode { uniforms, start, steps } in episodes {
                let shares: Vec<_> =
                    uniforms.into_iter().flatten().map(|share| Draw::Share { share }).collect();
                walk.restart(&mut Replay(shares.into_iter()));
                compare(&walk, &start);
                for ColorStep { normals: numbers, colors } in steps {
                    walk.advance(&mut Replay(normals(numbers.into_iter().flatten()).into_iter()));
                    compare(&walk, &colors);
                }
            }
        }
        println!("{task}: colours off by at most {largest:e}");
        assert!(largest <= 1e-6, "{task}: off by {largest:e}");
    }
}

/// Over many episodes, components start uniformly within their bounds, step by the settings' deviation, and stay.
#[test]
fn fresh_colors_have_the_settings_statistics() {
    let settings = color_settings(0.2, true);
    let mut walk = ColorWalk::new(settings, &[[0.5; 3], [0.9, 1.0, 0.0]]);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut starts, mut steps) = (Vec::new(), Vec::new());
    for _ in 0..1000 {
        walk.restart(&mut rng);
        starts.push(walk.current()[0][0]);
        let before = walk.current()[0][0];
        walk.advance(&mut rng);
        steps.push(walk.current()[0][0] - before);
        for _ in 0..20 {
            walk.advance(&mut rng);
            let [middle, bright] = [walk.current()[0], walk.current()[1]];
            assert!(middle.iter().all(|value| (0.299..=0.701).contains(value)));
            assert!((0.699..=1.0).contains(&bright[0]) && (0.0..=0.201).contains(&bright[2]));
        }
    }
    let (mean, deviation) = moments(&starts);
    assert!((mean - 0.5).abs() < 0.015 && (deviation - 0.4 / 12f64.sqrt()).abs() < 0.006);
    // A few steps end at a wall.
    let (mean, deviation) = moments(&steps);
    assert!(mean.abs() < 6e-4 && (0.0055..0.0062).contains(&deviation), "{deviation}");
}

/// Cameras stay within their limits, keep at most their speed, and look at the same point all the time.
#[test]
fn fresh_cameras_keep_their_limits() {
    let view = View {
        position: [0.0, -4.0, 1.0],
        axes: [1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0],
        centre: [0.0, 0.0, 1.0],
    };
    let settings = camera_settings(0.3, true);
    let behaviour = CameraBehaviour { tracking: false, upper_quadrant: true };
    let mut walk = CameraWalk::new(settings, behaviour);
    assert!(walk.pose(&view).is_none());
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let distance = 17f64.sqrt();
    let mut moved: f64 = 0.0;
    for _ in 0..50 {
        walk.restart(&view, &mut rng);
        let mut before = walk.pose(&view).unwrap().0;
        for _ in 0..200 {
            walk.advance(&mut rng);
            let (position, axes) = walk.pose(&view).unwrap();
            let step = length(std::array::from_fn(|axis| position[axis] - before[axis]));
            // At the nearest distance allowed, the same angle is a longer way.
            assert!(step <= 1.2 * settings.max_velocity * distance / 4.0);
            moved = moved.max(step);
            let radius = length(position);
            assert!(radius >= distance * 0.85 - 1e-9 && radius <= distance * 1.45 + 1e-9);
            assert!(position[2] >= -1e-12, "under the ground");
            // The third column points from the target, straight ahead of the undistorted camera, to the camera.
            let sight: [f64; 3] =
                std::array::from_fn(|axis| position[axis] - [0.0, 0.0, 1.0][axis]);
            let far = length(sight);
            for (axis, component) in sight.iter().enumerate() {
                assert!((axes[3 * axis + 2] - component / far).abs() < 1e-9);
            }
            before = position;
        }
    }
    assert!(moved > 0.05);
}

#[test]
fn a_still_camera_and_still_colors_only_jump_at_resets() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut walk = ColorWalk::new(color_settings(0.1, false), &[[0.5; 3]]);
    walk.restart(&mut rng);
    let start = walk.current().clone();
    walk.advance(&mut rng);
    assert_eq!(walk.current(), &start);
    walk.restart(&mut rng);
    assert_ne!(walk.current(), &start);
}

fn moments(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / values.len() as f64;
    (mean, variance.sqrt())
}

fn length([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}
