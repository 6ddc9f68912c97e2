//! The registry's tasks.

use hksl_core::rng;
use hksl_train::config::{Config, resolve};
use hksl_train::{Factories, Registry};
use numpy::{IntoPyArray, PyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::borrow;
use crate::error::Error;
use crate::request::Arguments;

/// A task of the registry as `hksl train` trains in it.
#[pyclass(unsendable, module = "hksl._native")]
pub struct Environment {
    config: Config,
    environment: Option<Box<dyn hksl_envs::Environment>>,
    channels_last: bool,
}

type Frame<'py> = Bound<'py, PyArray3<u8>>;

#[pymethods]
impl Environment {
    /// Resolves the configuration; `channels_last` says how frames are returned.
    #[new]
    fn new(arguments: Arguments, channels_last: bool) -> PyResult<Self> {
        let config = resolve(&arguments.request()?).map_err(Error::from)?.config;
        let mut made = Self { config, environment: None, channels_last };
        made.seed(0)?;
        Ok(made)
    }

    /// Starts the random numbers from this seed; a reset must follow. A run with this seed trains on the same episodes.
    fn seed(&mut self, seed: u64) -> PyResult<()> {
        let random = rng::stream(seed, "env");
        self.environment = Some(Registry.environment(&self.config, random).map_err(Error::from)?);
        Ok(())
    }

    /// Starts an episode and returns its first frame.
    fn reset<'py>(&mut self, py: Python<'py>) -> PyResult<Frame<'py>> {
        self.open()?.reset().map_err(Error::from)?;
        self.frame(py)
    }

    /// Takes an agent step; returns the frame, the reward, and whether the episode terminated or was truncated.
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        action: &Bound<'py, PyAny>,
    ) -> PyResult<(Frame<'py>, f64, bool, bool)> {
        let dims = self.spec()?.action_dims;
        let expected = || format!("float32 numbers of shape ({dims},) in [-1, 1]");
        let action = borrow::<f32>("action", action, expected)?;
        if action.as_array().shape() != [dims] {
            let (got, dtype) = (action.as_array().shape().to_vec(), "float32".to_owned());
            let what = "action";
            return Err(Error::Array { what, got, dtype, expected: expected() }.into());
        }
        let step = match action.as_slice() {
            Ok(action) => self.open()?.step(action),
            Err(_) => {
                let action: Vec<f32> = action.as_array().iter().copied().collect();
                self.open()?.step(&action)
            }
        };
        let step = step.map_err(Error::from)?;
        Ok((self.frame(py)?, step.reward, step.terminal, step.last && !step.terminal))
    }

    /// The ground truth of the state by name: a number, or an array of several.
    fn readings<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let readings = PyDict::new(py);
        let environment = self.open()?;
        for (spec, values) in environment.spec().readings.iter().zip(environment.readings()) {
            match values.as_slice() {
                [value] => readings.set_item(&*spec.name, *value)?,
                _ => readings.set_item(&*spec.name, values.into_pyarray(py))?,
            }
        }
        Ok(readings)
    }

    /// The frame of the state.
    fn frame<'py>(&mut self, py: Python<'py>) -> PyResult<Frame<'py>> {
        let frame = self.open()?.frame().map_err(Error::from)?;
        let last = self.channels_last;
        let frame = if last {
            frame.permuted_axes([1, 2, 0]).as_standard_layout().into_owned()
        } else {
            frame
        };
        Ok(frame.into_pyarray(py))
    }

    /// Channels, height and width of a frame.
    #[getter]
    fn frame_shape(&self) -> PyResult<(usize, usize, usize)> {
        Ok(self.spec()?.frame.dim())
    }

    #[getter]
    fn action_dims(&self) -> PyResult<usize> {
        Ok(self.spec()?.action_dims)
    }

    #[getter]
    fn steps_per_episode(&self) -> PyResult<usize> {
        Ok(self.spec()?.steps_per_episode)
    }

    #[getter]
    fn frame_stack(&self) -> usize {
        self.config.environment.frame_stack
    }

    #[getter]
    fn action_repeat(&self) -> usize {
        self.config.environment.action_repeat
    }

    /// Simulated milliseconds of an agent step; None for a task without physics.
    #[getter]
    fn step_milliseconds(&self) -> Option<u32> {
        self.config.agent_step_milliseconds()
    }

    /// The settings as TOML.
    fn config(&self) -> PyResult<String> {
        Ok(self.config.to_toml().map_err(Error::from)?)
    }

    /// Frees the simulation and its renderer.
    fn close(&mut self) {
        self.environment = None;
    }
}

impl Environment {
    fn open(&mut self) -> PyResult<&mut Box<dyn hksl_envs::Environment>> {
        self.environment.as_mut().ok_or_else(closed)
    }

    fn spec(&self) -> PyResult<&hksl_envs::Spec> {
        Ok(self.environment.as_ref().ok_or_else(closed)?.spec())
    }
}

fn closed() -> PyErr {
    Error::from(hksl_envs::Error::NotReset { what: "a call after close()" }).into()
}
