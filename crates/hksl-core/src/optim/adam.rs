//! Adam (Kingma & Ba, arXiv 1412.6980), computed as in PyTorch.

mod on_device;
mod on_host;
#[cfg(test)]
mod tests;

use std::cell::RefCell;
use std::collections::BTreeMap;

use candle_core::backprop::GradStore;
use candle_core::{DType, Device, Tensor};

use self::on_device::{MoveMoments, MoveWeight};
use self::on_host::Step;
use super::gradient_norm;
use crate::kernels::{MomentStep, WeightStep};
use crate::params::Parameters;
use crate::{Error, Result};

const BETA1: f32 = 0.9;
const BETA2: f32 = 0.999;

/// Settings of [`Adam`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdamConfig {
    /// The learning rate.
    pub learning_rate: f64,
    /// ε, added to the denominator.
    pub epsilon: f64,
    /// L2 penalty: this factor times the weight is added to the gradient.
    pub l2: f64,
    /// Decoupled weight decay per step, not multiplied by the learning rate.
    pub decay: f64,
}

impl AdamConfig {
    /// Settings with this learning rate, ε = 1e-8, no L2 penalty and no weight decay.
    pub fn at(learning_rate: f64) -> Self {
        Self { learning_rate, epsilon: 1e-8, l2: 0.0, decay: 0.0 }
    }
}

/// Adam for a set of parameters, with β = (0.9, 0.999).
///
/// A step skips parameters without gradient: their weights and moments do not change. Steps are therefore counted per
/// parameter.
#[derive(Debug)]
pub struct Adam {
    parameters: Parameters,
    config: AdamConfig,
    moments: BTreeMap<String, Moments>,
}

/// The moments of a parameter's gradients.
#[derive(Debug)]
pub(super) struct Moments {
    steps: u32,
    values: Values,
}

/// Storage of the moments. On the CPU they are vectors, so that one pass updates moments and weight in place.
#[derive(Debug)]
enum Values {
    Host {
        mean: Vec<f32>,
        square: Vec<f32>,
    },
    /// First and second moment, (2, N).
    Device(Tensor),
}

impl Adam {
    /// Creates an optimiser with the settings of [`AdamConfig::at`] and zero moments.
    pub fn new(parameters: Parameters, learning_rate: f64) -> Result<Self> {
        Self::with(parameters, AdamConfig::at(learning_rate))
    }

    /// Creates an optimiser with the given settings and zero moments.
    pub fn with(parameters: Parameters, config: AdamConfig) -> Result<Self> {
        let moments = parameters
            .iter()
            .map(|(name, parameter)| {
                let values = if parameter.device().is_cpu() {
                    let zeros = vec![0f32; parameter.elem_count()];
                    Values::Host { mean: zeros.clone(), square: zeros }
                } else {
                    let shape = (2, parameter.elem_count());
                    Values::Device(Tensor::zeros(shape, DType::F32, parameter.device())?)
                };
                Ok((name.to_owned(), Moments { steps: 0, values }))
            })
            .collect::<Result<_>>()?;
        Ok(Self { parameters, config, moments })
    }

    /// The optimised parameters.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// Takes one step with these gradients. The step changes weights in place, which invalidates the backward pass of graphs
    /// built before.
    pub fn step(&mut self, gradients: &GradStore) -> Result<()> {
        self.step_scaled(gradients, 1.0)
    }

    /// Takes one step with gradients clipped to a total norm of at most `most`. Returns the norm before clipping.
    ///
    /// # Errors
    /// [`Error::GradientNotFinite`]. Nothing changes in that case.
    pub fn step_clipped(&mut self, gradients: &GradStore, most: f64) -> Result<f64> {
        let norm = gradient_norm(&self.parameters, gradients)?;
        if !norm.is_finite() {
            return Err(Error::GradientNotFinite(norm));
        }
        self.step_scaled(gradients, if norm > most { most / norm } else { 1.0 })?;
        Ok(norm)
    }

