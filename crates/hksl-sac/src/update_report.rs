//! What a learning step reports.

use std::collections::BTreeMap;
use std::time::Instant;

use candle_core::{DType, Tensor};

use crate::Result;

/// The parts of a learning step whose time is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// Choosing trajectories, copying them to the device, drawing noise.
    Sample,
    /// Stacking frames and shifting them at random.
    Augment,
    /// The hierarchy's losses.
    Representation,
    /// The critics.
    Critics,
    /// Actor and temperature.
    Actor,
    /// Target critics and momentum encoders.
    TargetNetworks,
}

impl Phase {
    /// The phase's name, as metrics write it.
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

/// Losses and other scalars of one step, still on the device, and the seconds of each phase.
#[derive(Debug, Default)]
pub struct UpdateReport {
    scalars: Vec<(String, Tensor)>,
    seconds: BTreeMap<Phase, f64>,
}

impl UpdateReport {
    /// Adds a scalar under its name in metrics.
    pub fn add(&mut self, name: &str, value: Tensor) {
        self.scalars.push((name.to_owned(), value));
    }

    /// Levels are counted from 1, the finest, in names that people read.
    pub(crate) fn add_level(&mut self, name: &str, level: usize, value: Tensor) {
        self.scalars.push((format!("{name}_{}", level + 1), value));
    }

    /// Adds the time since `clock` to a phase, and sets the clock to now.
    pub fn lap(&mut self, phase: Phase, clock: &mut Instant) {
        *self.seconds.entry(phase).or_default() += clock.elapsed().as_secs_f64();
        *clock = Instant::now();
    }

    /// This report and a later one of the same step.
    pub(crate) fn merge(mut self, later: Self) -> Self {
        self.scalars.extend(later.scalars);
        for (phase, seconds) in later.seconds {
            *self.seconds.entry(phase).or_default() += seconds;
        }
        self
    }

    /// The scalars with their names, in the order in which they were computed, copied from the device.
    /// `docs/metrics.md` defines each.
    pub fn values(&self) -> Result<Vec<(String, f64)>> {
        if self.scalars.is_empty() {
            return Ok(Vec::new());
        }
        // Read from the device at once.
        let scalar = |(_, tensor): &(String, Tensor)| tensor.to_dtype(DType::F64)?.flatten_all();
        let scalars = self.scalars.iter().map(scalar).collect::<candle_core::Result<Vec<_>>>()?;
        let values = Tensor::cat(&scalars, 0)?.to_vec1::<f64>()?;
        Ok(self.scalars.iter().map(|(name, _)| name.clone()).zip(values).collect())
    }

    /// Seconds spent in each phase; on a GPU, those that handing the work over took. The joint schedule's one backward
    /// pass counts as the critics'.
    pub fn seconds(&self) -> &BTreeMap<Phase, f64> {
        &self.seconds
    }
}
