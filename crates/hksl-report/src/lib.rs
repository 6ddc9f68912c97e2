//! Comparing runs: [`statistics`] over seeds and tasks, [`plot`]s, and a [`report`] of both in one page.
//!
//! It reads what runs have left in their folders, and knows nothing of how they were trained: what only the program
//! that trained them can tell comes as an [`Account`](hksl_files::Account) of each.
#![deny(missing_docs)]
// They panic where a stream is closed or full.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod plot;
pub mod report;
pub mod statistics;

// The example of the README is a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
