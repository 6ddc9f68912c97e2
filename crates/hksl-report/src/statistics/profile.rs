//! Performance profiles: distributions of scores.

use super::{Bootstrap, Error, Estimate, Result, Scores};

/// Unit that a performance profile counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProfileOf {
    /// Runs: [`performance_profile`].
    Runs,
    /// Tasks: [`profile_of_means`].
    TaskMeans,
}

/// Run-score distribution: for each threshold of `taus`, in any order, the fraction of all runs of all tasks with a
/// strictly higher score. (Agarwal et al. 2021, section 4; rliable 1.2.0, `run_score_deviation`.)
///
/// ```
/// use hksl_report::statistics::{Scores, performance_profile};
///
/// let scores = Scores::from_rows(&[[0.1, 0.9], [0.5, 0.8], [0.3, 1.2], [0.7, 0.4], [0.2, 0.6]])?;
/// assert_eq!(performance_profile(&scores, &[0.0, 0.5, 1.2])?, [1.0, 0.5, 0.0]);
/// # Ok::<(), hksl_report::statistics::Error>(())
/// ```
///
/// # Errors
/// A threshold that is not a number.
pub fn performance_profile(scores: &Scores, taus: &[f64]) -> Result<Vec<f64>> {
    let thresholds = Thresholds::new(taus)?;
    Ok(thresholds.profile(scores.values().iter().copied()))
}

/// Fraction of tasks whose mean over runs is strictly above each threshold. It shows less than [`performance_profile`]
/// and is less certain. (rliable 1.2.0, `mean_score_deviation`.)
///
/// ```
/// use hksl_report::statistics::{Scores, profile_of_means};
///
/// let scores = Scores::from_rows(&[[0.25, 0.5], [0.75, 1.0]])?; // means of 0.5 and 0.75
/// assert_eq!(profile_of_means(&scores, &[0.4, 0.5, 0.6, 0.75])?, [1.0, 0.5, 0.5, 0.0]);
/// # Ok::<(), hksl_report::statistics::Error>(())
/// ```
///
/// # Errors
/// A threshold that is not a number.
pub fn profile_of_means(scores: &Scores, taus: &[f64]) -> Result<Vec<f64>> {
    Ok(Thresholds::new(taus)?.profile(scores.task_means()))
}

/// Profile with an interval at each threshold. All thresholds share the replicates.
///
/// ```
/// use hksl_report::statistics::{Bootstrap, ProfileOf, Scores, profile_intervals};
///
/// let scores = Scores::from_rows(&[[0.1, 0.9], [0.5, 0.8], [0.3, 1.2], [0.7, 0.4], [0.2, 0.6]])?;
/// let bootstrap = Bootstrap::for_profiles(1, "hksl");
/// let profile = profile_intervals(&scores, &[0.05, 0.5], ProfileOf::Runs, &bootstrap)?;
/// assert_eq!([profile[0].point, profile[0].low, profile[0].high], [1.0, 1.0, 1.0]);
/// assert!(profile[1].point == 0.5 && profile[1].low == 0.3 && (profile[1].high - 0.7).abs() < 0.01);
/// # Ok::<(), hksl_report::statistics::Error>(())
/// ```
///
/// # Errors
/// A threshold that is NaN, an invalid [`Bootstrap`].
pub fn profile_intervals(
    scores: &Scores,
    taus: &[f64],
    of: ProfileOf,
    bootstrap: &Bootstrap,
) -> Result<Vec<Estimate>> {
    let thresholds = Thresholds::new(taus)?;
    // For runs, the number of thresholds below each score is computed once, not in every replicate.
    let above: Vec<usize> = scores.values().iter().map(|&value| thresholds.below(value)).collect();
    let scratch = || (scores.clone(), thresholds.counts());
    let evaluate =
        |(resample, counts): &mut (Scores, Vec<usize>), picks: &[usize], row: &mut [f64]| {
            match of {
                ProfileOf::Runs => picks.iter().for_each(|&pick| counts[above[pick]] += 1),
                ProfileOf::TaskMeans => {
                    scores.resample(picks, resample);
                    resample.task_means().for_each(|mean| counts[thresholds.below(mean)] += 1);
                }
            }
            thresholds.fractions(counts, row);
        };
    let points = match of {
        ProfileOf::Runs => thresholds.profile(scores.values().iter().copied()),
        ProfileOf::TaskMeans => thresholds.profile(scores.task_means()),
    };
    let replicates = bootstrap.replicate(&[scores], taus.len(), scratch, evaluate)?;
    Ok(replicates.estimates(points))
}

