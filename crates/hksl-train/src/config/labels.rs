//! That a run is what its name says: folders, evaluations and reports go by the names of ablation and distractor; and
//! that what is set for it has an effect.

use hksl_sac::Ablation;
use hksl_sac::config::HkslConfig;
use toml::{Table, Value};

use super::error::{Error, Result};

use super::layer::{Merged, flatten};
use super::shipped::varies_levels;
use super::{Config, Origin, Origins, methods};

/// Refuses settings of the user's that undo the ablation.
///
/// # Errors
/// [`Error::Ablation`] names the first key.
pub(super) fn ablation_holds(config: &Config, origins: &Origins) -> Result<()> {
    // Whether the task supports the ablation has been checked before.
    let varies_levels = varies_levels(&config.task);
    let Ok(ablation) = Ablation::from_name(&config.ablation, varies_levels) else { return Ok(()) };
    let mut ablated = config.hksl.clone();
    ablation.apply(&mut ablated);
    let leaves = |hksl: &_| Table::try_from(hksl).map(flatten).map_err(Error::NotToml);
    let found = leaves(&config.hksl)?;
    // `h2` to `h4` are named after their levels; the trajectory length is only adapted to these.
    for (name, expected) in leaves(&ablated)?.into_iter().filter(|of| of.0 != "trajectory_length") {
        let Some(value) = found.get(&name).filter(|value| **value != expected) else { continue };
        let key = format!("hksl.{name}");
        let origin = origins.get(&key).map_or(String::new(), |origin| format!(" by {origin}"));
        return Err(Error::Ablation {
            name: config.ablation.clone(),
            origin: origins.get("ablation").cloned().unwrap_or(Origin::Default),
            reason: format!(
                "`{ablation}` requires {key} = {expected}, but it is set to {value}{origin}: leave out the ablation or the \
                 setting; use --name NAME for a run with custom settings"
            ),
        });
    }
    Ok(())
}

/// Refuses unused settings with `--set`: parameters of a distractor that is not chosen, rendering settings of a task
/// without rendering, and `augmentation.shift_per` for a method that shifts whole sequences. Unused settings are allowed
/// in files, because every run's config.toml has them, and if the value equals that of `shipped`, the layers below.
///
/// # Errors
/// [`Error::OutOfRange`] names the first key.
pub(super) fn sets_have_effect(
    shipped: &Merged,
    user: &Merged,
    (task, method): (&str, &str),
    distractor: &str,
) -> Result<()> {
    let undrawn = hksl_envs::registry::find(task).is_ok_and(|task| !task.needs_mujoco);
    let shifts_sequences = methods::find(method).is_some_and(|method| method.shifts_sequences);
    let kind = distractor.split('-').next().unwrap_or_default();
    let without_effect = |key: &str| match key.split('.').collect::<Vec<_>>()[..] {
        ["distractors", "dynamic"] => distractor == "none",
        ["distractors", of, _] => of != kind,
        ["render", _] => undrawn,
        ["augmentation", "shift_per"] => shifts_sequences,
        _ => false,
    };
    let sets = ["distractors.", "render.", "augmentation."]
        .into_iter()
        .flat_map(|section| user.values_under(section));
    let mut sets = sets.filter(|(_, _, origin)| matches!(origin, Origin::Set | Origin::Program));
    match sets.find(|(key, value, _)| without_effect(key) && shipped.value(key) != Some(*value)) {
        Some((key, value, origin)) => Err(Error::OutOfRange {
            key: key.to_owned(),
            value: value.to_string(),
            origin: Some(origin.clone()),
            expected: match key.split('.').next() {
                Some("render") => {
                    format!("{task} does not use the renderer; leave this setting out")
                }
                Some("augmentation") => {
                    format!("{method} shifts whole sequences; leave this setting out")
                }
                _ => format!(
                    "distractor {distractor} does not use it; choose another --distractor, or leave this setting out"
                ),
            },
        }),
        None => Ok(()),
    }
}

/// Refuses a file with settings of an ablation or distractor other than the chosen ones. Modified settings of the
/// chosen ones are allowed. `shipped` are the layers below the file.
///
/// # Errors
/// [`Error::OutOfRange`] names the first key.
pub(super) fn file_agrees(
    shipped: &Merged,
    file: &Merged,
    task: &str,
    (ablation, ablation_by): &(String, Origin),
    (distractor, distractor_by): &(String, Origin),
) -> Result<()> {
    let refused = |key: &str, value: &Value, origin: &Origin, chosen: String| Error::OutOfRange {
        key: key.to_owned(),
        value: value.to_string(),
        origin: Some(origin.clone()),
        expected: format!(
            "the file has the value of another one, but {chosen} has {}: remove the key from the file",
            shipped.value(key).map(Value::to_string).unwrap_or_default()
        ),
    };
    let differs = |(key, value, _): &(&str, &Value, &Origin)| shipped.value(key) != Some(*value);
    if file.text("distractor").is_some_and(|(named, _)| named != *distractor) {
        let mut found = file.values_under("distractors.").filter(differs);
        if let Some((key, value, origin)) = found.find(|of| of.0 != "distractors.dynamic") {
            let chosen = format!("distractor {distractor} ({distractor_by})");
            return Err(refused(key, value, origin, chosen));
        }
    }
    let Some((named, _)) = file.text("ablation").filter(|(named, _)| named != ablation) else {
        return Ok(());
    };
    // An ablation that the task does not support is refused by name if it is chosen.
    let Ok(named) = Ablation::from_name(&named, varies_levels(task)) else { return Ok(()) };
    let mut ablated: HkslConfig = shipped.section("hksl")?;
    named.apply(&mut ablated);
    let ablated = Table::try_from(&ablated).map(flatten).map_err(Error::NotToml)?;
    for (key, value, origin) in file.values_under("hksl.").filter(differs) {
        if key.strip_prefix("hksl.").and_then(|name| ablated.get(name)) == Some(value) {
            let chosen = format!("ablation {ablation} ({ablation_by})");
            return Err(refused(key, value, origin, chosen));
        }
    }
    Ok(())
}
