//! That a run is what its name says: folders, evaluations and reports go by the names of ablation and distractor.

use hksl_sac::Ablation;
use toml::{Table, Value};

use crate::{Error, Result};

use super::layer::{Merged, flatten};
use super::{Config, Origin, Origins};

/// Refuses settings of the user's that undo the ablation.
///
/// # Errors
/// [`Error::Ablation`] names the first key.
pub(super) fn ablation_holds(config: &Config, origins: &Origins) -> Result<()> {
    // Whether the task has it has been looked at.
    let Ok(ablation) = Ablation::from_name(&config.ablation, &config.task) else { return Ok(()) };
    let mut ablated = config.hksl.clone();
    ablation.apply(&mut ablated);
    let leaves = |hksl: &_| Table::try_from(hksl).map(flatten).map_err(Error::NotToml);
    let found = leaves(&config.hksl)?;
    for (name, expected) in leaves(&ablated)? {
        let Some(value) = found.get(&name).filter(|value| **value != expected) else { continue };
        let key = format!("hksl.{name}");
        let origin = origins.get(&key).map_or(String::new(), |origin| format!(" by {origin}"));
        return Err(Error::Ablation {
            name: config.ablation.clone(),
            origin: origins.get("ablation").cloned().unwrap_or(Origin::Default),
            reason: format!(
                "`{ablation}` means {key} = {expected}, which is {value}{origin}: leave one of the two out; --name NAME \
                 tells runs with settings of your own apart"
            ),
        });
    }
    Ok(())
}

/// Refuses a file that has another distractor's settings than the one asked for beside it. In one that names its
/// distractor itself they are that distractor's, tuned.
///
/// # Errors
/// [`Error::OutOfRange`] names the first key.
pub(super) fn distractor_holds(
    shipped: &Merged,
    user: &Merged,
    (name, origin): &(String, Origin),
) -> Result<()> {
    if matches!(origin, Origin::File(_)) {
        return Ok(());
    }
    let of_file = |origin: &Origin| matches!(origin, Origin::File(_));
    for (key, value, set_by) in user.values_under("distractors.") {
        let expected = shipped.value(key).map(Value::to_string).unwrap_or_default();
        if of_file(set_by) && value.to_string() != expected && key != "distractors.dynamic" {
            return Err(Error::OutOfRange {
                key: key.to_owned(),
                value: value.to_string(),
                origin: Some(set_by.clone()),
                expected: format!(
                    "distractor {name} ({origin}) has {expected}: leave the key out, or name the distractor in the file"
                ),
            });
        }
    }
    Ok(())
}
