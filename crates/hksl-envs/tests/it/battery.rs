//! What every control task promises under every distractor.

use hksl_envs::distractors::{CameraSettings, ColorSettings};
use hksl_envs::{Distractor, Environment, Error, Settings, make, tasks};
use ndarray::Array3;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// The distractors at a scale: 0.1 easy, 0.2 medium, 0.3 hard.
fn distractions(scale: f64) -> [Distractor; 2] {
    let turn = std::f64::consts::FRAC_PI_2 * scale;
    [
        Distractor::Color(ColorSettings { max_delta: scale, step_std: 0.03 * scale }),
        Distractor::Camera(CameraSettings {
            horizontal_delta: turn,
            vertical_delta: turn,
            roll_delta: turn,
            velocity_std: 0.1 * scale,
            max_velocity: 0.4 * scale,
            roll_velocity_std: turn / 150.0,
            max_roll_velocity: turn / 25.0,
            max_zoom_in: 0.5 * scale,
            max_zoom_out: 1.5 * scale,
        }),
    ]
}

fn all() -> Vec<Distractor> {
    let distracted = [0.1, 0.2, 0.3].into_iter().flat_map(distractions);
    std::iter::once(Distractor::None).chain(distracted).collect()
}

fn control_tasks() -> impl Iterator<Item = &'static str> {
    tasks().iter().filter(|task| task.needs_mujoco).map(|task| task.name)
}

fn environment(task: &str, distraction: Distractor, seed: u64) -> Box<dyn Environment> {
    let settings = Settings { distraction, ..Settings::new(84, 84, 1000) };
    make(task, &settings, ChaCha8Rng::seed_from_u64(seed)).unwrap()
}

fn action(step: usize, actuators: usize) -> Vec<f32> {
    (0..actuators).map(|i| ((step * 7 + i * 5 + 3) % 11) as f32 / 5.0 - 1.0).collect()
}

fn act(environment: &mut dyn Environment, steps: usize) -> f64 {
    let actuators = environment.spec().action_dims;
    (0..steps).map(|step| environment.step(&action(step, actuators)).unwrap().reward).sum()
}

/// Share of pixels that differ at all.
fn changed(a: &Array3<u8>, b: &Array3<u8>) -> f64 {
    a.iter().zip(b).filter(|(a, b)| a != b).count() as f64 / a.len() as f64
}

#[test]
fn every_task_under_every_distractor() {
    std::thread::scope(|scope| {
        for task in control_tasks() {
            scope.spawn(move || under_every_distractor(task));
        }
    });
}

/// Environments that draw are few: each compiles the renderer's shaders anew.
fn under_every_distractor(task: &str) {
    let mut plain = environment(task, Distractor::None, 1);
    plain.reset().unwrap();
    let start = plain.snapshot().unwrap();
    for distraction in all() {
        let place = format!("{task} {distraction:?}");
        let [mut one, mut same, mut other] =
            [1, 1, 2].map(|seed| environment(task, distraction, seed));
        for environment in [&mut one, &mut same, &mut other] {
            environment.reset().unwrap();
        }
        plain.restore(&start).unwrap();
        let first = one.frame().unwrap();
        assert_eq!(first.dim(), (3, 84, 84));
        for channel in first.outer_iter() {
            let level = channel[(0, 0)];
            assert!(channel.iter().any(|pixel| *pixel != level), "{place}: nothing drawn");
        }
        // A picture is the caller's own: drawing again changes neither it nor what is drawn.
        assert_eq!(one.frame().unwrap(), first, "{place}");
        assert_eq!(same.frame().unwrap(), first, "{place}: another picture for the same seed");
        assert_ne!(other.physical_state(), one.physical_state(), "{place}: the same start");

        // Rewards and states are those of the task without distractor.
        let rewards = act(one.as_mut(), 25);
        assert_eq!(rewards.to_bits(), act(plain.as_mut(), 25).to_bits(), "{place}");
        assert_eq!(one.physical_state(), plain.physical_state(), "{place}");
        let later = one.frame().unwrap();
        assert_ne!(later, first, "{place}: the picture stood still");
        let undisturbed = plain.frame().unwrap();
        let distracted = distraction != Distractor::None;
        assert_eq!(changed(&later, &undisturbed) > 0.02, distracted, "{place}");

        // A restored copy goes on to the same pictures, through the next reset as well.
        let mut copy = other;
        copy.restore(&one.snapshot().unwrap()).unwrap();
        assert_eq!(copy.frame().unwrap(), later, "{place}");
        for environment in [&mut one, &mut copy] {
            act(environment.as_mut(), 10);
            environment.reset().unwrap();
            act(environment.as_mut(), 10);
        }
        assert_eq!(copy.frame().unwrap(), one.frame().unwrap(), "{place}: after a restore");
    }
}

#[test]
fn a_snapshot_of_another_distractor_is_refused() {
    let [color, camera] = distractions(0.1);
    let (mut color, camera) =
        (environment("walker-walk", color, 1), environment("walker-walk", camera, 1));
    let error = color.restore(&camera.snapshot().unwrap()).unwrap_err().to_string();
    assert!(error.contains("walker-walk") && error.contains("another distractor"), "{error}");
}

/// A walk under the first settings, told to go on under the second.
fn refused(from: Distractor, into: Distractor) -> String {
    let [mut from, mut into] = [from, into].map(|settings| environment("walker-walk", settings, 1));
    from.reset().unwrap();
    act(from.as_mut(), 5);
    let snapshot = from.snapshot().unwrap();
    from.restore(&snapshot).unwrap();
    into.restore(&snapshot).unwrap_err().to_string()
}

