//! The stratified percentile bootstrap.

use rayon::prelude::*;

use super::draws::{self, BLOCK};
use super::percentiles::select;
use super::{Error, Estimate, Result, Scores};

/// rliable's default number of replicates for intervals of aggregates.
pub const REPLICATES: usize = 50_000;
/// rliable's default number of replicates for performance profiles.
pub const PROFILE_REPLICATES: usize = 2_000;
/// rliable's default confidence.
pub const CONFIDENCE: f64 = 0.95;

/// Largest number of replicates. The error of interval bounds falls only with 1/√replicates, and more would fill the
/// memory.
pub const MOST_REPLICATES: usize = 1_000_000;

/// Settings of the bootstrap.
///
/// For each replicate, the runs of each task are resampled with replacement, independently of other tasks; the tasks
/// are fixed. An interval of confidence level `c` spans the `100 (1 − c)/2`-th to the `100 (1 + c)/2`-th
/// [`percentile`](super::percentile) of the statistic over all replicates. It need not be centred at the point
/// estimate, nor contain it. It shows how the statistic would vary with other runs of the same tasks (Agarwal et al.
/// 2021, section 4; rliable 1.2.0, `StratifiedBootstrap` with the method `percentile`).
#[derive(Debug, Clone, PartialEq)]
pub struct Bootstrap {
    /// Confidence level.
    pub confidence: f64,
    /// Where replicates come from.
    pub resampling: Resampling,
}

/// Where replicates come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Resampling {
    /// Random resampling, identical for any number of threads.
    Drawn {
        /// Number of replicates.
        replicates: usize,
        /// Random seed.
        seed: u64,
        /// Name of the RNG stream, such as the method's name. Scores of the same shape with the same seed and stream
        /// name draw the same runs.
        stream: String,
    },
    /// Given indices of runs, by replicate, task and draw. A statistic of several matrices, such as two methods or all
    /// checkpoints, takes the tasks of the first matrix, then those of the second, and so on.
    Given(Vec<Vec<Vec<usize>>>),
}

impl Bootstrap {
    /// A bootstrap with this number of replicates, seed and stream name, and rliable's [`CONFIDENCE`].
    pub fn drawn(replicates: usize, seed: u64, stream: &str) -> Self {
        let stream = stream.to_owned();
        let resampling = Resampling::Drawn { replicates, seed, stream };
        Self { confidence: CONFIDENCE, resampling }
    }

    /// rliable's defaults for aggregates: [`REPLICATES`] and [`CONFIDENCE`].
    pub fn seeded(seed: u64, stream: &str) -> Self {
        Self::drawn(REPLICATES, seed, stream)
    }

    /// rliable's defaults for performance profiles: [`PROFILE_REPLICATES`] and [`CONFIDENCE`].
    pub fn for_profiles(seed: u64, stream: &str) -> Self {
        Self::drawn(PROFILE_REPLICATES, seed, stream)
    }

    /// A bootstrap with given indices of runs.
    pub fn given(indices: Vec<Vec<Vec<usize>>>) -> Self {
        Self { confidence: CONFIDENCE, resampling: Resampling::Given(indices) }
    }

    /// Evaluates `outputs` statistics on every replicate.
    ///
    /// `evaluate` receives scratch memory from `scratch`, allocated once per thread, and the resampled positions: for
    /// each value of each matrix, the position of its replacement in that matrix.
    pub(super) fn replicate<S>(
        &self,
        matrices: &[&Scores],
        outputs: usize,
        scratch: impl Fn() -> S + Sync + Send,
        evaluate: impl Fn(&mut S, &[usize], &mut [f64]) + Sync + Send,
    ) -> Result<Replicates> {
        if !(self.confidence > 0.0 && self.confidence < 1.0) {
            return Err(Error::Confidence { got: self.confidence });
        }
        let count = match &self.resampling {
            Resampling::Drawn { replicates, .. } => *replicates,
            Resampling::Given(replicates) => replicates.len(),
        };
        if !(1..=MOST_REPLICATES).contains(&count) {
            return Err(Error::Replicates { got: count, most: MOST_REPLICATES });
        }
        let confidence = self.confidence;
        if outputs == 0 {
            return Ok(Replicates { confidence, outputs, values: Vec::new() });
        }
        let strata = draws::strata(matrices);
        let mut values = vec![0.0; count * outputs];
        match &self.resampling {
            Resampling::Drawn { seed, stream, .. } => {
                let cells = matrices.iter().map(|scores| scores.values().len()).sum();
                // Each thread reuses its scratch memory for all its blocks.
                let state = || (scratch(), vec![0; cells]);
                let blocks = values.par_chunks_mut(BLOCK * outputs).enumerate();
                blocks.for_each_init(state, |(scratch, picks), (block, rows)| {
                    let mut rng = draws::block_rng(*seed, stream, block);
                    for row in rows.chunks_exact_mut(outputs) {
                        draws::draw(&strata, &mut rng, picks);
                        evaluate(scratch, picks, row);
                    }
                });
            }
            Resampling::Given(replicates) => {
                let mut scratch = scratch();
                let rows = values.chunks_exact_mut(outputs).zip(replicates);
                for (replicate, (row, tasks)) in rows.enumerate() {
                    let picks = draws::given(&strata, replicate, tasks)?;
                    evaluate(&mut scratch, &picks, row);
                }
            }
        }
        if let Some(position) = values.iter().position(|value| !value.is_finite()) {
            let sample = format!("replicate {} (from 0)", position / outputs);
            return Err(Error::Statistic { sample, value: values[position] });
        }
        Ok(Replicates { confidence, outputs, values })
    }
}

