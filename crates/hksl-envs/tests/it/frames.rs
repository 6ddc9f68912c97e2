//! FrameWriter: equal to dm_control's to the pixel where the same software draws them.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use hksl_envs::dmc::ControlTask;
use hksl_envs::render::{RenderDevice, renderer_description};
use hksl_envs::rollout::Start;
use hksl_envs::{Environment, Settings};
use ndarray::Array3;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

const SETTINGS: Settings = Settings::new(84, 84, 1000);

/// What a picture was drawn from.
#[derive(serde::Deserialize)]
struct State {
    start: Start,
    camera: Option<Camera>,
    #[serde(default)]
    colors: Vec<[f64; 3]>,
}

#[derive(serde::Deserialize)]
struct Camera {
    position: [f64; 3],
    axes: [f64; 9],
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/frames")
}

fn task() -> ControlTask {
    hksl_envs::control_task("cartpole-swingup", &SETTINGS, ChaCha8Rng::seed_from_u64(0)).unwrap()
}

/// A picture as `(3, height, width)`.
fn read_png(path: &Path) -> Array3<u8> {
    let mut reader =
        png::Decoder::new(BufReader::new(File::open(path).unwrap())).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert_eq!(info.color_type, png::ColorType::Rgb);
    let shape = (info.height as usize, info.width as usize, 3);
    Array3::from_shape_vec(shape, pixels).unwrap().permuted_axes([2, 0, 1])
}

/// Largest and mean absolute difference, levels of 255.
fn difference(a: &Array3<u8>, b: &Array3<u8>) -> (u8, f64) {
    assert_eq!(a.dim(), b.dim());
    let levels: Vec<u8> = a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).collect();
    let mean = levels.iter().map(|&level| f64::from(level)).sum::<f64>() / levels.len() as f64;
    (levels.into_iter().max().unwrap(), mean)
}

#[test]
fn pictures_equal_the_recorded_ones() {
    let renderer = renderer_description(RenderDevice::Auto { cuda: None })
        .unwrap_or_else(|error| panic!("{error}"))
        .software;
    let same_software =
        ["llvmpipe (LLVM 15", "Mesa 22.3.6"].iter().all(|part| renderer.contains(part));
    println!(
        "drawn by {renderer}: {}",
        if same_software { "must be equal to the pixel" } else { "mean difference below 2 levels" }
    );
    let states: BTreeMap<String, State> =
        serde_json::from_reader(File::open(folder().join("frames.json")).unwrap()).unwrap();
    assert_eq!(states.len(), 24);
    for (name, State { start, camera, colors }) in &states {
        let rng = ChaCha8Rng::seed_from_u64(0);
        let mut task = hksl_envs::control_task(&start.task, &SETTINGS, rng).unwrap();
        task.start(start).unwrap();
        if let Some(Camera { position, axes }) = camera {
            task.aim(*position, *axes);
        }
        task.paint(colors);
        let frame = task.frame().unwrap();
        let (largest, mean) = difference(&frame, &read_png(&folder().join(format!("{name}.png"))));
        println!("{name}: largest difference {largest}, mean {mean:.4}");
        if same_software {
            assert_eq!(largest, 0, "{name}");
        }
        assert!(mean < 2.0, "{name}: mean difference {mean}");
    }
    // The comparison can tell states apart: two of the pictures differ from each other.
    let recorded: Vec<_> =
        states.keys().map(|name| read_png(&folder().join(format!("{name}.png")))).collect();
    assert!(difference(&recorded[0], &recorded[1]).0 > 0);
}

#[test]
fn drawing_changes_no_state_and_two_environments_do_not_disturb_each_other() {
    let (mut drawn, mut blind, mut small) = (task(), task(), {
        let settings = Settings::new(40, 60, 10);
        let rng = ChaCha8Rng::seed_from_u64(1);
        hksl_envs::control_task("cartpole-swingup", &settings, rng).unwrap()
    });
    for task in [&mut drawn, &mut blind, &mut small] {
        task.reset().unwrap();
    }
    let first = drawn.frame().unwrap();
    assert_eq!(small.frame().unwrap().dim(), (3, 40, 60));
    assert_eq!(drawn.frame().unwrap(), first);
    for _ in 0..10 {
        let (a, b) = (drawn.step(&[1.0]).unwrap(), blind.step(&[1.0]).unwrap());
        small.step(&[-1.0]).unwrap();
        drawn.frame().unwrap();
        small.frame().unwrap();
        assert_eq!(a.reward.to_bits(), b.reward.to_bits());
    }
    assert_eq!((drawn.qpos(), drawn.qvel()), (blind.qpos(), blind.qvel()));
    let moved = drawn.frame().unwrap();
    assert!(difference(&moved, &first).0 > 0);
    assert_eq!(blind.frame().unwrap(), moved);
}

#[test]
fn a_picture_beyond_the_models_own_buffer_is_whole() {
    let settings = Settings::new(500, 700, 10);
    let mut task =
        hksl_envs::control_task("cartpole-swingup", &settings, ChaCha8Rng::seed_from_u64(1))
            .unwrap();
    task.reset().unwrap();
    let frame = task.frame().unwrap();
    for row in [0, 499] {
        for column in [0, 699] {
            let lit = (0..3).any(|channel| frame[(channel, row, column)] > 0);
            assert!(lit, "nothing drawn at {row}, {column}");
        }
    }
}

#[test]
fn a_restored_environment_draws_the_same_picture() {
    let mut original = task();
    original.reset().unwrap();
    for _ in 0..25 {
        original.step(&[0.7]).unwrap();
    }
    let mut copy = task();
    copy.restore(&original.snapshot().unwrap()).unwrap();
    assert_eq!(copy.frame().unwrap(), original.frame().unwrap());
}
