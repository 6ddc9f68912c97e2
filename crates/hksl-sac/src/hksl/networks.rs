//! HKSL's networks and their optimisers.

use candle_core::Device;
use hksl_core::kernels::Kernels;
use hksl_core::nn::{PixelEncoder, PixelEncoderConfig};
use hksl_core::optim::{Adam, MovingAverage};
use hksl_core::{Builder, Hierarchy, HierarchyConfig, HierarchyLearner, Parameters, rng};

use crate::Result;
use crate::actor::Actor;
use crate::config::{HkslConfig, SacConfig, UpdateSchedule};
use crate::critic::Critic;
use crate::networks::{ImageEncoder, Networks, QFunction};
use crate::temperature::Temperature;

/// Sizes and settings of the networks.
#[derive(Debug, Clone, PartialEq)]
pub struct Architecture {
    /// Shape of one observation, `(C, H, W)`.
    pub observation: [usize; 3],
    /// Action dimensions, `A`.
    pub action_dims: usize,
    /// Sizes of the encoders.
    pub encoder: PixelEncoderConfig,
    /// The hierarchy and how it learns.
    pub hksl: HkslConfig,
    /// The actor-critic and how it learns.
    pub sac: SacConfig,
}

impl Architecture {
    /// The hierarchy's configuration.
    pub fn hierarchy(&self) -> HierarchyConfig {
        HierarchyConfig {
            skips: self.hksl.skips.clone(),
            trajectory_length: self.hksl.trajectory_length,
            action_dims: self.action_dims,
            latent_dims: self.encoder.latent_dims,
            communication_hidden: self.hksl.communication_hidden,
            communication: self.hksl.communication,
            projection: self.hksl.projection,
            shared_encoder: self.hksl.shared_encoder,
        }
    }
}

/// HKSL's networks and their optimisers.
///
/// Parameters: those of the hierarchy, `critics.{l}`, `targets.{l}`, `actor` and `log_alpha`.
///
/// # Panics
/// Methods that take a level panic if it does not exist.
#[derive(Debug)]
pub struct Hksl {
    pub(super) architecture: Architecture,
    pub(super) networks: Networks,
    pub(super) hierarchy: Hierarchy<PixelEncoder>,
    pub(super) critics: Vec<LevelCritic>,
    pub(super) actor: Actor,
    pub(super) frozen_actor: Actor,
    pub(super) temperature: Temperature,
    pub(super) optimizers: Optimizers,
    pub(super) averages: MovingAverage,
}

/// A level's critic, a view of the same weights without gradient, and its target.
#[derive(Debug)]
pub(super) struct LevelCritic {
    pub(super) trained: Critic,
    pub(super) frozen: Critic,
    pub(super) target: Critic,
}

/// The optimisers. Each encoder has two: one for the representation losses and one for the critic losses.
#[derive(Debug)]
pub(super) struct Optimizers {
    pub(super) representation: HierarchyLearner,
    /// Optimisers with their names. Sequential schedule: `critic.{l}` for the critic and the encoder of a level. Joint
    /// schedule: `encoder.{i}` and `critic.{l}`.
    pub(super) critics: Vec<(String, Adam)>,
    pub(super) actor: Adam,
    pub(super) temperature: Adam,
}

impl Optimizers {
    fn new(
        architecture: &Architecture,
        hierarchy: &Hierarchy<PixelEncoder>,
        parameters: &Parameters,
    ) -> Result<Self> {
        let Architecture { hksl, sac, .. } = architecture;
        let config = hierarchy.config();
        let adam = |parameters| Adam::new(parameters, sac.learning_rate);
        let encoder = |index: usize| parameters.under(&hierarchy.encoder_name(index));
        let critic = |level: usize| parameters.under(&format!("critics.{level}"));
        let mut critics = Vec::new();
        let sequential = hksl.update_schedule == UpdateSchedule::Sequential;
        if !sequential {
            for index in 0..config.encoders() {
                critics.push((format!("encoder.{index}"), adam(encoder(index))?));
            }
        }
        for level in 0..config.levels() {
            let mut own = critic(level);
            if sequential {
                own = own.union(&encoder(hierarchy.encoder_index(level)));
            }
            critics.push((format!("critic.{level}"), adam(own)?));
        }
        Ok(Self {
            representation: HierarchyLearner::new(hierarchy, hksl.learning_rate)?,
            critics,
            actor: adam(parameters.under("actor"))?,
            temperature: adam(parameters.under("log_alpha"))?,
        })
    }

    pub(super) fn named(&mut self) -> Vec<(String, &mut Adam)> {
        let Self { representation, critics, actor, temperature } = self;
        let levels = representation.optimisers_mut();
        let levels = levels.map(|(name, adam)| (format!("representation.{name}"), adam));
        let critics = critics.iter_mut().map(|(name, adam)| (name.clone(), adam));
        let rest = [("actor".to_owned(), actor), ("temperature".to_owned(), temperature)];
        levels.chain(critics).chain(rest).collect()
    }
}

