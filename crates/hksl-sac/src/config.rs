//! The agent's sections of the configuration.

use hksl_core::at_least_one;
use hksl_core::nn::Initialisation;
use serde::{Deserialize, Serialize};

use crate::Result;

/// The order in which a learning step updates levels and critics.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UpdateSchedule {
    /// One level after the other (HKSL, algorithm 1), then one critic after the other, an order that the paper leaves
    /// open. Each update uses the weights that the previous one left. Every level is unrolled again for each finer level.
    #[default]
    Sequential,
    /// All levels and critics from one forward pass, with one step of each optimiser. The cost of the representation
    /// losses grows linearly with the number of levels.
    Joint,
}

/// Section `[hksl]`: the hierarchy and how it learns (HKSL §4, table of hyperparameters).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HkslConfig {
    /// Transitions that each level skips per step, `n^l`, finest level first.
    pub skips: Vec<usize>,
    /// Transitions in a sampled trajectory, `k`.
    pub trajectory_length: usize,
    /// Adam's learning rate for the representation losses: encoders, forward models, communication managers, projections.
    pub learning_rate: f64,
    /// Agent steps between updates of actor and temperature.
    pub actor_update_every: u64,
    /// Whether levels and critics learn one after the other or together.
    pub update_schedule: UpdateSchedule,
    /// Weight initialisation.
    pub initialisation: Initialisation,
    /// Hidden units of a communication manager.
    pub communication_hidden: usize,
    /// Whether the representation losses train the encoders (off: ablation `no-repr`).
    pub representation: bool,
    /// Whether coarser levels send contexts to finer ones (off: ablation `no-c`).
    pub communication: bool,
    /// Whether predictions are projected before the loss (off: ablation `no-w`).
    pub projection: bool,
    /// Whether all levels share one encoder (on: ablation `shared-encoder`).
    pub shared_encoder: bool,
}

/// Section `[sac]`: soft actor-critic.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SacConfig {
    /// Trajectories in a batch, `B`.
    pub batch_size: usize,
    /// Adam's learning rate for the critics with their encoders, the actor and the temperature.
    pub learning_rate: f64,
    /// γ, per agent step.
    pub discount: f64,
    /// Initial value of α.
    pub initial_temperature: f64,
    /// Units of each of the two hidden layers of critics and actor.
    pub hidden_units: usize,
    /// Smallest logarithm of the policy's standard deviation.
    pub log_std_minimum: f64,
    /// Largest logarithm of the policy's standard deviation.
    pub log_std_maximum: f64,
    /// Agent steps between updates of the target networks.
    pub target_update_every: u64,
    /// Soft update coefficient τ of the target critics.
    pub critic_tau: f64,
    /// Soft update coefficient τ of the momentum encoders.
    pub encoder_tau: f64,
}

impl HkslConfig {
    /// Checks the actor's update period. [`hksl_core::HierarchyConfig::validate`] checks the sizes; the learning rate is not
    /// checked.
    ///
    /// # Errors
    /// [`hksl_core::Error::Setting`] names the first value that is out of range, and the range.
    pub fn validate(&self) -> Result<()> {
        Ok(at_least_one("hksl.actor_update_every", self.actor_update_every)?)
    }
}

impl SacConfig {
    /// Checks sizes, periods, the initial temperature and the order of the log-std bounds. Learning rates, discount and τ
    /// are not checked.
    ///
    /// # Errors
    /// [`hksl_core::Error::Setting`] names the first value that is out of range, and the range.
    pub fn validate(&self) -> Result<()> {
        at_least_one("sac.batch_size", self.batch_size as u64)?;
        at_least_one("sac.hidden_units", self.hidden_units as u64)?;
        at_least_one("sac.target_update_every", self.target_update_every)?;
        let (name, value) = ("sac.initial_temperature", self.initial_temperature);
        if !(value > 0.0 && value.is_finite()) {
            return Err(hksl_core::Error::setting(name, value, "must be above 0").into());
        }
        let (name, value) = ("sac.log_std_maximum", self.log_std_maximum);
        if value.is_nan() || value < self.log_std_minimum {
            let expected =
                format!("must be at least sac.log_std_minimum = {}", self.log_std_minimum);
            return Err(hksl_core::Error::setting(name, value, expected).into());
        }
        Ok(())
    }
}

/// Section `[replay]`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReplayConfig {
    /// Maximal number of stored transitions. A full replay drops its oldest episodes whole.
    pub capacity: usize,
    /// Where finished episodes are stored. hksl-train applies this setting; an agent alone keeps them in memory until
    /// [`crate::replay::Replay::keep_in_file`] is called.
    pub storage: ReplayStorage,
}

/// Where a replay stores finished episodes. The choice does not change the sampled batches.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReplayStorage {
    /// In memory.
    #[default]
    Memory,
    /// In the memory-mapped files of the last save: the operating system caches as much as fits.
    File,
}

/// Section `[augmentation]`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AugmentationConfig {
    /// Largest shift of an observation, in pixels.
    pub pad: usize,
    /// Which observations share one random shift.
    pub shift_per: ShiftPer,
}

/// Which observations share one random shift. The frames of one observation always share theirs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShiftPer {
    /// Each observation has its own shift.
    #[default]
    Observation,
    /// All observations of a sampled trajectory share one shift.
    Trajectory,
}
