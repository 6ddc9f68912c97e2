//! Random resampling of runs for the bootstrap.

use rand::RngCore;
use rand_chacha::ChaCha8Rng;

use super::{Error, Result, Scores};

/// Replicates per block. Blocks are drawn in parallel. Another block size would change the numbers of a seed.
pub(super) const BLOCK: usize = 250;

/// Random words reserved for each block of replicates, more than any block uses.
const WORDS_PER_BLOCK: u128 = 1 << 40;

/// The runs of one task.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stratum {
    /// Position of the first run among the scores.
    start: usize,
    runs: usize,
    /// Number of indices drawn from one random word.
    batch: usize,
    /// Words with a smaller remainder are rejected: threshold for full batches and for the last, shorter batch.
    thresholds: [u64; 2],
}

impl Stratum {
    fn new(start: usize, runs: usize) -> Self {
        // At most a fraction runs^batch / 2^64 of the words is rejected. Large tasks use one word per index.
        let mut batch = 1;
        while batch < runs && (runs as u128).pow(batch as u32 + 1) <= 1 << 48 {
            batch += 1;
        }
        let threshold = |indices: usize| {
            let outcomes = (runs as u128).pow(indices as u32);
            ((1u128 << 64) % outcomes) as u64
        };
        Self { start, runs, batch, thresholds: [threshold(batch), threshold(runs % batch)] }
    }

    /// Fills `picks` with positions of random runs.
    ///
    /// Draws several exactly uniform indices from each random word, because generating words dominates the cost:
    /// Brackett-Rozinsky and Lemire, "Batched ranged random integer generation"
    /// ([arXiv:2408.06213](https://arxiv.org/abs/2408.06213)).
    fn draw(&self, rng: &mut ChaCha8Rng, picks: &mut [usize]) {
        for indices in picks.chunks_mut(self.batch) {
            let threshold = self.thresholds[usize::from(indices.len() < self.batch)];
            loop {
                let mut rest = rng.next_u64();
                for index in indices.iter_mut() {
                    let product = u128::from(rest) * self.runs as u128;
                    *index = self.start + (product >> 64) as usize;
                    rest = product as u64;
                }
                if rest >= threshold {
                    break;
                }
            }
        }
    }
}

/// Strata of several matrices of scores: the tasks of the first, then those of the second, and so on.
pub(super) fn strata(matrices: &[&Scores]) -> Vec<Stratum> {
    let mut strata = Vec::new();
    for scores in matrices {
        let mut start = 0;
        for (_, runs) in scores.tasks() {
            strata.push(Stratum::new(start, runs.len()));
            start += runs.len();
        }
    }
    strata
}

/// Draws a replicate: resamples the runs of each stratum with replacement.
pub(super) fn draw(strata: &[Stratum], rng: &mut ChaCha8Rng, mut picks: &mut [usize]) {
    for stratum in strata {
        let (own, others) = picks.split_at_mut(stratum.runs);
        stratum.draw(rng, own);
        picks = others;
    }
}

/// RNG of a block of replicates, at the block's position in the stream, so results do not depend on the thread.
pub(super) fn block_rng(seed: u64, stream: &str, block: usize) -> ChaCha8Rng {
    let mut rng = hksl_core::rng::stream(seed, stream);
    rng.set_word_pos(block as u128 * WORDS_PER_BLOCK);
    rng
}

