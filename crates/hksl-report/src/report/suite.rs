//! Which tasks and which questions belong together.

use hksl_files::Names;

/// Returns that can be averaged over tasks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Suite {
    /// The control tasks: returns of episodes of 1,000 control steps lie between 0 and 1,000, so that a score is a return
    /// divided by 1,000, of shorter episodes too.
    Control,
    /// Falling Pixels, whose returns stand for themselves.
    FallingPixels,
}

impl Suite {
    /// That of a task; none for a task that `hksl tasks` does not list.
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

    /// The return that is a score of 1.
    pub fn scale(self) -> f64 {
        match self {
            Self::Control => 1000.0,
            Self::FallingPixels => 1.0,
        }
    }

    /// What a score is.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Control => "return / 1,000",
            Self::FallingPixels => "return",
        }
    }

    /// A score as people read it.
    pub(super) fn written(self, score: f64) -> String {
        match self {
            _ if score.abs() >= 1e6 => format!("{score:.3e}"),
            Self::Control => format!("{score:.3}"),
            Self::FallingPixels => format!("{score:.2}"),
        }
    }
}

/// Which question a comparison answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Question {
    /// Which method is better.
    Methods,
    /// What each part of HKSL is worth; on Falling Pixels, how many levels are.
    Ablations,
}
