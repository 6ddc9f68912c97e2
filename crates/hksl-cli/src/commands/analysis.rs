//! Options and data shared by the commands that analyse runs.

mod data;
mod source;

use std::path::PathBuf;

use candle_core::Device;
use clap::Args;
use hksl_train::config::DeviceChoice;
use hksl_train::device;

use crate::numbers::at_least;

pub use data::{Data, Played};
pub use source::Source;

/// Options of every analysis.
#[derive(Debug, Args)]
pub struct Options {
    /// Output folder, new or empty [default: named after the command, in the current folder]
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    pub out: Option<PathBuf>,

    /// Seed of the episodes and of the samples drawn from them
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = at_least::<u64>(0))]
    pub seed: u64,

    /// Cache folder for collected episodes [default: hksl in the user's cache folder]
    #[arg(long, value_name = "DIR", env = "HKSL_CACHE", help_heading = "Machine")]
    pub cache: Option<PathBuf>,

    /// Device for the networks: auto, cpu, cuda or cuda:N
    #[arg(long, value_name = "DEVICE", default_value = "auto", help_heading = "Machine")]
    pub device: String,

    /// CPU threads, 0 for all logical cores
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = at_least::<usize>(0), help_heading = "Machine")]
    pub threads: usize,
}

impl Options {
    /// Opens the device and sets the number of threads.
    pub fn open(&self) -> anyhow::Result<Device> {
        let device = device::open(DeviceChoice::from_option(&self.device, "--device")?)?;
        device::set_threads(self.threads)?;
        Ok(device)
    }
}
