//! One level's own parts.

use crate::Result;
use crate::hierarchy::{Communication, ForwardModel, HierarchyConfig, Projection};
use crate::params::Builder;

/// The networks of one level beside its encoder.
#[derive(Debug, Clone)]
pub struct Level {
    /// Predicts the level's next latent, `f^l`.
    pub forward_model: ForwardModel,
    /// Maps predictions before the loss, `w^l`; none in the ablation `no-w`.
    pub projection: Option<Projection>,
    /// Makes contexts from the level above, `c^{l+1,l}`; none at the top and in the ablation `no-c`.
    pub communication: Option<Communication>,
}

impl Level {
    /// The parts of level `level` (0 the finest).
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
