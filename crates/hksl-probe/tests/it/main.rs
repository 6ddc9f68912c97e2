//! The analyses against known answers and scikit-learn.
#![allow(clippy::unwrap_used)]

mod known_answers;
mod scikit_learn;
