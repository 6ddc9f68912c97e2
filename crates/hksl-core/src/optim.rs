//! Adam with visible state, and exponential moving averages.

mod adam;
mod ema;

pub use adam::Adam;
pub use ema::MovingAverage;
