//! The convolution stack and the following linear layer as one operation. The feature maps between the two, the largest
//! tensor of a step, and their gradient do not become candle tensors, which saves clearing and accumulating gradients.

use std::sync::OnceLock;

use candle_core::bail;
use candle_core::{CpuStorage, CustomOp3, Device, Layout, Result as CandleResult, Shape, Tensor};

use crate::kernels::{
    Block, Convolutions, Engine, LinearGradients, Sizes, linear, linear_gradients,
};
use crate::on_host::{bytes, cpu, numbers};

/// An operation on images, the vector of the stack's parameters and the weight of the linear layer.
pub(super) struct Projected {
    pub(super) shape: Convolutions,
    pub(super) engine: Engine,
    /// Activations for the backward pass, if there will be one.
    pub(super) kept: Option<OnceLock<Kept>>,
}

/// Feature maps between the layers, and of the last layer.
pub(super) struct Kept {
    maps: Block,
    features: Vec<f32>,
}

impl Projected {
    fn sizes(&self, batch: usize, weight: &Shape) -> CandleResult<Sizes> {
        let (outputs, inputs) = weight.dims2()?;
        let (height, width) = self.shape.output_size();
        let features = height * width * self.shape.filters;
        if inputs != features {
            bail!("a linear map from {inputs} numbers was given {features} features");
        }
        Ok(Sizes { batch, inputs, outputs })
    }
}

impl CustomOp3 for Projected {
    fn name(&self) -> &'static str {
        "convolutions-and-linear"
    }

    fn cpu_fwd(
        &self,
        images: &CpuStorage,
        images_layout: &Layout,
        parameters: &CpuStorage,
        parameters_layout: &Layout,
        weight: &CpuStorage,
        weight_layout: &Layout,
    ) -> CandleResult<(CpuStorage, Shape)> {
        let images = bytes(images, images_layout)?;
        let parameters = numbers(parameters, parameters_layout)?;
        let weight = numbers(weight, weight_layout)?;
        let sizes = self.sizes(images_layout.dims()[0], weight_layout.shape())?;
        let keep = self.kept.is_some();
        let (features, maps) = self.shape.forward(images, parameters, &self.engine, keep);
        let nothing = vec![0.0; sizes.outputs];
        let output = linear(&self.engine, sizes, &features, weight, &nothing, false);
        if let (Some(kept), Some(maps)) = (&self.kept, maps) {
            // candle runs the operation once. A second run would give the same maps.
            let _ = kept.set(Kept { maps, features });
        }
        Ok((CpuStorage::F32(output), (sizes.batch, sizes.outputs).into()))
    }

    fn bwd(
        &self,
        images: &Tensor,
        parameters: &Tensor,
        weight: &Tensor,
        _: &Tensor,
        gradient: &Tensor,
    ) -> CandleResult<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let Some(Kept { maps, features }) = self.kept.as_ref().and_then(OnceLock::get) else {
            bail!("the convolutions were run without keeping what their gradient needs")
        };
        let gradient = gradient.contiguous()?;
        let (image_storage, image_layout) = images.storage_and_layout();
        let (parameter_storage, parameter_layout) = parameters.storage_and_layout();
        let (weight_storage, weight_layout) = weight.storage_and_layout();
        let (gradient_storage, gradient_layout) = gradient.storage_and_layout();
        let LinearGradients { x: grad_features, weight: grad_weight, .. } = linear_gradients(
            &self.engine,
            self.sizes(image_layout.dims()[0], weight.shape())?,
            features,
            numbers(cpu(&weight_storage)?, weight_layout)?,
            numbers(cpu(&gradient_storage)?, gradient_layout)?,
            (true, true),
        );
        let grad_parameters = grad_features.map(|grad_features| {
            CandleResult::Ok(self.shape.gradient(
                bytes(cpu(&image_storage)?, image_layout)?,
                numbers(cpu(&parameter_storage)?, parameter_layout)?,
                &self.engine,
                maps,
                features,
                &grad_features,
            ))
        });
        let tensor = |numbers, like: &Tensor| Tensor::from_vec(numbers, like.shape(), &Device::Cpu);
        Ok((
            None,
            grad_parameters.transpose()?.map(|sums| tensor(sums, parameters)).transpose()?,
            grad_weight.map(|numbers| tensor(numbers, weight)).transpose()?,
        ))
    }
}
