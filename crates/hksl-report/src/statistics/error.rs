//! The one error type of these statistics.

/// Why a statistic has no value.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Scores of nothing.
    #[error("there are no scores: not one task")]
    NoTask,

    /// A task that nothing is known about.
    #[error("{task} has no run; leave it out, or wait for its first")]
    NoRun {
        /// The task.
        task: String,
    },

    /// A score that is no number to compute with.
    #[error("{task}: the score of run {run}, counting from 0, is {value}, not a finite number")]
    NotFinite {
        /// The task.
        task: String,
        /// The run's position among the task's, from 0.
        run: usize,
        /// What it is.
        value: f64,
    },

    /// Rows of different lengths.
    #[error("row {run}, counting from 0, has {got} scores for {expected} tasks")]
    Row {
        /// The row's position, from 0.
        run: usize,
        /// Scores in it.
        got: usize,
        /// Scores in the first row.
        expected: usize,
    },

    /// Scores that were to be compared task by task, on other tasks.
    #[error("both should have the same tasks in the same order; at position {position}, {differ}")]
    Tasks {
        /// The first position at which they differ, from 0.
        position: usize,
        /// How.
        differ: String,
    },

    /// A percentage that is none.
    #[error("a percentile lies between 0 and 100, not at {got}")]
    Percent {
        /// The percentage asked for.
        got: f64,
    },

    /// A percentile of nothing.
    #[error("no numbers have no percentile")]
    NoValue,

    /// A percentile of what cannot be put in order.
    #[error("number {position}, counting from 0, is {value}: percentiles need finite ones")]
    Value {
        /// Its position, from 0.
        position: usize,
        /// What it is.
        value: f64,
    },

    /// A confidence that leaves nothing inside or outside of an interval.
    #[error(
        "the confidence of an interval is more than 0 and less than 1, 0.95 as a rule, not {got}"
    )]
    Confidence {
        /// The confidence asked for.
        got: f64,
    },

    /// No replicates, or more than are of use.
    #[error("a bootstrap takes from 1 to {most} replicates, 50000 as a rule, not {got}")]
    Replicates {
        /// Replicates asked for.
        got: usize,
        /// The largest number allowed.
        most: usize,
    },

    /// Given resampling indices that do not fit the scores.
    #[error("resampling indices of replicate {replicate}, counting from 0: {reason}")]
    Indices {
        /// The replicate's position, from 0.
        replicate: usize,
        /// What is wrong with them.
        reason: String,
    },

    /// A threshold that scores cannot be above or below.
    #[error("threshold {position} of the profile, counting from 0, is not a number")]
    Threshold {
        /// Its position, from 0.
        position: usize,
    },

    /// A statistic without a value.
    #[error("the statistic of {sample} is {value}, not a finite number")]
    Statistic {
        /// Of which scores: those given, or those of a replicate.
        sample: String,
        /// What it is.
        value: f64,
    },
}

/// Shorthand for results of these statistics.
pub type Result<T> = std::result::Result<T, Error>;
