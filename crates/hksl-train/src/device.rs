//! Opening the device that networks live on.

use candle_core::Device;

use crate::config::DeviceChoice;
pub use crate::config::MOST_THREADS;
use crate::{Error, Result};

/// Opens the device asked for; `auto` is the first GPU where this build and the machine have one, else the
/// CPU. What is computed on a GPU belongs to the thread that computes it: its tensors are not for others.
///
/// # Errors
/// [`Error::Device`] if a GPU was asked for and cannot be opened.
pub fn open(choice: DeviceChoice) -> Result<Device> {
    let cuda = |index: usize| {
        Device::new_cuda(index).map_err(|error| Error::Device {
            name: format!("cuda:{index}"),
            reason: error.to_string(),
        })
    };
    match choice {
        DeviceChoice::Cpu => Ok(Device::Cpu),
        DeviceChoice::Cuda(index) => cuda(index),
        DeviceChoice::Auto => Ok(cuda(0).unwrap_or(Device::Cpu)),
    }
}

/// Lets the whole process compute on this many threads; 0 stands for all logical cores. To be called once,
/// before anything is computed.
///
/// # Errors
/// [`Error::OutOfRange`] beyond [`MOST_THREADS`]; [`Error::Threads`] if computing has begun.
pub fn set_threads(threads: usize) -> Result<()> {
    if threads > MOST_THREADS {
        return Err(Error::OutOfRange {
            key: "threads".to_owned(),
            value: threads.to_string(),
            origin: None,
            expected: format!("it must be from 0 to {MOST_THREADS}"),
        });
    }
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .map_err(|error| Error::Threads { threads, reason: error.to_string() })
}

/// How many threads the process computes on.
pub fn threads() -> usize {
    rayon::current_num_threads()
}

/// How the device is written in folders and on screens.
pub fn name(device: &Device) -> String {
    match device.location() {
        candle_core::DeviceLocation::Cpu => "cpu".to_owned(),
        candle_core::DeviceLocation::Cuda { gpu_id } => format!("cuda:{gpu_id}"),
        candle_core::DeviceLocation::Metal { gpu_id } => format!("metal:{gpu_id}"),
    }
}

/// What the GPU is, by its driver; none for the CPU.
pub fn gpu_name(device: &Device) -> Option<String> {
    match device {
        #[cfg(feature = "cuda")]
        Device::Cuda(device) => device.cuda_stream().context().name().ok(),
        _ => None,
    }
}
