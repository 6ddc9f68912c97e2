//! Agents for training loops of Python.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard};

use hksl_train::device;
use hksl_train::online::OnlineAgent;
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{Stacked, borrow};
use crate::error::{Error, Result};
use crate::request::Arguments;

/// An agent whose environment Python steps.
#[pyclass(frozen, module = "hksl._native")]
pub struct Agent {
    inner: Mutex<OnlineAgent>,
    stacked: Stacked,
    action_dims: usize,
}

#[pymethods]
impl Agent {
    /// Creates an agent for observations of this shape.
    #[new]
    fn new(
        py: Python,
        arguments: Arguments,
        observation_shape: [usize; 3],
        action_dims: usize,
    ) -> PyResult<Self> {
        let request = arguments.request()?;
        let make = || -> Result<OnlineAgent> {
            hksl_cli::keep_freed_memory();
            Ok(OnlineAgent::new(request, observation_shape, action_dims, |config| {
                device::require_threads(config.threads)?;
                device::open(config.device_choice()?)
            })?)
        };
        let inner = py.detach(make)?;
        let frames = inner.config().environment.frame_stack;
        let stacked = Stacked { frames, shape: inner.observation() };
        Ok(Self { inner: Mutex::new(inner), stacked, action_dims })
    }

    /// Begins an episode.
    fn begin(&self, observation: &Bound<'_, PyAny>) -> PyResult<()> {
        let begin = |observation: ndarray::ArrayView3<u8>| Ok(self.lock()?.begin(observation)?);
        Ok(self.stacked.with_one(observation, begin)?)
    }

    /// Chooses an action.
    fn act<'py>(
        &self,
        observation: &Bound<'py, PyAny>,
        explore: bool,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let action = self
            .stacked
            .with_one(observation, |observation| Ok(self.lock()?.act(observation, explore)?))?;
        Ok(action.into_pyarray(observation.py()))
    }

    /// Stores a transition.
    fn observe(
        &self,
        action: &Bound<'_, PyAny>,
        reward: f64,
        next_observation: &Bound<'_, PyAny>,
        terminated: bool,
        truncated: bool,
    ) -> PyResult<()> {
        let expected = || format!("float32 numbers of shape ({},) in [-1, 1]", self.action_dims);
        let action = borrow::<f32>("action", action, expected)?;
        let action: Vec<f32> = action.as_array().iter().copied().collect();
        Ok(self.stacked.with_one(next_observation, |next| {
            Ok(self.lock()?.observe(&action, reward, next, terminated, truncated)?)
        })?)
    }

    /// Takes a learning step and returns its figures; None if none is due.
    fn update<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let report = py.detach(|| -> Result<_> { Ok(self.lock()?.update()?) })?;
        let Some(report) = report else { return Ok(None) };
        let figures = PyDict::new(py);
        for (name, value) in report {
            figures.set_item(name, value)?;
        }
        Ok(Some(figures))
    }

    /// Saves everything into a folder.
    fn save(&self, py: Python, folder: PathBuf) -> PyResult<()> {
        Ok(py.detach(|| -> Result<()> { Ok(self.lock()?.save(&folder)?) })?)
    }

    /// Restores the newest save of a folder.
    fn load(&self, py: Python, folder: PathBuf) -> PyResult<()> {
        Ok(py.detach(|| -> Result<()> { Ok(self.lock()?.load(&folder)?) })?)
    }

    #[getter]
    fn agent_step(&self) -> PyResult<u64> {
        Ok(self.lock()?.agent_step())
    }

    #[getter]
    fn updates(&self) -> PyResult<u64> {
        Ok(self.lock()?.updates())
    }

    #[getter]
    fn observation_shape(&self) -> [usize; 3] {
        self.stacked.shape
    }

    #[getter]
    fn frame_stack(&self) -> usize {
        self.stacked.frames
    }

    #[getter]
    fn action_dims(&self) -> usize {
        self.action_dims
    }

    /// The settings as TOML.
    fn config(&self) -> PyResult<String> {
        Ok(self.lock()?.config().to_toml().map_err(Error::from)?)
    }
}

impl Agent {
    fn lock(&self) -> Result<MutexGuard<'_, OnlineAgent>> {
        self.inner.try_lock().map_err(|_| Error::Busy { what: "agent" })
    }
}
