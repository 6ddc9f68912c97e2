//! The methods that the paper compares HKSL with, and plain SAC, on the same encoder, actor, critics, augmentation,
//! replay and loop, so that a difference between two curves is one between two methods.
//!
//! | method | what it adds to soft actor-critic from pixels |
//! |---|---|
//! | [`Drq`] with one view | nothing but the random shift: plain SAC |
//! | [`Drq`] | losses summed and targets averaged over views (Kostrikov et al., arXiv 2004.13649) |
//! | [`Curl`] | two views of an observation must be recognised as one (Laskin et al., arXiv 2004.04136) |
//! | [`PiSac`] | predictive information, compressed (Lee et al., arXiv 2007.12401) |
//! | [`Dbc`] | distances between latents are distances in behaviour (Zhang et al., arXiv 2006.10742) |
//! | [`DreamerV2`] | nothing: it learns a model of the world, and actor and critic in its imagination |
//!
//! Each is a [`hksl_sac::Learner`]; all but DreamerV2 build on one [`ActorCritic`]. `docs/baselines.md`
//! states their losses and where they differ from the originals.
#![deny(missing_docs)]
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod actor_critic;
pub mod bisimulation;
pub mod config;
pub mod contrastive;
mod curl;
mod dbc;
pub mod dreamer;
mod drq;
mod pi_sac;
mod transitions;

pub use actor_critic::{ActorCritic, ActorInput, Architecture, Passes};
pub use curl::{Curl, Pairs};
pub use dbc::{Dbc, ModelLosses, Permuted};
pub use dreamer::DreamerV2;
pub use drq::{Drq, Views};
pub use hksl_sac::{Error, Result};
pub use pi_sac::{PiSac, Windows};
pub use transitions::Transitions;
