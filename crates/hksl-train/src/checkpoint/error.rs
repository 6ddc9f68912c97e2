//! Why there is no checkpoint to go on from.

use std::path::PathBuf;

/// What a run's checkpoints lack.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A checkpoint that is not there.
    #[error("there is no checkpoint at environment step {step}; {}", steps_there(*step, steps))]
    NoCheckpoint {
        /// The step asked for.
        step: u64,
        /// The steps there are.
        steps: Vec<u64>,
    },

    /// A run that has not saved anything yet.
    #[error("{} holds no checkpoint; a run saves its first with its first evaluation", folder.display())]
    NoCheckpoints {
        /// Where they would be.
        folder: PathBuf,
    },

    /// Checkpoints without any state to go on from.
    #[error(
        "{} holds weights, but no state to go on from (no checkpoint has a folder `state`); choose another --name or \
         --runs folder to begin anew",
        folder.display()
    )]
    NoState {
        /// The checkpoints' folder.
        folder: PathBuf,
    },

    /// Weights that are not those of a run's agent.
    #[error(
        "the checkpoint at {environment_step} does not hold the weights of a {method} agent of this run's sizes: \
         {reason}; a run's checkpoints and its config.toml belong together"
    )]
    OtherWeights {
        /// Its environment step.
        environment_step: u64,
        /// The run's method.
        method: String,
        /// What does not fit.
        reason: String,
    },
}

/// Which steps there are; of many, the nearest to the one asked for.
fn steps_there(asked: u64, steps: &[u64]) -> String {
    const MANY: usize = 6;
    let mut shown = steps.to_vec();
    shown.sort_by_key(|step| step.abs_diff(asked));
    shown.truncate(MANY);
    shown.sort_unstable();
    let list = shown.iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
    match steps.len() {
        0 => "the run has none yet".to_owned(),
        count if count <= MANY => format!("there are {list}"),
        count => format!("there are {count}, the nearest {list}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_steps_the_nearest_are_named() {
        let steps: Vec<u64> = (0..11).map(|index| 10_000 * index).collect();
        assert_eq!(steps_there(5, &[]), "the run has none yet");
        assert_eq!(steps_there(5, &steps[..2]), "there are 0, 10000");
        let text = steps_there(77_777, &steps);
        assert_eq!(text, "there are 11, the nearest 50000, 60000, 70000, 80000, 90000, 100000");
    }
}
