//! Linear maps with ReLU between them.

use candle_core::Tensor;

use crate::Result;
use crate::nn::Linear;
use crate::params::Builder;

/// A chain of linear maps with ReLU after each but the last.
///
/// The maps are named `0`, `2`, `4`, …: each ReLU takes a number too, as in a PyTorch `Sequential`, so that
/// weights travel between the two without renaming.
#[derive(Debug, Clone)]
pub struct Mlp {
    layers: Vec<Linear>,
}

impl Mlp {
    /// A network through layers of these `sizes`, input and output included.
    pub fn new(builder: &mut Builder, sizes: &[usize]) -> Result<Self> {
        let layers = sizes
            .windows(2)
            .enumerate()
            .map(|(index, pair)| Linear::new(&mut builder.under(2 * index), pair[0], pair[1]))
            .collect::<Result<_>>()?;
        Ok(Self { layers })
    }

    /// # Shapes
    /// - `x`: `(B, sizes[0])`
    /// - output: `(B, sizes[last])`
    pub fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let mut x = x.clone();
        for (index, layer) in self.layers.iter().enumerate() {
            let is_last = index + 1 == self.layers.len();
            x = if is_last { layer.forward(&x)? } else { layer.forward_relu(&x)? };
        }
        Ok(x)
    }
}
