//! One file a command.

pub mod bench;
pub mod completions;
pub mod config;
pub mod doctor;
pub mod eval;
pub mod rollout;
pub mod tasks;
pub mod train;
