//! Named parameters, and the builder with which modules create or look up theirs.

mod builder;

use std::collections::{BTreeMap, HashMap};

use candle_core::{Device, Tensor, Var};

pub use builder::Builder;

use crate::kernels::{Engine, Kernels, Operations};
use crate::{Error, Result};

/// Named parameters, ordered by name, so that sums and files do not depend on hashing.
///
/// Cloning is cheap: clones share the values.
///
/// ```
/// use candle_core::{DType, Device, Var};
/// use hksl_core::Parameters;
///
/// let mut parameters = Parameters::default();
/// parameters.insert("linear.weight", Var::zeros((2, 3), DType::F32, &Device::Cpu)?)?;
/// parameters.insert("linear.bias", Var::ones(2, DType::F32, &Device::Cpu)?)?;
/// assert_eq!(parameters.names().collect::<Vec<_>>(), ["linear.bias", "linear.weight"]);
/// assert_eq!(parameters.elements(), 8);
///
/// let bytes = parameters.to_safetensors()?;
/// parameters.load_safetensors(&bytes)?;
/// # Ok::<(), hksl_core::Error>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Parameters {
    entries: BTreeMap<String, Var>,
    engine: Engine,
}

impl Parameters {
    /// Creates an empty set for modules that compute with these kernels. [`Parameters::default`] uses the fastest kernels.
    pub fn with_kernels(kernels: Kernels) -> Self {
        Self { entries: BTreeMap::new(), engine: Engine::new(kernels) }
    }

    /// Adds a parameter.
    ///
    /// # Errors
    /// [`Error::DuplicateParameter`] if the name exists.
    pub fn insert(&mut self, name: impl Into<String>, value: Var) -> Result<()> {
        let name = name.into();
        if self.entries.contains_key(&name) {
            return Err(Error::DuplicateParameter(name));
        }
        self.entries.insert(name, value);
        Ok(())
    }

    /// The parameter with this name.
    pub fn get(&self, name: &str) -> Option<&Var> {
        self.entries.get(name)
    }

