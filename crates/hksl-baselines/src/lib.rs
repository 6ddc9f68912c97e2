//! The paper's baselines and plain SAC. All share encoder, actor, critics, augmentation, replay and training loop with
//! HKSL, so that learning curves differ by the method alone.
//!
//! | method | difference to soft actor-critic from pixels |
//! |---|---|
//! | [`Drq`] with one view | random shift augmentation: plain SAC |
//! | [`Drq`] | critic losses and targets averaged over augmented views (Kostrikov et al., arXiv 2004.13649) |
//! | [`Curl`] | contrastive loss between two views of an observation (Laskin et al., arXiv 2004.04136) |
//! | [`PiSac`] | predictive information with a conditional entropy bottleneck (Lee et al., arXiv 2007.12401) |
//! | [`Dbc`] | bisimulation loss on the latents (Zhang et al., arXiv 2006.10742) |
//! | [`DreamerV2`] | not based on SAC: learns a world model, and actor and critic on imagined trajectories |
//!
//! Each method is a [`hksl_sac::Learner`]. All except DreamerV2 use [`ActorCritic`]. `docs/baselines.md` states their
//! losses and their differences from the original implementations.
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

pub use actor_critic::{ActorCritic, ActorInput, Architecture};
pub use curl::{Curl, CurlBatch};
pub use dbc::{Dbc, DbcBatch, ModelLosses};
pub use dreamer::DreamerV2;
pub use drq::{Drq, DrqBatch};
pub use hksl_sac::{Error, Result};
pub use pi_sac::{PiSac, PiSacBatch};
pub use transitions::Transitions;

// The example of the README is a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
