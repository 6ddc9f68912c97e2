//! The hierarchy of forward models (HKSL §4). Each level predicts latents on its own time scale; coarser levels send
//! contexts to finer ones.

mod communication;
mod config;
mod encoder;
mod forward_model;
mod learner;
mod level;
mod loss;
mod projection;

use candle_core::{Device, Tensor};

pub use communication::Communication;
pub use config::HierarchyConfig;
pub use encoder::Encoder;
pub use forward_model::ForwardModel;
pub use learner::HierarchyLearner;
pub use level::Level;
pub use loss::{LevelLoss, prediction_loss};
pub use projection::Projection;

use crate::nn::Initialisation;
use crate::optim::MovingAverage;
use crate::params::{Builder, Parameters};
use crate::{Error, Result, parallel};

/// A batch of trajectories.
#[derive(Debug, Clone)]
pub struct Trajectories {
    /// `(k+1, B, …)` in the form that the encoder reads; `(k+1, B, C, H, W)` u8 for the pixel encoder.
    pub observations: Tensor,
    /// `(B, k, A)` f32.
    pub actions: Tensor,
}

impl Trajectories {
    /// The observations at a time, `(B, …)`.
    pub fn at(&self, time: usize) -> Result<Tensor> {
        Ok(self.observations.get(time)?)
    }
}

/// All levels with their encoders and momentum encoders. Generic over the encoder type.
///
/// Parameters: `levels.{l}.encoder`, `levels.{l}.forward_model`, `levels.{l}.communication`, `levels.{l}.projection` and
/// `momentum.{l}`, with `l` from 0, the finest level. A shared encoder has the parameters `encoder` and `momentum` in
/// place of those per level.
#[derive(Debug)]
pub struct Hierarchy<E> {
    config: HierarchyConfig,
    levels: Vec<Level>,
    trained: Vec<E>,
    frozen: Vec<E>,
    momentum: Vec<E>,
    parameters: Parameters,
}

impl<E: Encoder> Hierarchy<E> {
    /// Creates all levels and adds their parameters to `parameters`.
    ///
    /// `make` creates one encoder `(B, …) → (B, Z)`. It is called three times per encoder: for the trained encoder, for its
    /// view without gradient, and for its momentum encoder, which is initialised as a copy. `initialisation` applies to the
    /// encoders; all other weights are initialised uniformly, as in the authors' code.
    ///
    /// # Errors
    /// A configuration out of range, an error of `make`, or existing parameters under `levels`, `encoder` or `momentum`. In
    /// that case `parameters` may contain a part of the hierarchy.
    pub fn new(
        config: HierarchyConfig,
        parameters: &mut Parameters,
        rng: &mut rand_chacha::ChaCha8Rng,
        initialisation: Initialisation,
        device: &Device,
        make: impl Fn(&mut Builder) -> Result<E>,
    ) -> Result<Self> {
        config.validate()?;
        let mut trained = Vec::new();
        for index in 0..config.encoders() {
            let mut builder = Builder::create(parameters, rng, initialisation, device);
            trained.push(make(&mut builder.under(encoder_name(&config, index)))?);
        }
        let mut levels = Vec::new();
        for index in 0..config.levels() {
            let mut builder = Builder::create(parameters, rng, Initialisation::Uniform, device);
            levels.push(Level::new(&mut builder.under(level_name(index)), &config, index)?);
        }
        let (mut frozen, mut momentum) = (Vec::new(), Vec::new());
        for index in 0..config.encoders() {
            let (source, target) = (encoder_name(&config, index), momentum_name(&config, index));
            parameters.copy_under(&source, &target)?;
            frozen.push(make(&mut Builder::view(parameters, device).under(source))?);
            momentum.push(make(&mut Builder::view(parameters, device).under(target))?);
        }
        let own = ["levels", "encoder", "momentum"]
            .iter()
            .fold(Parameters::default(), |own, part| own.union(&parameters.under(part)));
        Ok(Self { config, levels, trained, frozen, momentum, parameters: own })
    }

    /// The hierarchy's configuration.
    pub fn config(&self) -> &HierarchyConfig {
        &self.config
    }

    /// All parameters under `levels`, `encoder` and `momentum`, including momentum encoders.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// The level with this index; 0 is the finest.
    ///
    /// # Panics
    /// This and the methods below panic if the level does not exist.
    pub fn level(&self, level: usize) -> &Level {
        &self.levels[level]
    }

    /// The encoder of a level, with gradient.
    pub fn encoder(&self, level: usize) -> &E {
        &self.trained[self.encoder_index(level)]
    }

    /// The encoder of a level, without gradient.
    pub fn frozen_encoder(&self, level: usize) -> &E {
        &self.frozen[self.encoder_index(level)]
    }

    /// The momentum encoder of a level.
    pub fn momentum_encoder(&self, level: usize) -> &E {
        &self.momentum[self.encoder_index(level)]
    }

