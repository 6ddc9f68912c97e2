//! Adam with serialisable state, and moving averages of weights.

mod adam;
mod ema;
mod named_state;
mod norm;

pub use adam::{Adam, AdamConfig};
pub use ema::MovingAverage;
pub use named_state::{load_into, state_of};
pub use norm::gradient_norm;
