//! Where a run stands.

/// Where a run stands, as far as its folder says.
#[derive(Debug, Clone, PartialEq)]
pub enum Standing {
    /// It has not begun.
    NotBegun,
    /// A process works on it, at this environment step as far as is written.
    Running {
        /// Of the last line of its metrics.
        environment_step: u64,
    },
    /// It was stopped or cut off, saved at this environment step, and can go on.
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
