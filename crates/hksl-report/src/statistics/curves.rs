//! Learning curves of aggregates.

use super::intervals::intervals_of;
use super::{Aggregate, Bootstrap, Estimate, Result, Scores};

/// A sample-efficiency curve: an aggregate at each checkpoint, with a pointwise interval.
///
/// Runs are resampled independently for each task and checkpoint, as in rliable for a matrix of runs × tasks ×
/// checkpoints. An interval holds for its own checkpoint and does not predict how a single run continues. (rliable
/// 1.2.0, `library.py`; Agarwal et al. 2021, section 4.)
///
/// ```
/// use hksl_report::statistics::{Aggregate, Bootstrap, Scores, curve};
///
/// let early = Scores::new([("walker_walk", vec![0.1, 0.3, 0.2]), ("cheetah_run", vec![0.1, 0.1, 0.1])])?;
/// let late = Scores::new([("walker_walk", vec![0.8, 0.9, 0.7]), ("cheetah_run", vec![0.3, 0.3, 0.3])])?;
/// let curve = curve(&[early, late], Aggregate::Mean, &Bootstrap::seeded(1, "hksl"))?;
/// assert!((curve[0].point - 0.15).abs() < 1e-12 && (curve[1].point - 0.55).abs() < 1e-12);
/// assert!(curve[0].high < curve[1].low);
/// # Ok::<(), hksl_report::statistics::Error>(())
/// ```
///
/// # Errors
/// Checkpoints of different tasks, and as [`interval`](super::interval).
pub fn curve(
    checkpoints: &[Scores],
    aggregate: Aggregate,
    bootstrap: &Bootstrap,
) -> Result<Vec<Estimate>> {
    for two in checkpoints.windows(2) {
        two[0].check_same_tasks(&two[1])?;
    }
    intervals_of(&checkpoints.iter().collect::<Vec<_>>(), &[aggregate], bootstrap)
}

#[cfg(test)]
mod tests {
    use super::super::{Error, draws};
    use super::*;

    #[test]
    fn checkpoints_may_differ_in_runs_but_not_in_tasks() {
        let at = |name, runs| Scores::new([(name, vec![0.5; runs])]).unwrap();
        let of = |checkpoints: &[Scores]| {
            curve(checkpoints, Aggregate::Iqm, &Bootstrap::seeded(1, "curve"))
        };
        assert_eq!(of(&[]), Ok(Vec::new()));
        let flat = Estimate { point: 0.5, low: 0.5, high: 0.5 };
        assert_eq!(of(&[at("a", 5), at("a", 3)]), Ok(vec![flat; 2]));
        assert!(matches!(of(&[at("a", 1), at("b", 1)]), Err(Error::Tasks { position: 0, .. })));
    }

    #[test]
    fn checkpoints_are_drawn_independently() {
        let scores = Scores::new([("a", vec![0.0; 5])]).unwrap();
        let strata = draws::strata(&[&scores, &scores]);
        let mut rng = draws::block_rng(1, "independent", 0);
        let (mut picks, mut products) = ([0; 10], 0.0);
        for _ in 0..2000 {
            draws::draw(&strata, &mut rng, &mut picks);
            let [one, other] = [&picks[..5], &picks[5..]]
                .map(|picks| picks.iter().map(|&pick| pick as f64 - 2.0).sum::<f64>());
            products += one * other;
        }
        // Each sum has mean 0 and variance 10, so the standard deviation of the correlation is 0.022.
        assert!((products / 2000.0 / 10.0).abs() < 0.1, "{products}");
    }
}
