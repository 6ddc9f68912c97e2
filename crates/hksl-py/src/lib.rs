//! The extension module of the Python package `hksl`.
//!
//! It translates: Python's values in, one library call, values or exceptions out. What Python's users see, with types and
//! documentation, is in `python/hksl`.
#![deny(missing_docs)]
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod agent;
mod arrays;
mod command;
mod environment;
mod error;
mod interface;
mod logging;
mod policy;
mod probe;
mod request;
mod train;
mod values;

use std::path::PathBuf;

use pyo3::prelude::*;

/// The extension module, for the package around it.
#[pymodule]
mod _native {
    use super::*;

    #[pymodule_export]
    use super::agent::Agent;
    #[pymodule_export]
    use super::command::run_command;
    #[pymodule_export]
    use super::environment::Environment;
    #[pymodule_export]
    use super::policy::Policy;
    #[pymodule_export]
    use super::probe::probe;
    #[pymodule_export]
    use super::train::train;

    /// Names the package's folder of model files, if it carries them.
    #[pyfunction]
    fn set_models(folder: PathBuf) {
        #[cfg(feature = "mujoco")]
        hksl_envs::models::set_package_folder(folder);
        #[cfg(not(feature = "mujoco"))]
        drop(folder);
    }

    /// `(name, summary, available)` of each task.
    #[pyfunction]
    fn tasks() -> Vec<(&'static str, &'static str, bool)> {
        hksl_envs::tasks().iter().map(|task| (task.name, task.summary, task.available)).collect()
    }

    /// The names of all methods, the default first.
    #[pyfunction]
    fn methods() -> Vec<&'static str> {
        hksl_train::config::methods()
    }

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        super::logging::forward_warnings();
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("commit", hksl_train::COMMIT)
    }
}
