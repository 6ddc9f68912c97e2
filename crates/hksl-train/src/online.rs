//! Agents for training loops of other programs.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use candle_core::Device;
use hksl_envs::{FrameShape, Spec};
use hksl_files::RunFolder;
use hksl_sac::{Acting, Agent, RecurrentState};
use ndarray::{Array3, ArrayView3, s};
use serde_json::json;

use crate::checkpoint::{self, Checkpoints, Content, Reason, RunState, Saved};
use crate::config::{Config, OwnTask, Request, resolve};
use crate::factories::agent;
use crate::run::check_settings;
use crate::run::facts::SPECIFICATION;
use crate::{Error, Result};

/// Task name of agents that are trained by another program's loop.
pub const TASK: &str = "online";

/// Episode length that settings are checked against, if the request says nothing else. Episodes may have any length.
const EPISODE_STEPS: usize = 1000;

/// An agent whose environment is stepped by its caller.
///
/// An episode is [`OnlineAgent::begin`], then in turn [`OnlineAgent::act`], [`OnlineAgent::update`] and
/// [`OnlineAgent::observe`], which is the order of the training loop.
#[derive(Debug)]
pub struct OnlineAgent {
    config: Config,
    spec: Spec,
    agent: Agent,
    counts: RunState,
    state: RecurrentState,
    running: bool,
}

impl OnlineAgent {
    /// Creates an agent for observations `(stack·C, H, W)` of `environment.frame_stack` frames.
    ///
    /// # Errors
    /// As [`resolve`]; a number of channels that is no multiple of the frame stack.
    pub fn new(
        request: Request,
        observation: [usize; 3],
        action_dims: usize,
        device: impl FnOnce(&Config) -> Result<Device>,
    ) -> Result<Self> {
        let [stacked, height, width] = observation;
        let own_task =
            OwnTask { name: TASK.to_owned(), height, width, episode_steps: Some(EPISODE_STEPS) };
        let config = resolve(&Request { own_task: Some(own_task), ..request })?.config;
        let stack = config.environment.frame_stack;
        let refused = |key: &str, value: String, expected: &str| {
            let (key, expected) = (key.to_owned(), expected.to_owned());
            crate::config::Error::OutOfRange { key, value, origin: None, expected }
        };
        if stacked == 0 || !stacked.is_multiple_of(stack) {
            let expected = format!(
                "its channels must be a multiple of environment.frame_stack = {stack}: an observation is a stack of \
                 frames, (frame_stack·channels, height, width)"
            );
            let value = format!("{observation:?}");
            return Err(refused("observation_shape", value, &expected).into());
        }
        if action_dims == 0 {
            return Err(refused("action_dims", "0".to_owned(), "it must be at least 1").into());
        }
        let spec = Spec {
            task: TASK.to_owned(),
            frame: FrameShape { channels: stacked / stack, height, width },
            action_dims,
            steps_per_episode: config.environment.episode_steps,
            readings: Vec::new(),
        };
        let device = device(&config)?;
        let agent = agent(&config, &spec, &device)?;
        let (counts, state) = (RunState::default(), RecurrentState::default());
        Ok(Self { config, spec, agent, counts, state, running: false })
    }

    /// Its configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The agent.
    pub fn agent(&self) -> &Agent {
        &self.agent
    }

    /// Shape of an observation, `(stack·C, H, W)`.
    pub fn observation(&self) -> [usize; 3] {
        self.agent.networks().observation
    }

    /// Transitions observed.
    pub fn agent_step(&self) -> u64 {
        self.counts.agent_step
    }

    /// Learning steps taken.
    pub fn updates(&self) -> u64 {
        self.counts.updates
    }

    /// Begins an episode with its first observation `(stack·C, H, W)`, which repeats the first frame. A running episode
    /// ends without a terminal state.
    ///
    /// # Errors
    /// An observation of another shape, or whose frames differ.
    pub fn begin(&mut self, observation: ArrayView3<u8>) -> Result<()> {
        let newest = self.newest(observation)?;
        let frames = observation.exact_chunks(self.spec.frame.dim());
        if frames.into_iter().any(|frame| frame != newest) {
            return Err(crate::config::Error::OutOfRange {
                key: "observation".to_owned(),
                value: "a stack of different frames".to_owned(),
                origin: None,
                expected: "an episode's first observation must repeat its first frame environment.frame_stack times, \
                           because the replay stores each frame once"
                    .to_owned(),
            }
            .into());
        }
        self.agent.begin_episode(newest)?;
        self.state = RecurrentState::default();
        self.running = true;
        Ok(())
    }

    /// Chooses an action in [−1, 1] for an observation `(stack·C, H, W)`. To explore, it is uniformly random for the first
    /// `training.initial_random_steps` transitions and then sampled from the policy; otherwise it is the policy's mean.
    ///
    /// # Errors
    /// An observation of another shape.
    pub fn act(&mut self, observation: ArrayView3<u8>, explore: bool) -> Result<Vec<f32>> {
        let acting = match (explore, self.learns()) {
            (false, _) => Acting::Mean,
            (true, true) => Acting::Sample,
            (true, false) => Acting::Uniform,
        };
        self.newest(observation)?;
        Ok(self.agent.act(observation, acting, &mut self.state)?)
    }

