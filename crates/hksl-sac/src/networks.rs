//! The networks of a method as acting, analyses and checkpoints see them.

use std::collections::BTreeMap;
use std::fmt;

use candle_core::{DType, Tensor};
use hksl_core::nn::PixelEncoder;
use hksl_core::{Encoder, Parameters};

use crate::Result;
use crate::critic::Critic;

/// First parts of the names of parameters that only learning needs.
const LEARNING_ONLY: [&str; 2] = ["targets", "momentum"];

/// A method's networks by name. Encoders and critics are views without gradient of the weights in `parameters`.
#[derive(Debug)]
pub struct Networks {
    /// Shape of one observation, `(C, H, W)`.
    pub observation: [usize; 3],
    /// Every parameter of every network. Those under `targets` and `momentum` serve learning only.
    pub parameters: Parameters,
    /// The trained networks: the name that is printed, and the prefixes of the network's parameters.
    pub trained: Vec<(String, Vec<String>)>,
    /// The encoders by name.
    pub encoders: Vec<(String, Box<dyn ImageEncoder>)>,
    /// The critics of observations and actions.
    pub critics: Vec<QFunction>,
}

/// A twin critic on an encoder's latents.
#[derive(Debug)]
pub struct QFunction {
    /// What follows the names of its metrics: `_1` and so on for critics of levels, nothing for an only critic.
    pub suffix: String,
    /// Index of its encoder in [`Networks::encoders`].
    pub encoder: usize,
    /// γ, per agent step, of the returns that it predicts.
    pub discount: f64,
    /// The critic.
    pub critic: Critic,
}

/// An encoder of observations `(B, C, H, W)` u8 whose last feature maps can be drawn.
pub trait ImageEncoder: Encoder + fmt::Debug + Send {
    /// The last feature maps after their activation, `(B, F, h, w)`, and the receptive field of their points.
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

/// The square of pixels that one point of a feature map depends on. The first point's square begins in the image's
/// corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReceptiveField {
    /// Side of the square, in pixels.
    pub side: usize,
    /// Pixels between the squares of neighbouring points.
    pub spacing: usize,
}

/// An encoder's last feature maps.
#[derive(Debug, Clone)]
pub struct FeatureMaps {
    /// The encoder's name.
    pub encoder: String,
    /// `(B, F, h, w)`.
    pub maps: Tensor,
    /// Receptive field of a point.
    pub field: ReceptiveField,
}

impl Networks {
    /// Names of the trained networks with their numbers of parameters.
    pub fn sizes(&self) -> Vec<(String, usize)> {
        let size = |prefix: &String| self.parameters.under(prefix).elements();
        let sizes = |prefixes: &[String]| prefixes.iter().map(size).sum();
        self.trained.iter().map(|(name, prefixes)| (name.clone(), sizes(prefixes))).collect()
    }

    /// The latents of each encoder, by the encoder's name.
    ///
    /// # Shapes
    /// - `observations`: `(B, C, H, W)` u8
    /// - output: one `(B, Z)` an encoder
    ///
    /// # Errors
    /// Observations of another shape.
    pub fn encode(&self, observations: &Tensor) -> Result<Vec<(String, Tensor)>> {
        let encode = |(name, encoder): &(String, Box<dyn ImageEncoder>)| {
            Ok((name.clone(), encoder.forward(observations)?))
        };
        self.encoders.iter().map(encode).collect()
    }

    /// The last feature maps of each encoder, after their activation.
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

    /// The mean of both values of each critic, for several actions at each observation: `[critic][action]`, `B` numbers
    /// each.
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

    /// Copies of the weights that acting and analyses need: no targets, no moments.
    ///
    /// # Errors
    /// Whatever the tensors report.
    pub fn weights(&self) -> Result<BTreeMap<String, Tensor>> {
        let mut weights = self.parameters.snapshot()?;
        weights.retain(|name, _| !is_for_learning(name));
        Ok(weights)
    }

    /// Takes over weights as [`Self::weights`] gives them. Targets stay as they are.
    ///
    /// # Errors
    /// A tensor that is missing, unknown or misshapen.
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

fn is_for_learning(name: &str) -> bool {
    LEARNING_ONLY.iter().any(|part| name.split('.').next() == Some(part))
}
