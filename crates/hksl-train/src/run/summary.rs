//! What the first screen says, gathered.

use std::collections::BTreeMap;

use candle_core::Tensor;
use hksl_sac::Agent;
use serde_json::Value;

use super::{Plan, Summary};
use crate::config::Config;
use crate::{Result, device};

/// Bytes of the run's folder: weights at each interval, the best and the last; three states while one is written;
/// and the episodes of all three.
fn disk_bytes(config: &Config, agent: &Agent, episode: usize, replay_bytes: u64) -> Result<u64> {
    let bytes = |numbers: usize| 4 * numbers as u64;
    let weights = bytes(agent.networks().weights()?.values().map(Tensor::elem_count).sum());
    let trained = bytes(agent.networks().sizes().iter().map(|(_, count)| count).sum());
    let kept = config.environment_steps / config.checkpoint.weights_every_environment_steps + 3;
    // All weights and their slow copies, two moments of each that is trained.
    let state = 2 * weights + 2 * trained;
    let ahead = 3 * (episode * agent.replay().layout().transition_bytes()) as u64;
    Ok(kept * weights + 3 * (weights + state) + replay_bytes + ahead)
}

impl Summary {
    /// Leaves `memory`, `available_bytes` and `resumed_at` to the caller.
    pub(super) fn of(
        plan: &Plan,
        spec: &hksl_envs::Spec,
        agent: &Agent,
        facts: &BTreeMap<String, Value>,
    ) -> Result<Self> {
        let config = plan.config;
        let layout = agent.replay().layout();
        let stored = config.replay.capacity.min(config.budget_agent_steps() as usize);
        let replay_bytes = (stored * layout.transition_bytes()) as u64;
        Ok(Self {
            task: config.task_label(),
            method: config.method.clone(),
            ablation: config.ablation.clone(),
            observation: layout.observation(),
            action_dims: spec.action_dims,
            agent_steps_per_episode: spec.steps_per_episode,
            networks: agent.networks().sizes(),
            replay_transitions: stored,
            replay_bytes,
            replay_storage: config.replay.storage,
            disk_bytes: disk_bytes(config, agent, spec.steps_per_episode, replay_bytes)?,
            memory: None,
            available_bytes: None,
            device: device::name(&plan.device),
            threads: rayon::current_num_threads(),
            renderer: facts.get("renderer").and_then(Value::as_str).map(str::to_owned),
            environment_steps: config.environment_steps,
            agent_steps: config.budget_agent_steps(),
            learning_steps: config.learning_steps(),
            folder: std::path::absolute(plan.folder.path())
                .unwrap_or_else(|_| plan.folder.path().to_owned()),
            resumed_at: None,
        })
    }
}
