//! Adam's step in two passes, as the GPU kernels compute it.

/// Coefficients of the moment update: decay rates, gradient scale and L2 penalty.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MomentStep {
    pub(crate) betas: (f32, f32),
    pub(crate) scale: f32,
    pub(crate) l2: f32,
}

impl MomentStep {
    /// Updates the first and second moments `(2, N)` with gradients `(N)` and weights `(N)`.
    pub(crate) fn apply(&self, moments: &mut [f32], gradients: &[f32], weights: &[f32]) {
        let Self { betas: (beta1, beta2), scale, l2 } = *self;
        let (means, squares) = moments.split_at_mut(gradients.len());
        let pairs = means.iter_mut().zip(squares).zip(gradients.iter().zip(weights));
        for ((mean, square), (gradient, weight)) in pairs {
            let gradient = gradient * scale + weight * l2;
            *mean = *mean * beta1 + gradient * (1.0 - beta1);
            *square = *square * beta2 + gradient * gradient * (1.0 - beta2);
        }
    }
}

/// Coefficients of the weight update: learning rate, square root of the second moment's bias correction, ε, and the
/// factor of weight decay.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WeightStep {
    pub(crate) rate: f32,
    pub(crate) root_correction2: f32,
    pub(crate) epsilon: f32,
    pub(crate) kept: f32,
}

impl WeightStep {
    /// Updates weights `(N)` with moments `(2, N)`.
    pub(crate) fn apply(&self, weights: &mut [f32], moments: &[f32]) {
        let Self { rate, root_correction2, epsilon, kept } = *self;
        let (means, squares) = moments.split_at(weights.len());
        for (weight, (mean, square)) in weights.iter_mut().zip(means.iter().zip(squares)) {
            let length = square.sqrt() / root_correction2 + epsilon;
            *weight = (*weight - rate * mean / length) * kept;
        }
    }
}
