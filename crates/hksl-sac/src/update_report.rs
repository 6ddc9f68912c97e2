//! Reports of learning steps.

use std::collections::BTreeMap;
use std::time::Instant;

use candle_core::{DType, Tensor};

use crate::Result;

/// The timed phases of a learning step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// Choosing trajectories, copying them to the device, drawing noise.
    Sample,
    /// Stacking frames and applying random shifts.
    Augment,
    /// The hierarchy's losses.
    Representation,
    /// Critic updates.
    Critics,
    /// Actor and temperature updates.
    Actor,
    /// Soft updates of target critics and momentum encoders.
    TargetNetworks,
}

impl Phase {
    /// The phase's name in metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sample => "sample",
            Self::Augment => "augment",
            Self::Representation => "representation",
            Self::Critics => "critics",
            Self::Actor => "actor",
            Self::TargetNetworks => "target_networks",
        }
    }
}

/// Losses and other scalars of one learning step, on the learner's device, and the seconds of each phase.
#[derive(Debug, Default)]
pub struct UpdateReport {
    scalars: Vec<(String, Tensor)>,
    seconds: BTreeMap<Phase, f64>,
}

impl UpdateReport {
    /// Adds a scalar with its metric name.
    pub fn add(&mut self, name: &str, value: Tensor) {
        self.scalars.push((name.to_owned(), value));
    }

    /// Adds a scalar of a level. Metric names number levels from 1, the finest.
    pub(crate) fn add_level(&mut self, name: &str, level: usize, value: Tensor) {
        self.scalars.push((format!("{name}_{}", level + 1), value));
    }

    /// Adds the time since `clock` to a phase and resets the clock.
    pub fn lap(&mut self, phase: Phase, clock: &mut Instant) {
        *self.seconds.entry(phase).or_default() += clock.elapsed().as_secs_f64();
        *clock = Instant::now();
    }

    /// Merges a later report of the same step into this one.
    pub(crate) fn merge(mut self, later: Self) -> Self {
        self.scalars.extend(later.scalars);
        for (phase, seconds) in later.seconds {
            *self.seconds.entry(phase).or_default() += seconds;
        }
        self
    }

    /// Copies the scalars from the device. Returns pairs of metric name and value in the order in which they were added.
    /// `docs/metrics.md` defines each metric.
    pub fn values(&self) -> Result<Vec<(String, f64)>> {
        if self.scalars.is_empty() {
            return Ok(Vec::new());
        }
        // One transfer from the device for all scalars.
        let scalar = |(_, tensor): &(String, Tensor)| tensor.to_dtype(DType::F64)?.flatten_all();
        let scalars = self.scalars.iter().map(scalar).collect::<candle_core::Result<Vec<_>>>()?;
        let values = Tensor::cat(&scalars, 0)?.to_vec1::<f64>()?;
        Ok(self.scalars.iter().map(|(name, _)| name.clone()).zip(values).collect())
    }

    /// Seconds spent in each phase. On a GPU this is the time to enqueue the work. In the joint schedule, the backward
    /// passes count for the critics.
    pub fn seconds(&self) -> &BTreeMap<Phase, f64> {
        &self.seconds
    }
}
