//! Fast interquartile means of resampled scores.

use super::Scores;
use super::aggregates::iqm_cut;

/// Scores, sorted once. The interquartile mean of a resample then follows from how often each score was drawn, without
/// sorting the resample.
pub(super) struct Ranked {
    sorted: Vec<f64>,
    /// Rank of each score.
    ranks: Vec<usize>,
}

impl Ranked {
    pub(super) fn new(scores: &Scores) -> Self {
        let values = scores.values();
        let mut order: Vec<usize> = (0..values.len()).collect();
        order.sort_by(|&one, &other| values[one].total_cmp(&values[other]));
        let mut ranks = vec![0; values.len()];
        order.iter().enumerate().for_each(|(rank, &cell)| ranks[cell] = rank);
        Self { sorted: order.iter().map(|&cell| values[cell]).collect(), ranks }
    }

    /// Interquartile mean of the scores at `picks`, as many as there are scores. `counts` must contain a 0 for each
    /// score and is reset to 0.
    pub(super) fn iqm(&self, picks: &[usize], counts: &mut [usize]) -> f64 {
        let counts = &mut counts[..self.sorted.len()];
        for &pick in picks {
            counts[self.ranks[pick]] += 1;
        }
        let cut = iqm_cut(picks.len());
        let end = picks.len() - cut;
        // Each score occupies `count` positions of the sorted resample. Positions from `cut` to `end` are kept.
        let (mut place, mut sum) = (0, 0.0);
        for (count, value) in counts.iter_mut().zip(&self.sorted) {
            let next = place + *count;
            let kept = next.clamp(cut, end) - place.clamp(cut, end);
            sum += kept as f64 * value;
            place = next;
            *count = 0;
        }
        sum / (end - cut) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::super::{draws, iqm};
    use super::*;

    #[test]
    fn it_is_the_interquartile_mean_of_the_resample() {
        let tasks = [
            ("ragged", vec![0.3, -0.2, 0.9]),
            ("with ties", vec![0.5, 0.5, 0.9, 0.3, 0.3]),
            ("alone", vec![0.1]),
        ];
        let scores = Scores::new(tasks).unwrap();
        let strata = draws::strata(&[&scores]);
        let mut rng = draws::block_rng(1, "ranked", 0);
        let (ranked, mut resample) = (Ranked::new(&scores), scores.clone());
        let (mut picks, mut counts) = ([0; 9], [0; 12]);
        for _ in 0..1000 {
            draws::draw(&strata, &mut rng, &mut picks);
            scores.resample(&picks, &mut resample);
            assert!((ranked.iqm(&picks, &mut counts) - iqm(&resample)).abs() < 1e-12);
            assert_eq!(counts, [0; 12]);
        }
    }
}