    /// All names in order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.entries.keys().map(String::as_str)
    }

    /// All parameters, ordered by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Var)> {
        self.entries.iter().map(|(name, value)| (name.as_str(), value))
    }

    /// Total number of elements of all parameters.
    pub fn elements(&self) -> usize {
        self.entries.values().map(|value| value.elem_count()).sum()
    }

    /// Whether the set is empty.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The operations that modules with these parameters, or with any that share the origin, have executed so far.
    ///
    /// ```
    /// use candle_core::{DType, Device, Tensor};
    /// use hksl_core::nn::{Initialisation, PixelEncoder, PixelEncoderConfig};
    /// use hksl_core::{Builder, Encoder, Parameters, rng};
    ///
    /// let (mut parameters, mut rng) = (Parameters::default(), rng::stream(1, "init"));
    /// let device = Device::Cpu;
    /// let mut builder =
    ///     Builder::create(&mut parameters, &mut rng, Initialisation::Uniform, &device);
    /// let paper = PixelEncoderConfig { filters: 32, latent_dims: 50 };
    /// let encoder = PixelEncoder::new(&mut builder, [9, 84, 84], paper)?;
    /// encoder.forward(&Tensor::zeros((1, 9, 84, 84), DType::U8, &device)?)?;
    ///
    /// let operations = parameters.operations();
    /// assert_eq!(operations.encoder_images, 1);
    /// assert_eq!((operations.defined as f64 / 1e5).round(), 885.0);
    /// assert!(operations.executed <= operations.defined);
    /// # Ok::<(), hksl_core::Error>(())
    /// ```
    pub fn operations(&self) -> Operations {
        self.engine.counter.read()
    }

    /// The parameters whose name is `prefix` or begins with `prefix.`, with shared values.
    pub fn under(&self, prefix: &str) -> Parameters {
        let belongs = |name: &str| {
            name.strip_prefix(prefix).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        };
        let entries = self.entries.iter().filter(|(name, _)| belongs(name));
        let entries = entries.map(|(name, value)| (name.clone(), value.clone())).collect();
        Parameters { entries, engine: self.engine.clone() }
    }

    /// The parameters of `self` and `other`, with shared values. `other` takes precedence for a name in both.
    pub fn union(&self, other: &Parameters) -> Parameters {
        let mut entries = self.entries.clone();
        entries.extend(other.entries.iter().map(|(name, value)| (name.clone(), value.clone())));
        Parameters { entries, engine: self.engine.clone() }
    }

    /// Copies every parameter under the prefix `source` to the prefix `target`.
    ///
    /// # Errors
    /// [`Error::DuplicateParameter`] if a target name exists.
    pub fn copy_under(&mut self, source: &str, target: &str) -> Result<()> {
        for (name, value) in self.under(source).iter() {
            let copy = Var::from_tensor(&value.as_detached_tensor().copy()?)?;
            self.insert(format!("{target}{}", &name[source.len()..]), copy)?;
        }
        Ok(())
    }

    /// The values as tensors that share the parameters' storage, so they change with the weights. Use
    /// [`Parameters::snapshot`] for copies.
    pub fn tensors(&self) -> BTreeMap<String, Tensor> {
        self.iter().map(|(name, value)| (name.to_owned(), value.as_detached_tensor())).collect()
    }

    /// Copies all values.
    ///
    /// # Errors
    /// Whatever the tensors report.
    pub fn snapshot(&self) -> Result<BTreeMap<String, Tensor>> {
        let copy =
            |(name, value): (&str, &Var)| Ok((name.to_owned(), value.as_detached_tensor().copy()?));
        self.iter().map(copy).collect()
    }

    /// Checks tensors for [`Self::load`].
    ///
    /// # Errors
    /// The first tensor that is missing, unknown, or of another shape or data type.
    pub fn check(&self, tensors: &BTreeMap<String, Tensor>) -> Result<()> {
        for (name, value) in self.iter() {
            let tensor =
                tensors.get(name).ok_or_else(|| Error::MissingParameter(name.to_owned()))?;
            let name = || name.to_owned();
            if tensor.shape() != value.shape() {
                let (got, expected) = (tensor.dims().to_vec(), value.dims().to_vec());
                return Err(Error::ParameterShape { name: name(), got, expected });
            }
            if tensor.dtype() != value.dtype() {
                let (got, expected) = (tensor.dtype().as_str(), value.dtype().as_str());
                return Err(Error::ParameterType { name: name(), got, expected });
            }
        }
        match tensors.keys().find(|name| !self.entries.contains_key(*name)) {
            Some(name) => Err(Error::UnknownParameter(name.clone())),
            None => Ok(()),
        }
    }

    /// Overwrites every value with the tensor of the same name.
    ///
    /// # Errors
    /// A tensor that is missing, unknown, or of another shape or data type. Nothing changes in that case.
    pub fn load(&self, tensors: &BTreeMap<String, Tensor>) -> Result<()> {
        self.check(tensors)?;
        for (name, value) in self.iter() {
            // `copy` because a variable rejects a tensor that shares its storage.
            value.set(&tensors[name].to_device(value.device())?.copy()?)?;
        }
        Ok(())
    }

    /// Writes all values in the safetensors format.
    pub fn to_safetensors(&self) -> Result<Vec<u8>> {
        to_safetensors(&self.tensors())
    }

    /// Overwrites every value from a buffer in the safetensors format.
    ///
    /// # Errors
    /// An invalid safetensors buffer; errors of [`Parameters::load`].
    pub fn load_safetensors(&self, bytes: &[u8]) -> Result<()> {
        self.load(&from_safetensors(bytes)?)
    }
}

/// Writes named tensors in the safetensors format. Their order depends on types and names alone.
pub fn to_safetensors(tensors: &BTreeMap<String, Tensor>) -> Result<Vec<u8>> {
    serialize(tensors, None)
}

/// The same with texts that say more about them.
pub fn to_safetensors_with(
    tensors: &BTreeMap<String, Tensor>,
    metadata: BTreeMap<String, String>,
) -> Result<Vec<u8>> {
    serialize(tensors, Some(metadata.into_iter().collect()))
}

