//! How modules get their parameters.

use candle_core::{DType, Device, Tensor, Var};
use rand_chacha::ChaCha8Rng;

use super::Parameters;
use crate::kernels::{Engine, Kernels};
use crate::nn::{Initialisation, Initializer};
use crate::{Error, Result};

/// Creates the parameters of modules, or looks up existing ones without gradient.
///
/// A module's constructor requests each parameter from a builder by name. The same constructor thus creates the trained
/// module and views of its weights without gradient. Views share the storage, so they need no memory, hold no graph
/// and change with the weights.
#[derive(Debug)]
pub struct Builder<'a> {
    source: Source<'a>,
    prefix: String,
    initialisation: Initialisation,
    device: Device,
}

#[derive(Debug)]
enum Source<'a> {
    Create { parameters: &'a mut Parameters, rng: &'a mut ChaCha8Rng },
    View { parameters: &'a Parameters },
}

impl<'a> Builder<'a> {
    /// Returns a builder that adds new parameters to `parameters`, initialised by `initialisation` with values from `rng`.
    pub fn create(
        parameters: &'a mut Parameters,
        rng: &'a mut ChaCha8Rng,
        initialisation: Initialisation,
        device: &Device,
    ) -> Self {
        let source = Source::Create { parameters, rng };
        Self { source, prefix: String::new(), initialisation, device: device.clone() }
    }

    /// Returns a builder that looks up existing parameters, without gradient.
    pub fn view(parameters: &'a Parameters, device: &Device) -> Self {
        Self {
            source: Source::View { parameters },
            prefix: String::new(),
            initialisation: Initialisation::Uniform,
            device: device.clone(),
        }
    }

    /// The builder for the submodule `name`.
    pub fn under(&mut self, name: impl std::fmt::Display) -> Builder<'_> {
        let prefix = self.full_name(&name.to_string());
        let source = match &mut self.source {
            Source::Create { parameters, rng } => Source::Create { parameters, rng },
            Source::View { parameters } => Source::View { parameters },
        };
        Builder { source, prefix, initialisation: self.initialisation, device: self.device.clone() }
    }

    /// The initialisation scheme.
    pub fn initialisation(&self) -> Initialisation {
        self.initialisation
    }

    /// The CPU kernels for the modules.
    pub fn kernels(&self) -> Kernels {
        self.engine().kernels
    }

    /// The kernels with the buffer pool that all modules of the same parameters share.
    pub(crate) fn engine(&self) -> &Engine {
        match &self.source {
            Source::Create { parameters, .. } => &parameters.engine,
            Source::View { parameters } => &parameters.engine,
        }
    }

    /// The device of the parameters.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Creates the parameter `name` with `initializer`, or looks it up.
    ///
    /// # Errors
    /// A shape with a dimension of 0; when creating, a name that exists already; when looking up, a parameter that is missing
    /// or has another shape.
    pub fn parameter(
        &mut self,
        name: &str,
        shape: &[usize],
        initializer: Initializer,
    ) -> Result<Tensor> {
        let name = self.full_name(name);
        if shape.contains(&0) {
            return Err(Error::EmptyParameter { name, shape: shape.to_vec() });
        }
        match &mut self.source {
            Source::Create { parameters, rng } => {
                let numbers = initializer.values(shape, rng);
                let value = Var::from_vec(numbers, shape, &self.device)?;
                let tensor = value.as_tensor().clone();
                parameters.insert(name, value)?;
                Ok(tensor)
            }
            Source::View { parameters } => {
                let value =
                    parameters.get(&name).ok_or_else(|| Error::MissingParameter(name.clone()))?;
                if value.dims() != shape || value.dtype() != DType::F32 {
                    let (got, expected) = (value.dims().to_vec(), shape.to_vec());
                    return Err(Error::ParameterShape { name, got, expected });
                }
                Ok(value.as_detached_tensor())
            }
        }
    }

    fn full_name(&self, name: &str) -> String {
        if self.prefix.is_empty() { name.to_owned() } else { format!("{}.{name}", self.prefix) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_view_shares_the_weights_and_has_no_gradient() {
        let mut parameters = Parameters::default();
        parameters.insert("a.b", Var::new(&[1f32, 2.], &Device::Cpu).unwrap()).unwrap();
        let view = Builder::view(&parameters, &Device::Cpu)
            .under("a")
            .parameter("b", &[2], Initializer::Constant(0.))
            .unwrap();
        assert!(!view.is_variable());
        parameters
            .get("a.b")
            .unwrap()
            .set(&Tensor::new(&[9f32, 8.], &Device::Cpu).unwrap())
            .unwrap();
        assert_eq!(view.to_vec1::<f32>().unwrap(), [9., 8.]);
    }
}
