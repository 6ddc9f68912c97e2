//! Compares a rendered frame with dm_control's frame of the same state.

use std::time::{Duration, Instant};

use anyhow::Context;
use hksl_envs::render::RendererDescription;
use hksl_envs::rollout::Start;
use hksl_envs::{Environment, Error, Settings};
use hksl_files::digest::sha256;
use ndarray::{Array3, Axis};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::finding::Finding;

/// The state: the pole hangs, a little to one side.
const STATE: &str = r#"{"task": "cartpole-swingup", "qpos": [0.02630205148875025, 3.1449090054096565],
    "qvel": [0.0, 0.0], "actions": []}"#;
/// dm_control's frame of the state, and its SHA-256, channel by channel.
const REFERENCE: &[u8] = include_bytes!("test_frame.png");
const REFERENCE_HASH: &str = "7ca8ef65b46ca5fd3b3d0830e30710c4e4e768c2baa3314d754cea1b4a8b4558";
/// Parts of the name of the renderer of the reference.
const REFERENCE_RENDERER: [&str; 2] = ["llvmpipe (LLVM 15", "Mesa 22.3.6"];
const SIDE: usize = 84;
/// Side of the blocks whose means are compared: renderers may differ in edges and textures, but not in objects.
const BLOCK: usize = 7;
/// Levels of 255 by which a block's mean may differ: more than without anti-aliasing (10), less than without shadows
/// (18), with the cart moved by 7 cm (20) or the pole leaning by 9 degrees more (44).
const TOLERANCE: f64 = 16.0;

/// Difference of two frames, in levels of 255.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Difference {
    /// Mean absolute difference.
    mean: f64,
    /// Share of differing pixels.
    pixels: f64,
    /// The largest difference of the means of a block, of one channel.
    block: f64,
}

impl Difference {
    fn between(one: &Array3<u8>, other: &Array3<u8>) -> Self {
        let difference = one.mapv(f64::from) - other.mapv(f64::from);
        let differs = |pixel: ndarray::ArrayView1<f64>| pixel.iter().any(|level| *level != 0.0);
        let pixels = difference.lanes(Axis(0)).into_iter();
        let changed = pixels.filter(|pixel| differs(*pixel)).count();
        let blocks = difference.exact_chunks((1, BLOCK, BLOCK)).into_iter();
        let means = blocks.map(|block| block.sum().abs() / block.len() as f64);
        Self {
            mean: difference.mapv(f64::abs).mean().unwrap_or(0.0),
            pixels: changed as f64 * one.dim().0 as f64 / one.len() as f64,
            block: means.fold(0.0, f64::max),
        }
    }
}

/// Renders the state twice. The frames must be equal, and similar to dm_control's.
pub fn examine(renderer: &RendererDescription) -> Vec<Finding> {
    let (first, second, time) = match draw().context("cannot render a frame") {
        Ok(drawn) => drawn,
        Err(error) => {
            let advice = "fix the failed checks above first";
            return vec![Finding::fail("test frame", &error, advice)];
        }
    };
    let repeated = judge_repetition(&first, &second, time);
    match decode(REFERENCE) {
        Ok(reference) => vec![repeated, judge(&first, &reference, &renderer.software)],
        Err(error) => {
            let advice = "build hksl again: its reference frame is damaged";
            vec![repeated, Finding::fail("frame hash", &error, advice)]
        }
    }
}

/// Renders the frame twice and times the second rendering.
fn draw() -> Result<(Array3<u8>, Array3<u8>, Duration), Error> {
    let start = Start::parse(STATE)?;
    let settings = Settings::new(SIDE, SIDE, 1000);
    let mut task = hksl_envs::control_task(&start.task, &settings, ChaCha8Rng::seed_from_u64(0))?;
    task.start(&start)?;
    let first = task.frame()?;
    let begun = Instant::now();
    let second = task.frame()?;
    Ok((first, second, begun.elapsed()))
}

fn judge_repetition(first: &Array3<u8>, second: &Array3<u8>, time: Duration) -> Finding {
    let (channels, height, width) = first.dim();
    let found = format!(
        "{height} × {width} pixels, {channels} channels, {:.0} ms",
        time.as_secs_f64() * 1e3
    );
    if first == second {
        return Finding::ok("test frame", format!("{found}, identical when rendered twice"));
    }
    let advice = "runs with this renderer are not reproducible bit for bit: choose another \
                  EGL device with --render-device if that matters";
    Finding::warn("test frame", format!("{found}, different when rendered twice"), advice)
}

