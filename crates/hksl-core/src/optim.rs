//! Adam with visible state, and exponential moving averages.

mod adam;
mod ema;
mod together;

pub use adam::{Adam, AdamConfig, gradient_norm};
pub use ema::MovingAverage;
pub use together::{load_into, state_of};
