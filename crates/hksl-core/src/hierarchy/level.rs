//! The networks of a level.

use crate::Result;
use crate::hierarchy::{Communication, ForwardModel, HierarchyConfig, Projection};
use crate::params::Builder;

/// The networks of a level, except its encoder.
#[derive(Debug, Clone)]
pub struct Level {
    /// The forward model `f^l`, which predicts the level's next latent.
    pub forward_model: ForwardModel,
    /// The projection `w^l` of predictions before the loss. None in the ablation `no-w`.
    pub projection: Option<Projection>,
    /// The communication manager `c^{l+1,l}`. None for the coarsest level and in the ablation `no-c`.
    pub communication: Option<Communication>,
}

impl Level {
    /// Creates the networks of level `level`; 0 is the finest.
    pub fn new(builder: &mut Builder, config: &HierarchyConfig, level: usize) -> Result<Self> {
        let (latent, has_context) = (config.latent_dims, config.has_context(level));
        let actions = config.action_dims * config.skips[level];
        let forward_model =
            ForwardModel::new(&mut builder.under("forward_model"), latent, actions, has_context)?;
        let projection = config
            .projection
            .then(|| Projection::new(&mut builder.under("projection"), latent))
            .transpose()?;
        let communication = has_context
            .then(|| {
                let (above, own) = (config.steps(level + 1), config.steps(level));
                let hidden = config.communication_hidden;
                Communication::new(&mut builder.under("communication"), latent, hidden, above, own)
            })
            .transpose()?;
        Ok(Self { forward_model, projection, communication })
    }
}
