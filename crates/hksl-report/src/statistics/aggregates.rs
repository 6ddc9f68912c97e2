//! Aggregates over runs and tasks.
//!
//! Definitions: Agarwal et al. 2021 (arXiv:2108.13264), section 4, and rliable 1.2.0, `metrics.py`.

use super::Scores;

/// An aggregate of all scores.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Aggregate {
    /// [`iqm`].
    Iqm,
    /// [`mean`].
    Mean,
    /// [`median`].
    Median,
    /// [`optimality_gap`].
    OptimalityGap {
        /// Score at which scores are clipped, usually 1.
        gamma: f64,
    },
}

impl Aggregate {
    /// Computes the aggregate of `scores`.
    pub fn of(self, scores: &Scores) -> f64 {
        match self {
            Self::Iqm => iqm(scores),
            Self::Mean => mean(scores),
            Self::Median => median(scores),
            Self::OptimalityGap { gamma } => optimality_gap(scores, gamma),
        }
    }
}

/// Interquartile mean: the mean of all scores of all tasks without the `⌊n/4⌋` lowest and the `⌊n/4⌋` highest, as
/// `scipy.stats.trim_mean`, which rliable uses. No score counts partially, and three or fewer all count. Tasks with
/// more runs weigh more.
///
/// ```
/// use hksl_report::statistics::{Scores, iqm};
///
/// let scores = Scores::from_rows(&[[0.1, 0.9], [0.5, 0.8], [0.3, 1.2], [0.7, 0.4], [0.2, 0.6]])?;
/// assert!((iqm(&scores) - 0.55).abs() < 1e-12); // without 0.1, 0.2 and 0.9, 1.2
/// # Ok::<(), hksl_report::statistics::Error>(())
/// ```
pub fn iqm(scores: &Scores) -> f64 {
    let mut values = scores.values().to_vec();
    let cut = iqm_cut(values.len());
    let mut kept = &mut values[..];
    if cut > 0 {
        // Selection moves the lowest scores before the kept ones, then the highest behind them.
        kept.select_nth_unstable_by(cut, f64::total_cmp);
        kept = &mut kept[cut..];
        let count = kept.len() - cut;
        kept.select_nth_unstable_by(count, f64::total_cmp);
        kept = &mut kept[..count];
    }
    kept.iter().sum::<f64>() / kept.len() as f64
}

/// Number of scores out of `count` that the interquartile mean omits at each end.
pub(super) fn iqm_cut(count: usize) -> usize {
    count / 4
}

/// Mean of the task means: every task weighs the same, whatever its number of runs.
///
/// ```
/// use hksl_report::statistics::{Scores, mean};
///
/// let scores = Scores::from_rows(&[[0.1, 0.9], [0.5, 0.8], [0.3, 1.2], [0.7, 0.4], [0.2, 0.6]])?;
/// assert!((mean(&scores) - 0.57).abs() < 1e-12); // of 0.36 and 0.78
/// let ragged = Scores::new([("a", vec![1.0]), ("b", vec![0.0, 0.0, 0.0])])?;
/// assert_eq!(mean(&ragged), 0.5);
/// # Ok::<(), hksl_report::statistics::Error>(())
/// ```
pub fn mean(scores: &Scores) -> f64 {
    scores.task_means().sum::<f64>() / scores.task_means().len() as f64
}

/// Median of the task means. For an even number of tasks, the mean of the middle two.
///
/// ```
/// use hksl_report::statistics::{Scores, median};
///
/// assert_eq!(median(&Scores::from_rows(&[[0.25, 0.75, 0.125], [0.5, 1.0, 0.125]])?), 0.375);
/// # Ok::<(), hksl_report::statistics::Error>(())
/// ```
pub fn median(scores: &Scores) -> f64 {
    let mut means: Vec<f64> = scores.task_means().collect();
    means.sort_unstable_by(f64::total_cmp);
    let middle = means.len() / 2;
    if means.len() % 2 == 1 { means[middle] } else { (means[middle - 1] + means[middle]) / 2.0 }
}

/// Optimality gap: `gamma` minus the mean of `min(score, gamma)`; 0 is best. Every task weighs the same, as in
/// [`mean`], so the gap is `gamma − mean` if no score exceeds `gamma`.
///
/// ```
/// use hksl_report::statistics::{Scores, optimality_gap};
///
/// let scores = Scores::from_rows(&[[0.1, 0.9], [0.5, 0.8], [0.3, 1.2], [0.7, 0.4], [0.2, 0.6]])?;
/// assert!((optimality_gap(&scores, 1.0) - 0.45).abs() < 1e-12);
/// # Ok::<(), hksl_report::statistics::Error>(())
/// ```
pub fn optimality_gap(scores: &Scores, gamma: f64) -> f64 {
    let clipped = |runs: &[f64]| runs.iter().map(|&score| score.min(gamma)).sum::<f64>();
    let means = scores.tasks().map(|(_, runs)| clipped(runs) / runs.len() as f64);
    gamma - means.sum::<f64>() / scores.tasks().len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cut_is_a_whole_number_of_scores() {
        let of = |count: usize| {
            let values = (0..count).rev().map(|value| (value * value) as f64).collect();
            iqm(&Scores::new([("a", values)]).unwrap())
        };
        assert_eq!(of(1), 0.0);
        assert_eq!(of(3), (0.0 + 1.0 + 4.0) / 3.0);
        assert_eq!(of(4), (1.0 + 4.0) / 2.0);
        assert_eq!(of(7), (1.0 + 4.0 + 9.0 + 16.0 + 25.0) / 5.0);
        assert_eq!(of(8), (4.0 + 9.0 + 16.0 + 25.0) / 4.0);
    }

    #[test]
    fn tasks_of_many_runs_weigh_more_in_the_interquartile_mean_only() {
        let scores = Scores::new([("a", vec![1.0]), ("b", vec![0.0, 0.0, 0.0])]).unwrap();
        assert_eq!(iqm(&scores), 0.0);
        assert_eq!([mean(&scores), median(&scores), optimality_gap(&scores, 1.0)], [0.5; 3]);
    }
}
