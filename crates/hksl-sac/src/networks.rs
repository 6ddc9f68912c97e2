//! The networks of a method, for acting, analyses and checkpoints.

use std::collections::BTreeMap;
use std::fmt;

use candle_core::{DType, Tensor};
use hksl_core::nn::PixelEncoder;
use hksl_core::{Encoder, Parameters};

use crate::Result;
use crate::critic::Critic;

/// Prefixes of parameters that only learning needs.
const LEARNING_ONLY: [&str; 2] = ["targets", "momentum"];

/// A method's networks. Encoders and critics are views of the weights in `parameters` without gradient.
#[derive(Debug)]
pub struct Networks {
    /// Shape of one observation, `(C, H, W)`.
    pub observation: [usize; 3],
    /// The parameters of all networks. Only learning needs those under `targets` and `momentum`.
    pub parameters: Parameters,
    /// The trained networks: display name and prefixes of the parameters.
    pub trained: Vec<(String, Vec<String>)>,
    /// The encoders with their names.
    pub encoders: Vec<(String, Box<dyn ImageEncoder>)>,
    /// The critics.
    pub critics: Vec<QFunction>,
}

/// A twin critic on an encoder's latents.
#[derive(Debug)]
pub struct QFunction {
    /// Suffix of its metric names: `_1`, `_2` and so on for the critics of levels, empty for a single critic.
    pub suffix: String,
    /// Index of its encoder in [`Networks::encoders`].
    pub encoder: usize,
    /// Discount γ per agent step.
    pub discount: f64,
    /// The critic.
    pub critic: Critic,
}

/// An encoder of observations `(B, C, H, W)` u8 whose last feature maps can be visualised.
pub trait ImageEncoder: Encoder + fmt::Debug + Send {
    /// The last feature maps after the activation, `(B, F, h, w)`, and the receptive field of each element.
    ///
    /// # Errors
    /// Observations of another shape.
    fn attention(&self, observations: &Tensor) -> Result<(Tensor, ReceptiveField)>;
}

impl ImageEncoder for PixelEncoder {
    fn attention(&self, observations: &Tensor) -> Result<(Tensor, ReceptiveField)> {
        let (side, spacing) = PixelEncoder::map_field();
        Ok((self.feature_maps(observations)?, ReceptiveField { side, spacing }))
    }
}

/// The receptive field of the elements of a feature map, a square of pixels. The first element's square starts in the
/// image's top left corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReceptiveField {
    /// Side of the square, in pixels.
    pub side: usize,
    /// Distance between the squares of neighbouring elements, in pixels.
    pub spacing: usize,
}

/// An encoder's last feature maps.
#[derive(Debug, Clone)]
pub struct FeatureMaps {
    /// The encoder's name.
    pub encoder: String,
    /// `(B, F, h, w)`.
    pub maps: Tensor,
    /// Receptive field of an element.
    pub field: ReceptiveField,
}

impl Networks {
    /// Names and parameter counts of the trained networks.
    pub fn sizes(&self) -> Vec<(String, usize)> {
        let size = |prefix: &String| self.parameters.under(prefix).elements();
        let sizes = |prefixes: &[String]| prefixes.iter().map(size).sum();
        self.trained.iter().map(|(name, prefixes)| (name.clone(), sizes(prefixes))).collect()
    }

    /// Encodes observations with each encoder. Returns pairs of encoder name and latents.
    ///
    /// # Shapes
    /// - `observations`: `(B, C, H, W)` u8
    /// - output: one `(B, Z)` per encoder
    ///
    /// # Errors
    /// Observations of another shape.
    pub fn encode(&self, observations: &Tensor) -> Result<Vec<(String, Tensor)>> {
        let encode = |(name, encoder): &(String, Box<dyn ImageEncoder>)| {
            Ok((name.clone(), encoder.forward(observations)?))
        };
        self.encoders.iter().map(encode).collect()
    }

    /// The last feature maps of each encoder, after the activation.
    ///
    /// # Shapes
    /// - `observations`: `(B, C, H, W)` u8
    ///
    /// # Errors
    /// Observations of another shape.
    pub fn feature_maps(&self, observations: &Tensor) -> Result<Vec<FeatureMaps>> {
        let maps = |(name, encoder): &(String, Box<dyn ImageEncoder>)| {
            let (maps, field) = encoder.attention(observations)?;
            Ok(FeatureMaps { encoder: name.clone(), maps, field })
        };
        self.encoders.iter().map(maps).collect()
    }

    /// The mean of each critic's two Q-values for several actions at each observation, indexed
    /// `[critic][action][observation]`.
    ///
    /// # Shapes
    /// - `observations`: `(B, C, H, W)` u8
    /// - `actions`: `(B, A)` each
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn q_values(
        &self,
        observations: &Tensor,
        actions: &[Tensor],
    ) -> Result<Vec<Vec<Vec<f64>>>> {
        let of_critic = |q: &QFunction| {
            let latents = self.encoders[q.encoder].1.forward(observations)?;
            let values = |actions: &Tensor| {
                let values = q.critic.mean(&latents, actions)?.flatten_all()?;
                Ok(values.to_dtype(DType::F64)?.to_vec1()?)
            };
            actions.iter().map(values).collect()
        };
        self.critics.iter().map(of_critic).collect()
    }

    /// Copies the weights that acting and analyses need, without target networks and moments.
    ///
    /// # Errors
    /// Whatever the tensors report.
    pub fn weights(&self) -> Result<BTreeMap<String, Tensor>> {
        let mut weights = self.parameters.snapshot()?;
        weights.retain(|name, _| !is_for_learning(name));
        Ok(weights)
    }

    /// Loads weights from [`Self::weights`]. Target networks do not change.
    ///
    /// # Errors
    /// A tensor that is missing, unknown or of another shape.
    pub fn load_weights(&self, weights: &BTreeMap<String, Tensor>) -> Result<()> {
        let mut all = self.parameters.tensors();
        all.retain(|name, _| is_for_learning(name));
        if let Some(name) = weights.keys().find(|name| is_for_learning(name)) {
            return Err(hksl_core::Error::UnknownParameter(name.clone()).into());
        }
        all.extend(weights.iter().map(|(name, tensor)| (name.clone(), tensor.clone())));
        Ok(self.parameters.load(&all)?)
    }
}

pub(crate) fn is_for_learning(name: &str) -> bool {
    LEARNING_ONLY.iter().any(|part| name.split('.').next() == Some(part))
}