    /// Stores a transition: the action taken, its reward, and the observation that it led to.
    ///
    /// # Errors
    /// Arrays of another shape; NaN or infinity; no running episode. Nothing is stored then.
    pub fn observe(
        &mut self,
        action: &[f32],
        reward: f64,
        next: ArrayView3<u8>,
        terminated: bool,
        truncated: bool,
    ) -> Result<()> {
        if !self.running {
            return Err(hksl_sac::Error::NoEpisode.into());
        }
        let newest = self.newest(next)?;
        self.agent.observe(action, reward, terminated, newest)?;
        self.counts.agent_step += 1;
        self.counts.environment_step += 1;
        self.counts.episode_return += reward;
        if terminated || truncated {
            self.agent.end_episode();
            self.counts.last_return = Some(std::mem::take(&mut self.counts.episode_return));
            self.running = false;
        }
        Ok(())
    }

    /// Takes a learning step, after the outstanding pretraining steps, and returns its losses by name. None during the
    /// initial random steps, if no learning step is due, or if no finished episode is long enough to sample.
    ///
    /// # Errors
    /// Whatever the method reports.
    pub fn update(&mut self) -> Result<Option<Vec<(String, f64)>>> {
        if !self.learns() {
            return Ok(None);
        }
        while self.agent.pretrain()?.is_some() {}
        let Some(report) = self.agent.update(self.counts.agent_step)? else { return Ok(None) };
        self.counts.updates += 1;
        Ok(Some(report.values()?))
    }

    /// Saves everything into a folder, which [`crate::policy::Policy::open`] can open too. Earlier saves in the folder are
    /// kept as a run keeps its checkpoints.
    ///
    /// # Errors
    /// A folder that holds a run of another configuration, is in use or cannot be written.
    pub fn save(&mut self, folder: &Path) -> Result<()> {
        let folder = RunFolder::new(folder);
        if folder.is_begun() {
            check_settings(&folder, &self.config)?;
        }
        let _lock = folder.lock()?;
        let facts = BTreeMap::from([
            ("hksl".to_owned(), json!(env!("CARGO_PKG_VERSION"))),
            ("commit".to_owned(), json!(crate::COMMIT)),
            (SPECIFICATION.to_owned(), json!(self.spec)),
        ]);
        let frame = Array3::zeros(self.spec.frame.dim());
        let stack = vec![frame; self.config.environment.frame_stack];
        Checkpoints::of_run(&folder).save(&Content {
            agent: self.agent.save()?,
            replay: self.agent.replay(),
            run: &self.counts,
            stack,
            memory: RecurrentState::default(),
            reasons: BTreeSet::from([Reason::Best]),
        })?;
        Ok(folder.describe(&self.config.to_toml()?, "saved by a training loop", &facts)?)
    }

    /// Restores the newest save of a folder. An episode that was running ends without a terminal state.
    ///
    /// # Errors
    /// A folder without a save, of another configuration or damaged. The agent is then unchanged or unusable.
    pub fn load(&mut self, folder: &Path) -> Result<()> {
        let folder = RunFolder::existing(folder)?;
        check_settings(&folder, &self.config)?;
        let mut checkpoints = Checkpoints::of_run(&folder);
        let layout = *self.agent.replay().layout();
        let (saved, _) = checkpoints.load_newest(&layout, self.config.replay.storage)?;
        let Some(Saved { run, agent, finished, running, .. }) = saved else {
            let folder = folder.path().join("checkpoints");
            return Err(checkpoint::Error::NoCheckpoints { folder }.into());
        };
        let other = |error: hksl_sac::Error| checkpoint::Error::OtherWeights {
            environment_step: run.environment_step,
            method: self.config.method.clone(),
            reason: error.to_string(),
        };
        self.agent.load(agent).map_err(other)?;
        self.agent.replay_mut().restore(finished, running)?;
        self.agent.end_episode();
        self.counts = RunState { episode_return: 0.0, ..run };
        (self.running, self.state) = (false, RecurrentState::default());
        Ok(())
    }

    fn learns(&self) -> bool {
        self.counts.agent_step >= self.config.training.initial_random_steps
    }

    /// The newest frame of an observation.
    fn newest<'a>(&self, observation: ArrayView3<'a, u8>) -> Result<ArrayView3<'a, u8>> {
        let (channels, height, width) = observation.dim();
        let expected = self.observation();
        if [channels, height, width] != expected {
            return Err(Error::from(hksl_core::Error::Shape {
                what: "observation",
                got: vec![channels, height, width],
                expected: format!("{expected:?}"),
            }));
        }
        let own = self.spec.frame.channels;
        Ok(observation.slice_move(s![channels - own.., .., ..]))
    }
}
