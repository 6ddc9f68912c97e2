//! Trains a hierarchy of two levels with the pixel encoder on images of a square that actions move.
//!
//! ```text
//! cargo run --release -p hksl-core --example moving_shapes
//! ```
//!
//! To predict the square's motion, the representation must encode its position: after training, the distance of latents
//! grows with the distance of the squares.

use candle_core::{Device, Tensor};
use hksl_core::nn::{Initialisation, PixelEncoder, PixelEncoderConfig};
use hksl_core::{
    Hierarchy, HierarchyConfig, HierarchyLearner, Parameters, Result, Trajectories, rng,
};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

const SIDE: usize = 20;
const SQUARE: usize = 4;
const BATCH: usize = 32;
const LENGTH: usize = 6;

fn main() -> Result<()> {
    let config = HierarchyConfig {
        skips: vec![1, 3],
        trajectory_length: LENGTH,
        action_dims: 2,
        latent_dims: 16,
        communication_hidden: 32,
        communication: true,
        projection: true,
        shared_encoder: false,
    };
    let encoder = PixelEncoderConfig { filters: 8, latent_dims: config.latent_dims };
    let device = Device::Cpu;
    let mut parameters = Parameters::default();
    let hierarchy = Hierarchy::new(
        config,
        &mut parameters,
        &mut rng::stream(1, "init"),
        Initialisation::Uniform,
        &device,
        |builder| PixelEncoder::new(builder, [1, SIDE, SIDE], encoder),
    )?;
    let mut learner = HierarchyLearner::new(&hierarchy, 1e-3)?;
    let momentum = hierarchy.momentum(0.01)?;

    let mut rng = rng::stream(1, "shapes");
    for step in 0..=150 {
        let (trajectories, _) = moving_square(&mut rng, &device)?;
        let losses = learner.step(&hierarchy, &trajectories)?;
        momentum.update()?;
        if step % 30 == 0 {
            let loss = |level: usize| losses[level].loss.to_scalar::<f32>();
            println!("step {step:>3}  loss of level 1 {:.3}, of level 2 {:.3}", loss(0)?, loss(1)?);
        }
    }

    // Similarity of two latents by the distance of the squares in pixels.
    let (trajectories, places) = moving_square(&mut rng, &device)?;
    let latents = hierarchy.encode(&trajectories.at(0)?)?.to_vec2::<f32>()?;
    let (mut near, mut far) = (Vec::new(), Vec::new());
    for i in 0..BATCH {
        for j in 0..i {
            let distance = distance(&latents[i], &latents[j]);
            let pixels = places[i].0.abs_diff(places[j].0) + places[i].1.abs_diff(places[j].1);
            if pixels <= 3 {
                near.push(distance)
            } else if pixels >= 12 {
                far.push(distance)
            }
        }
    }
    let mean = |values: &[f32]| values.iter().sum::<f32>() / values.len().max(1) as f32;
    println!(
        "mean distance of latents: squares within 3 pixels {:.2}, beyond 12 {:.2}",
        mean(&near),
        mean(&far)
    );
    Ok(())
}

fn distance(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum::<f32>().sqrt()
}

/// Trajectories of a bright square that moves by up to three pixels per step and axis, with their start positions.
fn moving_square(
    rng: &mut ChaCha8Rng,
    device: &Device,
) -> Result<(Trajectories, Vec<(usize, usize)>)> {
    let mut pixels = vec![0u8; (LENGTH + 1) * BATCH * SIDE * SIDE];
    let (mut actions, mut places) = (Vec::new(), Vec::new());
    for trajectory in 0..BATCH {
        let mut place = [(); 2].map(|()| rng.random_range(0..=SIDE - SQUARE));
        places.push((place[0], place[1]));
        for time in 0..=LENGTH {
            let image = (time * BATCH + trajectory) * SIDE * SIDE;
            for row in place[0]..place[0] + SQUARE {
                pixels[image + row * SIDE + place[1]..][..SQUARE].fill(255);
            }
            if time < LENGTH {
                for axis in &mut place {
                    let action: f32 = rng.random_range(-1.0..1.0);
                    let moved = *axis as f32 + (3.0 * action).round();
                    *axis = moved.clamp(0.0, (SIDE - SQUARE) as f32) as usize;
                    actions.push(action);
                }
            }
        }
    }
    let observations = Tensor::from_vec(pixels, (LENGTH + 1, BATCH, 1, SIDE, SIDE), device)?;
    let actions = Tensor::from_vec(actions, (BATCH, LENGTH, 2), device)?;
    Ok((Trajectories { observations, actions }, places))
}
