//! GRU gates: the elementwise part of a gated cell as single operations, to save kernel launches on GPUs.

#[cfg(feature = "cuda")]
use candle_core::CudaStorage;
use candle_core::{CpuStorage, CustomOp2, CustomOp3, Layout, Result, Shape, Tensor, bail};

use crate::kernels;
#[cfg(feature = "cuda")]
use crate::kernels::Elementwise;
use crate::on_host::{cpu, numbers};

/// Applies a gate: `σ(gate) · value`. All tensors have the same shape.
pub(crate) fn apply_gate(gates: &Tensor, values: &Tensor) -> Result<Tensor> {
    same_shape(gates, &[values])?;
    gates.contiguous()?.apply_op2(&values.contiguous()?, ApplyGate)
}

/// The GRU update `(1 − u) · old + u · tanh(candidate)` with `u = σ(gate)`. All tensors have the same shape.
pub(crate) fn gru_update(gates: &Tensor, candidates: &Tensor, old: &Tensor) -> Result<Tensor> {
    same_shape(gates, &[candidates, old])?;
    gates.contiguous()?.apply_op3(&candidates.contiguous()?, &old.contiguous()?, GruUpdate)
}

fn same_shape(first: &Tensor, others: &[&Tensor]) -> Result<()> {
    if let Some(other) = others.iter().find(|other| other.dims() != first.dims()) {
        bail!("a gated cell was given tensors {:?} and {:?}", first.dims(), other.dims());
    }
    Ok(())
}

struct ApplyGate;

impl CustomOp2 for ApplyGate {
    fn name(&self) -> &'static str {
        "apply-gate"
    }

    fn cpu_fwd(
        &self,
        gates: &CpuStorage,
        gates_layout: &Layout,
        values: &CpuStorage,
        values_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let output =
            kernels::apply_gate(numbers(gates, gates_layout)?, numbers(values, values_layout)?);
        Ok((CpuStorage::F32(output), gates_layout.shape().clone()))
    }

    #[cfg(feature = "cuda")]
    fn cuda_fwd(
        &self,
        gates: &CudaStorage,
        gates_layout: &Layout,
        values: &CudaStorage,
        values_layout: &Layout,
    ) -> Result<(CudaStorage, Shape)> {
        let read = [(gates, gates_layout), (values, values_layout)];
        Ok((
            kernels::elementwise_on_gpu(Elementwise::ApplyGate, &read)?,
            gates_layout.shape().clone(),
        ))
    }

    fn bwd(
        &self,
        gates: &Tensor,
        values: &Tensor,
        _: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let towards =
            gates.apply_op3_no_bwd(values, &gradient.contiguous()?, &ApplyGateBackward)?;
        Ok((Some(towards.get(0)?), Some(towards.get(1)?)))
    }
}

/// The gradients of gates and values, stacked to (2, …).
struct ApplyGateBackward;

impl CustomOp3 for ApplyGateBackward {
    fn name(&self) -> &'static str {
        "apply-gate-backward"
    }

    fn cpu_fwd(
        &self,
        gates: &CpuStorage,
        gates_layout: &Layout,
        values: &CpuStorage,
        values_layout: &Layout,
        gradient: &CpuStorage,
        gradient_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (gates, values) = (numbers(gates, gates_layout)?, numbers(values, values_layout)?);
        let towards =
            kernels::apply_gate_backward(gates, values, numbers(gradient, gradient_layout)?);
        Ok((CpuStorage::F32(towards), times(2, gates_layout)))
    }

    #[cfg(feature = "cuda")]
    fn cuda_fwd(
        &self,
        gates: &CudaStorage,
        gates_layout: &Layout,
        values: &CudaStorage,
        values_layout: &Layout,
        gradient: &CudaStorage,
        gradient_layout: &Layout,
    ) -> Result<(CudaStorage, Shape)> {
        let read = [(gates, gates_layout), (values, values_layout), (gradient, gradient_layout)];
        Ok((
            kernels::elementwise_on_gpu(Elementwise::ApplyGateBackward, &read)?,
            times(2, gates_layout),
        ))
    }
}

struct GruUpdate;

