//! The baselines' sections of the configuration. `configs/default.toml` documents units, original values and effects of
//! each key; `configs/methods` contains the values.

use hksl_core::nn::Initialisation;
use hksl_core::{Error, at_least_one};
use hksl_sac::Result;
use serde::{Deserialize, Serialize};

/// Section `[baseline]`: settings common to all baselines.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaselineConfig {
    /// Agent steps between updates of actor and temperature.
    pub actor_update_every: u64,
    /// Weight initialisation of encoder, actor and critics.
    pub initialisation: Initialisation,
}

impl BaselineConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// [`Error::Setting`] if a value is out of range.
    pub fn validate(&self) -> Result<()> {
        Ok(at_least_one("baseline.actor_update_every", self.actor_update_every)?)
    }
}

/// Section `[drq]`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DrqConfig {
    /// Augmented views of the next observation over which the target is averaged, `K`.
    pub target_views: usize,
    /// Augmented views of the observation over which the critic loss is summed, `M`.
    pub critic_views: usize,
}

impl DrqConfig {
    /// One view each: plain SAC.
    pub const ONE_VIEW: Self = Self { target_views: 1, critic_views: 1 };
}

/// Section `[curl]`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurlConfig {
    /// Whether two optimisers step the encoder along the contrastive gradient, as in the original code.
    pub double_encoder_step: bool,
}

/// Section `[pi_sac]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PiSacConfig {
    /// Adam's learning rate for the predictive task.
    pub learning_rate: f64,
    /// β, the weight of the KL terms of the CEB loss.
    pub compression: f64,
    /// Weight of the KL term for the step after the predicted one, relative to β.
    pub smoothing: f64,
    /// Units of each of the two hidden layers of both heads.
    pub head_units: usize,
    /// Soft update coefficient τ of the backward encoder.
    pub backward_tau: f64,
    /// Pretraining steps, which train the predictive task alone.
    pub pretraining_steps: u64,
}

/// Section `[dbc]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DbcConfig {
    /// Kind of transition model.
    pub transition: Transition,
    /// Number of models in an ensemble.
    pub ensemble_size: usize,
    /// Units of the hidden layer of the transition and reward models.
    pub model_units: usize,
    /// Weight of the bisimulation loss.
    pub bisimulation_weight: f64,
    /// L2 penalty on the weights of the models.
    pub model_l2: f64,
}

/// Kind of transition model in DBC.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Transition {
    /// Predicts a mean.
    Deterministic,
    /// Predicts a mean and a standard deviation.
    Probabilistic,
    /// An ensemble of probabilistic models.
    Ensemble,
}

/// Section `[dreamer]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DreamerConfig {
    /// Architecture of encoder and decoder.
    pub vision: Vision,
    /// Filters of the first convolution of the original encoder.
    pub vision_depth: usize,
    /// Sequences in a batch, `B`.
    pub batch_sequences: usize,
    /// Observations in a sequence, `T`.
    pub sequence_length: usize,
    /// Agent steps between learning steps.
    pub train_every: u64,
    /// Pretraining steps, taken before the first agent step that learns.
    pub pretraining_steps: u64,
    /// Size of the deterministic state, `D`.
    pub deterministic_units: usize,
    /// Units of the hidden layers of the recurrent state-space model.
    pub hidden_units: usize,
    /// Categorical variables of the stochastic state, `V`.
    pub variables: usize,
    /// Classes of each variable, `K`.
    pub classes: usize,
    /// Hidden layers of the reward head.
    pub reward_layers: usize,
    /// Units of each hidden layer of the reward head.
    pub reward_units: usize,
    /// Hidden layers of actor and critic.
    pub behaviour_layers: usize,
    /// Units of each hidden layer of actor and critic.
    pub behaviour_units: usize,
    /// Adam's learning rate for the world model.
    pub world_learning_rate: f64,
    /// Adam's learning rate for the actor.
    pub actor_learning_rate: f64,
    /// Adam's learning rate for the critic.
    pub critic_learning_rate: f64,
    /// Adam's ε.
    pub epsilon: f64,
    /// Gradient norm to which the gradients of world model, actor and critic are clipped, each separately.
    pub gradient_clip: f64,
    /// Decoupled weight decay per learning step.
    pub weight_decay: f64,
    /// KL balancing: weight of the KL term that trains the prior.
    pub kl_balance: f64,
    /// Free nats: KL divergence below which the KL loss has no gradient.
    pub free_nats: f64,
    /// γ, per agent step.
    pub discount: f64,
    /// λ of the returns.
    pub lambda: f64,
    /// Imagined steps, `H`.
    pub horizon: usize,
    /// Weight of the policy's entropy.
    pub entropy_weight: f64,
    /// Learning steps between copies of the critic to the target critic.
    pub slow_critic_every: u64,
}

impl DreamerConfig {
    /// Checks sizes and periods.
    ///
    /// # Errors
    /// [`Error::Setting`] names the first value that is out of range, and the range.
    pub fn validate(&self) -> Result<()> {
        for (name, value) in [
            ("dreamer.batch_sequences", self.batch_sequences as u64),
            ("dreamer.train_every", self.train_every),
            ("dreamer.deterministic_units", self.deterministic_units as u64),
            ("dreamer.hidden_units", self.hidden_units as u64),
            ("dreamer.variables", self.variables as u64),
            ("dreamer.reward_units", self.reward_units as u64),
            ("dreamer.behaviour_units", self.behaviour_units as u64),
            ("dreamer.horizon", self.horizon as u64),
            ("dreamer.slow_critic_every", self.slow_critic_every),
        ] {
            at_least_one(name, value)?;
        }
        for (name, value) in
            [("dreamer.sequence_length", self.sequence_length), ("dreamer.classes", self.classes)]
        {
            if value < 2 {
                return Err(Error::setting(name, value, "must be at least 2").into());
            }
        }
        Ok(())
    }
}

/// Architecture of DreamerV2's encoder and decoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Vision {
    /// The encoder of the other methods, and a decoder that mirrors it.
    Shared,
    /// The encoder and decoder of the original, with 4×4 convolutions in the encoder.
    Original,
}
