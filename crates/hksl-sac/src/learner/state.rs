//! What a learner needs to go on.

use std::collections::BTreeMap;

use candle_core::Tensor;
use hksl_core::named::{nothing_left, prefixed, take};
use hksl_core::optim::{Adam, load_into, state_of};

use super::{HkslLearner, Optimisers};
use crate::Result;

impl HkslLearner {
    /// Copies of all weights and all moments, by name.
    pub fn state(&self) -> Result<BTreeMap<String, Tensor>> {
        let mut state = prefixed("weights", self.parameters.snapshot()?);
        state.extend(prefixed("moments", state_of(self.optimisers())?));
        Ok(state)
    }

    /// Goes back to a saved state.
    ///
    /// # Errors
    /// A tensor that is missing, unknown or misshapen, and then nothing was changed.
    pub fn load(&mut self, state: &BTreeMap<String, Tensor>) -> Result<()> {
        let mut rest = state.clone();
        let (weights, moments) = (take(&mut rest, "weights"), take(&mut rest, "moments"));
        nothing_left(&rest)?;
        self.parameters.check(&weights)?;
        load_into(self.optimisers_mut(), moments)?;
        Ok(self.parameters.load(&weights)?)
    }

    fn optimisers(&self) -> Vec<(String, &Adam)> {
        let mut named: Vec<(String, &Adam)> = match &self.optimisers {
            Optimisers::Sequential { representation, critics } => {
                let representation = representation.optimisers();
                let critics = critics.iter().enumerate();
                let critics = critics.map(|(level, adam)| (format!("critic.{level}"), adam));
                let named = |(name, adam)| (format!("representation.{name}"), adam);
                representation.map(named).chain(critics).collect()
            }
            Optimisers::Joint(joint) => joint.named().collect(),
        };
        named.push(("actor".to_owned(), &self.actor_adam));
        named.push(("temperature".to_owned(), &self.temperature_adam));
        named
    }

    fn optimisers_mut(&mut self) -> Vec<(String, &mut Adam)> {
        let mut named: Vec<(String, &mut Adam)> = match &mut self.optimisers {
            Optimisers::Sequential { representation, critics } => {
                let representation = representation.optimisers_mut();
                let critics = critics.iter_mut().enumerate();
                let critics = critics.map(|(level, adam)| (format!("critic.{level}"), adam));
                let named = |(name, adam)| (format!("representation.{name}"), adam);
                representation.map(named).chain(critics).collect()
            }
            Optimisers::Joint(joint) => joint.named_mut().collect(),
        };
        named.push(("actor".to_owned(), &mut self.actor_adam));
        named.push(("temperature".to_owned(), &mut self.temperature_adam));
        named
    }
}
