//! Why there is nothing to report.

use std::fmt;
use std::path::{Path, PathBuf};

/// What keeps runs from being reported on together, and the way out.
#[derive(Debug, thiserror::Error)]
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

    /// Nothing of what there is can be reported on.
    #[error("nothing can be reported on: {}", reasons.join("; "))]
    AllLeftOut {
        /// What there is, and why not.
        reasons: Vec<String>,
    },

    /// A file that holds no curves.
    #[error(
        "{} is no file of curves: it lacks {}. Curves have the columns agent, task, seed, frame and episode_reward, as \
         those that drqv2 published, or those of eval.csv",
        path.display(),
        lacking.join(", ")
    )]
    NoCurves {
        /// The file.
        path: PathBuf,
        /// The columns that it lacks of drqv2's or of eval.csv's, whichever are fewer.
        lacking: Vec<&'static str>,
    },

    /// A method or task that is not there.
    #[error("there is no run of {kind} {}; there are {}", unknown.join(", "), there.join(", "))]
    UnknownFilter {
        /// `method` or `task`.
        kind: &'static str,
        /// The names that are not there.
        unknown: Vec<String>,
        /// Those that are.
        there: Vec<String>,
    },

    /// Filters that leave nothing.
    #[error("no run that can be read is {}", asked_for(methods, tasks))]
    FilteredOut {
        /// Methods asked for.
        methods: Vec<String>,
        /// Tasks asked for.
        tasks: Vec<String>,
    },

    /// Two runs that claim the same cell.
    #[error(
        "{} and {} are both {cell}: report on one of them, or rename one: a run is called what its folder is, as in \
         hksl-NAME, a curve in a CSV file by its agent",
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
        "{} ({}) has a budget of {} environment steps, and {} ({}) of {}: {}choose --methods or --tasks, or report \
         without one of them",
        first.0,
        first.1.display(),
        first.2,
        second.0,
        second.1.display(),
        second.2,
        both.map_or_else(String::new, |step| format!("compare them where both were evaluated (--at {step}), "))
    )]
    Budgets {
        /// A run, where it is, and its budget.
        first: (String, PathBuf, u64),
        /// Another.
        second: Box<(String, PathBuf, u64)>,
        /// The last step, within both budgets, at which both were evaluated since they began to learn.
        both: Option<u64>,
    },

    /// Runs that were evaluated at different steps in one comparison.
    #[error(
        "{} ({}) was evaluated at environment step {step}, and {} ({}), which went further, was not: keep the \
         evaluations that both have (--every STEPS), choose --methods or --tasks, or report without one of them",
        with.0,
        with.1.display(),
        without.0,
        without.1.display()
    )]
    EvaluationPoints {
        /// The step.
        step: u64,
        /// A run that was evaluated there, and where it is.
        with: (String, PathBuf),
        /// One that was not.
        without: (String, PathBuf),
    },

    /// A step of comparison at which no evaluation counts.
    #[error(
        "scores are compared at environment step {at}, which is no multiple of {every}: {}another --every",
        latest.map_or("no evaluation counts; choose ".to_owned(), |step| format!("--at {step}, or "))
    )]
    Every {
        /// The step of the comparison.
        at: u64,
        /// Evaluations at multiples of so many steps count.
        every: u64,
        /// The last evaluation below that counts.
        latest: Option<u64>,
    },

    /// A fault of the page's template or of a table, not of the runs.
    #[error("the report cannot be put together: {reason}")]
    Page {
        /// Why.
        reason: String,
    },

    /// A file that cannot be read, or is not what it should be.
    #[error(transparent)]
    Files(#[from] hksl_files::Error),

    /// Scores that nothing can be said of.
    #[error(transparent)]
    Statistics(#[from] crate::statistics::Error),

    /// A picture that cannot be drawn.
    #[error(transparent)]
    Plot(#[from] crate::plot::Error),
}

impl Error {
    /// A file that is not what it should be.
    pub(super) fn damaged(path: &Path, reason: impl fmt::Display) -> Self {
        hksl_files::Error::damaged(path, reason).into()
    }

    /// Whether the fault lies in what was asked for, or in the runs (exit code 2).
    pub fn is_usage(&self) -> bool {
        match self {
            Self::Empty { .. }
            | Self::AllLeftOut { .. }
            | Self::NoCurves { .. }
            | Self::UnknownFilter { .. }
            | Self::FilteredOut { .. }
            | Self::SameCell { .. }
            | Self::Budgets { .. }
            | Self::EvaluationPoints { .. }
            | Self::Every { .. } => true,
            Self::Page { .. } | Self::Files(_) | Self::Statistics(_) | Self::Plot(_) => false,
        }
    }
}

/// Shorthand for results of reports.
pub type Result<T> = std::result::Result<T, Error>;

fn asked_for(methods: &[String], tasks: &[String]) -> String {
    let of = |kind: &str, names: &[String]| match names {
        [] => None,
        names => Some(format!("of the {kind} asked for ({})", names.join(", "))),
    };
    let asked: Vec<_> =
        [of("methods", methods), of("tasks", tasks)].into_iter().flatten().collect();
    asked.join(" and ")
}

fn listed(sources: &[PathBuf]) -> String {
    let names: Vec<_> = sources.iter().map(|source| source.display().to_string()).collect();
    names.join(", ")
}
