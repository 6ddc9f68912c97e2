//! How a run's parts are made from its configuration.

use candle_core::Device;
use hksl_envs::{ActionRepeat, Environment, Settings, Spec};
use hksl_sac::learner::Architecture;
use hksl_sac::replay::Layout;
use hksl_sac::{Agent, HkslAgent};
use rand_chacha::ChaCha8Rng;

use crate::Result;
use crate::config::{Config, EnvironmentConfig};

/// What the training loop needs made. It knows nothing else of tasks and methods, so that a test, or
/// another project, can bring an environment or an agent of its own.
pub trait Factories {
    /// An environment as the agent meets it, actions repeated, that draws from `rng`.
    fn environment(&self, rng: ChaCha8Rng) -> Result<Box<dyn Environment>>;

    /// An agent for environments like this, its weights and random streams started.
    fn agent(&self, spec: &Spec, device: &Device) -> Result<Box<dyn Agent>>;
}

/// The registry's tasks and the methods that a configuration names.
#[derive(Debug, Clone)]
pub struct Configured<'a>(pub &'a Config);

impl Factories for Configured<'_> {
    fn environment(&self, rng: ChaCha8Rng) -> Result<Box<dyn Environment>> {
        let Config { task, environment, .. } = self.0;
        let settings = settings(self.0);
        let single = hksl_envs::make(task, &settings, rng)?;
        Ok(Box::new(ActionRepeat::new(single, environment.action_repeat)?))
    }

    fn agent(&self, spec: &Spec, device: &Device) -> Result<Box<dyn Agent>> {
        Ok(Box::new(hksl_agent(self.0, spec, device)?))
    }
}

/// What a configuration says about its environment.
pub fn settings(config: &Config) -> Settings {
    let EnvironmentConfig { height, width, episode_steps, .. } = config.environment;
    Settings {
        height,
        width,
        episode_steps,
        distraction: config.distraction(),
        render: config.render_settings(),
        render_device: config.render_device(),
    }
}

/// What the networks of a configuration's agent are built for, in environments of this `spec`.
pub fn architecture(config: &Config, spec: &Spec) -> Architecture {
    Architecture {
        observation: layout(config, spec).observation(),
        action_dims: spec.action_dims,
        encoder: config.encoder,
        hksl: config.hksl.clone(),
        sac: config.sac.clone(),
    }
}

fn layout(config: &Config, spec: &Spec) -> Layout {
    Layout {
        frame: [spec.frame.channels, spec.frame.height, spec.frame.width],
        stack: config.environment.frame_stack,
        action_dims: spec.action_dims,
    }
}

/// The HKSL agent that a configuration describes, for environments of this `spec`.
pub fn hksl_agent(config: &Config, spec: &Spec, device: &Device) -> Result<HkslAgent> {
    let (layout, architecture) = (layout(config, spec), architecture(config, spec));
    let Config { replay, augmentation, seed, .. } = config;
    Ok(HkslAgent::new(architecture, layout, replay, augmentation, *seed, device)?)
}
