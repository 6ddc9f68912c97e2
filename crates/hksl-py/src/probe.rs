//! Linear probes of a run's encoders, in an environment of Python.

use std::path::PathBuf;

use hksl_core::rng;
use hksl_probe::coordinates::{Coordinates, horizons};
use hksl_probe::encoders::probe_encoders;
use hksl_probe::episodes::{self, collect};
use hksl_probe::linear_probe::Fit;
use hksl_train::config::DeviceChoice;
use hksl_train::policy::Policy;
use hksl_train::{Factories, Own, device};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::error::{Error, Result};
use crate::interface::Brought;

/// How much data there is, and what is predicted.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Settings {
    checkpoint: Option<u64>,
    info: Vec<String>,
    horizons: Option<Vec<usize>>,
    train_episodes: usize,
    test_episodes: usize,
    seed: u64,
    on_policy: bool,
    device: String,
}

/// Fits linear maps from frozen latents to keys of `info`, and returns the errors of each encoder and horizon.
#[pyfunction]
pub fn probe<'py>(
    py: Python<'py>,
    run: PathBuf,
    settings: Settings,
    brought: Brought,
) -> PyResult<Bound<'py, PyList>> {
    let rows = py.detach(|| rows(&run, &settings, &brought))?;
    let list = PyList::empty(py);
    for probed in rows {
        let row = PyDict::new(py);
        row.set_item("encoder", probed.encoder)?;
        row.set_item("horizon", probed.horizon)?;
        row.set_item("mse", probed.errors.mean())?;
        row.set_item("mse_std", probed.errors.std())?;
        row.set_item("constant_mse", probed.errors.constant_mean())?;
        row.set_item("mse_by_coordinate", probed.errors.by_coordinate)?;
        list.append(row)?;
    }
    Ok(list)
}

fn rows(
    run: &std::path::Path,
    settings: &Settings,
    brought: &Brought,
) -> Result<Vec<hksl_probe::encoders::Probed>> {
    let device = device::open(DeviceChoice::from_option(&settings.device, "device")?)?;
    let policy = Policy::open(run, settings.checkpoint, &device)?;
    let config = policy.config().clone();
    let interface = brought.interface()?;
    let steps = config.environment.episode_steps;
    let make = |rng| Ok(brought.environment(&interface, steps, rng)?);
    let own = Own { make: &make, interface: None };
    let mut environment =
        own.environment(&config, rng::stream(settings.seed, "analysis episodes"))?;
    let (seen, expected) = (environment.spec(), policy.spec());
    if (seen.frame, seen.action_dims) != (expected.frame, expected.action_dims) {
        return Err(Error::Array {
            what: "the environment's frame",
            got: vec![seen.frame.channels, seen.frame.height, seen.frame.width],
            dtype: format!("uint8 with {} action dimensions", seen.action_dims),
            expected: format!(
                "those of the run, {:?} with {} action dimensions; probe it in the environment that it was trained in",
                expected.frame.dim(),
                expected.action_dims
            ),
        });
    }
    let coordinates = Coordinates::named(seen, &settings.info)?;
    let horizons = settings.horizons.clone().unwrap_or_else(|| horizons(&seen.task).to_vec());
    let count = settings.train_episodes + settings.test_episodes;
    let stack = config.environment.frame_stack;
    let mut acting = if settings.on_policy {
        let agent = Policy::open(run, settings.checkpoint, &device)?.into_agent();
        episodes::Policy::Trained { agent: Box::new(agent), frame_stack: stack }
    } else {
        episodes::Policy::Random(Box::new(rng::stream(settings.seed, "analysis actions")))
    };
    let episodes = collect(environment.as_mut(), &mut acting, count, &mut |_| {})?;
    let data = (episodes.as_slice(), settings.train_episodes);
    let fit = Fit::default();
    Ok(probe_encoders(policy.agent(), stack, data, &coordinates, &horizons, &fit, &device)?)
}
