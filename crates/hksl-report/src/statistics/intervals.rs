//! Point estimates with confidence intervals.

use super::ranked::Ranked;
use super::{Aggregate, Bootstrap, Error, Result, Scores};

/// A statistic and its interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Point estimate: the statistic of the original scores.
    pub point: f64,
    /// The interval's lower bound.
    pub low: f64,
    /// The interval's upper bound.
    pub high: f64,
}

/// Checks a point estimate.
///
/// # Errors
/// NaN or infinity.
fn finite(point: f64) -> Result<f64> {
    if point.is_finite() {
        return Ok(point);
    }
    Err(Error::Statistic { sample: "the given scores".to_owned(), value: point })
}

/// Interval of any statistic. `statistic` is called with the scores of each replicate, which have the same tasks and
/// numbers of runs.
///
/// ```
/// use hksl_report::statistics::{Bootstrap, Scores, interval};
///
/// let scores = Scores::from_rows(&[[0.1, 0.9], [0.5, 0.8], [0.3, 1.2], [0.7, 0.4], [0.2, 0.6]])?;
/// let best = |scores: &Scores| scores.values().iter().copied().fold(0.0, f64::max);
/// let estimate = interval(&scores, best, &Bootstrap::seeded(1, "best"))?;
/// assert_eq!([estimate.point, estimate.low, estimate.high], [1.2, 0.8, 1.2]);
/// # Ok::<(), hksl_report::statistics::Error>(())
/// ```
///
/// # Errors
/// A statistic that is NaN or infinite, an invalid [`Bootstrap`].
pub fn interval(
    scores: &Scores,
    statistic: impl Fn(&Scores) -> f64 + Sync + Send,
    bootstrap: &Bootstrap,
) -> Result<Estimate> {
    let point = finite(statistic(scores))?;
    let evaluate = |resample: &mut Scores, picks: &[usize], row: &mut [f64]| {
        scores.resample(picks, resample);
        row[0] = statistic(resample);
    };
    let replicates = bootstrap.replicate(&[scores], 1, || scores.clone(), evaluate)?;
    Ok(replicates.estimate(0, point))
}

/// Intervals of several aggregates from the same replicates, faster than [`interval`].
///
/// ```
/// use hksl_report::statistics::{Aggregate, Bootstrap, Scores, aggregate_intervals};
///
/// let scores = Scores::from_rows(&[[0.1, 0.9], [0.5, 0.8], [0.3, 1.2], [0.7, 0.4], [0.2, 0.6]])?;
/// let aggregates = [Aggregate::Iqm, Aggregate::OptimalityGap { gamma: 1.0 }];
/// let estimates = aggregate_intervals(&scores, &aggregates, &Bootstrap::seeded(1, "hksl"))?;
/// let [iqm, gap] = estimates[..] else { unreachable!() };
/// assert!((iqm.point - 0.55).abs() < 1e-12 && (gap.point - 0.45).abs() < 1e-12);
/// assert!((iqm.low - 0.383).abs() < 0.01 && (iqm.high - 0.733).abs() < 0.01);
/// # Ok::<(), hksl_report::statistics::Error>(())
/// ```
///
/// # Errors
/// As [`interval`].
pub fn aggregate_intervals(
    scores: &Scores,
    aggregates: &[Aggregate],
    bootstrap: &Bootstrap,
) -> Result<Vec<Estimate>> {
    intervals_of(&[scores], aggregates, bootstrap)
}

/// All aggregates of the first matrix, then those of the second, and so on.
pub(super) fn intervals_of(
    matrices: &[&Scores],
    aggregates: &[Aggregate],
    bootstrap: &Bootstrap,
) -> Result<Vec<Estimate>> {
    let ranked: Vec<Ranked> = matrices.iter().map(|scores| Ranked::new(scores)).collect();
    let largest = matrices.iter().map(|scores| scores.values().len()).max().unwrap_or(0);
    // The interquartile mean needs only ranks.
    let resamples = aggregates.iter().any(|&aggregate| aggregate != Aggregate::Iqm);
    let scratch = || (vec![0; largest], matrices.iter().copied().cloned().collect::<Vec<_>>());
    type Scratch = (Vec<usize>, Vec<Scores>);
    let evaluate = |(counts, resampled): &mut Scratch, mut picks: &[usize], row: &mut [f64]| {
        let all = matrices.iter().zip(&ranked).zip(resampled).zip(row.chunks_mut(aggregates.len()));
        for (((scores, ranked), resample), numbers) in all {
            let (own, others) = picks.split_at(scores.values().len());
            picks = others;
            if resamples {
                scores.resample(own, resample);
            }
            for (number, &aggregate) in numbers.iter_mut().zip(aggregates) {
                *number = match aggregate {
                    Aggregate::Iqm => ranked.iqm(own, counts),
                    other => other.of(resample),
                };
            }
        }
    };
    let points = matrices.iter().flat_map(|scores| aggregates.iter().map(|one| one.of(scores)));
    let points = points.map(finite).collect::<Result<Vec<f64>>>()?;
    let replicates = bootstrap.replicate(matrices, points.len(), scratch, evaluate)?;
    Ok(replicates.estimates(points))
}
