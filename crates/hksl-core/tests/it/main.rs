//! The hierarchy against an independent implementation and finite differences.
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[path = "../golden/fixture.rs"]
mod fixture;
mod golden;
mod gradients;
