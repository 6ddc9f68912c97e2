//! Configuration of a hierarchy.

use serde::{Deserialize, Serialize};

use crate::error::at_least_one;
use crate::{Error, Result};

/// Sizes and parts of a hierarchy (HKSL §4).
///
/// The three switches are for the ablations of the paper's figure 4. The full model has `communication: true,
/// projection: true, shared_encoder: false`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HierarchyConfig {
    /// Transitions that each level skips per step, `n^l`, finest level first. The number of entries is `h`.
    pub skips: Vec<usize>,
    /// Transitions in a trajectory, `k`. Level `l` takes `k div n^l` steps.
    pub trajectory_length: usize,
    /// Action dimensions, `A`.
    pub action_dims: usize,
    /// Latent dimensions, `Z` (paper: 50).
    pub latent_dims: usize,
    /// Hidden units of a communication manager (paper: 128).
    pub communication_hidden: usize,
    /// Whether coarser levels send contexts to finer ones (off: ablation `no-c`).
    pub communication: bool,
    /// Whether predictions are projected by `w` before the loss (off: ablation `no-w`).
    pub projection: bool,
    /// Whether all levels share one encoder (on: ablation `shared-encoder`).
    pub shared_encoder: bool,
}

impl HierarchyConfig {
    /// Number of levels, `h`.
    pub fn levels(&self) -> usize {
        self.skips.len()
    }

    /// Number of steps of a level in a trajectory, `N_l = k div n^l`.
    ///
    /// # Panics
    /// If the level does not exist or its skip is 0.
    pub fn steps(&self, level: usize) -> usize {
        self.trajectory_length / self.skips[level]
    }

    /// Whether a level receives contexts from the next coarser level.
    pub fn has_context(&self, level: usize) -> bool {
        self.communication && level + 1 < self.levels()
    }

    /// Number of encoders and of momentum encoders: one per level, or one shared encoder.
    pub fn encoders(&self) -> usize {
        if self.shared_encoder { 1 } else { self.levels() }
    }

    /// Checks every value.
    ///
    /// # Errors
    /// [`Error::Setting`] names the first value that is out of range, and the range.
    pub fn validate(&self) -> Result<()> {
        let k = self.trajectory_length;
        if self.skips.is_empty() {
            return Err(Error::setting(
                "hksl.skips",
                "[]",
                "at least one level is needed, as in [1, 3]",
            ));
        }
        for (name, value) in [
            ("hksl.trajectory_length", k),
            ("action_dims", self.action_dims),
            ("encoder.latent_dims", self.latent_dims),
            ("hksl.communication_hidden", self.communication_hidden),
        ] {
            at_least_one(name, value as u64)?;
        }
        if let Some(n) = self.skips.iter().find(|&&n| n == 0 || n > k) {
            return Err(Error::setting(
                "hksl.skips",
                format!("{:?}", self.skips),
                format!(
                    "a level that skips {n} transitions takes no step in a trajectory of \
                     hksl.trajectory_length = {k}; every skip must be in 1..={k}"
                ),
            ));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(crate) fn config(skips: &[usize], trajectory_length: usize) -> HierarchyConfig {
        HierarchyConfig {
            skips: skips.to_vec(),
            trajectory_length,
            action_dims: 1,
            latent_dims: 6,
            communication_hidden: 10,
            communication: true,
            projection: true,
            shared_encoder: false,
        }
    }

    #[test]
    fn counts_steps_by_whole_division() {
        let config = config(&[1, 3, 5, 7], 7);
        assert_eq!((0..4).map(|level| config.steps(level)).collect::<Vec<_>>(), [7, 2, 1, 1]);
        assert!(config.has_context(2) && !config.has_context(3));
    }

    #[test]
    fn names_the_skip_that_does_not_fit() {
        let message = config(&[1, 7], 6).validate().unwrap_err().to_string();
        assert!(message.contains("[1, 7]") && message.contains("1..=6"), "{message}");
        assert!(config(&[], 6).validate().is_err());
        assert!(config(&[0], 6).validate().is_err());
        config(&[4, 5], 10).validate().unwrap();
    }
}
