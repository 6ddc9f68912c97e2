//! Communication managers.

use candle_core::{DType, Tensor};

use crate::nn::Mlp;
use crate::params::Builder;
use crate::{Error, Result};

/// The communication manager `c^{l+1,l}` (HKSL §4): computes the context of a step of the finer level from the step's
/// index and all latents predicted by the coarser level.
#[derive(Debug, Clone)]
pub struct Communication {
    network: Mlp,
    steps_above: usize,
    steps: usize,
}

impl Communication {
    /// Creates a manager from a coarser level with `steps_above` steps to a finer level with `steps` steps.
    pub fn new(
        builder: &mut Builder,
        latent_dims: usize,
        hidden: usize,
        steps_above: usize,
        steps: usize,
    ) -> Result<Self> {
        let sizes = [steps_above * latent_dims + steps, hidden, latent_dims];
        Ok(Self { network: Mlp::new(builder, &sizes)?, steps_above, steps })
    }

    /// The context of the finer level's step `step` (0-based).
    ///
    /// # Shapes
    /// - `above`: `N_{l+1}` latents `(B, Z)`
    /// - output: `(B, Z)`
    ///
    /// # Errors
    /// Another number of latents; a step index out of range.
    pub fn forward(&self, above: &[Tensor], step: usize) -> Result<Tensor> {
        if above.len() != self.steps_above {
            let (got, expected) = (vec![above.len()], format!("({}) of (B, Z)", self.steps_above));
            return Err(Error::Shape { what: "latents of the level above", got, expected });
        }
        if step >= self.steps {
            let expected = format!("the level takes {} steps, from 0", self.steps);
            return Err(Error::Setting { name: "step", value: step.to_string(), expected });
        }
        let (batch, device) = (above[0].dim(0)?, above[0].device());
        let one_hot: Vec<f32> =
            (0..self.steps).map(|index| if index == step { 1.0 } else { 0.0 }).collect();
        let one_hot = Tensor::new(one_hot, device)?.to_dtype(DType::F32)?;
        let mut inputs = above.to_vec();
        inputs.push(one_hot.unsqueeze(0)?.broadcast_as((batch, self.steps))?.contiguous()?);
        self.network.forward(&Tensor::cat(&inputs, 1)?)
    }
}
