//! Steps written down, and replaying actions from a given physical state: how parity with dm_control is held.

#[cfg(feature = "mujoco")]
mod start;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

#[cfg(feature = "mujoco")]
pub use start::{Start, play};

use crate::{Environment, Step};

/// What control steps led to, a row after each.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Steps {
    /// Rewards.
    pub reward: Vec<f64>,
    /// Generalised positions, where there is physics.
    pub qpos: Vec<Vec<f64>>,
    /// Generalised velocities, where there is physics.
    pub qvel: Vec<Vec<f64>>,
    /// 0 after a terminal state, 1 otherwise: a time limit is none.
    pub discount: Vec<f64>,
    /// Ground-truth readings by name.
    pub probe: Vec<BTreeMap<String, Vec<f64>>>,
    /// The actions taken; of a replay from a state they are in its file.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub action: Vec<Vec<f32>>,
    /// Whether the episode ended there; of a replay from a state none does.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub last: Vec<bool>,
}

impl Steps {
    /// Adds the row of a step that `environment` just took.
    pub fn push(&mut self, environment: &dyn Environment, action: &[f32], step: Step) {
        if let Some(state) = environment.physical_state() {
            self.qpos.push(state.qpos);
            self.qvel.push(state.qvel);
        }
        self.reward.push(step.reward);
        self.discount.push(if step.terminal { 0.0 } else { 1.0 });
        let names = environment.spec().readings.iter().map(|reading| reading.name.to_owned());
        self.probe.push(names.zip(environment.readings()).collect());
        self.action.push(action.to_vec());
        self.last.push(step.last);
    }
}