#[test]
fn a_snapshot_that_the_settings_do_not_allow_is_refused() {
    let [wide, narrow] = [0.3, 0.1].map(distractions);
    let error = refused(wide[0], narrow[0]);
    assert!(error.contains("colours further than 0.1"), "{error}");

    let Distractor::Camera(camera) = wide[1] else { panic!("the second is the camera's") };
    for narrower in [
        CameraSettings { horizontal_delta: 0.1, ..camera },
        CameraSettings { vertical_delta: 0.1, ..camera },
        CameraSettings { roll_delta: 1e-6, ..camera },
        CameraSettings { max_zoom_in: 0.1, ..camera },
        CameraSettings { max_zoom_out: 0.1, ..camera },
    ] {
        let error = refused(wide[1], Distractor::Camera(narrower));
        assert!(error.contains("its camera"), "{narrower:?}: {error}");
    }

    let mut walker = environment("walker-walk", wide[1], 1);
    walker.reset().unwrap();
    let mut damaged = walker.snapshot().unwrap();
    damaged["walk"]["Camera"]["place"][1] = 1e3.into();
    let error = walker.restore(&damaged).unwrap_err().to_string();
    assert!(error.contains("its camera"), "{error}");
}

#[test]
fn a_snapshot_from_beyond_the_end_of_an_episode_is_refused() {
    let settings = |episode_steps| Settings::new(84, 84, episode_steps);
    let make = |steps| make("walker-walk", &settings(steps), ChaCha8Rng::seed_from_u64(0)).unwrap();
    let mut long = make(1000);
    long.reset().unwrap();
    act(long.as_mut(), 6);
    let snapshot = long.snapshot().unwrap();
    make(6).restore(&snapshot).unwrap();
    let error = make(5).restore(&snapshot).unwrap_err().to_string();
    assert!(error.contains("6 steps into an episode, and these have 5"), "{error}");
}

#[test]
fn distractors_out_of_range_are_refused() {
    let color = ColorSettings { max_delta: 0.1, step_std: 0.01 };
    let Distractor::Camera(camera) = distractions(0.1)[1] else {
        panic!("the second is the camera's")
    };
    for (name, distraction) in [
        ("max_delta = 1.5", Distractor::Color(ColorSettings { max_delta: 1.5, ..color })),
        ("step_std = NaN", Distractor::Color(ColorSettings { step_std: f64::NAN, ..color })),
        ("max_zoom_in = 1", Distractor::Camera(CameraSettings { max_zoom_in: 1.0, ..camera })),
        ("max_velocity = -1", Distractor::Camera(CameraSettings { max_velocity: -1.0, ..camera })),
        ("max_roll_velocity = inf", {
            Distractor::Camera(CameraSettings { max_roll_velocity: f64::INFINITY, ..camera })
        }),
    ] {
        let settings = Settings { distraction, ..Settings::new(84, 84, 1000) };
        let error =
            make("walker-walk", &settings, ChaCha8Rng::seed_from_u64(0)).err().unwrap().to_string();
        assert!(error.contains(name) && error.contains("walker-walk"), "{error}");
    }
}

/// MuJoCo would end the process.
#[test]
fn a_picture_larger_than_anything_can_draw_is_refused() {
    let settings = Settings::new(1, 1 << 20, 1000);
    let mut environment = make("walker-walk", &settings, ChaCha8Rng::seed_from_u64(0)).unwrap();
    environment.reset().unwrap();
    let error = environment.frame().unwrap_err().to_string();
    assert!(error.contains("width = 1048576") && error.contains("at most"), "{error}");
}

#[test]
fn falling_pixels_has_no_distractors() {
    let settings = Settings { distraction: distractions(0.1)[0], ..Settings::new(35, 15, 250) };
    let error = make("falling-pixels", &settings, ChaCha8Rng::seed_from_u64(0)).err().unwrap();
    assert!(matches!(&error, Error::Distractor { task } if task == "falling-pixels"), "{error}");
}

/// Shadows, mirrors and samples change the picture, as they should; the defaults are what the recorded pictures
/// were drawn with.
#[test]
fn render_settings_take_effect() {
    use hksl_envs::render::RenderSettings;
    let draw = |render| {
        let settings = Settings { render, ..Settings::new(84, 84, 1000) };
        let rng = ChaCha8Rng::seed_from_u64(3);
        let mut environment = make("walker-walk", &settings, rng).unwrap();
        environment.reset().unwrap();
        environment.frame().unwrap()
    };
    let default = draw(RenderSettings::DM_CONTROL);
    for other in [
        RenderSettings { shadows: false, ..RenderSettings::DM_CONTROL },
        RenderSettings { reflections: false, ..RenderSettings::DM_CONTROL },
        RenderSettings { samples: 0, ..RenderSettings::DM_CONTROL },
    ] {
        assert!(changed(&draw(other), &default) > 0.0, "{other:?} draws the same");
    }
}

#[test]
fn a_device_that_is_not_there_is_named() {
    use hksl_envs::render::RenderDevice;
    let settings =
        Settings { render_device: RenderDevice::Number(99), ..Settings::new(84, 84, 1000) };
    let mut environment = make("reacher-easy", &settings, ChaCha8Rng::seed_from_u64(3)).unwrap();
    environment.reset().unwrap();
    let error = environment.frame().unwrap_err();
    assert!(error.is_native() && error.to_string().contains("99"), "{error}");
}