fn serialize(
    tensors: &BTreeMap<String, Tensor>,
    metadata: Option<HashMap<String, String>>,
) -> Result<Vec<u8>> {
    let on_host: BTreeMap<&str, Tensor> = tensors
        .iter()
        .map(|(name, tensor)| Ok((name.as_str(), tensor.to_device(&Device::Cpu)?.contiguous()?)))
        .collect::<Result<_>>()?;
    safetensors::tensor::serialize(on_host.iter().map(|(name, tensor)| (*name, tensor)), metadata)
        .map_err(|error| Error::SafeTensors(error.to_string()))
}

/// Reads the named tensors of a safetensors buffer, on the CPU.
pub fn from_safetensors(bytes: &[u8]) -> Result<BTreeMap<String, Tensor>> {
    let tensors = candle_core::safetensors::load_buffer(bytes, &Device::Cpu)
        .map_err(|error| Error::SafeTensors(error.to_string()))?;
    Ok(tensors.into_iter().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two() -> Parameters {
        let mut parameters = Parameters::default();
        parameters.insert("a.b", Var::new(&[1f32, 2.], &Device::Cpu).unwrap()).unwrap();
        parameters.insert("ab", Var::new(&[3f32], &Device::Cpu).unwrap()).unwrap();
        parameters
    }

    #[test]
    fn a_prefix_ends_at_a_dot() {
        assert_eq!(two().under("a").names().collect::<Vec<_>>(), ["a.b"]);
    }

    #[test]
    fn loading_is_all_or_nothing() {
        let parameters = two();
        let mut tensors = parameters.tensors();
        tensors.insert("a.b".into(), Tensor::new(&[7f32, 7.], &Device::Cpu).unwrap());
        tensors.insert("ab".into(), Tensor::new(&[7f32, 7.], &Device::Cpu).unwrap());
        assert!(matches!(parameters.load(&tensors), Err(Error::ParameterShape { .. })));
        tensors.remove("ab");
        assert!(matches!(parameters.load(&tensors), Err(Error::MissingParameter(_))));
        tensors.insert("ab".into(), Tensor::new(&[7f32], &Device::Cpu).unwrap());
        tensors.insert("c".into(), Tensor::new(&[7f32], &Device::Cpu).unwrap());
        assert!(matches!(parameters.load(&tensors), Err(Error::UnknownParameter(_))));
        tensors.remove("c");
        tensors.insert("ab".into(), Tensor::new(&[7f64], &Device::Cpu).unwrap());
        assert!(matches!(parameters.load(&tensors), Err(Error::ParameterType { .. })));
        tensors.insert("ab".into(), Tensor::new(&[7f32], &Device::Cpu).unwrap());
        assert_eq!(parameters.get("a.b").unwrap().to_vec1::<f32>().unwrap(), [1., 2.]);
        parameters.load(&tensors).unwrap();
        assert_eq!(parameters.get("a.b").unwrap().to_vec1::<f32>().unwrap(), [7., 7.]);
    }

    #[test]
    fn a_snapshot_does_not_change() {
        let parameters = two();
        let (view, snapshot) = (parameters.tensors(), parameters.snapshot().unwrap());
        let value = Tensor::new(&[9f32, 9.], &Device::Cpu).unwrap();
        parameters.get("a.b").unwrap().set(&value).unwrap();
        assert_eq!(view["a.b"].to_vec1::<f32>().unwrap(), [9., 9.]);
        assert_eq!(snapshot["a.b"].to_vec1::<f32>().unwrap(), [1., 2.]);
    }

    #[test]
    fn a_copy_has_its_own_storage() {
        let mut parameters = two();
        parameters.copy_under("a", "m").unwrap();
        parameters
            .get("a.b")
            .unwrap()
            .set(&Tensor::new(&[9f32, 9.], &Device::Cpu).unwrap())
            .unwrap();
        assert_eq!(parameters.get("m.b").unwrap().to_vec1::<f32>().unwrap(), [1., 2.]);
        assert!(parameters.copy_under("a", "m").is_err());
    }
}
