//! How many floating-point operations a learning step has.

/// The operations of encoders, critics and actor in one learning step with every phase, two for each multiply-add.
/// Forward models, communication, projections and elementwise work are left out.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Operations {
    /// Passes of one batch through one encoder, forward or backward; a backward pass counts as two.
    pub encoder_passes: u64,
    /// In encoders, each convolution counted by its definition.
    pub encoders: f64,
    /// In encoders, as the CPU's kernels compute them (the convolutions of stride 1 take fewer).
    pub encoders_executed: f64,
    /// In critics and actor.
    pub networks: f64,
}

impl Operations {
    /// Of encoders and networks, each convolution counted by its definition.
    pub fn total(&self) -> f64 {
        self.encoders + self.networks
    }
}