impl Hksl {
    /// Creates the networks and initialises them with the RNG stream `init` of `seed`.
    ///
    /// # Errors
    /// A setting out of range; the error names its key.
    pub fn new(architecture: Architecture, seed: u64, device: &Device) -> Result<Self> {
        Self::with_kernels(architecture, seed, device, Kernels::detect())
    }

    /// Creates the networks with a choice of CPU kernels; otherwise the same as [`Self::new`].
    ///
    /// # Errors
    /// A setting out of range; the error names its key.
    pub fn with_kernels(
        architecture: Architecture,
        seed: u64,
        device: &Device,
        kernels: Kernels,
    ) -> Result<Self> {
        let Architecture { observation, action_dims, encoder, ref hksl, ref sac } = architecture;
        hksl.validate()?;
        sac.validate()?;
        let mut parameters = Parameters::with_kernels(kernels);
        let mut rng = rng::stream(seed, "init");
        let config = architecture.hierarchy();
        let initialisation = hksl.initialisation;
        let hierarchy = Hierarchy::new(
            config.clone(),
            &mut parameters,
            &mut rng,
            initialisation,
            device,
            |builder| PixelEncoder::new(builder, observation, encoder),
        )?;
        let make = |builder: &mut Builder| {
            Critic::new(builder, encoder.latent_dims, action_dims, sac.hidden_units)
        };
        let mut critics = Vec::new();
        for level in 0..config.levels() {
            let (name, target) = (format!("critics.{level}"), format!("targets.{level}"));
            let mut builder = Builder::create(&mut parameters, &mut rng, initialisation, device);
            let trained = make(&mut builder.under(&name))?;
            parameters.copy_under(&name, &target)?;
            let mut view = Builder::view(&parameters, device);
            let frozen = make(&mut view.under(&name))?;
            critics.push(LevelCritic { trained, frozen, target: make(&mut view.under(&target))? });
        }
        let latents = config.encoders() * encoder.latent_dims;
        let make = |builder: &mut Builder| {
            Actor::new(&mut builder.under("actor"), latents, action_dims, sac)
        };
        let actor = make(&mut Builder::create(&mut parameters, &mut rng, initialisation, device))?;
        let frozen_actor = make(&mut Builder::view(&parameters, device))?;
        let temperature =
            Temperature::new(&mut parameters, sac.initial_temperature, action_dims, device)?;

        let averages = (0..config.levels()).map(|level| {
            let (source, target) = (format!("critics.{level}"), format!("targets.{level}"));
            MovingAverage::new(&parameters, &source, &target, sac.critic_tau)
        });
        let averages = averages.chain([hierarchy.momentum(sac.encoder_tau)]);
        let averages = MovingAverage::merged(averages.collect::<hksl_core::Result<Vec<_>>>()?);
        Ok(Self {
            optimizers: Optimizers::new(&architecture, &hierarchy, &parameters)?,
            networks: networks(&architecture, &hierarchy, &critics, parameters),
            hierarchy,
            critics,
            actor,
            frozen_actor,
            temperature,
            averages,
            architecture,
        })
    }

    /// The sizes and settings of the networks.
    pub fn architecture(&self) -> &Architecture {
        &self.architecture
    }

    /// Encoders and forward models.
    pub fn hierarchy(&self) -> &Hierarchy<PixelEncoder> {
        &self.hierarchy
    }

    /// The entropy temperature α.
    pub fn temperature(&self) -> &Temperature {
        &self.temperature
    }
}

/// Lists the networks. Encoders are named `level 1` (the finest), `level 2` and so on, or `shared` if all levels share
/// one encoder.
fn networks(
    architecture: &Architecture,
    hierarchy: &Hierarchy<PixelEncoder>,
    critics: &[LevelCritic],
    parameters: Parameters,
) -> Networks {
    let config = hierarchy.config();
    let name = |index: usize| match config.shared_encoder {
        true => "shared".to_owned(),
        false => format!("level {}", index + 1),
    };
    let mut trained = Vec::new();
    for index in 0..config.encoders() {
        trained.push((format!("encoder, {}", name(index)), vec![hierarchy.encoder_name(index)]));
    }
    for level in 0..config.levels() {
        let prefixes = ["forward_model", "communication", "projection"]
            .map(|part| format!("levels.{level}.{part}"));
        trained.push((format!("forward model, level {}", level + 1), prefixes.into()));
    }
    for level in 0..config.levels() {
        trained
            .push((format!("twin critics, level {}", level + 1), vec![format!("critics.{level}")]));
    }
    trained.push(("actor".to_owned(), vec!["actor".to_owned()]));
    let encoder = |index: usize| {
        let encoder: Box<dyn ImageEncoder> = Box::new(hierarchy.frozen_encoder(index).clone());
        (name(index), encoder)
    };
    let q = |(level, critic): (usize, &LevelCritic)| QFunction {
        suffix: format!("_{}", level + 1),
        encoder: hierarchy.encoder_index(level),
        discount: architecture.sac.discount,
        critic: critic.frozen.clone(),
    };
    Networks {
        observation: architecture.observation,
        parameters,
        trained,
        encoders: (0..config.encoders()).map(encoder).collect(),
        critics: critics.iter().enumerate().map(q).collect(),
    }
}
