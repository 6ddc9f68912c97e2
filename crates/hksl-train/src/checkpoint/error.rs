//! Errors of checkpoints.

use std::path::PathBuf;

/// A missing or unsuitable checkpoint.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No checkpoint at the requested step.
    #[error("no checkpoint at environment step {step}; {}", steps_there(*step, steps))]
    NoCheckpoint {
        /// The requested step.
        step: u64,
        /// The available steps.
        steps: Vec<u64>,
    },

    /// A run without checkpoints.
    #[error("{} has no checkpoint; a run saves its first one at its first evaluation", folder.display())]
    NoCheckpoints {
        /// The checkpoints' folder.
        folder: PathBuf,
    },

    /// Checkpoints without a training state to resume from.
    #[error(
        "{} has weights but no state to resume from (no checkpoint has a `state` folder); choose another --name or \
         --runs folder to start a new run",
        folder.display()
    )]
    NoState {
        /// The checkpoints' folder.
        folder: PathBuf,
    },

    /// Weights that do not fit the run's agent.
    #[error(
        "the checkpoint at environment step {environment_step} does not fit the {method} agent of config.toml: \
         {reason}; use the config.toml that the run was trained with"
    )]
    OtherWeights {
        /// Its environment step.
        environment_step: u64,
        /// The run's method.
        method: String,
        /// The mismatch.
        reason: String,
    },
}

/// Lists the available steps; of many, those nearest to the requested one.
fn steps_there(asked: u64, steps: &[u64]) -> String {
    const MANY: usize = 6;
    let mut shown = steps.to_vec();
    shown.sort_by_key(|step| step.abs_diff(asked));
    shown.truncate(MANY);
    shown.sort_unstable();
    let list = shown.iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
    match steps.len() {
        0 => "the run has none yet".to_owned(),
        count if count <= MANY => format!("available: {list}"),
        count => format!("{count} are available, the nearest are {list}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_steps_the_nearest_are_named() {
        let steps: Vec<u64> = (0..11).map(|index| 10_000 * index).collect();
        assert_eq!(steps_there(5, &[]), "the run has none yet");
        assert_eq!(steps_there(5, &steps[..2]), "available: 0, 10000");
        let text = steps_there(77_777, &steps);
        assert_eq!(
            text,
            "11 are available, the nearest are 50000, 60000, 70000, 80000, 90000, 100000"
        );
    }
}
