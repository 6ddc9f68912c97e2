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

/// More would fill memory, and place bounds no better than anyone can see: they vary with 1/√replicates.
pub const MOST_REPLICATES: usize = 1_000_000;

/// How intervals are found.
///
/// A replicate holds, for each task independently, as many runs as the task has, drawn with replacement; the tasks are
/// always the same ones. An interval of confidence `c` reaches from the `100 (1 − c)/2`-th to the `100 (1 + c)/2`-th
/// [`percentile`](super::percentile) of a statistic over all replicates. It is not centred at the statistic of the
/// scores themselves, and need not contain it. It says how the statistic would vary with other runs of the same tasks
/// (Agarwal et al. 2021, section 4; rliable 1.2.0, `StratifiedBootstrap` with the method `percentile`).
#[derive(Debug, Clone, PartialEq)]
pub struct Bootstrap {
    /// The share of replicates that an interval spans.
    pub confidence: f64,
    /// Where replicates come from.
    pub resampling: Resampling,
}

/// Where replicates come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Resampling {
    /// They are drawn, the same ones on any number of threads.
    Drawn {
        /// How many.
        replicates: usize,
        /// The seed.
        seed: u64,
        /// What tells these draws from others with the same seed, such as the method's name. The same name with scores
        /// of the same shape draws the same runs.
        stream: String,
    },
    /// They are given, as indices of runs: replicate, task, draw. A statistic of several matrices, such as those of
    /// two methods or of all checkpoints, takes the tasks of the first, then those of the second, …
    Given(Vec<Vec<Vec<usize>>>),
}

impl Bootstrap {
    /// So many replicates, from random numbers of this seed and name, and rliable's [`CONFIDENCE`].
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

    /// Replicates that are known already.
    pub fn given(indices: Vec<Vec<Vec<usize>>>) -> Self {
        Self { confidence: CONFIDENCE, resampling: Resampling::Given(indices) }
    }

    /// Replicates of each matrix's runs, `outputs` numbers for each as `evaluate` writes them; replicate by replicate.
    ///
    /// `evaluate` gets what `scratch` made for its thread, and for each value of each matrix the position, in that
    /// matrix, of the value that takes its place.
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
                // Scratch for a thread's blocks, not for each of them.
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

/// What a statistic was in each replicate.
pub(super) struct Replicates {
    confidence: f64,
    outputs: usize,
    /// Replicate by replicate.
    values: Vec<f64>,
}

impl Replicates {
    /// The output at this position, which is `point` for the scores themselves, and its interval.
    pub(super) fn estimate(&self, output: usize, point: f64) -> Estimate {
        let values = self.values.iter().skip(output).step_by(self.outputs);
        let mut values: Vec<f64> = values.copied().collect();
        let tail = 100.0 * ((1.0 - self.confidence) / 2.0);
        let (low, high) = (select(&mut values, tail), select(&mut values, 100.0 - tail));
        Estimate { point, low, high }
    }

    /// Every output.
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
