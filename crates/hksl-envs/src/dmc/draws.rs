//! Random draws of resets.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// A source of the two kinds of random draws in dm_control's resets. Recorded draws reproduce a recorded reset.
pub trait Draws {
    /// Draws from the standard normal distribution.
    fn standard_normal(&mut self) -> f64;

    /// Draws uniformly from `[low, high)`.
    fn uniform(&mut self, low: f64, high: f64) -> f64;
}

impl Draws for ChaCha8Rng {
    fn standard_normal(&mut self) -> f64 {
        self.sample(StandardNormal)
    }

    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.random::<f64>()
    }
}
