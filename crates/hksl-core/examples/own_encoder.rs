//! Uses the hierarchy with a custom encoder, for readings of a pendulum instead of pixels.
//!
//! ```text
//! cargo run --release -p hksl-core --example own_encoder
//! ```
//!
//! Any type that implements [`Encoder`] works. The hierarchy creates each level's encoder three times with a closure: with
//! gradient, without gradient on the same weights, and as the momentum encoder.

use candle_core::{Device, Tensor};
use hksl_core::nn::{Initialisation, LayerNorm, Mlp};
use hksl_core::{
    Builder, Encoder, Hierarchy, HierarchyConfig, HierarchyLearner, Parameters, Result,
    Trajectories, rng,
};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

const READINGS: usize = 3;
const LATENT: usize = 8;
const BATCH: usize = 64;
const LENGTH: usize = 8;

/// Two hidden layers and layer normalisation for readings `(B, 3)`.
struct ReadingsEncoder {
    network: Mlp,
    norm: LayerNorm,
}

impl ReadingsEncoder {
    fn new(builder: &mut Builder) -> Result<Self> {
        let network = Mlp::new(&mut builder.under("network"), &[READINGS, 64, 64, LATENT])?;
        Ok(Self { network, norm: LayerNorm::new(&mut builder.under("norm"), LATENT)? })
    }
}

impl Encoder for ReadingsEncoder {
    fn forward(&self, observations: &Tensor) -> Result<Tensor> {
        self.norm.forward(&self.network.forward(observations)?)
    }
}

fn main() -> Result<()> {
    let config = HierarchyConfig {
        skips: vec![1, 2, 4],
        trajectory_length: LENGTH,
        action_dims: 1,
        latent_dims: LATENT,
        communication_hidden: 32,
        communication: true,
        projection: true,
        shared_encoder: false,
    };
    let device = Device::Cpu;
    let mut parameters = Parameters::default();
    let hierarchy = Hierarchy::new(
        config,
        &mut parameters,
        &mut rng::stream(1, "init"),
        Initialisation::Uniform,
        &device,
        ReadingsEncoder::new,
    )?;
    let mut learner = HierarchyLearner::new(&hierarchy, 1e-3)?;
    let momentum = hierarchy.momentum(0.05)?;
    println!("{} parameters, for example:", parameters.elements());
    for (name, value) in parameters.iter().filter(|(name, _)| name.contains("levels.1")).take(4) {
        println!("  {name} {:?}", value.dims());
    }
    let mut rng = rng::stream(1, "pendulum");
    for step in 0..=200 {
        let losses = learner.step(&hierarchy, &pendulum(&mut rng, &device)?)?;
        // Soft update of the momentum encoders, whose latents are the targets.
        momentum.update()?;
        if step % 40 == 0 {
            let losses = losses.iter().map(|outcome| outcome.loss.to_scalar::<f32>());
            let losses = losses.map(|loss| Ok(format!("{:.3}", loss?)));
            println!("step {step:>3}  losses {}", losses.collect::<Result<Vec<_>>>()?.join(", "));
        }
    }
    Ok(())
}

/// Trajectories of a driven pendulum. Readings are cosine and sine of the angle, and the angular velocity.
fn pendulum(rng: &mut ChaCha8Rng, device: &Device) -> Result<Trajectories> {
    let mut readings = vec![0f32; (LENGTH + 1) * BATCH * READINGS];
    let mut actions = Vec::with_capacity(BATCH * LENGTH);
    for trajectory in 0..BATCH {
        let mut angle: f32 = rng.random_range(-3.0..3.0);
        let mut velocity: f32 = rng.random_range(-1.0..1.0);
        for time in 0..=LENGTH {
            let at = (time * BATCH + trajectory) * READINGS;
            readings[at..at + READINGS].copy_from_slice(&[angle.cos(), angle.sin(), velocity]);
            if time < LENGTH {
                let push: f32 = rng.random_range(-1.0..1.0);
                velocity += 0.1 * (push - angle.sin());
                angle += 0.1 * velocity;
                actions.push(push);
            }
        }
    }
    let observations = Tensor::from_vec(readings, (LENGTH + 1, BATCH, READINGS), device)?;
    let actions = Tensor::from_vec(actions, (BATCH, LENGTH, 1), device)?;
    Ok(Trajectories { observations, actions })
}
