//! The HKSL agent: soft actor-critic from pixels on a hierarchy of latents (McInroe, Schäfer, Albrecht; TMLR
//! 2024, <https://arxiv.org/abs/2206.11396>).
//!
//! - [`HkslAgent`] acts, remembers and learns; the training loop knows it as an [`Agent`], as it knows every
//!   other method.
//! - [`learner::HkslLearner`] is its learning step alone, over batches and noise that you bring.
//! - [`replay`] stores each frame once and yields augmented trajectories; [`augment`] shifts them.
//! - [`Ablation`] names what the paper takes away from the method, one part at a time.
#![deny(missing_docs)]

pub mod ablation;
mod actor;
mod agent;
pub mod augment;
pub mod config;
pub mod critic;
pub mod diagnosis;
mod error;
pub mod learner;
pub mod replay;
mod temperature;

pub use ablation::Ablation;
pub use actor::{Actor, Sampled};
pub use agent::{
    Acting, Agent, AgentRest, AgentState, ArrivingSequences, Draw, FeatureMaps, Field, HkslAgent,
    Learner, Memory, PixelAgent, Streams, feature_maps_of,
};
pub use error::{Error, Result};
pub use temperature::Temperature;
