//! An agent that only takes notes: what it is asked, and when.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use candle_core::Tensor;
use hksl_sac::learner::{Operations, UpdateReport};
use hksl_sac::replay::{Replay, Sampler, Start};
use hksl_sac::{Acting, Agent, AgentRest, AgentState, FeatureMaps, Memory};
use ndarray::ArrayView3;
use rand_chacha::ChaCha8Rng;

/// A trajectory as the replay gave it.
pub struct Sampled {
    pub start: Start,
    pub observations: Vec<u8>,
    pub actions: Vec<f32>,
    pub rewards: Vec<f32>,
}

#[derive(Default)]
pub struct Notes {
    pub training_observations: Vec<Vec<u8>>,
    pub acting: Vec<Acting>,
    pub actions: Vec<f32>,
    /// Taken before the run was stopped.
    pub actions_before: usize,
    pub updates: Vec<u64>,
    pub loads: usize,
    pub batches: Vec<Sampled>,
}

/// Acts by a fixed rule and samples its replay at every update.
pub struct NoteTaker {
    pub notes: Rc<RefCell<Notes>>,
    pub replay: Replay,
    pub rng: ChaCha8Rng,
}

pub const LENGTH: usize = 6;

impl Agent for NoteTaker {
    fn act(
        &mut self,
        observation: ArrayView3<u8>,
        acting: Acting,
        _: &mut Memory,
    ) -> hksl_sac::Result<Vec<f32>> {
        if acting == Acting::Mean {
            return Ok(vec![0.0]);
        }
        let mut notes = self.notes.borrow_mut();
        let action = ((notes.actions_before + notes.actions.len()) as f32 * 0.7).sin();
        notes.training_observations.push(observation.iter().copied().collect());
        notes.acting.push(acting);
        notes.actions.push(action);
        Ok(vec![action])
    }

    fn begin_episode(&mut self, frame: ArrayView3<u8>) -> hksl_sac::Result<()> {
        self.replay.begin_episode(frame.as_slice().unwrap())
    }

    fn observe(
        &mut self,
        action: &[f32],
        reward: f64,
        terminal: bool,
        frame: ArrayView3<u8>,
    ) -> hksl_sac::Result<()> {
        self.replay.push(action, reward as f32, terminal, frame.as_slice().unwrap())
    }

    fn end_episode(&mut self) {
        self.replay.end_episode();
    }

    fn pretrain(&mut self) -> hksl_sac::Result<Option<UpdateReport>> {
        Ok(None)
    }

    fn pretraining(&self) -> (u64, u64) {
        (0, 0)
    }

    fn update(&mut self, agent_step: u64) -> hksl_sac::Result<Option<UpdateReport>> {
        let Some(starts) = self.replay.starts(&mut self.rng, 1, LENGTH) else { return Ok(None) };
        let batch = Sampler::new(0).batch(&self.replay, &starts, LENGTH, &mut self.rng);
        let mut notes = self.notes.borrow_mut();
        notes.updates.push(agent_step);
        notes.batches.push(Sampled {
            start: starts[0],
            observations: batch.observations,
            actions: batch.actions,
            rewards: batch.rewards,
        });
        Ok(Some(UpdateReport::default()))
    }

    fn diagnose(&self, _: &mut ChaCha8Rng) -> hksl_sac::Result<Vec<(String, f64)>> {
        Ok(Vec::new())
    }

    fn encode(&self, _: &Tensor) -> hksl_sac::Result<Vec<(String, Tensor)>> {
        Ok(Vec::new())
    }

    fn feature_maps(&self, _: &Tensor) -> hksl_sac::Result<Vec<FeatureMaps>> {
        Ok(Vec::new())
    }

    fn operations(&self) -> hksl_sac::Result<Operations> {
        Ok(Operations::default())
    }

    fn learning_bytes(&self) -> u64 {
        0
    }

    fn networks(&self) -> Vec<(String, usize)> {
        Vec::new()
    }

    fn weights(&self) -> hksl_sac::Result<BTreeMap<String, Tensor>> {
        Ok(BTreeMap::new())
    }

    fn load_weights(&mut self, _: &BTreeMap<String, Tensor>) -> hksl_sac::Result<()> {
        Ok(())
    }

    fn save(&self) -> hksl_sac::Result<AgentState> {
        let streams = BTreeMap::from([("notes".to_owned(), self.rng.clone())]);
        Ok(AgentState { tensors: BTreeMap::new(), rest: AgentRest { streams } })
    }

    fn load(&mut self, state: AgentState) -> hksl_sac::Result<()> {
        self.rng = state.rest.streams["notes"].clone();
        self.notes.borrow_mut().loads += 1;
        Ok(())
    }

    fn replay(&self) -> &Replay {
        &self.replay
    }

    fn replay_mut(&mut self) -> &mut Replay {
        &mut self.replay
    }
}