impl CustomOp3 for GruUpdate {
    fn name(&self) -> &'static str {
        "gru-update"
    }

    fn cpu_fwd(
        &self,
        gates: &CpuStorage,
        gates_layout: &Layout,
        candidates: &CpuStorage,
        candidates_layout: &Layout,
        old: &CpuStorage,
        old_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let candidates = numbers(candidates, candidates_layout)?;
        let gates = numbers(gates, gates_layout)?;
        let output = kernels::gru_update(gates, candidates, numbers(old, old_layout)?);
        Ok((CpuStorage::F32(output), gates_layout.shape().clone()))
    }

    #[cfg(feature = "cuda")]
    fn cuda_fwd(
        &self,
        gates: &CudaStorage,
        gates_layout: &Layout,
        candidates: &CudaStorage,
        candidates_layout: &Layout,
        old: &CudaStorage,
        old_layout: &Layout,
    ) -> Result<(CudaStorage, Shape)> {
        let read = [(gates, gates_layout), (candidates, candidates_layout), (old, old_layout)];
        Ok((
            kernels::elementwise_on_gpu(Elementwise::GruUpdate, &read)?,
            gates_layout.shape().clone(),
        ))
    }

    fn bwd(
        &self,
        gates: &Tensor,
        candidates: &Tensor,
        old: &Tensor,
        _: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let back = GruUpdateBackward { gradient: gradient.contiguous()? };
        let towards = gates.apply_op3_no_bwd(candidates, old, &back)?;
        Ok((Some(towards.get(0)?), Some(towards.get(1)?), Some(towards.get(2)?)))
    }
}

/// The gradients of gates, candidates and old state, stacked to (3, …). The output gradient is a field because candle's
/// operations take at most three tensors.
struct GruUpdateBackward {
    gradient: Tensor,
}

impl CustomOp3 for GruUpdateBackward {
    fn name(&self) -> &'static str {
        "gru-update-backward"
    }

    fn cpu_fwd(
        &self,
        gates: &CpuStorage,
        gates_layout: &Layout,
        candidates: &CpuStorage,
        candidates_layout: &Layout,
        old: &CpuStorage,
        old_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (gradient, gradient_layout) = self.gradient.storage_and_layout();
        let gradient = numbers(cpu(&gradient)?, gradient_layout)?;
        let candidates = numbers(candidates, candidates_layout)?;
        let (gates, old) = (numbers(gates, gates_layout)?, numbers(old, old_layout)?);
        let towards = kernels::gru_update_backward(gates, candidates, old, gradient);
        Ok((CpuStorage::F32(towards), times(3, gates_layout)))
    }

    #[cfg(feature = "cuda")]
    fn cuda_fwd(
        &self,
        gates: &CudaStorage,
        gates_layout: &Layout,
        candidates: &CudaStorage,
        candidates_layout: &Layout,
        old: &CudaStorage,
        old_layout: &Layout,
    ) -> Result<(CudaStorage, Shape)> {
        let (gradient, gradient_layout) = self.gradient.storage_and_layout();
        let candle_core::Storage::Cuda(gradient) = &*gradient else {
            bail!("a kernel of the GPU was given a gradient of another device")
        };
        let read = [
            (gates, gates_layout),
            (candidates, candidates_layout),
            (old, old_layout),
            (gradient, gradient_layout),
        ];
        Ok((
            kernels::elementwise_on_gpu(Elementwise::GruUpdateBackward, &read)?,
            times(3, gates_layout),
        ))
    }
}

/// The shape with an additional first dimension of size `count`.
fn times(count: usize, layout: &Layout) -> Shape {
    Shape::from([&[count], layout.dims()].concat())
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Var};

    use super::*;
    use crate::rng::{standard_normal, stream};
    use crate::testing::{assert_close, device, gradients};

    /// Compares the operations, on a GPU or on the CPU, with candle's operations on the CPU: output and all gradients.
    #[test]
    fn agree_with_the_formulae() {
        let mut rng = stream(3, "gates");
        let mut draw = || standard_normal(&mut rng, &[6, 7], &Device::Cpu).unwrap();
        let drawn = [draw(), draw(), draw()];
        let on = |device: &Device| {
            let on = |x: &Tensor| Var::from_tensor(&x.to_device(device).unwrap()).unwrap();
            [on(&drawn[0]), on(&drawn[1]), on(&drawn[2])]
        };
        let ([gate, value, old], ours) = (on(&Device::Cpu), on(&device()));
        let open = || (gate.neg().unwrap().exp().unwrap() + 1.0).unwrap().recip().unwrap();
        let new = (value.tanh().unwrap() - &*old).unwrap();
        let pairs = [
            (apply_gate(&ours[0], &ours[1]).unwrap(), (open() * &*value).unwrap()),
            (
                gru_update(&ours[0], &ours[1], &ours[2]).unwrap(),
                (&*old + (open() * new).unwrap()).unwrap(),
            ),
        ];
        for (got, expected) in pairs {
            assert_close(&got, &expected);
            let (got, expected) = (gradients(&got), gradients(&expected));
            for (ours, variable) in ours.iter().zip([&gate, &value, &old]) {
                match expected.get(variable) {
                    Some(expected) => assert_close(got.get(ours).unwrap(), expected),
                    None => assert!(got.get(ours).is_none()),
                }
            }
        }
        assert!(apply_gate(&ours[0], &ours[1].narrow(0, 0, 5).unwrap()).is_err());
    }
}
