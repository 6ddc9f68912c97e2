//! The baselines against independent implementations and finite differences.
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[path = "../golden/fixture.rs"]
mod fixture;
mod golden_dreamer;
mod golden_model_free;
mod gradients;
mod small;
