//! The HKSL agent: soft actor-critic from pixels on a hierarchy of latents (McInroe, Schäfer, Albrecht; TMLR
//! 2024, <https://arxiv.org/abs/2206.11396>).
//!
//! - [`Agent`] acts, stores transitions and learns; it is the interface of the training loop.
//! - [`Learner`] is the trait of learning methods; [`hksl::Hksl`] implements the paper's method.
//! - [`Networks`] lists a method's networks and gives access to weights, encodings and feature maps.
//! - [`Rollout`] plays episodes, for training, evaluation and probes.
//! - [`replay`] stores each frame once and yields augmented trajectories; [`augment`] shifts them.
//! - [`Ablation`] lists the paper's ablations, each of which removes one part of the method.
#![deny(missing_docs)]

pub mod ablation;
mod actor;
mod agent;
pub mod augment;
pub mod config;
pub mod critic;
pub mod diagnosis;
mod draw;
mod error;
pub mod hksl;
mod learner;
mod networks;
pub mod replay;
mod rollout;
mod temperature;
mod update_report;
mod value_diagnosis;

pub use ablation::Ablation;
pub use actor::{Actor, Sampled};
pub use agent::{Agent, AgentRest, AgentState, Streams};
pub use draw::{ArrivingSequences, Draw, LearningBatch};
pub use error::{Error, Result};
pub use learner::{Acting, Learner, RecurrentState};
pub use networks::{FeatureMaps, ImageEncoder, Networks, QFunction, ReceptiveField};
pub use rollout::Rollout;
pub use temperature::Temperature;
pub use update_report::{Phase, UpdateReport};

// The example of the README is a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
