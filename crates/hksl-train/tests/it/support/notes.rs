//! A learner and an environment that take notes: what was asked of them, and when.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use candle_core::{Device, Tensor};
use hksl_core::Parameters;
use hksl_core::optim::Adam;
use hksl_envs::{Environment, Spec, Step};
use hksl_sac::replay::Start;
use hksl_sac::{Acting, Draw, Learner, Networks, RecurrentState, UpdateReport};
use ndarray::Array3;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::dot::FollowTheDot;

/// A trajectory as the replay gave it.
pub struct Sampled {
    pub start: Start,
    pub observations: Vec<u8>,
    pub actions: Vec<f32>,
    pub rewards: Vec<f32>,
}

#[derive(Default)]
pub struct Notes {
    /// Environments made so far. The first one measures memory, the second is the run's, others serve evaluations.
    pub environments: usize,
    /// Of the run's environment: each action, with the frame before it.
    pub actions: Vec<f32>,
    pub frames: Vec<Vec<u8>>,
    /// Of the policy, evaluations apart: how many actions had been taken when it was asked.
    pub policy_asked_at: Vec<usize>,
    pub updates: Vec<u64>,
    pub batches: Vec<Sampled>,
    /// Whether the run was resumed.
    pub resumed: bool,
}

pub type SharedNotes = Arc<Mutex<Notes>>;

pub fn read(notes: &SharedNotes) -> MutexGuard<'_, Notes> {
    notes.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Acts at random, and samples its replay at every update.
pub struct NoteTaker {
    pub notes: SharedNotes,
    networks: Networks,
}

impl std::fmt::Debug for NoteTaker {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("NoteTaker")
    }
}

pub const LENGTH: usize = 6;

impl NoteTaker {
    pub fn new(notes: SharedNotes, observation: [usize; 3]) -> Self {
        let networks = Networks {
            observation,
            parameters: Parameters::default(),
            trained: Vec::new(),
            encoders: Vec::new(),
            critics: Vec::new(),
        };
        Self { notes, networks }
    }
}

impl Learner for NoteTaker {
    fn networks(&self) -> &Networks {
        &self.networks
    }

    fn optimizers(&mut self) -> Vec<(String, &mut Adam)> {
        Vec::new()
    }

    fn act(
        &self,
        _: &Tensor,
        acting: Acting,
        random: &mut ChaCha8Rng,
        _: &mut RecurrentState,
    ) -> hksl_sac::Result<Tensor> {
        let mut action = 0f32;
        if acting == Acting::Sample {
            let mut notes = read(&self.notes);
            let taken = notes.actions.len();
            notes.policy_asked_at.push(taken);
            action = random.random_range(-1.0..=1.0);
        }
        Ok(Tensor::new(&[[action]], &Device::Cpu)?)
    }

    fn update(&mut self, draw: &mut Draw, step: u64) -> hksl_sac::Result<Option<UpdateReport>> {
        let Some(starts) = draw.starts(1, LENGTH) else { return Ok(None) };
        let batch = draw.batch(&starts, LENGTH)?;
        let numbers = |tensor: &Tensor| tensor.flatten_all()?.to_vec1::<f32>();
        let mut notes = read(&self.notes);
        notes.updates.push(step);
        notes.batches.push(Sampled {
            start: starts[0],
            observations: batch.trajectories.observations.flatten_all()?.to_vec1()?,
            actions: numbers(&batch.trajectories.actions)?,
            rewards: numbers(&batch.rewards)?,
        });
        Ok(Some(UpdateReport::default()))
    }

    fn diagnose(&self, _: &mut Draw) -> hksl_sac::Result<Vec<(String, f64)>> {
        Ok(Vec::new())
    }
}

/// Follow the dot; if `notes` are given, each action and the frame before it are noted.
pub struct NotedDot {
    inside: FollowTheDot,
    notes: Option<SharedNotes>,
}

impl NotedDot {
    pub fn new(rng: ChaCha8Rng, notes: &SharedNotes) -> Self {
        let mut noted = read(notes);
        noted.environments += 1;
        let notes = (noted.environments == 2).then(|| Arc::clone(notes));
        Self { inside: FollowTheDot::new(rng), notes }
    }
}

impl Environment for NotedDot {
    fn spec(&self) -> &Spec {
        self.inside.spec()
    }

    fn reset(&mut self) -> Result<(), hksl_envs::Error> {
        self.inside.reset()
    }

    fn step(&mut self, action: &[f32]) -> Result<Step, hksl_envs::Error> {
        let frame = self.inside.frame()?.into_iter().collect();
        if let Some(notes) = &self.notes {
            let mut notes = read(notes);
            notes.actions.extend(action);
            notes.frames.push(frame);
        }
        self.inside.step(action)
    }

    fn frame(&mut self) -> Result<Array3<u8>, hksl_envs::Error> {
        self.inside.frame()
    }

    fn readings(&self) -> Vec<Vec<f64>> {
        self.inside.readings()
    }

    fn snapshot(&self) -> Result<serde_json::Value, hksl_envs::Error> {
        self.inside.snapshot()
    }

    fn restore(&mut self, snapshot: &serde_json::Value) -> Result<(), hksl_envs::Error> {
        self.inside.restore(snapshot)
    }
}
