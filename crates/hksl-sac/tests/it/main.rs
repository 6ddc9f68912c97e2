//! HKSL's learning step: reference values, the definition of its joint schedule, and the ablations.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod ablations;
#[path = "../../../hksl-core/tests/golden/fixture.rs"]
mod fixture;
mod golden;
mod joint_schedule;
