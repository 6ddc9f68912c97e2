//! A small task and agents for tests of the training loop.

pub mod dot;
pub mod learning;
pub mod noted;
pub mod notes;
