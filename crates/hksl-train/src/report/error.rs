//! Why there is nothing to report.

use std::path::PathBuf;

/// What keeps runs from being reported on together, and the way out.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Neither runs nor curves.
    #[error(
        "there is no run and no CSV file of curves in {}: `hksl train` and `hksl sweep` leave runs in folders with a \
         config.toml",
        listed(sources)
    )]
    Empty {
        /// Where they were looked for.
        sources: Vec<PathBuf>,
    },

    /// Filters that leave nothing.
    #[error("no run is left: of {kind} there are {}, and {} asked for", there.join(", "), asked.join(", "))]
    FilteredOut {
        /// `methods` or `tasks`.
        kind: &'static str,
        /// Those there are.
        there: Vec<String>,
        /// Those asked for.
        asked: Vec<String>,
    },

    /// Two runs that claim the same cell.
    #[error(
        "{} and {} are both {cell}: report on one of them, or rename one's folder (its name, as in hksl-NAME, is what \
         the report calls it)",
        first.display(),
        second.display()
    )]
    SameCell {
        /// Method, task and seed.
        cell: String,
        /// One run.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },

    /// Runs of different lengths in one comparison.
    #[error(
        "{} has a budget of {} environment steps, and {} of {}: compare them where both have been (--at {}), or leave \
         one out (--methods, --tasks)",
        first.0.display(),
        first.1,
        second.0.display(),
        second.1,
        first.1.min(second.1)
    )]
    Budgets {
        /// A run and its budget.
        first: (PathBuf, u64),
        /// Another and its.
        second: (PathBuf, u64),
    },

    /// Runs that were evaluated at different steps in one comparison.
    #[error(
        "{} was evaluated at environment step {step}, and {}, which went further, was not: keep the evaluations that \
         both have (--every STEPS), or leave one out (--methods, --tasks)",
        with.display(),
        without.display()
    )]
    EvaluationPoints {
        /// The step.
        step: u64,
        /// A run that was evaluated there.
        with: PathBuf,
        /// One that was not.
        without: PathBuf,
    },

    /// A fault of the page's template or of a table, not of the runs.
    #[error("the report cannot be put together: {reason}")]
    Page {
        /// Why.
        reason: String,
    },
}

fn listed(sources: &[PathBuf]) -> String {
    let names: Vec<_> = sources.iter().map(|source| source.display().to_string()).collect();
    names.join(", ")
}
