//! What runs are called.

/// The name that stands for no ablation.
pub const ABLATION_NONE: &str = "none";

/// The name for no distractor.
pub const DISTRACTOR_NONE: &str = "none";

/// The preset of a run that names none.
pub const PRESET_PAPER: &str = "paper";

/// A task with its distractor, if it has one: `cartpole-swingup-color-easy`.
pub fn task_label(task: &str, distractor: &str) -> String {
    match distractor {
        DISTRACTOR_NONE => task.to_owned(),
        distractor => format!("{task}-{distractor}"),
    }
}

/// The names that a program gives to what its runs can be made of, in the order in which people are shown them.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Names {
    /// Tasks.
    pub tasks: Vec<&'static str>,
    /// Those of them whose returns lie between 0 and 1,000, as the Control Suite's do.
    pub control_tasks: Vec<&'static str>,
    /// Distractors, the first [`DISTRACTOR_NONE`].
    pub distractors: Vec<&'static str>,
    /// Methods, the default first.
    pub methods: Vec<&'static str>,
    /// Ablations, the first [`ABLATION_NONE`].
    pub ablations: Vec<&'static str>,
}