/// Sorted thresholds with their original positions.
struct Thresholds {
    sorted: Vec<f64>,
    positions: Vec<usize>,
}

impl Thresholds {
    fn new(taus: &[f64]) -> Result<Self> {
        if let Some(position) = taus.iter().position(|tau| tau.is_nan()) {
            return Err(Error::Threshold { position });
        }
        let mut positions: Vec<usize> = (0..taus.len()).collect();
        positions.sort_by(|&one, &other| taus[one].total_cmp(&taus[other]));
        Ok(Self { sorted: positions.iter().map(|&position| taus[position]).collect(), positions })
    }

    /// Number of thresholds strictly below `value`.
    fn below(&self, value: f64) -> usize {
        self.sorted.partition_point(|&tau| tau < value)
    }

    /// Zeroed counters of values above no threshold, above one, and so on.
    fn counts(&self) -> Vec<usize> {
        vec![0; self.sorted.len() + 1]
    }

    fn profile(&self, values: impl Iterator<Item = f64>) -> Vec<f64> {
        let mut counts = self.counts();
        values.for_each(|value| counts[self.below(value)] += 1);
        let mut fractions = vec![0.0; self.sorted.len()];
        self.fractions(&mut counts, &mut fractions);
        fractions
    }

    /// Fraction of values above each threshold, in the original order of thresholds. Resets `counts` to 0.
    fn fractions(&self, counts: &mut [usize], fractions: &mut [f64]) {
        let total = counts.iter().sum::<usize>() as f64;
        let mut above = 0;
        for (&position, count) in self.positions.iter().zip(&counts[1..]).rev() {
            above += count;
            fractions[position] = above as f64 / total;
        }
        counts.fill(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scores() -> Scores {
        Scores::from_rows(&[[0.0, 0.25], [0.5, 0.75], [0.5, 1.0]]).unwrap()
    }

    #[test]
    fn thresholds_may_be_in_any_order_and_repeat() {
        let taus = [0.5, f64::INFINITY, -0.0, 0.25, 0.5, f64::NEG_INFINITY];
        let expected = [2.0, 0.0, 5.0, 4.0, 2.0, 6.0].map(|count| count / 6.0);
        assert_eq!(performance_profile(&scores(), &taus).unwrap(), expected);
        assert_eq!(performance_profile(&scores(), &[]).unwrap(), [0.0; 0]);
    }

    #[test]
    fn intervals_hold_the_whole_profile() {
        let taus = [0.9, 0.1, 0.4];
        let bootstrap = Bootstrap::for_profiles(1, "profile");
        for of in [ProfileOf::Runs, ProfileOf::TaskMeans] {
            let intervals = profile_intervals(&scores(), &taus, of, &bootstrap).unwrap();
            let points = match of {
                ProfileOf::Runs => performance_profile(&scores(), &taus).unwrap(),
                ProfileOf::TaskMeans => profile_of_means(&scores(), &taus).unwrap(),
            };
            assert_eq!(intervals.iter().map(|one| one.point).collect::<Vec<_>>(), points);
            assert!(intervals.iter().all(|one| one.low <= one.point && one.point <= one.high));
            assert_eq!(profile_intervals(&scores(), &[], of, &bootstrap), Ok(Vec::new()));
        }
    }

    #[test]
    fn a_threshold_is_a_number() {
        let error = Err(Error::Threshold { position: 1 });
        assert_eq!(performance_profile(&scores(), &[0.5, f64::NAN]), error);
        assert_eq!(profile_of_means(&scores(), &[0.5, f64::NAN]), error);
    }
}
