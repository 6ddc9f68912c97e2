//! The hierarchy of forward models (HKSL §4): levels that predict latents at their own time scales, coarser
//! ones telling finer ones what matters.

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
    /// `(k+1, B, …)`, time first, in whatever form the encoder reads; the pixel encoder reads u8
    /// `(k+1, B, C, H, W)`.
    pub observations: Tensor,
    /// `(B, k, A)` f32.
    pub actions: Tensor,
}

impl Trajectories {
    /// The observations at one time, `(B, …)`.
    pub fn at(&self, time: usize) -> Result<Tensor> {
        Ok(self.observations.get(time)?)
    }
}

/// All levels with their encoders and momentum encoders, of any encoder type.
///
/// Its parameters are named `levels.{l}.encoder`, `levels.{l}.forward_model`, `levels.{l}.communication`,
/// `levels.{l}.projection` and `momentum.{l}`, with `l` 0-based from the finest level. With a shared
/// encoder there are `encoder` and `momentum` in place of one a level.
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
    /// Builds all levels and adds their parameters to `parameters`.
    ///
    /// `make` builds one encoder `(B, …) → (B, Z)`. It is called three times for each: for the trained
    /// encoder, for its twin without gradient, and for its momentum encoder, which starts as a copy.
    /// Encoders start by `initialisation`, everything else uniformly, as the authors do.
    ///
    /// # Errors
    /// A configuration out of range, an encoder that cannot be built, names under `levels`, `encoder` or `momentum` that
    /// are taken. Then `parameters` may have some of the hierarchy's.
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

    /// The sizes and parts of this hierarchy.
    pub fn config(&self) -> &HierarchyConfig {
        &self.config
    }

    /// All parameters, momentum encoders included: everything under `levels`, `encoder` and `momentum`.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// The level with this index, 0 the finest. Here and below, one that is not there panics.
    pub fn level(&self, level: usize) -> &Level {
        &self.levels[level]
    }

    /// The encoder of a level, as it is trained.
    pub fn encoder(&self, level: usize) -> &E {
        &self.trained[self.encoder_index(level)]
    }

    /// The same encoder over the same weights, without gradient.
    pub fn frozen_encoder(&self, level: usize) -> &E {
        &self.frozen[self.encoder_index(level)]
    }

    /// The momentum encoder of a level.
    pub fn momentum_encoder(&self, level: usize) -> &E {
        &self.momentum[self.encoder_index(level)]
    }

    /// Which of the [`HierarchyConfig::encoders`] belongs to `level`.
    pub fn encoder_index(&self, level: usize) -> usize {
        if self.config.shared_encoder { 0 } else { level }
    }

    /// Where the parameters of encoder `index` are.
    pub fn encoder_name(&self, index: usize) -> String {
        encoder_name(&self.config, index)
    }

    /// Where the parameters of momentum encoder `index` are.
    pub fn momentum_name(&self, index: usize) -> String {
        momentum_name(&self.config, index)
    }

    /// How the momentum encoders follow: each moves a share `tau` of the way to its encoder at every
    /// [`MovingAverage::update`]. Nothing else moves them.
    ///
    /// # Errors
    /// None that a hierarchy's own parameters can cause.
    pub fn momentum(&self, tau: f64) -> Result<MovingAverage> {
        let averages = (0..self.config.encoders()).map(|index| {
            let (source, target) = (self.encoder_name(index), self.momentum_name(index));
            MovingAverage::new(&self.parameters, &source, &target, tau)
        });
        Ok(MovingAverage::together(averages.collect::<Result<Vec<_>>>()?))
    }

    /// The latents of every encoder side by side, without gradient: what the actor reads.
    ///
    /// # Shapes
    /// - `observations`: `(B, …)`
    /// - output: `(B, h·Z)`, or `(B, Z)` with a shared encoder
    pub fn encode(&self, observations: &Tensor) -> Result<Tensor> {
        Ok(Tensor::cat(&encode_each(&self.frozen, observations)?, 1)?)
    }

    /// The latents of every encoder, `(B, Z)` each, with gradient.
    ///
    /// # Shapes
    /// - `observations`: `(B, …)`
    pub fn encodings(&self, observations: &Tensor) -> Result<Vec<Tensor>> {
        encode_each(&self.trained, observations)
    }

    /// The latents that level `level` predicts, one `(B, Z)` for each of its `N_l` steps (HKSL §4).
    ///
    /// The level starts from its encoding of the first observation; `above` are the latents predicted one
    /// level up, from which each step's context comes.
    ///
    /// # Errors
    /// Tensors whose shapes do not fit the configuration; no `above` for a level that is told something.
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

    /// As [`Self::rollout`], from an encoding of the first observation that is there already.
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

    /// What the level above tells `level` before its step `step`, if it does.
    fn context(
        &self,
        level: usize,
        above: Option<&[Tensor]>,
        step: usize,
    ) -> Result<Option<Tensor>> {
        let Some(manager) = self.levels[level].communication.as_ref() else { return Ok(None) };
        manager.forward(above.unwrap_or_default(), step).map(Some)
    }

    /// What the level above tells `level` before each of its `N_l` steps, `(B, Z)` each: the outputs of its
    /// communication manager `c^{l+1,l}` (HKSL §4). Empty for a level that is told nothing.
    ///
    /// # Errors
    /// As [`Self::level_loss`].
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

    /// The latents predicted by every level from the top down to `lowest`, highest level first.
    ///
    /// Nothing is rolled out that a context does not need: without communication that is `lowest` alone.
    ///
    /// # Errors
    /// As [`Self::level_loss`].
    pub fn rollouts(&self, lowest: usize, trajectories: &Trajectories) -> Result<Vec<Vec<Tensor>>> {
        let top = if self.config.communication { self.config.levels() - 1 } else { lowest };
        let mut rolled: Vec<Vec<Tensor>> = Vec::new();
        for level in (lowest..=top).rev() {
            let above = rolled.last().map(Vec::as_slice);
            rolled.push(self.rollout(level, trajectories, above)?);
        }
        Ok(rolled)
    }

    /// What level `level` should have predicted: its momentum encodings of the observations it steps to.
    ///
    /// # Shapes
    /// - output: `(N_l, B, Z)`, without gradient
    ///
    /// # Errors
    /// As [`Self::level_loss`].
    pub fn targets(&self, level: usize, trajectories: &Trajectories) -> Result<Tensor> {
        self.check(trajectories)?;
        let (skip, steps) = (self.config.skips[level], self.config.steps(level));
        let ahead =
            (1..=steps).map(|step| trajectories.at(step * skip)).collect::<Result<Vec<_>>>()?;
        let batch = ahead[0].dim(0)?;
        let latents = self.momentum_encoder(level).forward(&Tensor::cat(&ahead, 0)?)?;
        Ok(latents.reshape((steps, batch, self.config.latent_dims))?)
    }

    /// The loss of one level, all levels above it rolled out for its contexts (HKSL eq. 1).
    ///
    /// # Errors
    /// [`Error::Shape`] if the trajectories do not have the configured length and action size.
    pub fn level_loss(&self, level: usize, trajectories: &Trajectories) -> Result<LevelLoss> {
        self.check(trajectories)?;
        let (latents, targets) = parallel::both(
            trajectories.observations.device(),
            || self.rollouts(level, trajectories),
            || self.targets(level, trajectories),
        );
        self.loss_of(level, latents?.pop().unwrap_or_default(), targets?)
    }

    /// The losses of all levels, finest first, from one rollout of each: what the joint schedule sums, where
    /// [`Self::level_loss`] rolls every level above out anew.
    ///
    /// `first` are the encodings of the first observations, one for each encoder.
    ///
    /// # Errors
    /// As [`Self::level_loss`]; another number of encodings.
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
