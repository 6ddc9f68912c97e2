//! What an agent's representations and HKSL's channels hold (HKSL §5.4 and appendix).
//!
//! - [`linear_probe`]: how well a linear map from frozen latents predicts where things will be.
//! - [`communication`]: what a communication manager says at each step, and how that differs.
//! - [`attention`]: where each encoder's last convolution is active.
//! - [`pca`], [`silhouette`]: projections of vectors, and how separate their groups are.
//! - [`episodes`]: what all of these look at, collected once and kept by a [`cache`].
//!
//! Plain arrays come out; drawing them is the caller's.
#![deny(missing_docs)]
// They panic where a stream is closed or full.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod attention;
pub mod cache;
pub mod communication;
pub mod coordinates;
pub mod episodes;
mod error;
pub mod linear_probe;
pub mod pca;
pub mod silhouette;

pub use error::{Error, Result};
