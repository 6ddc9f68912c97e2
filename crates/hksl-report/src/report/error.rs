//! Errors of reports.

use std::fmt;
use std::path::{Path, PathBuf};

/// An error that prevents a report, with what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No runs and no curves.
    #[error(
        "no runs and no CSV files of curves in {}; name run folders, which `hksl train` and `hksl sweep` write with a \
         config.toml, or CSV files",
        listed(sources)
    )]
    Empty {
        /// The given paths.
        sources: Vec<PathBuf>,
    },

    /// None of the runs and curves can be used.
    #[error("no run or curve can be used: {}", reasons.join("; "))]
    AllLeftOut {
        /// The reasons.
        reasons: Vec<String>,
    },

    /// A file without curves.
    #[error(
        "{} is not a file of curves: it lacks {}. Files of curves need the columns of eval.csv, or agent, task, seed, \
         frame and episode_reward, as in the curves that drqv2 published",
        path.display(),
        lacking.join(", ")
    )]
    NoCurves {
        /// The file.
        path: PathBuf,
        /// Missing columns of drqv2's format or of `eval.csv`, whichever are fewer.
        lacking: Vec<&'static str>,
    },

    /// A method or task without runs.
    #[error("no run of {kind} {}; available: {}", unknown.join(", "), there.join(", "))]
    UnknownFilter {
        /// `method` or `task`.
        kind: &'static str,
        /// The names without runs.
        unknown: Vec<String>,
        /// The available names.
        there: Vec<String>,
    },

    /// Filters that exclude all runs.
    #[error("no readable run is {}; change --methods or --tasks", asked_for(methods, tasks))]
    FilteredOut {
        /// The requested methods.
        methods: Vec<String>,
        /// The requested tasks.
        tasks: Vec<String>,
    },

    /// Two runs with the same method, task and seed.
    #[error(
        "{} and {} are both {cell}: leave one of them out, or rename one. The name of a run is that of its folder, as in \
         hksl-NAME; the name of a CSV curve is its agent",
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
        "{} ({}) has a budget of {} environment steps, and {} ({}) of {}: {}select runs with --methods or --tasks, or leave \
         one of them out",
        first.0,
        first.1.display(),
        first.2,
        second.0,
        second.1.display(),
        second.2,
        both.map_or_else(String::new, |step| format!("compare them at a step that both have (--at {step}), "))
    )]
    Budgets {
        /// One run with its path and budget.
        first: (String, PathBuf, u64),
        /// The other.
        second: Box<(String, PathBuf, u64)>,
        /// Last step after 0, within both budgets, at which both were evaluated.
        both: Option<u64>,
    },

    /// Runs that were evaluated at different steps in one comparison.
    #[error(
        "{} ({}) was evaluated at environment step {step}, but {} ({}), which is longer, was not: keep only the \
         evaluations that both have (--every STEPS), select runs with --methods or --tasks, or leave one of them out",
        with.0,
        with.1.display(),
        without.0,
        without.1.display()
    )]
    EvaluationPoints {
        /// The step.
        step: u64,
        /// A run that was evaluated there, with its path.
        with: (String, PathBuf),
        /// A longer run that was not.
        without: (String, PathBuf),
    },

    /// A comparison step without evaluations.
    #[error(
        "scores are compared at environment step {at}, which is not a multiple of --every {every}: choose {}another --every",
        latest.map_or_else(String::new, |step| format!("--at {step}, or "))
    )]
    Every {
        /// The step of the comparison.
        at: u64,
        /// Only evaluations at multiples of this number of steps count.
        every: u64,
        /// Last earlier evaluation that counts.
        latest: Option<u64>,
    },

    /// An internal error in the page's template or a table.
    #[error("cannot build the report: {reason}")]
    Page {
        /// The cause.
        reason: String,
    },

    /// A file that cannot be read, or is damaged.
    #[error(transparent)]
    Files(#[from] hksl_files::Error),

    /// Scores without statistics.
    #[error(transparent)]
    Statistics(#[from] crate::statistics::Error),

    /// A figure that cannot be drawn.
    #[error(transparent)]
    Plot(#[from] crate::plot::Error),
}

impl Error {
    /// A damaged file.
    pub(super) fn damaged(path: &Path, reason: impl fmt::Display) -> Self {
        hksl_files::Error::damaged(path, reason).into()
    }

    /// Whether the arguments or the runs caused the error (exit code 2).
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
        names => Some(format!("of the requested {kind} ({})", names.join(", "))),
    };
    let asked: Vec<_> =
        [of("methods", methods), of("tasks", tasks)].into_iter().flatten().collect();
    asked.join(" and ")
}

fn listed(sources: &[PathBuf]) -> String {
    let names: Vec<_> = sources.iter().map(|source| source.display().to_string()).collect();
    names.join(", ")
}
