//! Comparing runs: [`statistics`] over seeds and tasks, [`plot`]s, and a [`report`] of both in one page.
//!
//! Reads the folders of runs and does not depend on the training code. The training program supplies the rest as an
//! [`Account`](hksl_files::Account) of each run.
#![deny(missing_docs)]
// `print!` and `eprint!` panic if the stream is closed or full.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod plot;
pub mod report;
pub mod statistics;

// The example of the README is a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