    /// Index of the level's encoder among the [`HierarchyConfig::encoders`].
    pub fn encoder_index(&self, level: usize) -> usize {
        if self.config.shared_encoder { 0 } else { level }
    }

    /// Prefix of the parameters of encoder `index`.
    pub fn encoder_name(&self, index: usize) -> String {
        encoder_name(&self.config, index)
    }

    /// Prefix of the parameters of momentum encoder `index`.
    pub fn momentum_name(&self, index: usize) -> String {
        momentum_name(&self.config, index)
    }

    /// The soft update of the momentum encoders with coefficient `tau` ([`MovingAverage::update`]). Nothing else changes their
    /// weights.
    ///
    /// # Errors
    /// None for the parameters of a hierarchy.
    pub fn momentum(&self, tau: f64) -> Result<MovingAverage> {
        let averages = (0..self.config.encoders()).map(|index| {
            let (source, target) = (self.encoder_name(index), self.momentum_name(index));
            MovingAverage::new(&self.parameters, &source, &target, tau)
        });
        Ok(MovingAverage::merged(averages.collect::<Result<Vec<_>>>()?))
    }

    /// The latents of all encoders, concatenated, without gradient: the input of the actor.
    ///
    /// # Shapes
    /// - `observations`: `(B, …)`
    /// - output: `(B, h·Z)`, or `(B, Z)` with a shared encoder
    pub fn encode(&self, observations: &Tensor) -> Result<Tensor> {
        Ok(Tensor::cat(&encode_each(&self.frozen, observations)?, 1)?)
    }

    /// The latents of all encoders, `(B, Z)` each, with gradient.
    ///
    /// # Shapes
    /// - `observations`: `(B, …)`
    pub fn encodings(&self, observations: &Tensor) -> Result<Vec<Tensor>> {
        encode_each(&self.trained, observations)
    }

    /// Predicts the latents of a level, one `(B, Z)` for each of its `N_l` steps (HKSL §4).
    ///
    /// The prediction starts from the level's encoding of the first observation. `above` are the latents predicted by the
    /// next coarser level, from which the communication manager computes the contexts.
    ///
    /// # Errors
    /// Tensors whose shapes do not fit the configuration; `above` missing for a level with contexts.
    pub fn rollout(
        &self,
        level: usize,
        trajectories: &Trajectories,
        above: Option<&[Tensor]>,
    ) -> Result<Vec<Tensor>> {
        self.check(trajectories)?;
        let first = self.encoder(level).forward(&trajectories.at(0)?)?;
        self.rollout_from(level, first, trajectories, above)
    }

    /// Predicts the latents of a level like [`Self::rollout`], from a given encoding of the first observation.
    fn rollout_from(
        &self,
        level: usize,
        first: Tensor,
        trajectories: &Trajectories,
        above: Option<&[Tensor]>,
    ) -> Result<Vec<Tensor>> {
        let (skip, steps) = (self.config.skips[level], self.config.steps(level));
        let model = &self.levels[level].forward_model;
        let mut latent = first;
        let mut predicted = Vec::with_capacity(steps);
        for step in 0..steps {
            let context = self.context(level, above, step)?;
            let actions = trajectories.actions.narrow(1, step * skip, skip)?.flatten_from(1)?;
            latent = model.forward(&latent, &actions, context.as_ref())?;
            predicted.push(latent.clone());
        }
        Ok(predicted)
    }

    /// The context of the level's step `step`, if the level has contexts.
    fn context(
        &self,
        level: usize,
        above: Option<&[Tensor]>,
        step: usize,
    ) -> Result<Option<Tensor>> {
        let Some(manager) = self.levels[level].communication.as_ref() else { return Ok(None) };
        manager.forward(above.unwrap_or_default(), step).map(Some)
    }

    /// The contexts of a level's `N_l` steps, `(B, Z)` each: the outputs of its communication manager `c^{l+1,l}` (HKSL §4).
    /// Empty for a level without contexts.
    ///
    /// # Errors
    /// [`Error::Shape`] if the trajectories do not have the configured length and action dimensions.
    pub fn contexts(&self, level: usize, trajectories: &Trajectories) -> Result<Vec<Tensor>> {
        self.check(trajectories)?;
        if !self.config.has_context(level) {
            return Ok(Vec::new());
        }
        let rolled = self.rollouts(level + 1, trajectories)?;
        let above = rolled.last().map(Vec::as_slice);
        let contexts = (0..self.config.steps(level)).map(|step| self.context(level, above, step));
        contexts.filter_map(Result::transpose).collect()
    }

    /// The latents predicted by all levels from the coarsest to `lowest`, coarsest level first. Without communication, those
    /// of `lowest` alone.
    ///
    /// # Errors
    /// [`Error::Shape`] if the trajectories do not have the configured length and action dimensions.
    pub fn rollouts(&self, lowest: usize, trajectories: &Trajectories) -> Result<Vec<Vec<Tensor>>> {
        let top = if self.config.communication { self.config.levels() - 1 } else { lowest };
        let mut rolled: Vec<Vec<Tensor>> = Vec::new();
        for level in (lowest..=top).rev() {
            let above = rolled.last().map(Vec::as_slice);
            rolled.push(self.rollout(level, trajectories, above)?);
        }
        Ok(rolled)
    }

