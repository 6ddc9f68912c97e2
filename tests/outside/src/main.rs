//! Trains a hierarchy of two levels on one batch of trajectories, and fails unless every level's loss halves.

use candle_core::{DType, Device, Tensor};
use hksl_core::nn::{Initialisation, PixelEncoder, PixelEncoderConfig};
use hksl_core::{Hierarchy, HierarchyConfig, HierarchyLearner, Parameters, Trajectories, rng};

const STEPS: usize = 200;

fn main() -> hksl_core::Result<()> {
    let config = HierarchyConfig {
        skips: vec![1, 3],
        trajectory_length: 6,
        action_dims: 2,
        latent_dims: 8,
        communication_hidden: 16,
        communication: true,
        projection: true,
        shared_encoder: false,
    };
    let encoder = PixelEncoderConfig { filters: 4, latent_dims: 8 };
    let (device, mut weights) = (Device::Cpu, Parameters::default());
    let mut generator = rng::stream(1, "outside");
    let hierarchy = Hierarchy::new(
        config,
        &mut weights,
        &mut generator,
        Initialisation::Uniform,
        &device,
        |builder| PixelEncoder::new(builder, [3, 20, 20], encoder),
    )?;
    let mut learner = HierarchyLearner::new(&hierarchy, 1e-3)?;
    let momentum = hierarchy.momentum(0.05)?;
    let pixels = rng::standard_normal(&mut generator, &[7, 8, 3, 20, 20], &device)?;
    let batch = Trajectories {
        observations: pixels.affine(40.0, 128.0)?.clamp(0.0, 255.0)?.to_dtype(DType::U8)?,
        actions: rng::standard_normal(&mut generator, &[8, 6, 2], &device)?.tanh()?,
    };
    let mut losses: Vec<Vec<f32>> = Vec::new();
    for _ in 0..STEPS {
        let outcomes = learner.step(&hierarchy, &batch)?;
        let values = outcomes.iter().map(|outcome| outcome.loss.to_scalar());
        losses.push(values.collect::<candle_core::Result<_>>()?);
        momentum.update()?;
    }
    for (level, (first, last)) in losses[0].iter().zip(&losses[STEPS - 1]).enumerate() {
        println!("level {}: loss {first:.3} at first, {last:.3} after {STEPS} steps", level + 1);
        assert!(*last < 0.5 * first, "the loss did not halve");
    }
    let latents: Tensor = hierarchy.encode(&batch.at(0)?)?;
    assert_eq!(latents.dims(), [8, 16]);
    Ok(())
}
