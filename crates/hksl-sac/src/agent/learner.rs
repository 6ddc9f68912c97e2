//! What methods differ in.

use std::collections::BTreeMap;
use std::fmt;

use candle_core::Tensor;
use hksl_core::Parameters;
use hksl_core::nn::PixelEncoder;
use rand_chacha::ChaCha8Rng;

use crate::Result;
use crate::agent::{Acting, Draw, FeatureMaps, Field, Memory};
use crate::learner::{Operations, UpdateReport};

/// The networks of a method and how they learn. A [`crate::PixelAgent`] of it acts, remembers and is saved.
///
/// Parameters under `targets` or `momentum` are such as only learning needs.
pub trait Learner: fmt::Debug {
    /// Every parameter of every network.
    fn parameters(&self) -> &Parameters;

    /// γ, per agent step.
    fn discount(&self) -> f64;

    /// An action `(1, A)` for one observation `(1, C, H, W)`.
    fn action(
        &self,
        observation: &Tensor,
        acting: Acting,
        random: &mut ChaCha8Rng,
        memory: &mut Memory,
    ) -> Result<Tensor>;

    /// As [`crate::Agent::pretrain`].
    fn pretrain(&mut self, _: &mut Draw) -> Result<Option<UpdateReport>> {
        Ok(None)
    }

    /// As [`crate::Agent::pretraining`].
    fn pretraining(&self) -> (u64, u64) {
        (0, 0)
    }

    /// One learning step at this agent step; none if nothing can be sampled yet.
    fn update(&mut self, draw: &mut Draw, agent_step: u64) -> Result<Option<UpdateReport>>;

    /// As [`crate::Agent::diagnose`], but for the figures that come from [`Self::values`].
    fn diagnose(&self, draw: &mut Draw) -> Result<Vec<(String, f64)>>;

    /// The critics' values of these observations and actions, without gradient; by what ends the critic's names in
    /// metrics: `_1` and so on for critics of levels, nothing for an only one.
    ///
    /// # Shapes
    /// - `observations`: `(B, C, H, W)` u8
    /// - `actions`: `(B, A)`
    /// - output: one `B` a critic
    fn values(&self, observations: &Tensor, actions: &Tensor) -> Result<Vec<(String, Vec<f64>)>>;

    /// As [`crate::Agent::encode`].
    fn encode(&self, observations: &Tensor) -> Result<Vec<(String, Tensor)>>;

    /// As [`crate::Agent::feature_maps`].
    fn feature_maps(&self, observations: &Tensor) -> Result<Vec<FeatureMaps>>;

    /// As [`crate::Agent::networks`].
    fn networks(&self) -> Vec<(String, usize)>;

    /// As [`crate::Agent::operations`].
    fn operations(&self) -> Result<Operations>;

    /// As [`crate::Agent::learning_bytes`].
    fn memory_bytes(&self) -> u64;

    /// All weights and all moments, by name.
    fn state(&self) -> Result<BTreeMap<String, Tensor>>;

    /// Goes back to a saved state.
    ///
    /// # Errors
    /// A tensor that is missing, unknown or misshapen.
    fn load(&mut self, state: &BTreeMap<String, Tensor>) -> Result<()>;
}

/// The feature maps of an encoder of the paper's kind.
///
/// # Errors
/// Observations that are not such as it reads.
pub fn feature_maps_of(
    name: String,
    encoder: &PixelEncoder,
    observations: &Tensor,
) -> Result<FeatureMaps> {
    let (side, spacing) = PixelEncoder::map_field();
    let maps = encoder.feature_maps(observations)?;
    Ok(FeatureMaps { encoder: name, maps, field: Field { side, spacing } })
}
