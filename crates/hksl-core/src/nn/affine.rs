//! A linear layer with activation as one operation.

use candle_core::{CpuStorage, CustomOp3, Device, Layout, Result as CandleResult, Shape, Tensor};

use crate::Result;
use crate::kernels::{Engine, LinearGradients, Sizes, linear, linear_gradients};
use crate::nn::Activation;
use crate::nn::im2col_gemm::AffineGemm;
use crate::on_host::{cpu, numbers};

/// Computes `x Wᵀ + b` and applies the activation.
///
/// # Shapes
/// - `x`: `(B, in)`
/// - `weight`: `(out, in)`
/// - `bias`: `(out)`
/// - output: `(B, out)`
pub(super) fn affine(
    engine: &Engine,
    x: &Tensor,
    weight: &Tensor,
    bias: &Tensor,
    activation: Activation,
) -> Result<Tensor> {
    if x.device().is_cpu() {
        let operation = Affine { engine: engine.clone(), activation };
        return Ok(x.contiguous()?.apply_op3(weight, bias, operation)?);
    }
    let operation = AffineGemm { activation, counter: engine.counter.clone() };
    Ok(x.contiguous()?.apply_op3(weight, bias, operation)?)
}

struct Affine {
    engine: Engine,
    activation: Activation,
}

impl CustomOp3 for Affine {
    fn name(&self) -> &'static str {
        "affine"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        weight: &CpuStorage,
        weight_layout: &Layout,
        bias: &CpuStorage,
        bias_layout: &Layout,
    ) -> CandleResult<(CpuStorage, Shape)> {
        let (batch, inputs) = x_layout.shape().dims2()?;
        let (outputs, expected) = weight_layout.shape().dims2()?;
        if inputs != expected {
            candle_core::bail!("a linear map from {expected} numbers was given rows of {inputs}");
        }
        let sizes = Sizes { batch, inputs, outputs };
        let (x, weight) = (numbers(x, x_layout)?, numbers(weight, weight_layout)?);
        let bias = numbers(bias, bias_layout)?;
        // The kernel applies ReLU itself. Other activations are applied to its result.
        let relu = self.activation == Activation::Relu;
        let mut y = linear(&self.engine, sizes, x, weight, bias, relu);
        if !relu {
            self.activation.apply(&mut y);
        }
        Ok((CpuStorage::F32(y), (batch, outputs).into()))
    }

    fn bwd(
        &self,
        x: &Tensor,
        weight: &Tensor,
        bias: &Tensor,
        output: &Tensor,
        gradient: &Tensor,
    ) -> CandleResult<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let ((batch, inputs), outputs) = (x.dims2()?, weight.dim(0)?);
        let sizes = Sizes { batch, inputs, outputs };
        let gradient = gradient.contiguous()?;
        let (x_storage, x_layout) = x.storage_and_layout();
        let (weight_storage, weight_layout) = weight.storage_and_layout();
        let (output_storage, output_layout) = output.storage_and_layout();
        let (gradient_storage, gradient_layout) = gradient.storage_and_layout();
        let gradient = numbers(cpu(&gradient_storage)?, gradient_layout)?;
        let before =
            self.activation.backward(numbers(cpu(&output_storage)?, output_layout)?, gradient);
        let gradients = linear_gradients(
            &self.engine,
            sizes,
            numbers(cpu(&x_storage)?, x_layout)?,
            numbers(cpu(&weight_storage)?, weight_layout)?,
            before.as_deref().unwrap_or(gradient),
            (x.track_op(), weight.track_op()),
        );
        let LinearGradients { x: grad_x, weight: grad_weight, bias: grad_bias } = gradients;
        let tensor = |numbers, like: &Tensor| Tensor::from_vec(numbers, like.shape(), &Device::Cpu);
        Ok((
            grad_x.map(|numbers| tensor(numbers, x)).transpose()?,
            grad_weight.map(|numbers| tensor(numbers, weight)).transpose()?,
            grad_bias.map(|numbers| tensor(numbers, bias)).transpose()?,
        ))
    }
}

#[cfg(test)]
mod tests {
    use candle_core::Var;

    use super::*;
    use crate::kernels::Counter;
    use crate::rng::{standard_normal, stream};
    use crate::testing::{assert_close, device, gradients};

    /// Compares the GPU code path, on a GPU or on the CPU, with the CPU kernels: output and all gradients.
    #[test]
    fn products_and_kernels_agree() {
        for activation in [Activation::None, Activation::Relu, Activation::Elu] {
            let on = |device: &Device| {
                [&[9, 6][..], &[1, 6], &[1]].map(|dims| {
                    let name = format!("affine {dims:?}");
                    let drawn = standard_normal(&mut stream(3, &name), dims, &Device::Cpu);
                    Var::from_tensor(&drawn.unwrap().to_device(device).unwrap()).unwrap()
                })
            };
            let (ours, others) = (on(&Device::Cpu), on(&device()));
            let [x, weight, bias] = &ours;
            let kernels = affine(&Engine::default(), x, weight, bias, activation).unwrap();
            let [x, weight, bias] = &others;
            let gemm = || AffineGemm { activation, counter: Counter::default() };
            let products = x.apply_op3(weight, bias, gemm()).unwrap();
            assert_close(&products, &kernels);
            let (kernels, products) = (gradients(&kernels), gradients(&products));
            for (ours, other) in ours.iter().zip(&others) {
                assert_close(products.get(other).unwrap(), kernels.get(ours).unwrap());
            }
            let longer = Tensor::cat(&[x.as_tensor(), x.as_tensor()], 1).unwrap();
            assert!(longer.apply_op3(weight, bias, gemm()).is_err());
        }
    }
}
