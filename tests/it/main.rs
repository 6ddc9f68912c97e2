//! End-to-end tests of the binary `hksl`, in one program so that they link once.
//!
//! Each module holds one promise. Tests of a process's signals, limits or environment start `hksl` as a child, so all
//! tests can run in parallel in this process.
#![allow(clippy::unwrap_used)]

mod analyses;
mod bad_input;
mod benchmarks;
mod book;
#[cfg(unix)]
mod book_commands;
#[cfg(unix)]
mod browser;
mod commands;
#[cfg(unix)]
mod crash_recovery;
#[cfg(unix)]
mod every_method;
#[cfg(unix)]
mod extending;
mod fuzz_corpora;
mod generated_tables;
#[cfg(unix)]
mod input_formats;
mod packages;
mod python;
mod report;
#[cfg(unix)]
mod report_page;
mod reproducibility;
#[cfg(unix)]
mod slurm_cluster;
#[cfg(unix)]
mod slurm_launcher;
#[cfg(unix)]
mod streams_and_signals;
#[cfg(unix)]
mod sweep;
