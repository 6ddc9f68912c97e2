//! Probability of improvement of one method over another.

use super::{Bootstrap, Estimate, Result, Scores};

/// Probability that a run of `x` scores higher than a run of `y` on the same task, averaged over tasks. For each task,
/// this is the Mann-Whitney statistic `U / (n_x · n_y)`, where `U` counts the pairs of runs in which `x` scores higher,
/// plus half of the ties. (Agarwal et al. 2021, section 4; rliable 1.2.0, `metrics.py`, whose special case for
/// identical runs, 0.5, follows from `U`.)
///
/// ```
/// use hksl_report::statistics::{Scores, probability_of_improvement};
///
/// let x = Scores::from_rows(&[[0.1, 0.9], [0.5, 0.8], [0.3, 1.2], [0.7, 0.4], [0.2, 0.6]])?;
/// let y = Scores::from_rows(&[[0.2, 0.5], [0.5, 0.7], [0.1, 0.9], [0.4, 0.4], [0.6, 0.3]])?;
/// assert!((probability_of_improvement(&x, &y)? - 0.61).abs() < 1e-12); // of 0.5 and 0.72
/// # Ok::<(), hksl_report::statistics::Error>(())
/// ```
///
/// # Errors
/// Scores on different tasks.
pub fn probability_of_improvement(x: &Scores, y: &Scores) -> Result<f64> {
    x.check_same_tasks(y)?;
    Ok(mean_over_tasks(x, y))
}

/// [`probability_of_improvement`] with its interval. The runs of `x` and `y` are resampled independently.
///
/// ```
/// use hksl_report::statistics::{Bootstrap, Scores, improvement_interval};
///
/// let x = Scores::new([("walker_walk", vec![0.8, 0.9, 0.7]), ("cheetah_run", vec![0.3, 0.4, 0.5])])?;
/// let y = Scores::new([("walker_walk", vec![0.1, 0.2, 0.3]), ("cheetah_run", vec![0.3, 0.4, 0.5])])?;
/// let estimate = improvement_interval(&x, &y, &Bootstrap::seeded(1, "hksl over drq"))?;
/// assert_eq!(estimate.point, 0.75); // of 1 and 0.5
/// assert!(estimate.low > 0.5 && estimate.high < 1.0);
/// # Ok::<(), hksl_report::statistics::Error>(())
/// ```
///
/// # Errors
/// Scores on different tasks, an invalid [`Bootstrap`].
pub fn improvement_interval(x: &Scores, y: &Scores, bootstrap: &Bootstrap) -> Result<Estimate> {
    let point = probability_of_improvement(x, y)?;
    let scratch = || (x.clone(), y.clone());
    let evaluate = |(of_x, of_y): &mut (Scores, Scores), picks: &[usize], row: &mut [f64]| {
        let (picks_x, picks_y) = picks.split_at(x.values().len());
        x.resample(picks_x, of_x);
        y.resample(picks_y, of_y);
        row[0] = mean_over_tasks(of_x, of_y);
    };
    let replicates = bootstrap.replicate(&[x, y], 1, scratch, evaluate)?;
    Ok(replicates.estimate(0, point))
}

fn mean_over_tasks(x: &Scores, y: &Scores) -> f64 {
    let tasks = x.tasks().zip(y.tasks());
    tasks.map(|((_, x), (_, y))| of_task(x, y)).sum::<f64>() / x.tasks().len() as f64
}

fn of_task(x: &[f64], y: &[f64]) -> f64 {
    // Counts in halves to stay in integers.
    let halves =
        |one: f64| y.iter().map(move |&two| 2 * u64::from(one > two) + u64::from(one == two));
    let total: u64 = x.iter().map(|&one| halves(one).sum::<u64>()).sum();
    total as f64 / (2.0 * x.len() as f64 * y.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::super::Error;
    use super::*;

    #[test]
    fn ties_count_half() {
        assert_eq!(of_task(&[1.0], &[1.0]), 0.5);
        assert_eq!(of_task(&[0.0], &[-0.0]), 0.5);
        assert_eq!(of_task(&[0.3, 0.1, 0.2, 0.2], &[0.3, 0.1, 0.2, 0.2]), 0.5);
        assert_eq!(of_task(&[1.0, 2.0], &[0.0, 1.0, 3.0]), (2.0 + 1.5) / 6.0);
    }

    #[test]
    fn the_other_way_round_it_is_the_rest() {
        let x = Scores::new([("a", vec![0.5, 0.25, 0.75]), ("b", vec![0.5])]).unwrap();
        let y = Scores::new([("a", vec![0.25]), ("b", vec![0.5, 1.0, 0.0, 1.0])]).unwrap();
        let [xy, yx] = [(&x, &y), (&y, &x)].map(|(x, y)| probability_of_improvement(x, y).unwrap());
        assert_eq!(xy + yx, 1.0);
    }

    #[test]
    fn tasks_have_to_be_the_same() {
        let scores = |name| Scores::new([(name, vec![1.0])]).unwrap();
        let (a, b) = (scores("a"), scores("b"));
        let error = improvement_interval(&a, &b, &Bootstrap::seeded(1, ""));
        assert!(matches!(error, Err(Error::Tasks { position: 0, .. })));
    }
}
