//! Reads reference files from PyTorch.

#[path = "../../../hksl-core/tests/golden/common.rs"]
mod common;

use std::collections::BTreeMap;
use std::path::Path;

use candle_core::Tensor;
pub use common::{device, largest};
use hksl_core::Parameters;
use hksl_core::nn::PixelEncoder;
use serde::de::DeserializeOwned;

/// A reference file with sizes of type `S`.
pub struct Case<S> {
    pub sizes: S,
    name: &'static str,
    tensors: BTreeMap<String, Tensor>,
}

/// Sizes of a reference file's encoder.
pub trait EncoderSizes {
    /// Image `(C, H, W)`, filters and latent dimensions; None without the paper's encoder.
    fn encoder(&self) -> Option<([usize; 3], usize, usize)>;
}

impl<S: DeserializeOwned + EncoderSizes> Case<S> {
    /// Reads the file of this name. PyTorch flattens feature maps channels first, `hksl-core` channels last; this function
    /// reorders the columns of the heads' linear weights accordingly.
    pub fn read(name: &'static str) -> Self {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
        let bytes = std::fs::read(folder.join(format!("{name}.safetensors"))).unwrap();
        let (_, header) = safetensors::SafeTensors::read_metadata(&bytes).unwrap();
        let config = &header.metadata().as_ref().unwrap()["config"];
        let sizes: S = serde_json::from_str(config).unwrap();
        let mut tensors = hksl_core::from_safetensors(&bytes).unwrap();
        if let Some((image, filters, latent)) = sizes.encoder() {
            let (height, width) = PixelEncoder::map_size(image[1], image[2]).unwrap();
            for (_, tensor) in tensors.iter_mut().filter(|(n, _)| n.ends_with("linear.weight")) {
                let by_pixel = |weight: &Tensor| {
                    weight.reshape((latent, filters, height, width))?.permute((0, 2, 3, 1))
                };
                *tensor = by_pixel(tensor).unwrap().flatten_from(1).unwrap();
            }
        }
        for tensor in tensors.values_mut() {
            *tensor = tensor.to_device(&device()).unwrap();
        }
        Self { sizes, name, tensors }
    }

    /// Replaces each tensor by the result of `of`.
    #[allow(dead_code)] // Not every test needs it.
    pub fn map(&mut self, of: impl Fn(&S, &str, &Tensor) -> Tensor) {
        for (name, tensor) in &mut self.tensors {
            *tensor = of(&self.sizes, name, tensor);
        }
    }

    pub fn tensor(&self, name: &str) -> &Tensor {
        self.tensors.get(name).unwrap_or_else(|| panic!("{} lacks {name}", self.name))
    }

    /// All tensors under a prefix, with the prefix removed from their names.
    pub fn under(&self, prefix: &str) -> BTreeMap<String, Tensor> {
        hksl_core::named::under(&self.tensors, prefix)
    }

    /// Fails unless `|got − expected| ≤ tolerance · max|expected|` everywhere.
    pub fn check(&self, name: &str, got: &Tensor, tolerance: f64) {
        let expected = self.tensor(name);
        assert_eq!(got.dims(), expected.dims(), "{} {name}", self.name);
        let (worst, scale) = (
            largest(&(got.to_device(expected.device()).unwrap() - expected).unwrap()),
            largest(expected),
        );
        assert!(
            worst <= tolerance * scale,
            "{} {name}: off by {worst:.3e}, allowed {tolerance:.0e} of {scale:.3e}",
            self.name
        );
    }

    /// Checks the gradients of a loss. Exactly the parameters with a gradient in the file must have one.
    pub fn check_gradients(&self, loss: &str, of: &Tensor, parameters: &Parameters, most: f64) {
        let gradients = of.backward().unwrap();
        let expected = self.under(&format!("gradient.{loss}"));
        assert!(!expected.is_empty(), "{} has no gradient.{loss}", self.name);
        for (name, parameter) in parameters.iter() {
            match (gradients.get(parameter), expected.contains_key(name)) {
                (Some(gradient), true) if is_removed(name) => {
                    assert!(largest(gradient) < 1e-5, "{} {loss} {name}", self.name);
                }
                (Some(gradient), true) => {
                    self.check(&format!("gradient.{loss}.{name}"), gradient, most);
                }
                (Some(gradient), false) => {
                    assert_eq!(largest(gradient), 0.0, "{} {loss} reaches {name}", self.name);
                }
                (None, expected) => assert!(!expected, "{} {loss} misses {name}", self.name),
            }
        }
    }

    /// Checks every parameter against the file's tensors under `after`.
    pub fn check_after(&self, parameters: &Parameters, tolerance: f64) {
        let expected = self.under("after");
        assert_eq!(expected.len(), parameters.names().count(), "{}", self.name);
        for (name, value) in parameters.tensors().iter().filter(|(name, _)| !is_removed(name)) {
            self.check(&format!("after.{name}"), value, tolerance);
        }
    }
}

/// Biases that batch normalisation cancels. Their gradient is 0, and in f32 a rounding error that Adam scales to a full
/// step.
fn is_removed(name: &str) -> bool {
    name.ends_with("_head.4.bias")
}
