//! Hierarchical k-step latents (HKSL): representation learning on several time scales.
//!
//! This crate implements section 4 of *Multi-Horizon Representations with Hierarchical Forward Models for Reinforcement
//! Learning* (McInroe, Schäfer, Albrecht; TMLR 2024, <https://arxiv.org/abs/2206.11396>): the model, its losses and
//! one learning step over all levels. It reads no files and no clock. Its only global state is the compiled GPU kernels
//! and rayon's thread pool. All random numbers come from generators that the caller passes.
//!
//! - [`Hierarchy`] contains the levels: encoders, forward models, communication managers, projections and momentum
//!   encoders. It is generic over the [`Encoder`] trait; [`nn::PixelEncoder`] is the paper's encoder.
//! - [`HierarchyLearner`] contains the optimisers and takes learning steps.
//! - [`Parameters`] contains all weights by name and converts them to and from safetensors.
//!
//! ```
//! use candle_core::{DType, Device, Tensor};
//! use hksl_core::nn::{Initialisation, PixelEncoder, PixelEncoderConfig};
//! use hksl_core::{Hierarchy, HierarchyConfig, HierarchyLearner, Parameters, Trajectories, rng};
//!
//! // Two levels: one predicts every transition of a trajectory of 6, one every third.
//! let config = HierarchyConfig {
//!     skips: vec![1, 3],
//!     trajectory_length: 6,
//!     action_dims: 2,
//!     latent_dims: 8,
//!     communication_hidden: 16,
//!     communication: true,
//!     projection: true,
//!     shared_encoder: false,
//! };
//! let encoder = PixelEncoderConfig { filters: 4, latent_dims: 8 };
//! let (device, mut parameters) = (Device::Cpu, Parameters::default());
//! let hierarchy = Hierarchy::new(
//!     config,
//!     &mut parameters,
//!     &mut rng::stream(1, "init"),
//!     Initialisation::Uniform,
//!     &device,
//!     |builder| PixelEncoder::new(builder, [3, 20, 20], encoder),
//! )?;
//! let mut learner = HierarchyLearner::new(&hierarchy, 1e-3)?;
//! let momentum = hierarchy.momentum(0.05)?;
//!
//! // A batch of four trajectories: 7 observations and 6 actions each.
//! let trajectories = Trajectories {
//!     observations: Tensor::zeros((7, 4, 3, 20, 20), DType::U8, &device)?,
//!     actions: Tensor::zeros((4, 6, 2), DType::F32, &device)?,
//! };
//! let losses = learner.step(&hierarchy, &trajectories)?;
//! // Soft update of the momentum encoders, whose latents are the targets (paper: every second step).
//! momentum.update()?;
//! assert_eq!(losses.len(), 2);
//! assert_eq!(losses[1].latents.len(), 2);
//! assert_eq!(hierarchy.encode(&trajectories.at(0)?)?.dims(), [4, 16]);
//! # Ok::<(), hksl_core::Error>(())
//! ```
//!
//! # Notation
//! Shapes use `B` for the batch size, `C×H×W` for images, `A` for action dimensions, `Z` for latent dimensions, `h` for the
//! number of levels, `n^l` for the skip of level `l`, `k` for the transitions in a trajectory and `N_l = k div n^l` for
//! the steps of level `l`. Levels are numbered from 0, the finest.
#![deny(missing_docs)]

mod error;
pub mod hierarchy;
pub mod kernels;
pub mod named;
pub mod nn;
mod on_host;
pub mod optim;
pub mod parallel;
mod params;
pub mod rng;
#[cfg(test)]
mod testing;

pub use error::{Error, Result, at_least_one};
pub use hierarchy::{Encoder, Hierarchy, HierarchyConfig, HierarchyLearner, Trajectories};
pub use params::{Builder, Parameters, from_safetensors, to_safetensors, to_safetensors_with};

// The example of the README is a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
