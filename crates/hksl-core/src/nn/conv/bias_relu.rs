//! `max(0, x + bias)` in one pass, and its gradient.

use candle_core::{CpuStorage, CustomOp1, CustomOp2, Device, Layout, Result as CandleResult};
use candle_core::{Shape, Tensor};
use rayon::prelude::*;

use super::patches::contiguous;
use crate::Result;

/// Rows in one task. A constant, so that partial sums of the bias gradient, and thus its bits, do not
/// depend on how many threads there are.
const ROWS: usize = 1024;

/// # Shapes
/// - `x`: `(N, F)`
/// - `bias`: `(F)`
/// - output: `(N, F)`
pub(super) fn apply(x: &Tensor, bias: &Tensor) -> Result<Tensor> {
    if matches!(x.device(), Device::Cpu) {
        return Ok(x.apply_op2(bias, BiasRelu)?);
    }
    Ok(x.broadcast_add(bias)?.relu()?)
}

struct BiasRelu;

impl CustomOp2 for BiasRelu {
    fn name(&self) -> &'static str {
        "bias-relu"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        bias: &CpuStorage,
        bias_layout: &Layout,
    ) -> CandleResult<(CpuStorage, Shape)> {
        let (x, bias) = (contiguous(x, x_layout)?, contiguous(bias, bias_layout)?);
        let mut output = vec![0f32; x.len()];
        let chunk = ROWS * bias.len();
        output.par_chunks_mut(chunk).zip(x.par_chunks(chunk)).for_each(|(output, x)| {
            for (output, x) in output.chunks_exact_mut(bias.len()).zip(x.chunks_exact(bias.len())) {
                for ((output, x), bias) in output.iter_mut().zip(x).zip(bias) {
                    *output = (x + bias).max(0.0);
                }
            }
        });
        Ok((CpuStorage::F32(output), x_layout.shape().clone()))
    }

    fn bwd(
        &self,
        _: &Tensor,
        _: &Tensor,
        output: &Tensor,
        gradient: &Tensor,
    ) -> CandleResult<(Option<Tensor>, Option<Tensor>)> {
        let masked = gradient.contiguous()?.apply_op2_no_bwd(output, &Mask)?;
        let bias = masked.apply_op1_no_bwd(&ColumnSum)?;
        Ok((Some(masked), Some(bias)))
    }
}

/// The gradient where the output is positive, 0 elsewhere.
struct Mask;

impl CustomOp2 for Mask {
    fn name(&self) -> &'static str {
        "relu-mask"
    }

    fn cpu_fwd(
        &self,
        gradient: &CpuStorage,
        layout: &Layout,
        output: &CpuStorage,
        output_layout: &Layout,
    ) -> CandleResult<(CpuStorage, Shape)> {
        let (gradient, output) =
            (contiguous(gradient, layout)?, contiguous(output, output_layout)?);
        let mut masked = vec![0f32; gradient.len()];
        masked.par_iter_mut().with_min_len(1 << 14).zip(gradient).zip(output).for_each(
            |((masked, gradient), output)| {
                *masked = if *output > 0.0 { *gradient } else { 0.0 };
            },
        );
        Ok((CpuStorage::F32(masked), layout.shape().clone()))
    }
}

/// `(N, F)` → `(F)`.
struct ColumnSum;

impl CustomOp1 for ColumnSum {
    fn name(&self) -> &'static str {
        "column-sum"
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> CandleResult<(CpuStorage, Shape)> {
        let (_, columns) = layout.shape().dims2()?;
        let x = contiguous(storage, layout)?;
        let partial: Vec<Vec<f32>> =
            x.par_chunks(ROWS * columns).map(|rows| sum_rows(rows, columns)).collect();
        let sums = sum_rows(&partial.concat(), columns);
        Ok((CpuStorage::F32(sums), columns.into()))
    }
}

fn sum_rows(rows: &[f32], columns: usize) -> Vec<f32> {
    let mut sums = vec![0f32; columns];
    for row in rows.chunks_exact(columns) {
        for (sum, x) in sums.iter_mut().zip(row) {
            *sum += x;
        }
    }
    sums
}
