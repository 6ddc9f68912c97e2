//! The actor and its input.

use candle_core::Tensor;
use hksl_core::nn::{EncoderHead, PixelEncoder, PixelEncoderConfig};
use hksl_core::{Builder, Encoder};
use hksl_sac::config::SacConfig;
use hksl_sac::{Actor, Result};

use super::ActorInput;

/// An actor that reads the critics' latents, or a separate head on their convolution features.
#[derive(Debug)]
pub(super) struct Policy {
    head: Option<EncoderHead>,
    pub(super) actor: Actor,
}

impl Policy {
    pub(super) fn new(
        builder: &mut Builder,
        input: ActorInput,
        (image, sizes): ([usize; 3], PixelEncoderConfig),
        action_dims: usize,
        sac: &SacConfig,
    ) -> Result<Self> {
        let head = match input {
            ActorInput::Latent => None,
            ActorInput::OwnHead => {
                let features = PixelEncoder::feature_count(image, sizes)?;
                let builder = &mut builder.under("head");
                Some(EncoderHead::new(builder, features, sizes.latent_dims)?)
            }
        };
        Ok(Self { head, actor: Actor::new(builder, sizes.latent_dims, action_dims, sac)? })
    }

    /// Computes the actor's input from observations with the given encoder.
    pub(super) fn read(&self, encoder: &PixelEncoder, observations: &Tensor) -> Result<Tensor> {
        match &self.head {
            Some(head) => Ok(head.forward(&encoder.features(observations)?)?),
            None => Ok(encoder.forward(observations)?),
        }
    }

    /// Computes the actor's input from the encoder's convolution features and latents.
    pub(super) fn read_features(&self, features: &Tensor, latents: &Tensor) -> Result<Tensor> {
        match &self.head {
            Some(head) => Ok(head.forward(features)?),
            None => Ok(latents.clone()),
        }
    }
}
