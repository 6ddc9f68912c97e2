//! The agent's settings, as they stand in the configuration's sections.

use hksl_core::at_least_one;
use hksl_core::nn::Initialisation;
use serde::{Deserialize, Serialize};

use crate::Result;

/// In which order a learning step's parts see each other's changes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UpdateSchedule {
    /// HKSL's algorithm 1, level after level, and likewise critic after critic, which the paper leaves open: each with the weights that the one
    /// before it left. Every level is rolled out anew for each level below it.
    #[default]
    Sequential,
    /// All levels and critics from one forward pass, each optimiser once: the representation's cost grows linearly with
    /// the number of levels.
    Joint,
}

/// Section `[hksl]`: the hierarchy and how it learns (HKSL §4, table of hyperparameters).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HkslConfig {
    /// Transitions that each level skips in one step, `n^l`, finest first.
    pub skips: Vec<usize>,
    /// Transitions in a sampled trajectory, `k`.
    pub trajectory_length: usize,
    /// Adam's learning rate by the models' losses: for encoders, forward models, communication managers and projections.
    pub learning_rate: f64,
    /// Agent steps between two updates of actor and temperature.
    pub actor_update_every: u64,
    /// Whether levels and critics learn one after the other or together.
    pub update_schedule: UpdateSchedule,
    /// How weights start.
    pub initialisation: Initialisation,
    /// Hidden units of a communication manager.
    pub communication_hidden: usize,
    /// Whether the representation is trained by its own losses (off: ablation `no-repr`).
    pub representation: bool,
    /// Whether coarser levels send contexts to finer ones (off: ablation `no-c`).
    pub communication: bool,
    /// Whether predictions pass the projection before the loss (off: ablation `no-w`).
    pub projection: bool,
    /// Whether all levels use one encoder (on: ablation `shared-encoder`).
    pub shared_encoder: bool,
}

/// Section `[sac]`: soft actor-critic.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SacConfig {
    /// Trajectories in a batch, `B`.
    pub batch_size: usize,
    /// Adam's learning rate for critics with the encoders under them, actor and temperature.
    pub learning_rate: f64,
    /// γ, per agent step.
    pub discount: f64,
    /// α at the start.
    pub initial_temperature: f64,
    /// Units of each of the two hidden layers of critics and actor.
    pub hidden_units: usize,
    /// Smallest logarithm of the policy's standard deviation.
    pub log_std_minimum: f64,
    /// Largest logarithm of the policy's standard deviation.
    pub log_std_maximum: f64,
    /// Agent steps between two updates of the target networks.
    pub target_update_every: u64,
    /// Share of the critic that its target takes over at such an update.
    pub critic_tau: f64,
    /// Share of the encoder that its momentum encoder takes over at such an update.
    pub encoder_tau: f64,
}

impl HkslConfig {
    /// Checks the actor's period; sizes are the hierarchy's ([`hksl_core::HierarchyConfig::validate`]), the rate is not
    /// checked.
    ///
    /// # Errors
    /// [`hksl_core::Error::Setting`] names the first value that is out of range, and the range.
    pub fn validate(&self) -> Result<()> {
        Ok(at_least_one("hksl.actor_update_every", self.actor_update_every)?)
    }
}

impl SacConfig {
    /// Checks sizes, periods, the first temperature and the order of the policy's bounds; rates, discount and shares are
    /// not checked.
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
    /// Transitions that the replay holds; beyond it whole oldest episodes leave.
    pub capacity: usize,
    /// Where finished episodes are kept. The training loop of hksl-train sees to it; an agent by itself has them in memory
    /// until [`crate::replay::Replay::keep_in_file`].
    pub storage: ReplayStorage,
}

/// Where a replay's finished episodes are kept. Either way the same numbers are learnt from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReplayStorage {
    /// In memory.
    #[default]
    Memory,
    /// In the files of the last save, mapped into memory: the system keeps there what fits.
    File,
}

/// Section `[augmentation]`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AugmentationConfig {
    /// Largest shift of an observation, in pixels.
    pub pad: usize,
    /// What shares one random shift.
    pub shift_per: ShiftPer,
}

/// What shares one random shift. Frames stacked to one observation always do.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShiftPer {
    /// Each observation has its own.
    #[default]
    Observation,
    /// All observations of a sampled trajectory.
    Trajectory,
}
