//! How a run's parts are made from its configuration.

use candle_core::Device;
use hksl_baselines::config::DrqConfig;
use hksl_baselines::{Curl, Dbc, DreamerV2, Drq, PiSac, dreamer};
use hksl_core::kernels::Kernels;
use hksl_envs::{ActionRepeat, Bordered, Environment, Settings, Spec};
use hksl_sac::learner::Architecture;
use hksl_sac::replay::Layout;
use hksl_sac::{Agent, HkslAgent, PixelAgent};
use rand_chacha::ChaCha8Rng;

use crate::Result;
use crate::config::{self, Config, EnvironmentConfig, METHOD_DREAMER, METHOD_HKSL};

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
        let repeated = ActionRepeat::new(single, environment.action_repeat)?;
        Ok(match environment.border {
            0 => Box::new(repeated),
            border => Box::new(Bordered::new(repeated, border)),
        })
    }

    fn agent(&self, spec: &Spec, device: &Device) -> Result<Box<dyn Agent>> {
        agent(self.0, spec, device)
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

/// The agent of the method that a configuration names, for environments of this `spec`.
///
/// # Errors
/// Sizes out of range; a method that does not exist, which a checked configuration does not have.
pub fn agent(config: &Config, spec: &Spec, device: &Device) -> Result<Box<dyn Agent>> {
    let (architecture, kernels) = (baseline_architecture(config, spec), Kernels::detect());
    let Config { replay, augmentation, seed, .. } = config;
    let (layout, seed) = (layout(config, spec), *seed);
    macro_rules! of {
        ($method:expr) => {
            Box::new(hksl_baselines::agent($method, layout, replay, augmentation, seed, device)?)
        };
    }
    Ok(match config.method.as_str() {
        METHOD_HKSL => Box::new(hksl_agent(config, spec, device)?),
        "sac" => of!(Drq::new(architecture, DrqConfig::ONE_VIEW, kernels, seed, device)?),
        "drq" => of!(Drq::new(architecture, config.drq.clone(), kernels, seed, device)?),
        "curl" => of!(Curl::new(architecture, &config.curl, kernels, seed, device)?),
        "pi-sac" => {
            let frames = config.environment.frame_stack;
            of!(PiSac::new(architecture, config.pi_sac.clone(), frames, kernels, seed, device)?)
        }
        "dbc" => of!(Dbc::new(architecture, config.dbc.clone(), kernels, seed, device)?),
        METHOD_DREAMER => {
            let sizes = dreamer::Sizes {
                observation: architecture.observation,
                action_dims: architecture.action_dims,
                encoder: config.encoder,
                config: config.dreamer.clone(),
            };
            let (observation, learner) =
                (sizes.observation, DreamerV2::new(sizes, kernels, seed, device)?);
            Box::new(PixelAgent::of(
                learner,
                observation,
                layout,
                replay,
                augmentation,
                seed,
                device,
            )?)
        }
        other => {
            return Err(config::Error::OutOfRange {
                key: "method".to_owned(),
                value: other.to_owned(),
                origin: None,
                expected: format!("it must be one of {}", config::methods().join(", ")),
            }
            .into());
        }
    })
}

fn baseline_architecture(config: &Config, spec: &Spec) -> hksl_baselines::Architecture {
    hksl_baselines::Architecture {
        observation: layout(config, spec).observation(),
        action_dims: spec.action_dims,
        encoder: config.encoder,
        sac: config.sac.clone(),
        baseline: config.baseline.clone(),
    }
}

/// What the networks of a configuration's HKSL agent are built for, in environments of this `spec`.
fn architecture(config: &Config, spec: &Spec) -> Architecture {
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
