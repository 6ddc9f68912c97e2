//! Environments of Python.

use hksl_envs::external::{Declaration, External, Interface, Outcome, Scene, Simulator, Space};
use hksl_envs::{Environment, Error};
use numpy::{IntoPyArray, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use rand_chacha::ChaCha8Rng;

use crate::arrays::borrow;

/// An environment that the package has looked at: `hksl._bridge.Brought`.
#[derive(FromPyObject)]
pub struct Brought {
    task: String,
    observation_space: DeclaredSpace,
    action_space: DeclaredSpace,
    /// The time limit that the environment has of its own.
    pub episode_steps: Option<usize>,
    readings: Vec<String>,
    /// Makes a `hksl._bridge.Bridge`.
    make: Py<PyAny>,
}

/// `(dtype, shape, low, high)`, or what another kind of space is.
#[derive(Clone, FromPyObject)]
enum DeclaredSpace {
    Box((String, Vec<usize>, Vec<f64>, Vec<f64>)),
    Other(String),
}

impl From<&DeclaredSpace> for Space {
    fn from(space: &DeclaredSpace) -> Self {
        match space.clone() {
            DeclaredSpace::Box((dtype, shape, low, high)) => Self::Box { dtype, shape, low, high },
            DeclaredSpace::Other(kind) => Self::Other(kind),
        }
    }
}

impl Brought {
    /// Its spaces, checked.
    pub fn interface(&self) -> Result<Interface, Error> {
        Interface::new(&Declaration {
            task: self.task.clone(),
            observation: (&self.observation_space).into(),
            action: (&self.action_space).into(),
        })
    }

    /// Makes an environment whose episodes have at most so many steps.
    pub fn environment(
        &self,
        interface: &Interface,
        episode_steps: usize,
        rng: ChaCha8Rng,
    ) -> Result<Box<dyn Environment>, Error> {
        let failed = |error| failed(&interface.task, error);
        let bridge = Python::attach(|py| self.make.call0(py)).map_err(failed)?;
        let simulator = Box::new(Bridge { bridge, interface: interface.clone() });
        let interface = interface.clone();
        Ok(Box::new(External::new(interface, simulator, episode_steps, &self.readings, rng)?))
    }
}

fn failed(task: &str, error: PyErr) -> Error {
    Error::External { task: task.to_owned(), source: Box::new(error) }
}

/// A `hksl._bridge.Bridge`: resets, steps and closes the environment.
struct Bridge {
    bridge: Py<PyAny>,
    interface: Interface,
}

impl Bridge {
    fn attached<T>(
        &self,
        call: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<std::result::Result<T, Error>>,
    ) -> Result<T, Error> {
        Python::attach(|py| call(self.bridge.bind(py)))
            .map_err(|error| failed(&self.interface.task, error))?
    }

    fn scene(
        &self,
        frame: &Bound<'_, PyAny>,
        readings: Vec<PyReadonlyArrayDyn<f64>>,
    ) -> PyResult<std::result::Result<Scene, Error>> {
        let expected = || format!("uint8 frames of shape {:?}", self.interface.frame_shape());
        let frame = borrow::<u8>("frame", frame, expected)?;
        let readings = readings.iter().map(|values| values.as_array().iter().copied().collect());
        let readings = readings.collect();
        Ok(self.interface.frame(frame.as_array()).map(|frame| Scene { frame, readings }))
    }
}

impl Simulator for Bridge {
    fn reset(&mut self, seed: u32) -> Result<Scene, Error> {
        self.attached(|bridge| {
            let (frame, readings): (Bound<'_, PyAny>, _) =
                bridge.call_method1("reset", (seed,))?.extract()?;
            self.scene(&frame, readings)
        })
    }

    fn step(&mut self, action: &[f64]) -> Result<Outcome, Error> {
        self.attached(|bridge| {
            let action = action.to_vec().into_pyarray(bridge.py());
            type Step<'py> =
                (Bound<'py, PyAny>, f64, bool, bool, Vec<PyReadonlyArrayDyn<'py, f64>>);
            let (frame, reward, terminated, truncated, readings): Step =
                bridge.call_method1("step", (action,))?.extract()?;
            let scene = self.scene(&frame, readings)?;
            Ok(scene.map(|scene| Outcome { scene, reward, terminated, truncated }))
        })
    }
}

impl Drop for Bridge {
    fn drop(&mut self) {
        Python::attach(|py| {
            let bridge = self.bridge.bind(py);
            if let Err(error) = bridge.call_method0("close") {
                error.write_unraisable(py, Some(bridge));
            }
        });
    }
}
