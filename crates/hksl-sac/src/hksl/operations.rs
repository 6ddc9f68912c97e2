//! How many floating-point operations a learning step has.

use hksl_core::nn::PixelEncoder;

use super::Architecture;
use crate::config::UpdateSchedule;
use crate::operations::Operations;

/// Counts them; errors are those of an image too small for the encoder.
pub(super) fn of(architecture: &Architecture) -> crate::Result<Operations> {
    let Architecture { observation, action_dims, encoder, hksl, sac } = architecture;
    let config = architecture.hierarchy();
    let (levels, encoders) = (config.levels(), config.encoders());
    let mut next: Vec<usize> = hksl.skips.clone();
    next.sort_unstable();
    next.dedup();
    let steps: usize = (0..levels).map(|level| config.steps(level)).sum();
    // Forward passes, and those of them that are followed by a backward pass.
    let (mut forward, mut backward) = (0, 0);
    if hksl.representation {
        forward += steps;
    } else {
        forward += levels;
    }
    match hksl.update_schedule {
        UpdateSchedule::Sequential => {
            if hksl.representation {
                let rolled = if hksl.communication { levels * (levels + 1) / 2 } else { levels };
                forward += rolled;
                backward += rolled;
            }
            forward += levels * (encoders + 1) + encoders;
            backward += levels;
        }
        UpdateSchedule::Joint => {
            forward += encoders + next.len() * encoders;
            // Of the models' losses, and of the critics'.
            backward += encoders * if hksl.representation { 2 } else { 1 };
        }
    }
    let one = PixelEncoder::operations(*observation, *encoder)?;
    let batch = sac.batch_size as f64;
    let total = |forward_one: f64, backward_one: f64| {
        batch * (forward as f64 * forward_one + backward as f64 * backward_one)
    };
    let hidden = sac.hidden_units as f64;
    let network = |inputs: usize, outputs: usize| {
        2.0 * batch * (inputs as f64 * hidden + hidden * hidden + hidden * outputs as f64)
    };
    let q = network(encoder.latent_dims + action_dims, 1);
    let actor = network(encoders * encoder.latent_dims, 2 * action_dims);
    // Of each level: two target networks forward; two trained ones forward and backward (three times the
    // forward pass in all); two forward and, towards the action, backward (twice) for the actor. The
    // actor runs once a level for the next action and once with its gradient.
    let levels = levels as f64;
    let networks = levels * q * (2.0 + 6.0 + 4.0) + actor * (levels + 3.0);
    Ok(Operations {
        encoder_passes: (forward + 2 * backward) as u64,
        encoders: total(one.forward, one.backward),
        encoders_executed: total(one.forward_executed, one.backward_executed),
        networks,
    })
}
