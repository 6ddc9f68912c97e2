//! Floating-point operations of a learning step.

use hksl_core::nn::PixelEncoder;

use super::Architecture;
use crate::config::UpdateSchedule;
use crate::operations::Operations;

/// Counts the operations of one learning step.
///
/// # Errors
/// An image too small for the encoder.
pub(super) fn of(architecture: &Architecture) -> crate::Result<Operations> {
    let Architecture { observation, action_dims, encoder, hksl, sac } = architecture;
    let config = architecture.hierarchy();
    let (levels, encoders) = (config.levels(), config.encoders());
    let mut next: Vec<usize> = hksl.skips.clone();
    next.sort_unstable();
    next.dedup();
    let steps: usize = (0..levels).map(|level| config.steps(level)).sum();
    // Encoder passes: forward, and backward.
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
            // One backward pass for the representation losses and one for the critic losses.
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
    // Q-functions, per level, in units of one forward pass: 2 for the two target networks, 2 · 3 for the two trained
    // networks forward and backward, 2 · 2 for the actor loss (forward, and backward with respect to the action).
    // Actor: one forward pass per level for the next action, and one forward and backward pass for its loss.
    let levels = levels as f64;
    let networks = levels * q * (2.0 + 6.0 + 4.0) + actor * (levels + 3.0);
    Ok(Operations {
        encoder_passes: (forward + 2 * backward) as u64,
        encoders: total(one.forward, one.backward),
        encoders_executed: total(one.forward_executed, one.backward_executed),
        networks,
    })
}