fn judge(frame: &Array3<u8>, reference: &Array3<u8>, renderer: &str) -> Finding {
    let hash = hash(frame);
    let shown = &hash[..16];
    if hash == REFERENCE_HASH {
        let found = format!("{shown}: identical to dm_control's frame");
        return Finding::ok("frame hash", found);
    }
    let Difference { mean, pixels, block } = Difference::between(frame, reference);
    let difference =
        format!("{mean:.2} of 255 levels on average, in {:.1} % of the pixels", pixels * 100.0);
    if block > TOLERANCE {
        let reason = format!(
            "{shown}: the test frame differs from dm_control's by \
             {difference}, and in one block by {block:.0}"
        );
        let advice = "this driver renders incorrectly: update it, or choose another EGL device \
                      (MUJOCO_EGL_DEVICE_ID)";
        return Finding::fail("frame hash", &Error::Graphics { reason }.into(), advice);
    }
    if REFERENCE_RENDERER.iter().all(|part| renderer.contains(part)) {
        let found = format!("{shown}, expected {}: differs by {difference}", &REFERENCE_HASH[..16]);
        let advice = "on other machines, this renderer reproduces dm_control's frame exactly: compare runs \
                      bit for bit only between machines with this hash";
        return Finding::warn("frame hash", found, advice);
    }
    let found = format!(
        "{shown}: differs from the frame of the reference renderer (Mesa 22.3.6, llvmpipe) by \
         {difference}"
    );
    Finding::ok("frame hash", found)
}

/// SHA-256 of the frame, channel by channel, each from the top row down.
fn hash(frame: &Array3<u8>) -> String {
    let levels: Vec<u8> = frame.iter().copied().collect();
    sha256(levels)
}

/// Decodes an RGB image as `(3, height, width)`.
fn decode(file: &[u8]) -> anyhow::Result<Array3<u8>> {
    let mut reader = png::Decoder::new(std::io::Cursor::new(file)).read_info()?;
    let mut levels = vec![0; reader.output_buffer_size().context("too large")?];
    let info = reader.next_frame(&mut levels)?;
    let shape = (info.height as usize, info.width as usize, 3);
    Ok(Array3::from_shape_vec(shape, levels)?.permuted_axes([2, 0, 1]))
}

#[cfg(test)]
mod tests {
    use crate::commands::doctor::finding::exit_code;
    use crate::exit::Code;

    use super::*;

    const KNOWN: &str = "Mesa, llvmpipe (LLVM 15.0.6, 256 bits), 4.5 Mesa 22.3.6";
    const OTHER: &str = "NVIDIA Corporation, NVIDIA A40/PCIe/SSE2, 4.6.0 NVIDIA 535.1";

    fn reference() -> Array3<u8> {
        decode(REFERENCE).unwrap()
    }

    fn codes(frame: &Array3<u8>, renderer: &str) -> (bool, Code) {
        let finding = judge(frame, &reference(), renderer);
        (finding.is_fine(), exit_code(&[finding]))
    }

    #[test]
    fn the_reference_is_the_picture_that_the_frames_test_holds() {
        let fixture = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../hksl-envs/tests/fixtures/frames/cartpole-swingup_0.png"
        );
        assert_eq!(std::fs::read(fixture).unwrap(), REFERENCE);
        assert_eq!(reference().dim(), (3, SIDE, SIDE));
        assert_eq!(hash(&reference()), REFERENCE_HASH);
    }

    #[test]
    fn the_reference_is_fine_whatever_drew_it() {
        assert_eq!(codes(&reference(), KNOWN), (true, Code::Done));
        assert_eq!(codes(&reference(), OTHER), (true, Code::Done));
    }

    #[test]
    fn other_pixels_are_a_warning_where_the_renderer_is_known() {
        let mut near = reference();
        near[(0, 40, 40)] ^= 4;
        assert_eq!(codes(&near, KNOWN), (false, Code::Done));
        assert_eq!(codes(&near, OTHER), (true, Code::Done));
        let Difference { mean, pixels, block } = Difference::between(&near, &reference());
        assert_eq!(mean, 4.0 / 21168.0);
        assert_eq!(pixels, 1.0 / 7056.0);
        assert_eq!(block, 4.0 / 49.0);
    }

    #[test]
    fn noise_is_not_another_picture() {
        let mut noisy = reference();
        for (index, level) in noisy.iter_mut().enumerate() {
            *level = level.saturating_add_signed([-9, 0, 9][index % 3]);
        }
        assert_eq!(codes(&noisy, OTHER), (true, Code::Done));
    }

    #[test]
    fn wrong_frames_fail_on_every_renderer() {
        let reference = reference();
        let mut upside_down = reference.clone();
        upside_down.invert_axis(Axis(1));
        let mut other_channels = reference.clone();
        other_channels.invert_axis(Axis(0));
        // Each column below the cart as the one at the picture's left edge.
        let mut without_pole = reference.clone();
        for row in SIDE / 2..SIDE {
            for channel in 0..3 {
                let left = reference[(channel, row, 0)];
                without_pole.slice_mut(ndarray::s![channel, row, 36..48]).fill(left);
            }
        }
        let blank = Array3::zeros(reference.dim());
        let darker = reference.mapv(|level| level / 2);
        for (name, wrong) in [
            ("upside down", upside_down),
            ("other channels", other_channels),
            ("without its pole", without_pole),
            ("blank", blank),
            ("darker", darker),
        ] {
            for renderer in [KNOWN, OTHER] {
                assert_eq!(codes(&wrong, renderer), (false, Code::Native), "{name}");
            }
        }
    }

    #[test]
    fn a_picture_that_changes_when_drawn_again_is_told() {
        let (one, mut other) = (reference(), reference());
        assert!(judge_repetition(&one, &other, Duration::ZERO).is_fine());
        other[(2, 3, 4)] ^= 1;
        assert!(!judge_repetition(&one, &other, Duration::ZERO).is_fine());
    }
}
