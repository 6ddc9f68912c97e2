//! Adam with visible state, and exponential moving averages.

mod adam;
mod ema;

pub use adam::{Adam, AdamConfig, gradient_norm};
pub use ema::MovingAverage;
