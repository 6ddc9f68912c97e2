//! How much memory a learning step takes.

use hksl_core::nn::PixelEncoder;

use super::Hksl;

/// What allocator and bookkeeping add, measured: 10 to 15 %.
const MARGIN: f64 = 1.2;

impl Hksl {
    /// Bytes of the networks, their optimisers and the largest of what a learning step holds at a time,
    /// estimated from above for a CPU.
    pub(super) fn estimated_bytes(&self) -> u64 {
        let architecture = &self.architecture;
        let config = architecture.hierarchy();
        let batch = architecture.sac.batch_size;
        // Weight, gradient and two moments; encoders have a second pair, the slow networks have the first alone.
        let elements = |prefix: &str| self.networks.parameters.under(prefix).elements();
        let slow = elements("targets") + elements("momentum");
        let encoders: usize =
            (0..config.encoders()).map(|i| elements(&self.hierarchy.encoder_name(i))).sum();
        let trained = self.networks.parameters.elements() - slow;
        let networks = (4 * trained + 2 * encoders + slow) * size_of::<f32>();
        // As replayed, augmented, as a tensor, and those that the targets encode.
        let observation: usize = architecture.observation.iter().product();
        let frames = 4 * (config.trajectory_length + 1) * batch * observation;
        // Kept for the gradient of every encoder; with the last map's gradient on the way.
        let (all, last) = PixelEncoder::map_bytes(architecture.observation, architecture.encoder)
            .unwrap_or((0, 0));
        let tracked = config.encoders() * batch * (all + 2 * last);
        let steps = (0..config.levels()).map(|level| config.steps(level));
        let targets = match architecture.hksl.update_schedule {
            crate::config::UpdateSchedule::Sequential => steps.max().unwrap_or(0),
            crate::config::UpdateSchedule::Joint => steps.sum(),
        };
        let passes = tracked + targets * batch * last;
        // Between a layer's outputs and their gradients lie twenty or so matrices of hidden units.
        let hidden =
            24 * config.levels() * batch * architecture.sac.hidden_units * size_of::<f32>();
        (MARGIN * (networks + frames + passes + hidden) as f64) as u64
    }
}
