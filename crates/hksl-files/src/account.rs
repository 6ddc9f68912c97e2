//! What the program that trained runs tells those who compare them.

use std::collections::BTreeMap;

use crate::Standing;

/// Information about a run other than its labels and evaluations.
#[derive(Debug, Clone)]
pub struct Account {
    /// Where it stands.
    pub standing: Standing,
    /// Its settings; why they are not known, where another version of hksl wrote it, with other ones.
    pub settings: Result<Settings, String>,
}

/// What a run was set to.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Settings {
    /// All of it, as people read it.
    pub text: String,
    /// Each value that the run's method reads, by its dotted key.
    pub values: BTreeMap<String, String>,
    /// The keys that do not affect results: budget, machine and output.
    pub free: Vec<String>,
}

impl Settings {
    /// The keys in which other settings differ, with their values there.
    pub fn difference<'a>(&self, other: &'a Self) -> impl Iterator<Item = (&'a str, &'a str)> {
        let values = other.values.iter().map(|(key, value)| (key.as_str(), value.as_str()));
        values.filter(|(key, value)| self.values.get(*key).map(String::as_str) != Some(*value))
    }

    /// The keys other than the seed in which another run differs; if there are any, the runs are not repetitions.
    pub fn unlike<'a>(&'a self, other: &'a Self) -> impl Iterator<Item = &'a str> {
        let keys = self.difference(other).map(|(key, _)| key);
        keys.filter(|key| *key != "seed" && !other.free.iter().any(|free| free == key))
    }
}

/// A study in outline: which runs there should be.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Outline {
    /// What it is called.
    pub name: String,
    /// Its file.
    pub text: String,
    /// Its runs: the folder's name of the method, the task with its distractor, the seed.
    pub runs: Vec<(String, String, u64)>,
}
