//! Environments to learn from pixels in: Falling Pixels, and tasks of the DeepMind Control Suite
//! on MuJoCo (feature `mujoco`).
//!
//! An [`Environment`] is stepped with actions in `[-1, 1]`, drawn as 8-bit frames, read for its
//! ground truth, and saved and restored to the bit. [`make`] builds one from its task's name;
//! [`ActionRepeat`], [`Bordered`] and [`FrameStack`] are what an agent puts around it.
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
#![deny(missing_docs)]
// They panic where a stream is closed or full.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod action_repeat;
pub mod border;
pub mod distractors;
#[cfg(feature = "mujoco")]
pub mod dmc;
pub mod environment;
pub mod error;
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
pub use distractors::Distraction;
pub use environment::{Environment, FrameShape, PhysicalState, ReadingSpec, Spec, Step};
pub use error::Error;
pub use falling_pixels::FallingPixels;
pub use frame_stack::FrameStack;
pub use nearest::nearest;
#[cfg(feature = "mujoco")]
pub use registry::control_task;
pub use registry::{ProbeTargets, RewardKind, TaskInfo, make, tasks};
pub use settings::Settings;
