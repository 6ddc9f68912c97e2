//! Pixel environments for reinforcement learning: Falling Pixels, and tasks of the DeepMind Control Suite on MuJoCo
//! (feature `mujoco`).
//!
//! An [`Environment`] takes actions in `[-1, 1]`, renders 8-bit frames, reports ground-truth readings, and saves and
//! restores its state bit for bit. [`make`] creates an environment by the name of its task. [`ActionRepeat`],
//! [`Bordered`] and [`FrameStack`] are wrappers for agents. [`external`] takes in environments of other programs.
//!
//! ```
//! use hksl_envs::{Environment, FrameStack, Settings};
//! use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
//!
//! let settings = Settings::new(35, 15, 250);
//! let mut environment =
//!     hksl_envs::make("falling-pixels", &settings, ChaCha8Rng::seed_from_u64(7))?;
//! environment.reset()?;
//! let mut stack = FrameStack::new(3, environment.spec().frame);
//! stack.reset(&environment.frame()?)?;
//! let step = environment.step(&[1.0])?;
//! stack.push(&environment.frame()?)?;
//! assert!(!step.last && stack.observation().dim() == (3, 35, 15));
//! # Ok::<(), hksl_envs::Error>(())
//! ```
#![cfg_attr(docsrs, feature(doc_cfg))]
#![deny(missing_docs)]
// These macros panic if the stream is closed or full.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod action_repeat;
pub mod border;
pub mod distractors;
#[cfg(feature = "mujoco")]
pub mod dmc;
pub mod environment;
pub mod error;
pub mod external;
pub mod falling_pixels;
pub mod frame_stack;
#[cfg(feature = "mujoco")]
pub mod models;
pub mod nearest;
pub mod registry;
pub mod render;
pub mod rollout;
pub mod settings;
mod snapshot;

pub use action_repeat::ActionRepeat;
pub use border::Bordered;
#[cfg(feature = "mujoco")]
pub use distractors::Distracted;
pub use distractors::Distractor;
pub use environment::{Environment, FrameShape, PhysicalState, ReadingSpec, Spec, Step};
pub use error::Error;
pub use falling_pixels::FallingPixels;
pub use frame_stack::FrameStack;
pub use nearest::nearest;
#[cfg(feature = "mujoco")]
pub use registry::control_task;
pub use registry::{ProbeTargets, RewardKind, TaskInfo, make, tasks};
pub use settings::Settings;

// The example of the README is a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
