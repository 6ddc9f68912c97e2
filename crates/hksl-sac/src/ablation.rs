//! The paper's ablations: HKSL with one part taken away.

use std::fmt;

use crate::config::HkslConfig;
use crate::{Error, Result};

/// A part removed from HKSL, with the figure of the paper that shows its effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ablation {
    /// `none`: the full method.
    None,
    /// `no-repr`: the critics of every level, but no representation losses (HKSL figure 4, "No Repr").
    NoRepresentation,
    /// `all-n1`: every level has skip 1 (HKSL figure 4, "All n = 1").
    AllSkipsOne,
    /// `no-c`: levels do not communicate (HKSL figure 4, "No c").
    NoCommunication,
    /// `shared-encoder`: one encoder for all levels (HKSL figure 4, "Shared Encoder").
    SharedEncoder,
    /// `no-w`: no projection between prediction and loss (HKSL figure 4, "No w").
    NoProjection,
    /// `h1`: the finest level alone (HKSL figure 4, "h = 1"; in Falling Pixels figure 3, right).
    FinestLevel,
    /// `h2`: two levels with skips 1 and 3 (HKSL figure 3, right).
    TwoLevels,
    /// `h3`: three levels with skips 1, 3 and 5 (HKSL figure 3, right).
    ThreeLevels,
    /// `h4`: four levels with skips 1, 3, 5 and 7 (HKSL figure 3, right).
    FourLevels,
}

impl Ablation {
    /// Every ablation, `none` first.
    pub const ALL: [Self; 10] = [
        Self::None,
        Self::NoRepresentation,
        Self::AllSkipsOne,
        Self::NoCommunication,
        Self::SharedEncoder,
        Self::NoProjection,
        Self::FinestLevel,
        Self::TwoLevels,
        Self::ThreeLevels,
        Self::FourLevels,
    ];

    /// The ablation's name in options and directory names.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::NoRepresentation => "no-repr",
            Self::AllSkipsOne => "all-n1",
            Self::NoCommunication => "no-c",
            Self::SharedEncoder => "shared-encoder",
            Self::NoProjection => "no-w",
            Self::FinestLevel => "h1",
            Self::TwoLevels => "h2",
            Self::ThreeLevels => "h3",
            Self::FourLevels => "h4",
        }
    }

    /// Names of the ablations of a task; `h2` … `h4` are of those whose number of levels the paper varies.
    pub fn names(varies_levels: bool) -> Vec<&'static str> {
        let defined = |ablation: &&Self| varies_levels || !ablation.sets_levels();
        Self::ALL.iter().filter(defined).map(|ablation| ablation.name()).collect()
    }

    /// Looks up the ablation with this name, for a task as in [`Self::names`].
    ///
    /// # Errors
    /// [`Error::UnknownAblation`] if no ablation has the name; [`Error::AblationNotForTask`] for `h2` … `h4`
    /// on a task for which the paper does not define them.
    pub fn from_name(name: &str, varies_levels: bool) -> Result<Self> {
        let ablation = Self::ALL.into_iter().find(|ablation| ablation.name() == name);
        let ablation = ablation.ok_or_else(|| Error::UnknownAblation {
            name: name.to_owned(),
            valid: Self::names(varies_levels),
        })?;
        if ablation.sets_levels() && !varies_levels {
            return Err(Error::AblationNotForTask { name: name.to_owned() });
        }
        Ok(ablation)
    }

    /// Removes the part from the configuration. `h2` … `h4` set the skips and the trajectory length for any task.
    pub fn apply(self, hksl: &mut HkslConfig) {
        match self {
            Self::None => {}
            Self::NoRepresentation => hksl.representation = false,
            Self::AllSkipsOne => hksl.skips.fill(1),
            Self::NoCommunication => hksl.communication = false,
            Self::SharedEncoder => hksl.shared_encoder = true,
            Self::NoProjection => hksl.projection = false,
            Self::FinestLevel => hksl.skips.truncate(1),
            Self::TwoLevels => levels(hksl, &[1, 3], 6),
            Self::ThreeLevels => levels(hksl, &[1, 3, 5], 6),
            // A skip of 7 does not fit the trajectory of 6 that the other hierarchies use.
            Self::FourLevels => levels(hksl, &[1, 3, 5, 7], 7),
        }
    }

    fn sets_levels(self) -> bool {
        matches!(self, Self::TwoLevels | Self::ThreeLevels | Self::FourLevels)
    }
}

fn levels(hksl: &mut HkslConfig, skips: &[usize], trajectory_length: usize) {
    hksl.skips = skips.to_vec();
    hksl.trajectory_length = trajectory_length;
}

impl fmt::Display for Ablation {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.pad(self.name())
    }
}

#[cfg(test)]
mod tests {
    use hksl_core::nn::Initialisation;

    use super::*;
    use crate::config::UpdateSchedule;

    fn cheetah() -> HkslConfig {
        HkslConfig {
            skips: vec![4, 5],
            trajectory_length: 10,
            learning_rate: 1e-4,
            actor_update_every: 2,
            update_schedule: UpdateSchedule::Sequential,
            initialisation: Initialisation::Orthogonal,
            communication_hidden: 128,
            representation: true,
            communication: true,
            projection: true,
            shared_encoder: false,
        }
    }

    fn applied(name: &str, varies_levels: bool) -> HkslConfig {
        let mut hksl = cheetah();
        Ablation::from_name(name, varies_levels).unwrap().apply(&mut hksl);
        hksl
    }

    #[test]
    fn each_ablation_removes_only_its_part() {
        let full = cheetah();
        for (name, expected) in [
            ("none", full.clone()),
            ("no-repr", HkslConfig { representation: false, ..full.clone() }),
            ("all-n1", HkslConfig { skips: vec![1, 1], ..full.clone() }),
            ("no-c", HkslConfig { communication: false, ..full.clone() }),
            ("shared-encoder", HkslConfig { shared_encoder: true, ..full.clone() }),
            ("no-w", HkslConfig { projection: false, ..full.clone() }),
            ("h1", HkslConfig { skips: vec![4], ..full.clone() }),
        ] {
            assert_eq!(applied(name, false), expected, "{name}");
        }
    }

    #[test]
    fn level_counts_are_for_tasks_that_vary_them() {
        for (name, skips, trajectory_length) in
            [("h2", vec![1, 3], 6), ("h3", vec![1, 3, 5], 6), ("h4", vec![1, 3, 5, 7], 7)]
        {
            let expected = HkslConfig { skips, trajectory_length, ..cheetah() };
            assert_eq!(applied(name, true), expected, "{name}");
            let message = Ablation::from_name(name, false).unwrap_err().to_string();
            assert!(message.contains(name) && message.contains("--set hksl.skips="), "{message}");
        }
    }

    #[test]
    fn an_unknown_name_lists_the_tasks_ablations() {
        for (varies_levels, count) in [(true, 10), (false, 7)] {
            let unknown = Ablation::from_name("no-d", varies_levels);
            let Err(Error::UnknownAblation { name, valid }) = unknown else { panic!("accepted") };
            assert_eq!((name.as_str(), valid.len()), ("no-d", count));
        }
    }
}
