//! Trained policies.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard};

use hksl_sac::Acting;
use hksl_train::config::DeviceChoice;
use hksl_train::{device, policy};
use numpy::{IntoPyArray, PyArray1, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::Stacked;
use crate::error::{Error, Result};

/// A run's policy and encoders.
#[pyclass(frozen, module = "hksl._native")]
pub struct Policy {
    inner: Mutex<policy::Policy>,
    stacked: Stacked,
    frame: [usize; 3],
    action_shape: Vec<usize>,
}

#[pymethods]
impl Policy {
    /// Opens the checkpoint of a run, the newest if none is named.
    #[new]
    #[pyo3(signature = (run, checkpoint=None, device="auto"))]
    fn new(py: Python, run: PathBuf, checkpoint: Option<u64>, device: &str) -> PyResult<Self> {
        let open = || -> Result<policy::Policy> {
            let device = device::open(DeviceChoice::from_option(device, "device")?)?;
            Ok(policy::Policy::open(&run, checkpoint, &device)?)
        };
        let inner = py.detach(open)?;
        let frames = inner.config().environment.frame_stack;
        let stacked = Stacked { frames, shape: inner.observation() };
        let frame = inner.spec().frame;
        let action_shape = match inner.interface() {
            Some(interface) => interface.action_shape.clone(),
            None => vec![inner.spec().action_dims],
        };
        let frame = [frame.channels, frame.height, frame.width];
        Ok(Self { inner: Mutex::new(inner), stacked, frame, action_shape })
    }

    /// Chooses an action for an observation, in the environment's own bounds.
    fn act<'py>(
        &self,
        observation: &Bound<'py, PyAny>,
        sample: bool,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let acting = if sample { Acting::Sample } else { Acting::Mean };
        let action = self.stacked.with_one(observation, |observation| {
            let mut policy = self.lock()?;
            let action = policy.act(observation, acting)?;
            Ok(match policy.interface() {
                Some(interface) => {
                    interface.action(&action).into_iter().map(|number| number as f32).collect()
                }
                None => action,
            })
        })?;
        let action: Bound<PyArray1<f32>> = action.into_pyarray(observation.py());
        action.reshape(self.action_shape.clone())
    }

    /// The latents of each encoder.
    fn encode<'py>(&self, observations: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
        let encoded = self
            .stacked
            .with_batch(observations, |observations| Ok(self.lock()?.encode(observations)?))?;
        let latents = PyDict::new(observations.py());
        for (name, values) in encoded {
            latents.set_item(name, values.into_pyarray(observations.py()))?;
        }
        Ok(latents)
    }

    /// Forgets the running episode.
    fn reset(&self) -> PyResult<()> {
        self.lock()?.reset();
        Ok(())
    }

    /// Writes the weights, and what is needed to rebuild the policy, to a file.
    fn export(&self, py: Python, file: PathBuf) -> PyResult<()> {
        Ok(py.detach(|| -> Result<()> { Ok(self.lock()?.export(&file)?) })?)
    }

    #[getter]
    fn observation_shape(&self) -> [usize; 3] {
        self.stacked.shape
    }

    #[getter]
    fn frame_stack(&self) -> usize {
        self.stacked.frames
    }

    /// Channels, height and width of a single frame.
    #[getter]
    fn frame_shape(&self) -> [usize; 3] {
        self.frame
    }

    #[getter]
    fn action_shape(&self) -> Vec<usize> {
        self.action_shape.clone()
    }

    #[getter]
    fn environment_step(&self) -> PyResult<u64> {
        Ok(self.lock()?.environment_step())
    }

    #[getter]
    fn method(&self) -> PyResult<String> {
        Ok(self.lock()?.config().method.clone())
    }

    #[getter]
    fn task(&self) -> PyResult<String> {
        Ok(self.lock()?.config().task_label())
    }
}

impl Policy {
    fn lock(&self) -> Result<MutexGuard<'_, policy::Policy>> {
        self.inner.try_lock().map_err(|_| Error::Busy { what: "policy" })
    }
}
