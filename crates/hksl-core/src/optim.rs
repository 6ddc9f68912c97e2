//! Adam with visible state, and exponential moving averages.

mod adam;
mod ema;
mod norm;
mod together;

pub use adam::{Adam, AdamConfig};
pub use ema::MovingAverage;
pub use norm::gradient_norm;
pub use together::{load_into, state_of};
