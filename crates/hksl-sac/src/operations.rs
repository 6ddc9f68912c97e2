//! Floating-point operations of a learning step.

/// Floating-point operations of encoders, critics and actor in one learning step with all updates due. A multiply-add
/// counts as two. Forward models, communication managers, projections and elementwise operations are not counted.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Operations {
    /// Passes of one batch through one encoder. A forward pass counts as one, a backward pass as two.
    pub encoder_passes: u64,
    /// Operations of the encoders, with convolutions counted by their definition.
    pub encoders: f64,
    /// Operations of the encoders as the CPU kernels execute them. Convolutions of stride 1 need fewer than by definition.
    pub encoders_executed: f64,
    /// Operations of critics and actor.
    pub networks: f64,
}

impl Operations {
    /// Operations of encoders, critics and actor, with convolutions counted by their definition.
    pub fn total(&self) -> f64 {
        self.encoders + self.networks
    }
}
