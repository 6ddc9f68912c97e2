//! Compares the gradients of every level's loss with finite differences, for each parameter that the loss reaches.
//!
//! The encoder is smooth, because the kinks of hundreds of ReLUs would distort the differences. `golden.rs` and the tests
//! of the layers compare the pixel encoder's gradients with other implementations.

use candle_core::{Device, Tensor, Var};
use hksl_core::nn::{Initialisation, LayerNorm, Linear};
use hksl_core::{Builder, Encoder, Hierarchy, HierarchyConfig, Parameters, Result};
use hksl_core::{Trajectories, rng};

/// The encoder `norm(tanh(W o + b))` for vector observations.
struct SmoothEncoder {
    linear: Linear,
    norm: LayerNorm,
}

impl SmoothEncoder {
    fn new(builder: &mut Builder) -> Result<Self> {
        let linear = Linear::new(&mut builder.under("linear"), 8, 5)?;
        Ok(Self { linear, norm: LayerNorm::new(&mut builder.under("norm"), 5)? })
    }
}

impl Encoder for SmoothEncoder {
    fn forward(&self, observations: &Tensor) -> Result<Tensor> {
        self.norm.forward(&self.linear.forward(observations)?.tanh()?)
    }
}

fn hierarchy(shared_encoder: bool) -> Hierarchy<SmoothEncoder> {
    let config = HierarchyConfig {
        skips: vec![1, 2, 3],
        trajectory_length: 4,
        action_dims: 2,
        latent_dims: 5,
        communication_hidden: 7,
        communication: true,
        projection: true,
        shared_encoder,
    };
    Hierarchy::new(
        config,
        &mut Parameters::default(),
        &mut rng::stream(5, "init"),
        Initialisation::Uniform,
        &Device::Cpu,
        SmoothEncoder::new,
    )
    .unwrap()
}

fn trajectories() -> Trajectories {
    let mut rng = rng::stream(6, "data");
    Trajectories {
        observations: rng::standard_normal(&mut rng, &[5, 32, 8], &Device::Cpu).unwrap(),
        actions: rng::standard_normal(&mut rng, &[32, 4, 2], &Device::Cpu).unwrap(),
    }
}

/// Checks that the directional derivative of a loss along its gradient `g` is `|g|`, within the tolerance of f32 and ReLUs.
fn check(hierarchy: &Hierarchy<SmoothEncoder>, level: usize) {
    let trajectories = trajectories();
    let loss = || {
        let loss = hierarchy.level_loss(level, &trajectories).unwrap().loss;
        f64::from(loss.to_scalar::<f32>().unwrap())
    };
    let gradients = hierarchy.level_loss(level, &trajectories).unwrap().loss.backward().unwrap();
    let mut checked = 0;
    for (name, parameter) in hierarchy.parameters().iter() {
        let Some(gradient) = gradients.get(parameter) else { continue };
        let square = gradient.sqr().unwrap().sum_all().unwrap().to_scalar::<f32>().unwrap();
        let length = f64::from(square).sqrt();
        if length < 1e-2 {
            continue; // The difference would be below the loss's rounding error.
        }
        let start = parameter.as_detached_tensor().copy().unwrap();
        let at = |parameter: &Var, distance: f64| {
            let shift = (gradient * (distance / length)).unwrap();
            parameter.set(&(&start + shift).unwrap()).unwrap();
            loss()
        };
        let distance = 1e-3;
        let slope = (at(parameter, distance) - at(parameter, -distance)) / (2.0 * distance);
        parameter.set(&start).unwrap();
        assert!(
            (slope - length).abs() <= 0.05 * length + 1e-3,
            "level {level} {name}: slope {slope}, gradient {length}"
        );
        checked += 1;
    }
    assert!(checked > 10, "only {checked} parameters of level {level} had a gradient to check");
}

#[test]
fn every_levels_gradient_is_the_slope_of_its_loss() {
    let hierarchy = hierarchy(false);
    for level in 0..3 {
        check(&hierarchy, level);
    }
}

#[test]
fn a_shared_encoders_gradient_is_the_slope_of_each_loss() {
    let hierarchy = hierarchy(true);
    for level in 0..3 {
        check(&hierarchy, level);
    }
}
