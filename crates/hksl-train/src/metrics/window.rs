//! Values gathered between two lines of metrics.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Means of named values since the last line. Part of a checkpoint, so that the first line after a resume is
/// the one that the uninterrupted run would have written.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Window {
    sums: BTreeMap<String, (f64, u64)>,
}

impl Window {
    /// Takes in one value.
    pub fn add(&mut self, name: &str, value: f64) {
        if let Some((sum, count)) = self.sums.get_mut(name) {
            *sum += value;
            *count += 1;
        } else {
            self.sums.insert(name.to_owned(), (value, 1));
        }
    }

    /// How many values of this name came in.
    pub fn count(&self, name: &str) -> u64 {
        self.sums.get(name).map_or(0, |(_, count)| *count)
    }

    /// The mean of each name's values, and an empty window.
    pub fn take(&mut self) -> BTreeMap<String, f64> {
        let mean = |(name, (sum, count))| (name, sum / count as f64);
        std::mem::take(&mut self.sums).into_iter().map(mean).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gives_means_and_starts_anew() {
        let mut window = Window::default();
        window.add("a", 1.0);
        window.add("a", 4.0);
        window.add("b", 7.0);
        assert_eq!(window.count("a"), 2);
        assert_eq!(window.take(), BTreeMap::from([("a".into(), 2.5), ("b".into(), 7.0)]));
        assert_eq!(window, Window::default());
    }
}
