//! The configuration files that are part of the program.

pub use hksl_files::{ABLATION_NONE, DISTRACTOR_NONE, PRESET_PAPER};
use hksl_sac::Ablation;
use include_dir::{Dir, include_dir};

use super::methods::{self, METHODS};

/// `configs/`, as it was when the program was built.
static CONFIGS: Dir = include_dir!("$CARGO_MANIFEST_DIR/configs");

/// In the order of help texts; the first has no file.
const DISTRACTORS: [&str; 7] = [
    DISTRACTOR_NONE,
    "color-easy",
    "color-medium",
    "color-hard",
    "camera-easy",
    "camera-medium",
    "camera-hard",
];

/// Presets for every method, in the order of help texts.
const PRESETS: [&str; 4] = [PRESET_PAPER, "debug", "crop", "small"];

/// `default.toml`: every key, with its comment.
pub(super) fn default() -> &'static str {
    file("default").unwrap_or_default()
}

/// The names of all methods.
pub fn methods() -> Vec<&'static str> {
    METHODS.iter().map(|method| method.name).collect()
}

/// The names of all tasks.
pub fn tasks() -> Vec<&'static str> {
    hksl_envs::tasks().iter().map(|task| task.name).collect()
}

/// The names of all distractors.
pub fn distractors() -> Vec<&'static str> {
    DISTRACTORS.to_vec()
}

/// The names of all ablations, those that belong to one task alone included.
pub fn ablations() -> Vec<&'static str> {
    Ablation::ALL.iter().map(|ablation| ablation.name()).collect()
}

/// The tasks on which the paper varies the number of levels.
pub(super) fn tasks_of_varied_levels() -> Vec<&'static str> {
    hksl_envs::tasks().iter().filter(|task| task.varies_levels).map(|task| task.name).collect()
}

/// Whether the paper varies the number of levels on a task; not on tasks that programs bring.
pub(super) fn varies_levels(task: &str) -> bool {
    tasks_of_varied_levels().contains(&task)
}

/// The names of all presets.
pub fn presets() -> Vec<&'static str> {
    let own = METHODS.iter().flat_map(|method| method.presets);
    PRESETS.iter().chain(own).copied().collect()
}

pub(super) fn method(name: &str) -> Option<&'static str> {
    file(&format!("methods/{}", methods::find(name)?.name))
}

pub(super) fn task(name: &str) -> Option<&'static str> {
    tasks().contains(&name).then(|| file(&format!("tasks/{name}")))?
}

pub(super) fn distractor(name: &str) -> Option<&'static str> {
    let known = DISTRACTORS.contains(&name);
    known.then(|| file(&format!("distractors/{name}")).unwrap_or_default())
}

/// The only method that a preset is for, if it is not for all.
pub(super) fn preset_owner(preset: &str) -> Option<&'static str> {
    let owner = METHODS.iter().find(|method| method.presets.contains(&preset));
    owner.map(|method| method.name)
}

pub(super) fn preset(name: &str) -> Option<&'static str> {
    presets().contains(&name).then(|| file(&format!("presets/{name}")))?
}

/// The text of `configs/PATH.toml`.
fn file(path: &str) -> Option<&'static str> {
    CONFIGS.get_file(format!("{path}.toml"))?.contents_utf8()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_has_its_file_and_every_file_its_name() {
        assert!(!default().is_empty());
        let registered = [
            ("methods", methods()),
            ("tasks", tasks()),
            ("distractors", distractors().split_off(1)),
            ("presets", presets()),
        ];
        for (folder, names) in registered {
            for name in &names {
                assert!(
                    file(&format!("{folder}/{name}")).is_some(),
                    "configs/{folder}/{name}.toml"
                );
            }
            let files = CONFIGS.get_dir(folder).unwrap().files().count();
            assert_eq!(files, names.len(), "configs/{folder} has a file that no registry names");
        }
    }
}
