//! How a run's parts are made from its configuration.

use candle_core::Device;
use hksl_envs::external::Interface;
use hksl_envs::{ActionRepeat, Bordered, Environment, Settings, Spec};
use hksl_sac::Agent;
use hksl_sac::hksl::Hksl;
use hksl_sac::replay::Layout;
use rand_chacha::ChaCha8Rng;

use crate::Result;
use crate::config::methods::Build;
use crate::config::{self, Config, EnvironmentConfig};

/// Builds a run's environments and agents. The training loop knows nothing else of tasks and methods, so a test or
/// another project can bring its own.
pub trait Factories {
    /// Builds an environment with action repeat, whose randomness comes from `rng`.
    ///
    /// # Errors
    /// Whatever the environment reports.
    fn environment(&self, config: &Config, rng: ChaCha8Rng) -> Result<Box<dyn Environment>>;

    /// Builds an agent with initial weights and random number generators for environments of this `spec`. Besides the
    /// run's agent, the training loop builds agents with smaller batches to measure memory.
    ///
    /// # Errors
    /// Sizes out of range.
    fn agent(&self, config: &Config, spec: &Spec, device: &Device) -> Result<Agent>;

    /// The spaces of the environments, if they are another program's, for `environment.json`.
    fn interface(&self) -> Option<&Interface> {
        None
    }
}

/// The tasks and methods of the registry, as the configuration names them.
#[derive(Debug, Clone, Copy)]
pub struct Registry;

impl Factories for Registry {
    fn environment(&self, config: &Config, rng: ChaCha8Rng) -> Result<Box<dyn Environment>> {
        wrapped(config, hksl_envs::make(&config.task, &settings(config), rng)?)
    }

    fn agent(&self, config: &Config, spec: &Spec, device: &Device) -> Result<Agent> {
        agent(config, spec, device)
    }
}

/// Makes environments that take single control steps, from random numbers of this generator.
pub type Make<'a> = dyn Fn(ChaCha8Rng) -> Result<Box<dyn Environment>> + 'a;

/// A program's own environments, and the methods that a configuration names.
pub struct Own<'a> {
    /// Makes the environments.
    pub make: &'a Make<'a>,
    /// Their spaces, if they are another program's.
    pub interface: Option<Interface>,
}

impl Factories for Own<'_> {
    fn environment(&self, config: &Config, rng: ChaCha8Rng) -> Result<Box<dyn Environment>> {
        wrapped(config, (self.make)(rng)?)
    }

    fn agent(&self, config: &Config, spec: &Spec, device: &Device) -> Result<Agent> {
        agent(config, spec, device)
    }

    fn interface(&self) -> Option<&Interface> {
        self.interface.as_ref()
    }
}

/// An environment of single control steps as the agent meets it: actions repeated, frames with their border.
fn wrapped(config: &Config, single: Box<dyn Environment>) -> Result<Box<dyn Environment>> {
    let EnvironmentConfig { action_repeat, border, .. } = config.environment;
    let repeated = ActionRepeat::new(single, action_repeat)?;
    Ok(match border {
        0 => Box::new(repeated),
        border => Box::new(Bordered::new(repeated, border)),
    })
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

/// The agent of the method that a configuration names, for environments of this `spec`.
///
/// # Errors
/// Sizes out of range; a method that does not exist, which a checked configuration does not have.
pub fn agent(config: &Config, spec: &Spec, device: &Device) -> Result<Agent> {
    let layout = layout(config, spec);
    let learner = (config.registered()?.build)(config, &build(spec, &layout, device))?;
    let Config { replay, augmentation, seed, .. } = config;
    Ok(Agent::new(learner, layout, replay, augmentation, *seed, device)?)
}

/// The networks of the HKSL agent that a configuration describes, for environments of this `spec`.
///
/// # Errors
/// Sizes out of range.
pub fn hksl(config: &Config, spec: &Spec, device: &Device) -> Result<Hksl> {
    Ok(config::methods::hksl(config, &build(spec, &layout(config, spec), device))?)
}

fn build<'a>(spec: &Spec, layout: &Layout, device: &'a Device) -> Build<'a> {
    Build { observation: layout.observation(), action_dims: spec.action_dims, device }
}

fn layout(config: &Config, spec: &Spec) -> Layout {
    Layout {
        frame: [spec.frame.channels, spec.frame.height, spec.frame.width],
        stack: config.environment.frame_stack,
        action_dims: spec.action_dims,
    }
}
