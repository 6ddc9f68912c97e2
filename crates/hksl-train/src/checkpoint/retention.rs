//! Which checkpoints a run keeps.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::Summary;

/// How many full states are kept.
const STATES: usize = 2;

/// Why a checkpoint's weights are kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reason {
    /// Its step is a multiple of `checkpoint.weights_every_environment_steps`.
    Interval,
    /// The best evaluation so far.
    Best,
    /// The end of the run's budget.
    End,
}

/// What may go.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Plan {
    /// Checkpoints that lose their state and keep their weights.
    pub states: Vec<u64>,
    /// Checkpoints that go altogether.
    pub whole: Vec<u64>,
    /// Checkpoints that stay for fewer reasons than before.
    pub reasons: BTreeMap<u64, BTreeSet<Reason>>,
}

/// Of all checkpoints and those among them with a state, what may go: states but for the newest two, and
/// checkpoints without state or reason. Only the newest `best` is the best.
pub(super) fn plan(all: &BTreeMap<u64, Summary>, with_state: &BTreeSet<u64>) -> Plan {
    let kept_states: BTreeSet<u64> = with_state.iter().rev().take(STATES).copied().collect();
    let best =
        all.iter().rev().find(|(_, s)| s.reasons.contains(&Reason::Best)).map(|(step, _)| *step);
    let mut plan = Plan::default();
    for (&step, summary) in all {
        let mut reasons = summary.reasons.clone();
        if best != Some(step) {
            reasons.remove(&Reason::Best);
        }
        let state_stays = kept_states.contains(&step);
        if reasons.is_empty() && !state_stays {
            plan.whole.push(step);
            continue;
        }
        if with_state.contains(&step) && !state_stays {
            plan.states.push(step);
        }
        if reasons != summary.reasons {
            plan.reasons.insert(step, reasons);
        }
    }
    plan
}

#[cfg(test)]
mod tests {
    use super::*;

    fn summary(step: u64, reasons: &[Reason]) -> (u64, Summary) {
        let summary = Summary {
            agent_step: step,
            environment_step: step,
            reasons: reasons.iter().copied().collect(),
            files: BTreeMap::new(),
            episodes: BTreeMap::new(),
        };
        (step, summary)
    }

    #[test]
    fn keeps_two_states_and_what_has_a_reason() {
        use Reason::{Best, Interval};
        let all = BTreeMap::from([
            summary(0, &[Interval, Best]),
            summary(5, &[]),
            summary(10, &[Best]),
            summary(20, &[Interval, Best]),
            summary(25, &[]),
        ]);
        let plan = plan(&all, &BTreeSet::from([5, 10, 20, 25]));
        assert_eq!(plan.whole, [5, 10]);
        assert_eq!(plan.states, [0u64; 0]);
        assert_eq!(plan.reasons, BTreeMap::from([(0, BTreeSet::from([Interval]))]));
    }

    #[test]
    fn an_old_state_goes_and_its_weights_stay() {
        let all =
            BTreeMap::from([summary(10, &[Reason::Interval]), summary(20, &[]), summary(30, &[])]);
        let plan = plan(&all, &BTreeSet::from([10, 20, 30]));
        assert_eq!((plan.states, plan.whole), (vec![10], vec![]));
    }
}
