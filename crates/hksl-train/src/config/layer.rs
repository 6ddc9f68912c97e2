//! Merging layers, key by key, with the origin of each value.

use std::collections::BTreeMap;
use std::path::Path;

use serde::de::DeserializeOwned;
use toml::{Table, Value};

use super::error::{Error, Result};

use super::schema::{self, RULES};
use super::{Config, Origin, Origins, names};

/// Values by dotted key, each with its origin. Every value has passed its key's own rule.
#[derive(Debug, Clone)]
pub(super) struct Merged {
    values: BTreeMap<String, Value>,
    origins: Origins,
}

impl Merged {
    pub(super) fn empty() -> Self {
        Self { values: BTreeMap::new(), origins: Origins::new() }
    }

    /// Puts a TOML text on top.
    pub(super) fn add_text(&mut self, text: &str, origin: &Origin) -> Result<()> {
        let table: Table = text.parse().map_err(|error| syntax(text, &error, origin))?;
        self.add_table("", table, origin)
    }

    /// Puts a method's file on top, and returns what it has for single tasks, in its table `tasks`.
    pub(super) fn add_method(
        &mut self,
        text: &str,
        origin: &Origin,
    ) -> Result<BTreeMap<String, Table>> {
        let mut table: Table = text.parse().map_err(|error| syntax(text, &error, origin))?;
        let tasks = table.remove("tasks");
        self.add_table("", table, origin)?;
        let tasks = tasks.map(Value::try_into).transpose();
        Ok(tasks.map_err(|error| syntax(text, &error, origin))?.unwrap_or_default())
    }

    /// Puts one value, which may be a whole table, on top.
    pub(super) fn add(&mut self, key: &str, value: Value, origin: &Origin) -> Result<()> {
        match (schema::rule(key), value) {
            (None, Value::Table(table)) if schema::is_section(key) => {
                self.add_table(key, table, origin)
            }
            (Some(rule), value) => {
                let value = schema::check(key, rule, value, origin)?;
                self.values.insert(key.to_owned(), value);
                self.origins.insert(key.to_owned(), origin.clone());
                Ok(())
            }
            (None, value) if schema::is_section(key) => Err(Error::WrongType {
                key: key.to_owned(),
                value: value.to_string(),
                origin: origin.clone(),
                expected: "a table of keys".to_owned(),
            }),
            (None, _) => Err(Error::UnknownKey {
                key: key.to_owned(),
                origin: origin.clone(),
                nearest: names::nearest_keys(key),
            }),
        }
    }

    pub(super) fn add_table(&mut self, prefix: &str, table: Table, origin: &Origin) -> Result<()> {
        for (name, value) in table {
            let key = if prefix.is_empty() { name } else { format!("{prefix}.{name}") };
            self.add(&key, value, origin)?;
        }
        Ok(())
    }

    /// Puts the keys of `defaults` that the method does not read in place of whatever stands there.
    pub(super) fn reset_foreign(&mut self, defaults: &Self, method: &str) {
        for (key, value) in &defaults.values {
            if schema::is_foreign(key, method) {
                self.values.insert(key.clone(), value.clone());
                self.origins.insert(key.clone(), Origin::Default);
            }
        }
    }

    /// Takes over the keys of `defaults` that are not there and may be taken over.
    pub(super) fn fill(&mut self, defaults: &Self, may: impl Fn(&str) -> bool) {
        for (key, value) in &defaults.values {
            if may(key) && !self.values.contains_key(key) {
                self.values.insert(key.clone(), value.clone());
                self.origins.insert(key.clone(), Origin::Default);
            }
        }
    }

    /// Refuses what `user` changes in sections that only other methods read.
    pub(super) fn refuse_foreign(&self, user: &Self, method: &str) -> Result<()> {
        let changed = |(key, value): &(&String, &Value)| self.values.get(*key) != Some(*value);
        let foreign = user.values.iter().filter(changed);
        let mut foreign = foreign.filter(|(key, _)| schema::is_foreign(key, method));
        let Some((key, value)) = foreign.next() else { return Ok(()) };
        Err(Error::ForeignKey {
            key: key.as_str().into(),
            value: value.to_string().into(),
            origin: user.origins.get(key).cloned().unwrap_or(Origin::Default),
            method: method.into(),
            owners: schema::owners(key).unwrap_or_default(),
            own: schema::own_sections(method).into(),
        })
    }

