//! Multi-layer perceptrons.

use candle_core::Tensor;

use crate::Result;
use crate::nn::{Activation, Linear};
use crate::params::Builder;

/// A multi-layer perceptron: linear layers with an activation after each except the last.
///
/// The layers are named `0`, `2`, `4`, …. As in a PyTorch `Sequential`, activations are counted too, so weights can be
/// exchanged with PyTorch without renaming.
#[derive(Debug, Clone)]
pub struct Mlp {
    layers: Vec<Linear>,
    activation: Activation,
}

impl Mlp {
    /// Creates a network with ReLU. `sizes` are the sizes of input, hidden layers and output.
    pub fn new(builder: &mut Builder, sizes: &[usize]) -> Result<Self> {
        Self::with(builder, sizes, Activation::Relu)
    }

    /// Creates a network with another activation.
    pub fn with(builder: &mut Builder, sizes: &[usize], activation: Activation) -> Result<Self> {
        let layers = sizes
            .windows(2)
            .enumerate()
            .map(|(index, pair)| Linear::new(&mut builder.under(2 * index), pair[0], pair[1]))
            .collect::<Result<_>>()?;
        Ok(Self { layers, activation })
    }

    /// Applies the network.
    ///
    /// # Shapes
    /// - `x`: `(B, sizes[0])`
    /// - output: `(B, sizes[last])`
    pub fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let mut x = x.clone();
        for (index, layer) in self.layers.iter().enumerate() {
            let is_last = index + 1 == self.layers.len();
            let activation = if is_last { Activation::None } else { self.activation };
            x = layer.forward_then(&x, activation)?;
        }
        Ok(x)
    }
}
