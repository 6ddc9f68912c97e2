//! The configuration files that are part of the program.

pub use hksl_files::{ABLATION_NONE, DISTRACTOR_NONE, METHOD_HKSL, PRESET_PAPER};
use hksl_sac::Ablation;

use super::methods::{self, METHODS};

/// Every key, with its comment.
pub(super) const DEFAULT: &str = include_str!("../../../../configs/default.toml");

const TASKS: &[(&str, &str)] = &[
    ("falling-pixels", include_str!("../../../../configs/tasks/falling-pixels.toml")),
    ("cartpole-swingup", include_str!("../../../../configs/tasks/cartpole-swingup.toml")),
    ("finger-spin", include_str!("../../../../configs/tasks/finger-spin.toml")),
    ("reacher-easy", include_str!("../../../../configs/tasks/reacher-easy.toml")),
    ("cheetah-run", include_str!("../../../../configs/tasks/cheetah-run.toml")),
    ("walker-walk", include_str!("../../../../configs/tasks/walker-walk.toml")),
    ("ball_in_cup-catch", include_str!("../../../../configs/tasks/ball_in_cup-catch.toml")),
];

const DISTRACTORS: &[(&str, &str)] = &[
    (DISTRACTOR_NONE, ""),
    ("color-easy", include_str!("../../../../configs/distractors/color-easy.toml")),
    ("color-medium", include_str!("../../../../configs/distractors/color-medium.toml")),
    ("color-hard", include_str!("../../../../configs/distractors/color-hard.toml")),
    ("camera-easy", include_str!("../../../../configs/distractors/camera-easy.toml")),
    ("camera-medium", include_str!("../../../../configs/distractors/camera-medium.toml")),
    ("camera-hard", include_str!("../../../../configs/distractors/camera-hard.toml")),
];

const PRESETS: &[(&str, &str)] = &[
    (PRESET_PAPER, include_str!("../../../../configs/presets/paper.toml")),
    ("debug", include_str!("../../../../configs/presets/debug.toml")),
    ("crop", include_str!("../../../../configs/presets/crop.toml")),
    ("small", include_str!("../../../../configs/presets/small.toml")),
];

/// The names of all methods.
pub fn methods() -> Vec<&'static str> {
    METHODS.iter().map(|method| method.name).collect()
}

/// The names of all tasks that have a configuration.
pub fn tasks() -> Vec<&'static str> {
    names(TASKS)
}

/// The names of all distractors.
pub fn distractors() -> Vec<&'static str> {
    names(DISTRACTORS)
}

/// The names of all ablations, those that belong to one task alone included.
pub fn ablations() -> Vec<&'static str> {
    Ablation::ALL.iter().map(|ablation| ablation.name()).collect()
}

/// The names of all presets.
pub fn presets() -> Vec<&'static str> {
    let own = METHODS.iter().flat_map(|method| method.presets);
    PRESETS.iter().chain(own).map(|(name, _)| *name).collect()
}

pub(super) fn method(name: &str) -> Option<&'static str> {
    methods::find(name).map(|method| method.settings)
}

pub(super) fn task(name: &str) -> Option<&'static str> {
    text(TASKS, name)
}

pub(super) fn distractor(name: &str) -> Option<&'static str> {
    text(DISTRACTORS, name)
}

/// The only method that a preset is for, if it is not for all.
pub(super) fn preset_owner(preset: &str) -> Option<&'static str> {
    let owns = |method: &&methods::Method| method.presets.iter().any(|(name, _)| *name == preset);
    METHODS.iter().find(owns).map(|method| method.name)
}

pub(super) fn preset(name: &str) -> Option<&'static str> {
    let own = METHODS.iter().find_map(|method| text(method.presets, name));
    text(PRESETS, name).or(own)
}

fn names(files: &[(&'static str, &str)]) -> Vec<&'static str> {
    files.iter().map(|(name, _)| *name).collect()
}

fn text(files: &[(&str, &'static str)], name: &str) -> Option<&'static str> {
    files.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}
