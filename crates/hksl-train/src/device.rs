//! Opening the device for the networks.

mod error;

use candle_core::Device;

pub use error::Error;

use crate::Result;
pub use crate::config::MOST_THREADS;
use crate::config::{self, DeviceChoice};

/// Opens the device asked for; `auto` is the first GPU where this build and the machine have one, else the
/// CPU. What is computed on a GPU belongs to the thread that computes it: its tensors are not for others.
///
/// # Errors
/// [`Error::Device`] if a GPU was asked for and cannot be opened.
pub fn open(choice: DeviceChoice) -> Result<Device> {
    let cuda = |index: usize| -> Result<Device> {
        Device::new_cuda(index).map_err(|error| {
            let name = format!("cuda:{index}");
            Error::Device { name, reason: error.to_string() }.into()
        })
    };
    match choice {
        DeviceChoice::Cpu => Ok(Device::Cpu),
        DeviceChoice::Cuda(index) => cuda(index),
        DeviceChoice::Auto => Ok(cuda(0).unwrap_or(Device::Cpu)),
    }
}

/// Sets the number of threads of the whole process; 0 means all logical cores. Call it once, before any
/// computation.
///
/// # Errors
/// [`config::Error::OutOfRange`] beyond [`MOST_THREADS`]; [`Error::Threads`] if computing has begun.
pub fn set_threads(threads: usize) -> Result<()> {
    if threads > MOST_THREADS {
        return Err(config::Error::OutOfRange {
            key: "threads".to_owned(),
            value: threads.to_string(),
            origin: None,
            expected: format!("it must be from 0 to {MOST_THREADS}"),
        }
        .into());
    }
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .map_err(|error| Error::Threads { threads, reason: error.to_string() }.into())
}

/// The same for a library, whose caller may have begun to compute: it then only checks that the process has as many
/// threads as asked for; 0 accepts any number.
///
/// # Errors
/// [`config::Error::OutOfRange`] beyond [`MOST_THREADS`]; [`Error::Threads`] if the process has another number.
pub fn require_threads(wanted: usize) -> Result<()> {
    match set_threads(wanted) {
        Err(crate::Error::Device(_)) if wanted == 0 || wanted == threads() => Ok(()),
        set => set,
    }
}

/// Number of threads of the process.
pub fn threads() -> usize {
    rayon::current_num_threads()
}

/// The name of the device, for folders and output.
pub fn name(device: &Device) -> String {
    match device.location() {
        candle_core::DeviceLocation::Cpu => "cpu".to_owned(),
        candle_core::DeviceLocation::Cuda { gpu_id } => format!("cuda:{gpu_id}"),
        candle_core::DeviceLocation::Metal { gpu_id } => format!("metal:{gpu_id}"),
    }
}

/// The GPU's name from its driver; none for the CPU.
pub fn gpu_name(device: &Device) -> Option<String> {
    match device {
        #[cfg(feature = "cuda")]
        Device::Cuda(device) => device.cuda_stream().context().name().ok(),
        _ => None,
    }
}
