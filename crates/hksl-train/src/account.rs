//! What reports are told of runs and studies.

use hksl_files::{Account, Names, Outline, RunFolder};

use crate::config::{Config, ablations, distractors, methods, tasks};
use crate::sweep::{Sweep, standing};

/// What is known of the run in this folder, whose budget is so many environment steps.
pub fn account(folder: &RunFolder, environment_steps: u64) -> Account {
    let settings = Config::of_run(folder).and_then(|config| Ok(config.settings()?));
    Account {
        standing: standing(folder, environment_steps),
        settings: settings.map_err(|error| error.to_string()),
    }
}

/// What the shipped tasks, distractors, methods and ablations are called.
pub fn names() -> Names {
    let control_tasks = hksl_envs::tasks().iter().filter(|task| task.needs_mujoco);
    let control_tasks = control_tasks.map(|task| task.name).collect();
    Names {
        tasks: tasks(),
        control_tasks,
        distractors: distractors(),
        methods: methods(),
        ablations: ablations(),
    }
}

impl Sweep {
    /// Which runs there should be.
    pub fn outline(&self) -> Outline {
        let runs = self.runs.iter().map(|run| {
            let variant = run.folder.path().parent().and_then(|parent| parent.file_name());
            let variant =
                variant.map_or_else(String::new, |name| name.to_string_lossy().into_owned());
            (variant, run.config.task_label(), run.config.seed)
        });
        Outline {
            name: self.study.name.clone(),
            text: self.study.text.clone(),
            runs: runs.collect(),
        }
    }
}
