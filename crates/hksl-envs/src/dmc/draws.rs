//! The random draws that resets are made of.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// A source of the two kinds of draw that dm_control's resets use. Recorded draws reproduce a
/// recorded reset.
pub trait Draws {
    /// From the normal distribution of mean 0 and standard deviation 1.
    fn standard_normal(&mut self) -> f64;

    /// Uniform in `[low, high)`.
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
