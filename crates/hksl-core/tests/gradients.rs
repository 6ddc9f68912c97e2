//! Gradients of every level's loss against finite differences, for each parameter that the loss reaches.

use candle_core::{Device, Tensor, Var};
use hksl_core::nn::{Initialisation, PixelEncoder, PixelEncoderConfig};
use hksl_core::{Hierarchy, HierarchyConfig, Parameters, Trajectories, rng};
use rand::Rng;

fn hierarchy(shared_encoder: bool) -> Hierarchy<PixelEncoder> {
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
    let encoder = PixelEncoderConfig { filters: 3, latent_dims: 5 };
    Hierarchy::new(
        config,
        &mut Parameters::default(),
        &mut rng::stream(5, "init"),
        Initialisation::Uniform,
        &Device::Cpu,
        |builder| PixelEncoder::new(builder, [2, 16, 17], encoder),
    )
    .unwrap()
}

fn trajectories() -> Trajectories {
    let mut rng = rng::stream(6, "data");
    let pixels: Vec<u8> = (0..5 * 3 * 2 * 16 * 17).map(|_| rng.random()).collect();
    Trajectories {
        observations: Tensor::from_vec(pixels, (5, 3, 2, 16, 17), &Device::Cpu).unwrap(),
        actions: rng::standard_normal(&mut rng, &[3, 4, 2], &Device::Cpu).unwrap(),
    }
}

/// Along its own gradient `g`, a loss must rise by `|g|` a unit.
fn check(hierarchy: &Hierarchy<PixelEncoder>, level: usize) {
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
            continue; // The difference would drown in the loss's own rounding.
        }
        let start = parameter.as_detached_tensor().copy().unwrap();
        let at = |parameter: &Var, distance: f64| {
            let shift = (gradient * (distance / length)).unwrap();
            parameter.set(&(&start + shift).unwrap()).unwrap();
            loss()
        };
        // Convolutions feed many ReLUs, whose kinks bend a longer path.
        let distance = if name.contains("convs") { 6e-4 } else { 3e-3 };
        let slope = (at(parameter, distance) - at(parameter, -distance)) / (2.0 * distance);
        parameter.set(&start).unwrap();
        assert!(
            (slope - length).abs() <= 0.02 * length + 1e-3,
            "level {level} {name}: slope {slope}, gradient {length}"
        );
        checked += 1;
    }
    assert!(checked > 15, "only {checked} parameters of level {level} had a gradient to check");
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
