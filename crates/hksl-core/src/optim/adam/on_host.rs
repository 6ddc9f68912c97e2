//! Adam's step on the CPU, in one pass over weights, gradients and moments.

use std::cell::RefCell;

use candle_core::{CpuStorage, InplaceOp1, Layout, Result, Tensor};
use rayon::prelude::*;

use crate::kernels::{MomentStep, WeightStep};
use crate::on_host::{cpu, numbers, numbers_mut};

/// Elements per task.
const CHUNK: usize = 1 << 14;

/// Flushes subnormal numbers to 0.
///
/// The moments of a weight with zero gradients decay to subnormal numbers and stay there, because rounding stops the
/// decay. They do not affect the weights because of ε, but arithmetic on subnormals is many times slower on some CPUs.
#[inline(always)]
fn normal(number: f32) -> f32 {
    if number.abs() < f32::MIN_POSITIVE { 0.0 } else { number }
}

/// One step for one parameter: weight, gradient and moments.
pub(super) struct Step<'a> {
    pub(super) gradient: &'a Tensor,
    pub(super) moments: RefCell<(&'a mut Vec<f32>, &'a mut Vec<f32>)>,
    pub(super) moving: MomentStep,
    pub(super) along: WeightStep,
}

impl InplaceOp1 for Step<'_> {
    fn name(&self) -> &'static str {
        "adam-step"
    }

    fn cpu_fwd(&self, weights: &mut CpuStorage, layout: &Layout) -> Result<()> {
        let (gradient, gradient_layout) = self.gradient.storage_and_layout();
        let gradient = numbers(cpu(&gradient)?, gradient_layout)?;
        let mut moments = self.moments.borrow_mut();
        let (mean, square) = &mut *moments;
        let MomentStep { betas: (beta1, beta2), scale, l2 } = self.moving;
        let WeightStep { rate, root_correction2, epsilon, kept } = self.along;
        numbers_mut(weights, layout)?
            .par_chunks_mut(CHUNK)
            .zip(gradient.par_chunks(CHUNK))
            .zip(mean.par_chunks_mut(CHUNK).zip(square.par_chunks_mut(CHUNK)))
            .for_each(|((weights, gradient), (mean, square))| {
                let pairs = weights.iter_mut().zip(gradient);
                for ((weight, g), (m, v)) in pairs.zip(mean.iter_mut().zip(square)) {
                    let g = scale * g + l2 * *weight;
                    *m = normal(beta1 * *m + (1.0 - beta1) * g);
                    *v = normal(beta2 * *v + (1.0 - beta2) * g * g);
                    *weight -= rate * *m / (v.sqrt() / root_correction2 + epsilon);
                    *weight *= kept;
                }
            });
        Ok(())
    }
}
