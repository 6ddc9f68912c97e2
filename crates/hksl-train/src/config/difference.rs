//! What two configurations differ in, and whether a resumed run may differ so.

use std::collections::BTreeMap;

use hksl_files::Settings;
use toml::Value;

use super::error::{Error, Result};

use super::layer::flatten;
use super::{Config, schema};

/// A key that two configurations give different values.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// The key, dotted.
    pub key: String,
    /// Its value in the saved configuration, as TOML.
    pub saved: String,
    /// Its value in the requested configuration, as TOML.
    pub requested: String,
    /// Whether a run may take the requested value over when it resumes.
    pub may_change: bool,
}

impl Config {
    /// The keys in which `requested` differs from this, saved, configuration, by name.
    ///
    /// # Errors
    /// [`Error::NotToml`] for a configuration that cannot be written as TOML.
    pub fn difference(&self, requested: &Self) -> Result<Vec<Difference>> {
        let saved = self.leaves()?;
        let differences = requested
            .leaves()?
            .into_iter()
            .filter(|(key, value)| saved.get(key) != Some(value))
            .map(|(key, value)| Difference {
                saved: saved.get(&key).map(Value::to_string).unwrap_or_default(),
                requested: value.to_string(),
                may_change: may_change(&key),
                key,
            });
        Ok(differences.collect())
    }

    /// What reports show of the configuration and compare with others.
    ///
    /// # Errors
    /// [`Error::NotToml`] for a configuration that cannot be written as TOML.
    pub fn settings(&self) -> Result<Settings> {
        let values = self.leaves()?.into_iter().map(|(key, value)| (key, value.to_string()));
        let values: BTreeMap<String, String> = values.collect();
        let free = values.keys().filter(|key| may_change(key)).cloned().collect();
        Ok(Settings { text: self.to_toml()?, values, free })
    }

    /// Every value that the method reads, by dotted key.
    pub(super) fn leaves(&self) -> Result<BTreeMap<String, Value>> {
        let mut leaves = toml::Table::try_from(self).map(flatten).map_err(Error::NotToml)?;
        leaves.retain(|key, _| !schema::is_foreign(key, &self.method));
        Ok(leaves)
    }
}

/// The budget, the machine and the output may change in a resumed run; what decides its numbers may
/// not.
pub(super) fn may_change(key: &str) -> bool {
    [
        "environment_steps",
        "device",
        "render.device",
        "threads",
        "replay.storage",
        "evaluation.video",
    ]
    .contains(&key)
        || key.starts_with("checkpoint.")
        || key.starts_with("metrics.")
}
