//! Floating-point operations and memory estimate of a learning step.

use hksl_core::nn::PixelEncoder;
use hksl_sac::{Operations, Result};

use super::{ActorCritic, Architecture};

/// Factor for the overhead of allocator and bookkeeping.
const MARGIN: f64 = 1.2;

/// Passes of one batch through networks in a learning step with all updates due.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Passes {
    /// Forward passes through an encoder.
    pub forward: u64,
    /// Backward passes through an encoder.
    pub backward: u64,
    /// Augmented views over which the critic loss is summed.
    pub views: u64,
    /// Augmented views over which the targets are averaged.
    pub targets: u64,
    /// Floating-point operations of the method's own networks.
    pub own: f64,
}

impl ActorCritic {
    /// Floating-point operations of a learning step with these passes.
    pub fn operations_of(&self, passes: Passes) -> Result<Operations> {
        let Architecture { observation, action_dims, encoder, sac, .. } = &self.architecture;
        let Passes { forward, backward, views, targets, own } = passes;
        let one = PixelEncoder::operations(*observation, *encoder)?;
        let batch = sac.batch_size as f64;
        let encoders = |forward_one: f64, backward_one: f64| {
            batch * (forward as f64 * forward_one + backward as f64 * backward_one)
        };
        let hidden = sac.hidden_units as f64;
        let network = |inputs: usize, outputs: usize| {
            2.0 * batch * (inputs as f64 * hidden + hidden * hidden + hidden * outputs as f64)
        };
        let q = network(encoder.latent_dims + action_dims, 1);
        let actor = network(encoder.latent_dims, 2 * action_dims);
        let (views, targets) = (views as f64, targets as f64);
        // Q-functions, in units of one forward pass: 2 per view of the next observation for the two target networks,
        // 2 · 3 per view of the observation for the two critics forward and backward, 2 · 2 for the actor loss (forward,
        // and backward with respect to the action). Actor: one forward pass per view of the next observation, and one
        // forward and backward pass for its loss.
        let networks = q * (2.0 * targets + 6.0 * views + 4.0) + actor * (targets + 3.0) + own;
        Ok(Operations {
            encoder_passes: forward + 2 * backward,
            encoders: encoders(one.forward, one.backward),
            encoders_executed: encoders(one.forward_executed, one.backward_executed),
            networks,
        })
    }

    /// Estimated upper bound of the bytes that networks, optimisers and a learning step with these passes use on a CPU.
    /// `own` is the number of parameters in the method's own optimisers.
    pub fn estimated_bytes(&self, passes: Passes, own: usize) -> u64 {
        let Architecture { observation, encoder, sac, .. } = &self.architecture;
        let parameters = &self.networks.parameters;
        let target = parameters.under("targets").elements();
        let trained = parameters.elements() - target;
        let networks = (4 * trained + 2 * own + target) * size_of::<f32>();
        let pixels = 4 * sac.batch_size * observation.iter().product::<usize>();
        let frames = (passes.forward as usize + 2) * pixels;
        let (all, last) = PixelEncoder::map_bytes(*observation, *encoder).unwrap_or((0, 0));
        let tracked = passes.views.max(1) as usize * sac.batch_size * (all + 2 * last);
        let hidden = 24 * sac.batch_size * sac.hidden_units * size_of::<f32>();
        let maps = tracked + 2 * sac.batch_size * last;
        (MARGIN * (networks + frames + maps + hidden) as f64) as u64
    }
}
