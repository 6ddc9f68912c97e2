//! The error type of the statistics.

/// An invalid input of a statistic.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No task.
    #[error("no scores: at least one task is needed")]
    NoTask,

    /// A task without runs.
    #[error("{task} has no run; leave it out, or add at least one run")]
    NoRun {
        /// The task.
        task: String,
    },

    /// A score that is NaN or infinite.
    #[error("{task}: the score of run {run} (from 0) is {value}; scores must be finite")]
    NotFinite {
        /// The task.
        task: String,
        /// The run's position among the task's, from 0.
        run: usize,
        /// The value.
        value: f64,
    },

    /// Rows of different lengths.
    #[error("row {run} (from 0) has {got} scores for {expected} tasks")]
    Row {
        /// The row's position, from 0.
        run: usize,
        /// Scores in it.
        got: usize,
        /// Scores in the first row.
        expected: usize,
    },

    /// Scores on different tasks, which cannot be compared task by task.
    #[error("both must have the same tasks in the same order; at position {position}, {differ}")]
    Tasks {
        /// The first position at which they differ, from 0.
        position: usize,
        /// The difference.
        differ: String,
    },

    /// A percentage out of range.
    #[error("percentile {got} is out of range; it must be from 0 to 100")]
    Percent {
        /// The requested percentage.
        got: f64,
    },

    /// A percentile of an empty list.
    #[error("percentile of an empty list")]
    NoValue,

    /// A percentile of values that are not finite.
    #[error("value {position} (from 0) is {value}; percentiles need finite values")]
    Value {
        /// Its position, from 0.
        position: usize,
        /// The value.
        value: f64,
    },

    /// A confidence level out of range.
    #[error("confidence level {got} is out of range; it must be above 0 and below 1, as in 0.95")]
    Confidence {
        /// The requested confidence level.
        got: f64,
    },

    /// A number of replicates out of range.
    #[error("{got} bootstrap replicates are out of range; use from 1 to {most}, as in 50000")]
    Replicates {
        /// The requested replicates.
        got: usize,
        /// The largest number allowed.
        most: usize,
    },

    /// Resampling indices that do not match the scores.
    #[error("resampling indices of replicate {replicate} (from 0): {reason}")]
    Indices {
        /// The replicate's position, from 0.
        replicate: usize,
        /// The problem.
        reason: String,
    },

    /// A threshold that is NaN.
    #[error("threshold {position} (from 0) of the profile is NaN")]
    Threshold {
        /// Its position, from 0.
        position: usize,
    },

    /// A statistic that is NaN or infinite.
    #[error("the statistic of {sample} is {value}; it must be finite")]
    Statistic {
        /// The scores: the given ones, or those of a replicate.
        sample: String,
        /// The value.
        value: f64,
    },
}

/// Shorthand for results of these statistics.
pub type Result<T> = std::result::Result<T, Error>;
