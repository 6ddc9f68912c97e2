//! The command `hksl`.

use std::ffi::OsString;
use std::path::PathBuf;

use pyo3::prelude::*;

/// Runs the command line with these arguments, and returns the exit code. `program` is the file that starts it.
#[pyfunction]
#[pyo3(signature = (arguments, program=None))]
pub fn run_command(py: Python, arguments: Vec<OsString>, program: Option<PathBuf>) -> u8 {
    let invocation = hksl_cli::Invocation { arguments, program };
    py.detach(|| {
        hksl_cli::keep_freed_memory();
        hksl_cli::run(&invocation) as u8
    })
}
