//! Runs of agents: how they are configured, trained, evaluated, saved and resumed.
//!
//! A run starts from a [`config::Config`], which [`config::resolve`] puts together from the shipped files, the
//! user's file and the command line. [`train`] carries it out in a [`RunFolder`], with the environment and the
//! agent that [`Factories`] make; [`Event`]s tell whoever watches.
#![deny(missing_docs)]
// They panic where a stream is closed or full.
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod account;
pub mod bench;
pub mod checkpoint;
pub mod config;
pub mod device;
mod error;
pub mod evaluate;
mod factories;
mod folder;
pub mod images;
pub mod memory;
pub mod metrics;
pub mod online;

pub mod play;
pub mod policy;
mod run;
pub mod shell;
pub mod sweep;
mod synthetic;
mod version;

pub use account::{account, names};
pub use error::{Error, Result};
pub use factories::{Factories, Make, Own, Registry, agent, hksl, settings};
pub use folder::check_name;
pub use hksl_files::{Labels, RunFolder, RunId};
pub use run::facts::{instruction_sets, native_facts};
pub use run::{
    Ending, Error as RunError, Event, Outcome, Plan, Progress, Resume, RunMemory, Summary, preview,
    train,
};
pub use version::COMMIT;

// The example of the README is a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