    /// The targets of a level: its momentum encodings of the observations after each of its steps.
    ///
    /// # Shapes
    /// - output: `(N_l, B, Z)`, without gradient
    ///
    /// # Errors
    /// [`Error::Shape`] if the trajectories do not have the configured length and action dimensions.
    pub fn targets(&self, level: usize, trajectories: &Trajectories) -> Result<Tensor> {
        self.check(trajectories)?;
        let (skip, steps) = (self.config.skips[level], self.config.steps(level));
        let ahead =
            (1..=steps).map(|step| trajectories.at(step * skip)).collect::<Result<Vec<_>>>()?;
        let batch = ahead[0].dim(0)?;
        let latents = self.momentum_encoder(level).forward(&Tensor::cat(&ahead, 0)?)?;
        Ok(latents.reshape((steps, batch, self.config.latent_dims))?)
    }

    /// The loss of a level, with predictions of all coarser levels for its contexts (HKSL eq. 1).
    ///
    /// # Errors
    /// [`Error::Shape`] if the trajectories do not have the configured length and action dimensions.
    pub fn level_loss(&self, level: usize, trajectories: &Trajectories) -> Result<LevelLoss> {
        self.check(trajectories)?;
        let (latents, targets) = parallel::both(
            trajectories.observations.device(),
            || self.rollouts(level, trajectories),
            || self.targets(level, trajectories),
        );
        self.loss_of(level, latents?.pop().unwrap_or_default(), targets?)
    }

    /// The losses of all levels, finest first, from one rollout of each level, for the joint schedule. [`Self::level_loss`]
    /// repeats the rollouts of the coarser levels instead.
    ///
    /// `first` are the encodings of the first observations, one for each encoder.
    ///
    /// # Errors
    /// [`Error::Shape`] if the trajectories do not have the configured length and action dimensions, or for another number
    /// of encodings.
    pub fn joint_losses(
        &self,
        trajectories: &Trajectories,
        first: &[Tensor],
    ) -> Result<Vec<LevelLoss>> {
        self.check(trajectories)?;
        if first.len() != self.config.encoders() {
            let expected = format!("({}) of (B, Z)", self.config.encoders());
            return Err(Error::Shape { what: "first encodings", got: vec![first.len()], expected });
        }
        let device = trajectories.observations.device();
        let levels: Vec<usize> = (0..self.levels.len()).collect();
        let mut targets =
            parallel::each(device, &levels, |&level| self.targets(level, trajectories))?;
        let mut losses: Vec<LevelLoss> = Vec::with_capacity(self.levels.len());
        for level in (0..self.levels.len()).rev() {
            let above = losses.last().map(|above| above.latents.as_slice());
            let first = first[self.encoder_index(level)].clone();
            let latents = self.rollout_from(level, first, trajectories, above)?;
            let targets = targets.remove(level);
            losses.push(self.loss_of(level, latents, targets)?);
        }
        losses.reverse();
        Ok(losses)
    }

    fn loss_of(&self, level: usize, latents: Vec<Tensor>, targets: Tensor) -> Result<LevelLoss> {
        let projection = self.levels[level].projection.as_ref();
        let loss = prediction_loss(&latents, &targets, projection)?;
        Ok(LevelLoss { loss, latents, targets })
    }

    fn check(&self, trajectories: &Trajectories) -> Result<()> {
        let Trajectories { observations, actions } = trajectories;
        let (k, dims) = (self.config.trajectory_length, self.config.action_dims);
        let times = observations.dims().first().copied().unwrap_or(0);
        let batch = observations.dims().get(1).copied().unwrap_or(0);
        if times != k + 1 {
            let (got, expected) = (observations.dims().to_vec(), format!("({}, B, …)", k + 1));
            return Err(Error::Shape { what: "trajectories.observations", got, expected });
        }
        if actions.dims() != [batch, k, dims] {
            let (got, expected) = (actions.dims().to_vec(), format!("({batch}, {k}, {dims})"));
            return Err(Error::Shape { what: "trajectories.actions", got, expected });
        }
        Ok(())
    }
}

fn encode_each<E: Encoder>(encoders: &[E], observations: &Tensor) -> Result<Vec<Tensor>> {
    parallel::each(observations.device(), encoders, |encoder| encoder.forward(observations))
}

fn level_name(level: usize) -> String {
    format!("levels.{level}")
}

fn encoder_name(config: &HierarchyConfig, index: usize) -> String {
    if config.shared_encoder { "encoder".to_owned() } else { format!("levels.{index}.encoder") }
}

fn momentum_name(config: &HierarchyConfig, index: usize) -> String {
    if config.shared_encoder { "momentum".to_owned() } else { format!("momentum.{index}") }
}
