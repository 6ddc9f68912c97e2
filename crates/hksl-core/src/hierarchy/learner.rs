//! Optimisation of the representation losses.

use std::collections::BTreeMap;

use candle_core::Tensor;
use candle_core::backprop::GradStore;

use crate::Result;
use crate::hierarchy::{Encoder, Hierarchy, LevelLoss, Trajectories};
use crate::optim::{Adam, load_into, state_of};

/// The hierarchy's optimisers: one Adam per level for its encoder, `f`, `w` and `c`, and one more for a shared encoder.
#[derive(Debug)]
pub struct HierarchyLearner {
    levels: Vec<Adam>,
    shared: Option<Adam>,
}

impl HierarchyLearner {
    /// Creates the optimisers of a hierarchy, with Adam's learning rate `learning_rate`.
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

    /// Takes one step for each level, finest first (HKSL appendix, pseudocode). Each level's loss uses the weights after the
    /// updates of the finer levels and trains the level and all coarser levels (§4), from which its contexts come.
    /// `hierarchy` must be the one that the learner was created for, which is not checked.
    ///
    /// The step does not update the momentum encoders. Call [`MovingAverage::update`](crate::optim::MovingAverage::update) of
    /// [`Hierarchy::momentum`] after every step or, as in the paper, after every second one.
    ///
    /// Returns each level's loss, predictions and targets, without graph.
    ///
    /// # Errors
    /// [`crate::Error::Shape`] if the trajectories do not have the configured length and action dimensions.
    pub fn step<E: Encoder>(
        &mut self,
        hierarchy: &Hierarchy<E>,
        trajectories: &Trajectories,
    ) -> Result<Vec<LevelLoss>> {
        (0..self.levels.len())
            .map(|level| {
                let outcome = hierarchy.level_loss(level, trajectories)?;
                self.step_level(level, &outcome.loss.backward()?)?;
                // Detached to free the graph's memory for the next level.
                Ok(LevelLoss {
                    loss: outcome.loss.detach(),
                    latents: outcome.latents.iter().map(Tensor::detach).collect(),
                    targets: outcome.targets,
                })
            })
            .collect()
    }

    /// Updates a level and all coarser levels with the gradients of the level's loss ([`Hierarchy::level_loss`]).
    ///
    /// # Errors
    /// A gradient of another shape.
    pub fn step_level(&mut self, level: usize, gradients: &GradStore) -> Result<()> {
        let above = self.levels[level..].iter_mut().chain(self.shared.as_mut());
        above.into_iter().try_for_each(|adam| adam.step(gradients))
    }

    /// Takes one step of every optimiser with gradients such as those of the sum of [`Hierarchy::joint_losses`].
    ///
    /// # Errors
    /// A gradient of NaN or infinity.
    pub fn step_once(&mut self, gradients: &GradStore) -> Result<()> {
        self.levels.iter_mut().chain(self.shared.as_mut()).try_for_each(|adam| adam.step(gradients))
    }

    /// The optimisers with their names: `0` for the finest level, `1` and so on, and `shared` for a shared encoder.
    pub fn optimisers(&self) -> impl Iterator<Item = (String, &Adam)> {
        let levels = self.levels.iter().enumerate().map(|(level, adam)| (level.to_string(), adam));
        levels.chain(self.shared.iter().map(|adam| ("shared".to_owned(), adam)))
    }

    /// The optimisers with their names, mutably.
    pub fn optimisers_mut(&mut self) -> impl Iterator<Item = (String, &mut Adam)> {
        let levels = self.levels.iter_mut().enumerate();
        let levels = levels.map(|(level, adam)| (level.to_string(), adam));
        levels.chain(self.shared.iter_mut().map(|adam| ("shared".to_owned(), adam)))
    }

    /// Copies all moments, named `{level}.{parameter}.…` and `shared.{parameter}.…`.
    ///
    /// # Errors
    /// Whatever the tensors report.
    pub fn state(&self) -> Result<BTreeMap<String, Tensor>> {
        state_of(self.optimisers())
    }

    /// Restores a saved state.
    ///
    /// # Errors
    /// A tensor that is missing, unknown or of another shape. Nothing changes in that case.
    pub fn load(&mut self, state: &BTreeMap<String, Tensor>) -> Result<()> {
        load_into(self.optimisers_mut(), state.clone())
    }
}
