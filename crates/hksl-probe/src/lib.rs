//! Analyses of an agent's representations and of HKSL's communication (HKSL §5.4 and appendix).
//!
//! - [`linear_probe`]: how well a linear map from frozen latents predicts future positions.
//! - [`encoders`]: the linear probes of all encoders of an agent.
//! - [`communication`]: outputs of communication managers and their distances between steps.
//! - [`attention`]: activations of each encoder's last convolution.
//! - [`pca`], [`silhouette`]: principal components of vectors, and the separation of their groups.
//! - [`episodes`]: the data of these analyses, collected once and stored in a [`cache`].
//!
//! All analyses return arrays; plotting is left to the caller.
#![deny(missing_docs)]
// These macros panic if the stream is closed or full.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod attention;
pub mod cache;
pub mod communication;
pub mod coordinates;
pub mod encoders;
pub mod episodes;
mod error;
pub mod linear_probe;
pub mod pca;
pub mod silhouette;

pub use error::{Error, Result};

// The example of the README is a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
