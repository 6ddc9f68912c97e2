//! Statistics of returns against rliable.
#![allow(clippy::unwrap_used)]

mod statistics;
