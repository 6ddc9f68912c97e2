//! Sweeps: runs of a study file, their status, and how to launch them.

mod error;
mod local;
mod planned;
mod slurm;
mod status;
mod study;

pub use error::Error;
pub use hksl_files::Standing;
pub use local::{Launch, LocalEvent, launch};
pub use planned::{PlannedRun, Sweep};
pub use slurm::{Job, Jobs, submit, write_jobs};
pub use status::standing;
pub use study::{Group, LocalSection, SlurmSection, Study};
