//! Status of a run.

/// Status of a run, according to its folder.
#[derive(Debug, Clone, PartialEq)]
pub enum Standing {
    /// Not started.
    NotBegun,
    /// A process is working on it, at this environment step according to its metrics.
    Running {
        /// Of the last line of its metrics.
        environment_step: u64,
    },
    /// Stopped or killed, saved at this environment step, and resumable.
    Stopped {
        /// Of the newest state.
        environment_step: u64,
    },
    /// It ended with an error.
    Failed {
        /// What went wrong.
        reason: String,
    },
    /// Its budget is used up.
    Done {
        /// Mean return of its last evaluation; NaN where its `eval.csv` cannot be read.
        last_return: f64,
    },
}
