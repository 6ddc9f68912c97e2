//! Compares the hierarchy with reference values from PyTorch (`golden/README.md`).

use candle_core::Tensor;
use hksl_core::Encoder;

use crate::fixture::cases_and_kernels;

const TOLERANCE: f64 = 1e-5;

#[test]
fn golden_encodings_and_rollouts() {
    for (case, kernels) in cases_and_kernels() {
        let (hierarchy, trajectories) = (case.hierarchy(kernels), case.trajectories());
        let first = trajectories.at(0).unwrap();
        for level in 0..case.sizes.skips.len() {
            let encoding = hierarchy.encoder(level).forward(&first).unwrap();
            case.check(&format!("value.encoding.{level}"), &encoding, TOLERANCE);
            let latents = hierarchy.rollouts(level, &trajectories).unwrap().pop().unwrap();
            let latents = Tensor::stack(&latents, 0).unwrap();
            case.check(&format!("value.rollout.{level}"), &latents, TOLERANCE);
        }
    }
}

#[test]
fn golden_level_losses_and_gradients() {
    for (case, kernels) in cases_and_kernels() {
        let (hierarchy, trajectories) = (case.hierarchy(kernels), case.trajectories());
        for level in 0..case.sizes.skips.len() {
            let loss = hierarchy.level_loss(level, &trajectories).unwrap().loss;
            case.check(&format!("value.level_loss.{level}"), &loss, TOLERANCE);
            let gradients = loss.backward().unwrap();
            let expected = case.under(&format!("grad.level_loss.{level}."));
            let mut compared = 0;
            for (name, parameter) in hierarchy.parameters().iter() {
                let Some(gradient) = gradients.get(parameter) else { continue };
                let key = name.strip_prefix("levels.").unwrap_or(name);
                case.check(&format!("grad.level_loss.{level}.{key}"), gradient, TOLERANCE);
                compared += 1;
            }
            assert_eq!(compared, expected.len(), "{} level {level}", case.name);
        }
    }
}
