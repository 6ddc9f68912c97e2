//! What a learner needs to go on.

use std::collections::BTreeMap;

use candle_core::Tensor;

use super::{HkslLearner, Optimisers};
use crate::named::{prefixed, under};
use crate::{Error, Result};

impl HkslLearner {
    /// All weights and all moments, by name.
    pub fn state(&self) -> Result<BTreeMap<String, Tensor>> {
        let mut state = prefixed("weights", self.parameters.tensors());
        match &self.optimisers {
            Optimisers::Sequential { representation, critics } => {
                state.extend(prefixed("moments.representation", representation.state()?));
                for (level, adam) in critics.iter().enumerate() {
                    state.extend(prefixed(&format!("moments.critic.{level}"), adam.state()?));
                }
            }
            Optimisers::Joint(joint) => state.extend(prefixed("moments", joint.state()?)),
        }
        state.extend(prefixed("moments.actor", self.actor_adam.state()?));
        state.extend(prefixed("moments.temperature", self.temperature_adam.state()?));
        Ok(state)
    }

    /// Goes back to a saved state.
    ///
    /// # Errors
    /// A tensor that is missing, unknown or misshapen.
    pub fn load(&mut self, state: &BTreeMap<String, Tensor>) -> Result<()> {
        if let Some(name) =
            state.keys().find(|name| !name.starts_with("weights.") && !name.starts_with("moments."))
        {
            let reason = "this agent has no such tensor".to_owned();
            return Err(Error::SavedState { part: name.clone(), reason });
        }
        self.parameters.load(&under(state, "weights"))?;
        match &mut self.optimisers {
            Optimisers::Sequential { representation, critics } => {
                representation.load(&under(state, "moments.representation"))?;
                for (level, adam) in critics.iter_mut().enumerate() {
                    adam.load(&under(state, &format!("moments.critic.{level}")))?;
                }
            }
            Optimisers::Joint(joint) => joint.load(&under(state, "moments"))?,
        }
        self.actor_adam.load(&under(state, "moments.actor"))?;
        self.temperature_adam.load(&under(state, "moments.temperature"))?;
        Ok(())
    }
}
