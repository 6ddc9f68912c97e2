//! Configurations, the training loop, saved state, failures, event files, and agents that must learn.
#![allow(clippy::unwrap_used)]

mod config;
mod failures;
mod learning;
mod saved_state;
mod support;
mod tensorboard;
mod training_loop;
