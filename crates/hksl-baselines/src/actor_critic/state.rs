//! What of an actor-critic goes on from where it was, beside its weights.

use hksl_core::optim::Adam;

use super::ActorCritic;

impl ActorCritic {
    /// The optimisers by name.
    pub fn optimisers(&self) -> Vec<(&'static str, &Adam)> {
        vec![
            ("critic", &self.critic_adam),
            ("actor", &self.actor_adam),
            ("temperature", &self.temperature_adam),
        ]
    }

    /// As [`Self::optimisers`].
    pub fn optimisers_mut(&mut self) -> Vec<(&'static str, &mut Adam)> {
        vec![
            ("critic", &mut self.critic_adam),
            ("actor", &mut self.actor_adam),
            ("temperature", &mut self.temperature_adam),
        ]
    }
}
