//! Files that hksl writes and reads, known without networks, tasks or configurations.
//!
//! A [`RunFolder`] names what is in a run's folder; [`Labels`] say what the run is, [`read_points`] gives its learning
//! curve and [`Standing`] where it stands. [`CsvTable`] and [`text`] read what people bring, however it was written.
//! [`Files`] writes so that a reader sees the old or the new, never a half; [`digest`] tells contents apart.
//!
//! ```
//! use hksl_files::{RunFolder, read_points};
//!
//! for run in RunFolder::all_under(std::path::Path::new("src"))? {
//!     let (points, _) = read_points(&run.eval_file())?;
//!     println!("{}: {} evaluations", run.labels()?.task_label(), points.len());
//! }
//! # Ok::<(), hksl_files::Error>(())
//! ```
#![deny(missing_docs)]
// They panic where a stream is closed or full.
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod account;
mod aside;
mod csv_table;
pub mod digest;
pub mod disk;
mod error;
mod evaluations;
mod files;
mod folder;
mod labels;
mod lock;
mod names;
pub mod numbers;
mod standing;
pub mod text;

pub use account::{Account, Outline, Settings};
pub use aside::damaged;
pub use csv_table::{CsvTable, Row};
pub use error::{Error, Result};
pub use evaluations::{
    EVALUATION_COLUMNS, EvaluationRow, Point, read_evaluations, read_points, readable_evaluations,
};
pub use files::{FileRecord, Files, entries, from_json, name, read, to_json};
pub use folder::{EVENTS_NAME, RunFolder, RunId};
pub use labels::Labels;
pub use lock::RunLock;
pub use names::{ABLATION_NONE, DISTRACTOR_NONE, Names, PRESET_PAPER, task_label};
pub use standing::Standing;

// The example of the README is a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
