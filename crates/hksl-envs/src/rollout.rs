//! Recording of steps, and replay of actions from a given physical state, for comparison with dm_control.

#[cfg(feature = "mujoco")]
mod start;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

#[cfg(feature = "mujoco")]
pub use start::{Start, play};

use crate::{Environment, Step};

/// Recorded steps, with one row per step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Steps {
    /// Rewards.
    pub reward: Vec<f64>,
    /// Generalised positions; empty without physics.
    pub qpos: Vec<Vec<f64>>,
    /// Generalised velocities; empty without physics.
    pub qvel: Vec<Vec<f64>>,
    /// 0 for terminal states, 1 otherwise. Time limits truncate, they do not terminate.
    pub discount: Vec<f64>,
    /// Ground-truth readings by name.
    pub probe: Vec<BTreeMap<String, Vec<f64>>>,
    /// The actions taken. Empty for a replay from a state, whose file contains the actions.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub action: Vec<Vec<f32>>,
    /// Whether the episode ended at the step. Empty for a replay from a state.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub last: Vec<bool>,
}

impl Steps {
    /// Adds the row of the last step of `environment`.
    pub fn push(&mut self, environment: &dyn Environment, action: &[f32], step: Step) {
        if let Some(state) = environment.physical_state() {
            self.qpos.push(state.qpos);
            self.qvel.push(state.qvel);
        }
        self.reward.push(step.reward);
        self.discount.push(if step.terminal { 0.0 } else { 1.0 });
        let names =
            environment.spec().readings.iter().map(|reading| reading.name.clone().into_owned());
        self.probe.push(names.zip(environment.readings()).collect());
        self.action.push(action.to_vec());
        self.last.push(step.last);
    }
}
