//! A configuration as text.

use super::error::{Error, Result};

use super::{Config, Resolved, schema};

impl Config {
    /// The configuration as TOML, every key stated that its method reads; [`Config::from_toml`] reads it back unchanged.
    ///
    /// # Errors
    /// [`Error::NotToml`] where a value does not fit TOML: a seed above 2⁶³ − 1.
    pub fn to_toml(&self) -> Result<String> {
        let mut table = toml::Table::try_from(self).map_err(Error::NotToml)?;
        table.retain(|section, _| !schema::is_foreign(section, &self.method));
        toml::to_string(&table).map_err(Error::NotToml)
    }
}

impl Resolved {
    /// The configuration as TOML, each value followed by the layer it comes from, as a comment.
    ///
    /// # Errors
    /// As [`Config::to_toml`].
    pub fn to_toml_with_origins(&self) -> Result<String> {
        let text = self.config.to_toml()?;
        let width = text.lines().map(|line| line.chars().count()).max().unwrap_or(0);
        let mut section = String::new();
        let mut annotated = String::new();
        for line in text.lines() {
            if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
                section = format!("{name}.");
            }
            let key = line.split_once(" = ").map(|(name, _)| format!("{section}{name}"));
            match key.and_then(|key| self.origins.get(&key)) {
                Some(origin) => annotated.push_str(&format!("{line:width$}  # {origin}\n")),
                None => annotated.push_str(&format!("{line}\n")),
            }
        }
        Ok(annotated)
    }
}
