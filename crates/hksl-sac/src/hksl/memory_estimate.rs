//! Memory estimate of a learning step.

use hksl_core::nn::PixelEncoder;

use super::Hksl;

/// Factor for the overhead of allocator and bookkeeping, measured at 10 to 15 %.
const MARGIN: f64 = 1.2;

impl Hksl {
    /// Estimated upper bound of the bytes that networks, optimisers and a learning step use on a CPU.
    pub(super) fn estimated_bytes(&self) -> u64 {
        let architecture = &self.architecture;
        let config = architecture.hierarchy();
        let batch = architecture.sac.batch_size;
        // Trained networks have a weight, a gradient and two moments per parameter, encoders two moments more. Target
        // networks have the weight alone.
        let elements = |prefix: &str| self.networks.parameters.under(prefix).elements();
        let target = elements("targets") + elements("momentum");
        let encoders: usize =
            (0..config.encoders()).map(|i| elements(&self.hierarchy.encoder_name(i))).sum();
        let trained = self.networks.parameters.elements() - target;
        let networks = (4 * trained + 2 * encoders + target) * size_of::<f32>();
        // Four copies: the sampled frames, the augmented ones, their tensor, and the observations of the targets.
        let observation: usize = architecture.observation.iter().product();
        let frames = 4 * (config.trajectory_length + 1) * batch * observation;
        // Activations kept for the backward pass of every encoder, and the gradient of the last feature map.
        let (all, last) = PixelEncoder::map_bytes(architecture.observation, architecture.encoder)
            .unwrap_or((0, 0));
        let tracked = config.encoders() * batch * (all + 2 * last);
        let steps = (0..config.levels()).map(|level| config.steps(level));
        let targets = match architecture.hksl.update_schedule {
            crate::config::UpdateSchedule::Sequential => steps.max().unwrap_or(0),
            crate::config::UpdateSchedule::Joint => steps.sum(),
        };
        let passes = tracked + targets * batch * last;
        // The networks on the latents keep about 24 matrices of hidden units per level.
        let hidden =
            24 * config.levels() * batch * architecture.sac.hidden_units * size_of::<f32>();
        (MARGIN * (networks + frames + passes + hidden) as f64) as u64
    }
}