    fn step_scaled(&mut self, gradients: &GradStore, scale: f64) -> Result<()> {
        let AdamConfig { learning_rate, epsilon, l2, decay } = self.config;
        for (name, parameter) in self.parameters.iter() {
            let Some(gradient) = gradients.get(parameter) else { continue };
            let Some(moments) = self.moments.get_mut(name) else { continue };
            moments.steps += 1;
            let steps = f64::from(moments.steps);
            let correction1 = 1.0 - f64::from(BETA1).powf(steps);
            let correction2 = 1.0 - f64::from(BETA2).powf(steps);
            let moving = MomentStep { betas: (BETA1, BETA2), scale: scale as f32, l2: l2 as f32 };
            let along = WeightStep {
                rate: (learning_rate / correction1) as f32,
                root_correction2: correction2.sqrt() as f32,
                epsilon: epsilon as f32,
                kept: (1.0 - decay) as f32,
            };
            match &mut moments.values {
                Values::Host { mean, square } => {
                    let gradient = &gradient.contiguous()?;
                    let moments = RefCell::new((mean, square));
                    parameter.inplace_op1(&Step { gradient, moments, moving, along })?;
                }
                Values::Device(moments) => {
                    let (gradient, weight) =
                        (gradient.contiguous()?, parameter.as_detached_tensor());
                    moments.inplace_op3(&gradient, &weight, &MoveMoments(moving))?;
                    parameter.inplace_op2(moments, &MoveWeight(along))?;
                }
            }
        }
        Ok(())
    }

    /// The optimiser's state: `{parameter}.mean`, `{parameter}.square` and `{parameter}.steps` of each parameter.
    pub fn state(&self) -> Result<BTreeMap<String, Tensor>> {
        let mut state = BTreeMap::new();
        for (name, parameter) in self.parameters.iter() {
            let Some(Moments { steps, values }) = self.moments.get(name) else { continue };
            let (mean, square) = match values {
                Values::Host { mean, square } => (
                    Tensor::from_slice(mean, parameter.shape(), &Device::Cpu)?,
                    Tensor::from_slice(square, parameter.shape(), &Device::Cpu)?,
                ),
                Values::Device(moments) => (
                    moments.get(0)?.reshape(parameter.shape())?.force_contiguous()?,
                    moments.get(1)?.reshape(parameter.shape())?.force_contiguous()?,
                ),
            };
            state.insert(format!("{name}.mean"), mean);
            state.insert(format!("{name}.square"), square);
            state.insert(format!("{name}.steps"), Tensor::new(*steps, &Device::Cpu)?);
        }
        Ok(state)
    }

    /// Restores a saved state.
    ///
    /// # Errors
    /// A tensor that is missing, unknown or of another shape. Nothing changes in that case.
    pub fn load(&mut self, state: &BTreeMap<String, Tensor>) -> Result<()> {
        let moments = self.read(state)?;
        self.set(moments);
        Ok(())
    }

    /// Reads the moments of a saved state.
    pub(super) fn read(
        &self,
        state: &BTreeMap<String, Tensor>,
    ) -> Result<BTreeMap<String, Moments>> {
        let find = |name: String| {
            state.get(&name).cloned().ok_or_else(|| Error::MissingParameter(name.clone()))
        };
        let mut loaded = BTreeMap::new();
        for (name, parameter) in self.parameters.iter() {
            let (mean, square) = (find(format!("{name}.mean"))?, find(format!("{name}.square"))?);
            let steps = find(format!("{name}.steps"))?.to_dtype(DType::U32)?.to_scalar::<u32>()?;
            for tensor in [&mean, &square] {
                if tensor.dims() != parameter.dims() {
                    return Err(Error::ParameterShape {
                        name: format!("{name} (moments)"),
                        got: tensor.dims().to_vec(),
                        expected: parameter.dims().to_vec(),
                    });
                }
            }
            let device = parameter.device();
            let values = if device.is_cpu() {
                let numbers = |tensor: &Tensor| tensor.flatten_all()?.to_vec1::<f32>();
                Values::Host { mean: numbers(&mean)?, square: numbers(&square)? }
            } else {
                let rows = [mean.flatten_all()?, square.flatten_all()?];
                Values::Device(Tensor::stack(&rows, 0)?.to_device(device)?)
            };
            loaded.insert(name.to_owned(), Moments { steps, values });
        }
        let known = |key: &str| {
            key.rsplit_once('.').is_some_and(|(name, part)| {
                ["mean", "square", "steps"].contains(&part) && loaded.contains_key(name)
            })
        };
        match state.keys().find(|key| !known(key)) {
            Some(name) => Err(Error::UnknownParameter(name.clone())),
            None => Ok(loaded),
        }
    }

    /// Replaces the moments.
    pub(super) fn set(&mut self, moments: BTreeMap<String, Moments>) {
        self.moments = moments;
    }
}
