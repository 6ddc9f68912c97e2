//! Trained policies, opened from runs.

use std::collections::BTreeMap;
use std::path::Path;

use candle_core::{Device, Tensor};
use hksl_core::rng;
use hksl_envs::Spec;
use hksl_envs::external::Interface;
use hksl_files::{Files, RunFolder};
use hksl_sac::{Acting, Agent, RecurrentState};
use ndarray::{Array2, ArrayView3, ArrayView4};
use serde_json::Value;

use crate::checkpoint::Checkpoints;
use crate::config::Config;
use crate::evaluate::load_weights;
use crate::factories::{Factories, Registry, agent};
use crate::run::facts::{INTERFACE, SPECIFICATION};
use crate::{Error, Result};

/// Observations per batch.
const BATCH: usize = 64;

/// A run's policy and encoders, with the weights of one of its checkpoints. Its replay and optimisers are not read.
pub struct Policy {
    config: Config,
    spec: Spec,
    interface: Option<Interface>,
    environment_step: u64,
    agent: Agent,
    state: RecurrentState,
    device: Device,
}

impl Policy {
    /// Opens the checkpoint at `environment_step`, or the newest one, of the run in this folder. The run may still be
    /// training.
    ///
    /// # Errors
    /// A folder that is no run; a missing or damaged checkpoint; a task that this build cannot make.
    pub fn open(run: &Path, environment_step: Option<u64>, device: &Device) -> Result<Self> {
        let folder = RunFolder::existing(run)?;
        let mut config = Config::of_run(&folder)?;
        // The training machine may have had other EGL devices.
        config.render.device = "auto".to_owned();
        let (spec, interface) = specification(&folder, &config)?;
        let checkpoints = Checkpoints::of_run(&folder);
        let environment_step = environment_step.map_or_else(|| checkpoints.newest(), Ok)?;
        let weights = checkpoints.weights(environment_step)?;
        let agent = agent(&config, &spec, device)?;
        load_weights(agent.networks(), &config, &weights, environment_step)?;
        let (state, device) = (RecurrentState::default(), device.clone());
        Ok(Self { config, spec, interface, environment_step, agent, state, device })
    }

    /// The run's configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The environment that it acts in.
    pub fn spec(&self) -> &Spec {
        &self.spec
    }

    /// The spaces of that environment, if it is another program's.
    pub fn interface(&self) -> Option<&Interface> {
        self.interface.as_ref()
    }

    /// The environment step of its checkpoint.
    pub fn environment_step(&self) -> u64 {
        self.environment_step
    }

    /// Shape of an observation, `(stack·C, H, W)`.
    pub fn observation(&self) -> [usize; 3] {
        self.agent.networks().observation
    }

    /// The agent.
    pub fn agent(&self) -> &Agent {
        &self.agent
    }

    /// The agent, to collect episodes with.
    pub fn into_agent(self) -> Agent {
        self.agent
    }

    /// Begins an episode: recurrent policies forget the last one.
    pub fn reset(&mut self) {
        self.state = RecurrentState::default();
    }

    /// Chooses an action in [−1, 1] for the observation `(stack·C, H, W)`, the mean or a sample of the policy.
    ///
    /// # Errors
    /// An observation of another shape.
    pub fn act(&mut self, observation: ArrayView3<u8>, acting: Acting) -> Result<Vec<f32>> {
        Ok(self.agent.act(observation, acting, &mut self.state)?)
    }

    /// The latents of each encoder by its name, for observations `(B, stack·C, H, W)`: `(B, Z)` each.
    ///
    /// # Errors
    /// Observations of another shape.
    pub fn encode(&self, observations: ArrayView4<u8>) -> Result<Vec<(String, Array2<f32>)>> {
        let (count, channels, height, width) = observations.dim();
        let mut encoders: Vec<(String, Vec<f32>)> = Vec::new();
        for batch in observations.axis_chunks_iter(ndarray::Axis(0), BATCH) {
            let pixels: Vec<u8> = batch.iter().copied().collect();
            let shape = (batch.dim().0, channels, height, width);
            let pixels = Tensor::from_vec(pixels, shape, &self.device)?;
            let latents = self.agent.networks().encode(&pixels)?;
            for (index, (name, latents)) in latents.into_iter().enumerate() {
                if index == encoders.len() {
                    encoders.push((name, Vec::new()));
                }
                encoders[index].1.extend(latents.flatten_all()?.to_vec1::<f32>()?);
            }
        }
        let array = |(name, values): (String, Vec<f32>)| {
            let (got, columns) = (values.len(), values.len() / count.max(1));
            let array = Array2::from_shape_vec((count, columns), values);
            let unfit =
                |_| hksl_sac::Error::Size { what: "latents", got, expected: count * columns };
            Ok((name, array.map_err(unfit)?))
        };
        encoders.into_iter().map(array).collect()
    }

    /// Writes the weights of [`hksl_sac::Networks::weights`] to a safetensors file, whose metadata says what is needed to
    /// rebuild the policy elsewhere: `method`, `task`, `environment_step`, and as JSON `observation` (its shape),
    /// `frame_stack`, `action_dims`, `action_low` and `action_high`.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn export(&self, file: &Path) -> Result<()> {
        let Self { config, spec, .. } = self;
        let bound = |sign: f32| match &self.interface {
            Some(interface) => interface.action(&vec![sign; spec.action_dims]),
            None => vec![f64::from(sign); spec.action_dims],
        };
        let metadata = [
            ("method", config.method.clone()),
            ("task", config.task_label()),
            ("environment_step", self.environment_step.to_string()),
            ("observation", format!("{:?}", self.observation())),
            ("frame_stack", config.environment.frame_stack.to_string()),
            ("action_dims", spec.action_dims.to_string()),
            ("action_low", format!("{:?}", bound(-1.0))),
            ("action_high", format!("{:?}", bound(1.0))),
        ];
        let metadata: BTreeMap<String, String> =
            metadata.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
        let weights = self.agent.networks().weights()?;
        let bytes = hksl_core::to_safetensors_with(&weights, metadata)?;
        // A name alone has no folder that could be synced.
        let file = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
        Files::default().write_whole(&file, &bytes)?;
        Ok(())
    }
}

/// The environment of a run: the registry's, or what the run has recorded of another one.
fn specification(folder: &RunFolder, config: &Config) -> Result<(Spec, Option<Interface>)> {
    if hksl_envs::registry::find(&config.task).is_ok() {
        let environment = Registry.environment(config, rng::stream(0, "spec"))?;
        return Ok((environment.spec().clone(), None));
    }
    let path = folder.path().join("environment.json");
    let facts: Value = hksl_files::from_json(&path, &hksl_files::read(&path)?)?;
    let fact = |name: &str| facts.get(name).cloned();
    let damaged = |error: serde_json::Error| Error::damaged(&path, error);
    let Some(spec) = fact(SPECIFICATION) else {
        let reason = format!("it does not specify the environment of {}", config.task);
        return Err(Error::damaged(&path, reason));
    };
    let interface = fact(INTERFACE).map(serde_json::from_value).transpose().map_err(damaged)?;
    Ok((serde_json::from_value(spec).map_err(damaged)?, interface))
}
