//! Suites of tasks and questions that are analysed together.

use hksl_files::Names;

/// Tasks whose returns can be averaged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Suite {
    /// Control tasks: returns of episodes of 1,000 control steps are between 0 and 1,000, so a score is a return
    /// divided by 1,000, also for shorter episodes.
    Control,
    /// Falling Pixels: a score is a return.
    FallingPixels,
}

impl Suite {
    /// Suite of a task; `None` for an unknown task.
    pub fn of(task: &str, names: &Names) -> Option<Self> {
        let control = names.control_tasks.contains(&task);
        let suite = if control { Self::Control } else { Self::FallingPixels };
        names.tasks.contains(&task).then_some(suite)
    }

    /// Its name in a heading.
    pub fn title(self) -> &'static str {
        match self {
            Self::Control => "Control tasks",
            Self::FallingPixels => "Falling Pixels",
        }
    }

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Control => "control",
            Self::FallingPixels => "falling-pixels",
        }
    }

    /// Return that corresponds to a score of 1.
    pub fn scale(self) -> f64 {
        match self {
            Self::Control => 1000.0,
            Self::FallingPixels => 1.0,
        }
    }

    /// Unit of a score.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Control => "return / 1,000",
            Self::FallingPixels => "return",
        }
    }

    /// Formats a score.
    pub(super) fn written(self, score: f64) -> String {
        match self {
            _ if score.abs() >= 1e6 => format!("{score:.3e}"),
            Self::Control => format!("{score:.3}"),
            Self::FallingPixels => format!("{score:.2}"),
        }
    }
}

/// Question that a comparison answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Question {
    /// Comparison of methods.
    Methods,
    /// Comparison of ablations; on Falling Pixels, of numbers of levels.
    Ablations,
}
