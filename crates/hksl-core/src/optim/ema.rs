//! Moving averages of weights (Polyak averaging).

#[cfg(feature = "cuda")]
use candle_core::CudaStorage;
use candle_core::{CpuStorage, InplaceOp2, Layout, Result as CandleResult, Var};
use rayon::prelude::*;

#[cfg(feature = "cuda")]
use crate::kernels::moving_average;
use crate::on_host::{numbers, numbers_mut};
use crate::params::Parameters;
use crate::{Error, Result};

/// Soft updates `target ← target + τ · (source − target)` of pairs of parameters.
#[derive(Debug)]
pub struct MovingAverage {
    pairs: Vec<Pair>,
}

#[derive(Debug)]
struct Pair {
    source: Var,
    target: Var,
    tau: f64,
}

impl MovingAverage {
    /// Pairs every parameter under `target` with the parameter of the same name under `source`.
    ///
    /// # Errors
    /// [`Error::MissingParameter`] if the two have different names or no parameters; [`Error::ParameterShape`].
    pub fn new(parameters: &Parameters, source: &str, target: &str, tau: f64) -> Result<Self> {
        let (sources, targets) = (parameters.under(source), parameters.under(target));
        let pairs = sources
            .iter()
            .map(|(name, value)| {
                let twin = format!("{target}{}", &name[source.len()..]);
                let target = targets.get(&twin).cloned();
                let target = target.ok_or_else(|| Error::MissingParameter(twin.clone()))?;
                if target.dims() != value.dims() {
                    let (got, expected) = (target.dims().to_vec(), value.dims().to_vec());
                    return Err(Error::ParameterShape { name: twin, got, expected });
                }
                Ok(Pair { source: value.clone(), target, tau })
            })
            .collect::<Result<Vec<_>>>()?;
        if pairs.is_empty() || pairs.len() != targets.names().count() {
            return Err(Error::MissingParameter(format!("{source} (a part of {target})")));
        }
        Ok(Self { pairs })
    }

    /// Merges several averages, each with its own τ.
    pub fn merged(averages: impl IntoIterator<Item = Self>) -> Self {
        Self { pairs: averages.into_iter().flat_map(|average| average.pairs).collect() }
    }

    /// Applies the soft update. It changes targets in place, which invalidates the backward pass of graphs built on them
    /// before.
    pub fn update(&self) -> Result<()> {
        for Pair { source, target, tau } in &self.pairs {
            target.inplace_op2(source, &Blend { tau: *tau as f32 })?;
        }
        Ok(())
    }
}

struct Blend {
    tau: f32,
}

impl InplaceOp2 for Blend {
    fn name(&self) -> &'static str {
        "moving-average"
    }

    fn cpu_fwd(
        &self,
        target: &mut CpuStorage,
        target_layout: &Layout,
        source: &CpuStorage,
        source_layout: &Layout,
    ) -> CandleResult<()> {
        numbers_mut(target, target_layout)?
            .par_iter_mut()
            .with_min_len(1 << 14)
            .zip(numbers(source, source_layout)?)
            .for_each(|(target, source)| *target += self.tau * (source - *target));
        Ok(())
    }

    #[cfg(feature = "cuda")]
    fn cuda_fwd(
        &self,
        target: &mut CudaStorage,
        target_layout: &Layout,
        source: &CudaStorage,
        source_layout: &Layout,
    ) -> CandleResult<()> {
        moving_average(self.tau, (target, target_layout), (source, source_layout))
    }
}

#[cfg(test)]
mod tests {
    use candle_core::Device;

    use super::*;

    #[test]
    fn moves_a_share_of_the_way() {
        let mut parameters = Parameters::default();
        parameters.insert("a.x", Var::new(&[1f32, 2.], &Device::Cpu).unwrap()).unwrap();
        parameters.insert("b.x", Var::new(&[3f32, -2.], &Device::Cpu).unwrap()).unwrap();
        MovingAverage::new(&parameters, "a", "b", 0.25).unwrap().update().unwrap();
        assert_eq!(parameters.get("b.x").unwrap().to_vec1::<f32>().unwrap(), [2.5, -1.0]);
        assert_eq!(parameters.get("a.x").unwrap().to_vec1::<f32>().unwrap(), [1.0, 2.0]);
    }

    #[test]
    fn rejects_pairs_that_do_not_match() {
        let mut parameters = Parameters::default();
        parameters.insert("a.x", Var::new(&[1f32], &Device::Cpu).unwrap()).unwrap();
        parameters.insert("b.y", Var::new(&[1f32], &Device::Cpu).unwrap()).unwrap();
        assert!(MovingAverage::new(&parameters, "a", "b", 0.5).is_err());
        assert!(MovingAverage::new(&parameters, "misspelt", "nowhere", 0.5).is_err());
        parameters.insert("c.x", Var::new(&[1f32, 2.], &Device::Cpu).unwrap()).unwrap();
        let shapes = MovingAverage::new(&parameters, "a", "c", 0.5);
        assert!(matches!(shapes, Err(Error::ParameterShape { .. })), "{shapes:?}");
    }
}
