//! A run to analyse.

use std::path::Path;

use anyhow::{Context, bail};
use candle_core::Device;
use hksl_core::rng;
use hksl_envs::Spec;
use hksl_sac::hksl::Hksl;
use hksl_sac::{Agent, Learner, Networks};
use hksl_train::checkpoint::Checkpoints;
use hksl_train::config::Config;
use hksl_train::evaluate::load_weights;
use hksl_train::{Factories, Registry, RunFolder, hksl};

use super::Options;

/// A run with its configuration.
pub struct Source {
    /// Folder of the run.
    pub folder: RunFolder,
    /// Configuration of the run.
    pub config: Config,
    /// Specification of its environment.
    pub spec: Spec,
}

impl Source {
    /// Opens the run in this folder, which may still be training, on the device of the options.
    pub fn open(path: &Path, options: &Options) -> anyhow::Result<Self> {
        let folder = RunFolder::existing(path)?;
        let mut config = Config::of_run(&folder)?;
        config.device = options.device.clone();
        config.render.device = "auto".to_owned();
        let spec = Registry.environment(&config, rng::stream(0, "spec"))?.spec().clone();
        Ok(Self { folder, config, spec })
    }

    /// Method, ablation and name of the run: the name of the folder above `seed-…`.
    pub fn label(&self) -> String {
        let path = self.folder.path();
        let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let name = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
        let own = name(&path).unwrap_or_default();
        match path.parent().and_then(name) {
            Some(parent) if own.starts_with("seed-") => parent,
            _ => own,
        }
    }

    /// Its agent with the weights of a checkpoint.
    pub fn agent(&self, environment_step: u64, device: &Device) -> anyhow::Result<Agent> {
        let agent = Registry.agent(&self.config, &self.spec, device)?;
        self.load(agent.networks(), environment_step)?;
        Ok(agent)
    }

    /// Its HKSL networks with the weights of a checkpoint.
    pub fn hksl(&self, environment_step: u64, device: &Device) -> anyhow::Result<Hksl> {
        if self.config.hierarchy().is_none() {
            bail!(
                "{} was trained with {}, which has no communication managers; choose a run of method hksl",
                self.folder.path().display(),
                self.config.method
            );
        }
        let learner = hksl(&self.config, &self.spec, device)?;
        self.load(learner.networks(), environment_step)?;
        Ok(learner)
    }

    fn load(&self, networks: &Networks, environment_step: u64) -> anyhow::Result<()> {
        let weights = Checkpoints::of_run(&self.folder).weights(environment_step)?;
        Ok(load_weights(networks, &self.config, &weights, environment_step)?)
    }

    /// The requested checkpoint, or the newest one.
    pub fn step(&self, asked: Option<u64>) -> anyhow::Result<u64> {
        Ok(asked.map_or_else(|| Checkpoints::of_run(&self.folder).newest(), Ok)?)
    }

    /// SHA-256 of a checkpoint's weights.
    pub fn weights_sha256(&self, environment_step: u64) -> anyhow::Result<String> {
        let checkpoints = Checkpoints::of_run(&self.folder);
        checkpoints.weights(environment_step)?;
        let listing = checkpoints.list()?;
        let files = listing.sound.get(&environment_step).map(|summary| &summary.files);
        let record = files.and_then(|files| files.get("weights.safetensors"));
        let gone = || format!("the checkpoint at {environment_step} has just been removed");
        Ok(record.with_context(gone)?.sha256.clone())
    }
}
