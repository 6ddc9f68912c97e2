//! The commands, one module each.

mod analysis;
pub mod analyze_comm;
pub mod attention;
pub mod bench;
pub mod completions;
pub mod config;
pub mod doctor;
pub mod eval;
pub mod man;
pub mod probe;
pub mod report;
pub mod rollout;
pub mod sweep;
pub mod tasks;
pub mod train;
