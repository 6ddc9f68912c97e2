//! The representation's part of a learning step.

use std::collections::BTreeMap;

use candle_core::Tensor;
use candle_core::backprop::GradStore;

use crate::Result;
use crate::hierarchy::{Encoder, Hierarchy, LevelLoss, Trajectories};
use crate::optim::{Adam, load_into, state_of};

/// The hierarchy's optimisers: one Adam a level over its encoder, `f`, `w` and `c`; with a shared encoder,
/// one more for that encoder.
#[derive(Debug)]
pub struct HierarchyLearner {
    levels: Vec<Adam>,
    shared: Option<Adam>,
}

impl HierarchyLearner {
    /// Optimisers for this hierarchy, at Adam's rate `learning_rate`.
    pub fn new<E: Encoder>(hierarchy: &Hierarchy<E>, learning_rate: f64) -> Result<Self> {
        let parameters = hierarchy.parameters();
        let levels = (0..hierarchy.config().levels())
            .map(|level| Adam::new(parameters.under(&format!("levels.{level}")), learning_rate))
            .collect::<Result<_>>()?;
        let shared = hierarchy
            .config()
            .shared_encoder
            .then(|| Adam::new(parameters.under(&hierarchy.encoder_name(0)), learning_rate))
            .transpose()?;
        Ok(Self { levels, shared })
    }

    /// One step over all levels, finest first (HKSL appendix, pseudocode): each level's loss is computed with the
    /// weights as the levels before it left them, and moves that level and every level above it (§4), through
    /// which its contexts came. `hierarchy` must be the one this was made for, which is not checked.
    ///
    /// Momentum encoders, whose latents are the targets, are left as they are: [`Hierarchy::momentum`] makes what moves
    /// them, after every step or, as in the paper, every second one.
    ///
    /// Returns each level's loss with what it was computed from, without graph.
    ///
    /// # Errors
    /// As [`Hierarchy::level_loss`].
    pub fn step<E: Encoder>(
        &mut self,
        hierarchy: &Hierarchy<E>,
        trajectories: &Trajectories,
    ) -> Result<Vec<LevelLoss>> {
        (0..self.levels.len())
            .map(|level| {
                let outcome = hierarchy.level_loss(level, trajectories)?;
                self.step_level(level, &outcome.loss.backward()?)?;
                // Without its graph, whose memory the next level needs.
                Ok(LevelLoss {
                    loss: outcome.loss.detach(),
                    latents: outcome.latents.iter().map(Tensor::detach).collect(),
                    targets: outcome.targets,
                })
            })
            .collect()
    }

    /// Moves `level` and every level above it along the gradients of that level's loss, [`Hierarchy::level_loss`].
    ///
    /// # Errors
    /// A gradient of another shape.
    pub fn step_level(&mut self, level: usize, gradients: &GradStore) -> Result<()> {
        let above = self.levels[level..].iter_mut().chain(self.shared.as_mut());
        above.into_iter().try_for_each(|adam| adam.step(gradients))
    }

    /// One step of every optimiser along these gradients, such as those of the sum of [`Hierarchy::joint_losses`].
    ///
    /// # Errors
    /// A gradient that is not finite.
    pub fn step_once(&mut self, gradients: &GradStore) -> Result<()> {
        self.levels.iter_mut().chain(self.shared.as_mut()).try_for_each(|adam| adam.step(gradients))
    }

    /// Its optimisers by name: the levels', `0` the finest, and `shared`.
    pub fn optimisers(&self) -> impl Iterator<Item = (String, &Adam)> {
        let levels = self.levels.iter().enumerate().map(|(level, adam)| (level.to_string(), adam));
        levels.chain(self.shared.iter().map(|adam| ("shared".to_owned(), adam)))
    }

    /// As [`Self::optimisers`].
    pub fn optimisers_mut(&mut self) -> impl Iterator<Item = (String, &mut Adam)> {
        let levels = self.levels.iter_mut().enumerate();
        let levels = levels.map(|(level, adam)| (level.to_string(), adam));
        levels.chain(self.shared.iter_mut().map(|adam| ("shared".to_owned(), adam)))
    }

    /// Every moment, named `{level}.{parameter}.…`, and `shared.{parameter}.…`.
    ///
    /// # Errors
    /// Whatever the tensors report.
    pub fn state(&self) -> Result<BTreeMap<String, Tensor>> {
        state_of(self.optimisers())
    }

    /// Goes back to a saved state.
    ///
    /// # Errors
    /// A tensor that is missing, unknown or misshapen, and then nothing was changed.
    pub fn load(&mut self, state: &BTreeMap<String, Tensor>) -> Result<()> {
        load_into(self.optimisers_mut(), state.clone())
    }
}
