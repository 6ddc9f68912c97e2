//! What an actor-critic needs to go on.

use std::collections::BTreeMap;

use candle_core::Tensor;
use hksl_core::optim::Adam;
use hksl_sac::named::{prefixed, under};
use hksl_sac::{Error, Result};

use super::ActorCritic;

impl ActorCritic {
    /// The optimisers by name.
    fn optimisers(&self) -> [(&'static str, &Adam); 3] {
        [
            ("critic", &self.critic_adam),
            ("actor", &self.actor_adam),
            ("temperature", &self.temperature_adam),
        ]
    }

    /// All weights and all moments, those of a method's optimisers included.
    pub(crate) fn state(&self, others: &[(&str, &Adam)]) -> Result<BTreeMap<String, Tensor>> {
        let mut state = prefixed("weights", self.parameters.tensors());
        for (name, adam) in self.optimisers().iter().chain(others) {
            state.extend(prefixed(&format!("moments.{name}"), adam.state()?));
        }
        Ok(state)
    }

    /// Goes back to a saved state, but for a method's optimisers, which [`load_moments`] sees to.
    pub(crate) fn load(&mut self, state: &BTreeMap<String, Tensor>, others: &[&str]) -> Result<()> {
        let own = self.optimisers().map(|(name, _)| name);
        let known = |key: &str| {
            let mut names = own.iter().chain(others);
            key.starts_with("weights.")
                || names.any(|name| key.starts_with(&format!("moments.{name}.")))
        };
        if let Some(name) = state.keys().find(|key| !known(key)) {
            let reason = "this agent has no such tensor".to_owned();
            return Err(Error::SavedState { part: name.clone(), reason });
        }
        self.parameters.load(&under(state, "weights"))?;
        load_moments(&mut self.critic_adam, "critic", state)?;
        load_moments(&mut self.actor_adam, "actor", state)?;
        load_moments(&mut self.temperature_adam, "temperature", state)
    }
}

/// Takes over the moments that are saved under this name.
pub(crate) fn load_moments(
    adam: &mut Adam,
    name: &str,
    state: &BTreeMap<String, Tensor>,
) -> Result<()> {
    Ok(adam.load(&under(state, &format!("moments.{name}")))?)
}