/// Statistics of all replicates.
pub(super) struct Replicates {
    confidence: f64,
    outputs: usize,
    /// Ordered by replicate, then output.
    values: Vec<f64>,
}

impl Replicates {
    /// Point estimate and interval of the output at this position.
    pub(super) fn estimate(&self, output: usize, point: f64) -> Estimate {
        let values = self.values.iter().skip(output).step_by(self.outputs);
        let mut values: Vec<f64> = values.copied().collect();
        let tail = 100.0 * ((1.0 - self.confidence) / 2.0);
        let (low, high) = (select(&mut values, tail), select(&mut values, 100.0 - tail));
        Estimate { point, low, high }
    }

    /// Estimates of all outputs.
    pub(super) fn estimates(&self, points: Vec<f64>) -> Vec<Estimate> {
        let points = points.into_par_iter().enumerate();
        points.map(|(output, point)| self.estimate(output, point)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Aggregate, aggregate_intervals, interval, mean};
    use super::*;

    fn scores() -> Scores {
        Scores::from_rows(&[[0.1, 0.9], [0.5, 0.8], [0.3, 1.2], [0.7, 0.4], [0.2, 0.6]]).unwrap()
    }

    #[test]
    fn numbers_do_not_depend_on_the_threads() {
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let aggregates = [Aggregate::Iqm, Aggregate::Mean, Aggregate::Median];
            let bootstrap = Bootstrap::seeded(5, "threads");
            pool.install(|| aggregate_intervals(&scores(), &aggregates, &bootstrap)).unwrap()
        };
        let one = on(1);
        assert_eq!(on(2), one);
        assert_eq!(on(7), one);
    }

    #[test]
    fn more_confidence_is_a_wider_interval() {
        let at = |confidence| {
            let bootstrap = Bootstrap { confidence, ..Bootstrap::seeded(5, "confidence") };
            interval(&scores(), mean, &bootstrap)
        };
        let (narrow, wide) = (at(0.5).unwrap(), at(0.99).unwrap());
        assert!(wide.low < narrow.low && narrow.low < narrow.high && narrow.high < wide.high);
        for confidence in [0.0, 1.0, f64::NAN] {
            assert!(matches!(at(confidence), Err(Error::Confidence { .. })));
        }
    }

    #[test]
    fn replicates_are_of_a_sensible_number() {
        for replicates in [0, usize::MAX] {
            let error = interval(&scores(), mean, &Bootstrap::drawn(replicates, 0, ""));
            assert_eq!(error, Err(Error::Replicates { got: replicates, most: MOST_REPLICATES }));
        }
    }

    #[test]
    fn statistics_without_a_value_are_named() {
        let bootstrap = Bootstrap::given(vec![vec![vec![0; 5]; 2], vec![vec![1; 5]; 2]]);
        let statistic = |sample: &Scores| 1.0 / (sample.values()[0] - 0.5);
        let message = interval(&scores(), statistic, &bootstrap).unwrap_err().to_string();
        let expected = "the statistic of replicate 1 (from 0) is inf; it must be finite";
        assert_eq!(message, expected);
        let message = interval(&scores(), |_| f64::NAN, &bootstrap).unwrap_err().to_string();
        assert_eq!(message, "the statistic of the given scores is NaN; it must be finite");
    }
}