/// Converts given indices of a replicate to positions among the scores.
///
/// # Errors
/// Wrong number of lists or indices, or an index out of range.
pub(super) fn given(
    strata: &[Stratum],
    replicate: usize,
    tasks: &[Vec<usize>],
) -> Result<Vec<usize>> {
    let wrong = |reason| Err(Error::Indices { replicate, reason });
    if tasks.len() != strata.len() {
        return wrong(format!("{} lists for {} tasks", tasks.len(), strata.len()));
    }
    let mut picks = Vec::new();
    for (task, (indices, stratum)) in tasks.iter().zip(strata).enumerate() {
        let runs = stratum.runs;
        if indices.len() != runs {
            return wrong(format!("list {task} has {} for {runs} runs", indices.len()));
        }
        if let Some(index) = indices.iter().find(|&&index| index >= runs) {
            return wrong(format!("list {task} has run {index} (from 0) of only {runs}"));
        }
        picks.extend(indices.iter().map(|index| stratum.start + index));
    }
    Ok(picks)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pearson's chi-squared statistic for equal counts, in standard deviations above its mean.
    fn excess(counts: &[usize]) -> f64 {
        let expected = counts.iter().sum::<usize>() as f64 / counts.len() as f64;
        let squares = counts.iter().map(|&count| (count as f64 - expected).powi(2));
        let freedom = (counts.len() - 1) as f64;
        (squares.sum::<f64>() / expected - freedom) / (2.0 * freedom).sqrt()
    }

    #[test]
    fn runs_and_pairs_of_runs_have_equal_chances() {
        for runs in [2, 3, 5, 10, 30] {
            let stratum = Stratum::new(7, runs);
            let (mut singles, mut pairs) = (vec![0; runs], vec![0; runs * runs]);
            let mut rng = block_rng(3, "chances", 0);
            let mut picks = vec![0; runs];
            for _ in 0..100_000 / runs {
                stratum.draw(&mut rng, &mut picks);
                picks.iter().for_each(|&pick| singles[pick - 7] += 1);
                picks.windows(2).for_each(|two| pairs[(two[0] - 7) * runs + two[1] - 7] += 1);
            }
            assert!(excess(&singles).abs() < 4.0, "{runs}: {singles:?}");
            assert!(excess(&pairs).abs() < 4.0, "{runs}: {pairs:?}");
        }
    }

    #[test]
    fn batches_end_where_words_do() {
        let batch = |runs| Stratum::new(0, runs).batch;
        assert_eq!([batch(1), batch(2), batch(5), batch(10), batch(30)], [1, 2, 5, 10, 9]);
        assert_eq!([batch(1 << 24), batch(1 << 25), batch(1 << 60)], [2, 1, 1]);
        assert_eq!(Stratum::new(0, 5).thresholds[0], ((1u128 << 64) % 3125) as u64);
        assert_eq!(Stratum::new(0, 30).thresholds[1], ((1u128 << 64) % 27_000) as u64);
    }

    #[test]
    fn blocks_and_names_have_numbers_of_their_own() {
        let first = |seed, stream, block| block_rng(seed, stream, block).next_u64();
        assert_eq!(first(1, "a", 2), first(1, "a", 2));
        let others = [first(1, "a", 0), first(1, "a", 1), first(1, "b", 0), first(2, "a", 0)];
        for (position, one) in others.iter().enumerate() {
            assert!(!others[..position].contains(one));
        }
    }

    #[test]
    fn given_indices_have_to_fit() {
        let scores = Scores::new([("a", vec![1.0, 2.0]), ("b", vec![3.0])]).unwrap();
        let strata = strata(&[&scores, &scores]);
        let picks = given(&strata, 0, &[vec![1, 1], vec![0], vec![0, 1], vec![0]]);
        assert_eq!(picks, Ok(vec![1, 1, 2, 0, 1, 2]));
        let message = |tasks: &[Vec<usize>]| {
            let text = given(&strata[..2], 4, tasks).unwrap_err().to_string();
            text.trim_start_matches("resampling indices of replicate 4 (from 0): ").to_owned()
        };
        assert_eq!(message(&[vec![0, 0]]), "1 lists for 2 tasks");
        assert_eq!(message(&[vec![0, 0], vec![]]), "list 1 has 0 for 1 runs");
        assert_eq!(message(&[vec![0, 2], vec![0]]), "list 0 has run 2 (from 0) of only 2");
    }
}