    /// Puts all of another merge on top.
    pub(super) fn overlay(&mut self, upper: Self) {
        self.values.extend(upper.values);
        self.origins.extend(upper.origins);
    }

    /// A key's value.
    pub(super) fn value(&self, key: &str) -> Option<&Value> {
        self.values.get(key)
    }

    /// Where a key's value comes from.
    pub(super) fn origin(&self, key: &str) -> Option<Origin> {
        self.origins.get(key).cloned()
    }

    /// The keys that begin so, with their values and origins.
    pub(super) fn values_under(
        &self,
        prefix: &str,
    ) -> impl Iterator<Item = (&str, &Value, &Origin)> {
        let under = self.values.iter().filter(move |(key, _)| key.starts_with(prefix));
        under.filter_map(|(key, value)| Some((key.as_str(), value, self.origins.get(key)?)))
    }

    /// A string and where it comes from.
    pub(super) fn text(&self, key: &str) -> Option<(String, Origin)> {
        let text = self.values.get(key)?.as_str()?.to_owned();
        Some((text, self.origins.get(key)?.clone()))
    }

    /// One section, typed.
    pub(super) fn section<T: DeserializeOwned>(&self, name: &str) -> Result<T> {
        let table = self.nested().remove(name).unwrap_or(Value::Table(Table::new()));
        table.try_into().map_err(|error| self.inconsistent(name, &error))
    }

    /// Puts on top what differs from the present value of each key of `values`.
    pub(super) fn add_changes(
        &mut self,
        values: BTreeMap<String, Value>,
        origin: &Origin,
    ) -> Result<()> {
        for (key, value) in values {
            if self.values.get(&key) != Some(&value) {
                self.add(&key, value, origin)?;
            }
        }
        Ok(())
    }

    /// Requires every key.
    pub(super) fn complete(&self, path: &Path) -> Result<()> {
        let keys: Vec<_> = RULES
            .iter()
            .filter(|(key, _)| !self.values.contains_key(*key))
            .map(|(key, _)| (*key).to_owned())
            .collect();
        if keys.is_empty() {
            return Ok(());
        }
        Err(Error::MissingKeys { path: path.to_owned(), keys })
    }

    /// The typed configuration, checked as a whole.
    pub(super) fn finish(self) -> Result<(Config, Origins)> {
        let config: Config = Value::Table(self.nested())
            .try_into()
            .map_err(|error| self.inconsistent("the configuration", &error))?;
        config.validate_with(&self.origins)?;
        Ok((config, self.origins))
    }

    fn nested(&self) -> Table {
        let mut nested = Table::new();
        for (key, value) in &self.values {
            insert(&mut nested, key, value.clone());
        }
        nested
    }

    /// What the rules let pass and the typed configuration refuses.
    fn inconsistent(&self, what: &str, error: &toml::de::Error) -> Error {
        Error::OutOfRange {
            key: what.to_owned(),
            value: Value::Table(self.nested()).to_string(),
            origin: None,
            expected: error.message().to_owned(),
        }
    }
}

/// Puts a value where its dotted key says.
fn insert(table: &mut Table, key: &str, value: Value) {
    let Some((section, rest)) = key.split_once('.') else {
        table.insert(key.to_owned(), value);
        return;
    };
    let inner = table.entry(section).or_insert_with(|| Value::Table(Table::new()));
    if let Value::Table(inner) = inner {
        insert(inner, rest, value);
    }
}

/// The leaves of a table by dotted key.
pub(super) fn flatten(table: Table) -> BTreeMap<String, Value> {
    fn walk(prefix: &str, table: Table, leaves: &mut BTreeMap<String, Value>) {
        for (name, value) in table {
            let key = if prefix.is_empty() { name } else { format!("{prefix}.{name}") };
            match value {
                Value::Table(inner) => walk(&key, inner, leaves),
                value => {
                    leaves.insert(key, value);
                }
            }
        }
    }
    let mut leaves = BTreeMap::new();
    walk("", table, &mut leaves);
    leaves
}

fn syntax(text: &str, error: &toml::de::Error, origin: &Origin) -> Error {
    let place = error.span().and_then(|span| text.get(..span.start)).map(|before| {
        let line = before.matches('\n').count() + 1;
        let column = before.chars().rev().take_while(|&c| c != '\n').count() + 1;
        format!("line {line}, column {column}: ")
    });
    let message = format!("{}{}", place.unwrap_or_default(), error.message());
    Error::Syntax { origin: origin.clone(), message }
}
