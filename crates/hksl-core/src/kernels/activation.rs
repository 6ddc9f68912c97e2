//! Activation functions.

use rayon::prelude::*;

/// Elements per task.
const CHUNK: usize = 1 << 14;

/// An activation function whose derivative can be computed from its output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activation {
    /// Identity.
    None,
    /// ReLU: `max(x, 0)`.
    Relu,
    /// ELU: `x` if positive, `eˣ − 1` otherwise (Clevert et al., arXiv 1511.07289).
    Elu,
}

impl Activation {
    /// Applies the activation to every element in place.
    pub(crate) fn apply(self, numbers: &mut [f32]) {
        let chunks = numbers.par_chunks_mut(CHUNK);
        match self {
            Self::None => {}
            Self::Relu => chunks.flatten().for_each(|x| *x = x.max(0.0)),
            Self::Elu => chunks.flatten().for_each(|x| *x = if *x > 0.0 { *x } else { x.exp_m1() }),
        }
    }

    /// The gradient before the activation, from the output and the gradient after it. None if the two gradients are equal.
    pub(crate) fn backward(self, output: &[f32], gradient: &[f32]) -> Option<Vec<f32>> {
        let mut towards = gradient.to_vec();
        let pairs = towards.par_chunks_mut(CHUNK).zip(output.par_chunks(CHUNK));
        let each = |back: fn(f32, f32) -> f32| {
            pairs.for_each(|(gradient, output)| {
                for (gradient, output) in gradient.iter_mut().zip(output) {
                    *gradient = back(*gradient, *output);
                }
            });
        };
        match self {
            Self::None => return None,
            Self::Relu => each(|gradient, y| if y > 0.0 { gradient } else { 0.0 }),
            Self::Elu => each(|gradient, y| if y > 0.0 { gradient } else { gradient * (y + 1.0) }),
        }
        Some(towards)
    }
}
