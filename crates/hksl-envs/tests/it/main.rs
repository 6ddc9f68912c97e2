//! The control tasks on MuJoCo: against recordings of dm_control, and what every task guarantees.
#![cfg(feature = "mujoco")]
#![allow(clippy::unwrap_used)] // A test that cannot go on should stop.

mod battery;
mod control;
mod frames;
mod missing_parts;
mod model_edits;
mod start_states;
