//! Tasks of the DeepMind Control Suite on MuJoCo, equivalent to dm_control 1.0.50: with the same draws and actions, states
//! are bitwise identical.
//!
//! Each domain has its own file (such as `dmc/cartpole.rs`) with constants, readings, reset and reward in dm_control's
//! order. It defines a `Domain`, to which a row of the registry refers. All other code is shared.

pub(crate) mod ball_in_cup;
pub(crate) mod cartpole;
pub(crate) mod cheetah;
mod draws;
pub(crate) mod finger;
mod log;
mod model_edits;
mod physics;
pub(crate) mod reacher;
mod tolerance;
pub(crate) mod walker;

use ndarray::Array3;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use serde_json::Value;

pub use draws::Draws;
pub(crate) use log::redirect as redirect_messages;
pub use model_edits::ModelEdits;
pub use physics::mujoco_version;
pub(crate) use physics::{Object, Physics, PhysicsState, StartState, View};

use crate::environment::{PhysicalState, check_action};
use crate::render::{RenderDevice, RenderSettings, Renderer};
use crate::rollout::Start;
use crate::settings::{Settings, check_setting};
use crate::{Environment, Error, FrameShape, ReadingSpec, Spec, Step, snapshot};

/// Definition of a task of the suite: data and functions of its physics.
#[derive(Debug)]
pub(crate) struct Domain {
    /// The task's name.
    pub task: &'static str,
    /// Its model file, relative to the model directory.
    pub model: &'static str,
    /// Physics steps per control step.
    pub substeps: usize,
    /// Whether the camera looks straight down on the scene.
    pub seen_from_above: bool,
    /// Model objects that the functions below refer to by index in this list. [`Physics`] resolves them once.
    pub objects: &'static [Object],
    /// The ground-truth readings, in the order of `probe`.
    pub readings: &'static [ReadingSpec],
    /// Writes a start state. Draws are made in dm_control's order.
    pub reset: fn(&mut Physics, &mut dyn Draws) -> Result<(), Error>,
    /// The reward of the state after a control step.
    pub reward: fn(&Physics) -> f64,
    /// The values of the ground-truth readings.
    pub probe: fn(&Physics) -> Vec<Vec<f64>>,
}

/// A task of the suite as an environment. One step is one control step.
pub struct ControlTask {
    domain: &'static Domain,
    spec: Spec,
    physics: Physics,
    /// Created at the first frame, so that physics runs on machines without rendering.
    renderer: Option<Renderer>,
    drawing: (RenderSettings, RenderDevice),
    rng: ChaCha8Rng,
    /// Control steps taken in this episode. None before the first reset and after a failure.
    steps: Option<usize>,
}

/// Complete state for snapshots.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct State {
    task: String,
    steps: Option<usize>,
    rng: ChaCha8Rng,
    physics: PhysicsState,
}

impl ControlTask {
    /// Loads the domain's model. Rendering is set up at the first frame.
    ///
    /// # Errors
    /// A setting out of range, a missing or unusable model file.
    pub(crate) fn new(
        domain: &'static Domain,
        settings: &Settings,
        rng: ChaCha8Rng,
    ) -> Result<Self, Error> {
        let task = domain.task;
        check_setting(task, "height", settings.height, 1)?;
        check_setting(task, "width", settings.width, 1)?;
        check_setting(task, "episode_steps", settings.episode_steps, 1)?;
        let physics = Physics::load(domain)?;
        let spec = Spec {
            task: domain.task.to_owned(),
            frame: FrameShape { channels: 3, height: settings.height, width: settings.width },
            action_dims: physics.control_dims(),
            steps_per_episode: settings.episode_steps,
            readings: domain.readings.to_vec(),
        };
        let drawing = (settings.render, settings.render_device);
        Ok(Self { domain, spec, physics, renderer: None, drawing, rng, steps: None })
    }

    /// Starts an episode with the given draws instead of the environment's RNG.
    ///
    /// # Errors
    /// A physics warning in the start state; no start state without contacts found.
    pub fn reset_with(&mut self, draws: &mut dyn Draws) -> Result<(), Error> {
        self.steps = None;
        self.physics.reset(self.domain, draws)?;
        self.steps = Some(0);
        Ok(())
    }

    /// Starts an episode in the state of `start`. The actions of `start` are not applied.
    ///
    /// # Errors
    /// [`Error::Start`] for a start that does not fit this task; a physics warning in the start state.
    pub fn start(&mut self, start: &Start) -> Result<(), Error> {
        self.steps = None;
        start.enter(&mut self.physics)?;
        self.steps = Some(0);
        Ok(())
    }

    /// Moves the camera for the next frame to a position in the world (m), with row-major axes. The next step or reset
    /// restores the model's camera.
    pub fn aim(&mut self, position: [f64; 3], axes: [f64; 9]) {
        self.physics.aim(position, axes);
    }

    /// Sets the colours (red, green, blue in [0, 1]) of the model's materials in the model's order. Resets and snapshots do
    /// not restore the original colours. Superfluous colours are ignored.
    pub fn paint(&mut self, colors: &[[f64; 3]]) {
        self.physics.paint(colors);
    }

    pub(crate) fn physics(&self) -> &Physics {
        &self.physics
    }

    pub(crate) fn physics_mut(&mut self) -> &mut Physics {
        &mut self.physics
    }

    /// Whether the camera looks straight down.
    pub(crate) fn seen_from_above(&self) -> bool {
        self.domain.seen_from_above
    }

    /// Generalised positions, m and rad.
    pub fn qpos(&self) -> &[f64] {
        self.physics.qpos()
    }

    /// Generalised velocities, m/s and rad/s.
    pub fn qvel(&self) -> &[f64] {
        self.physics.qvel()
    }
}

impl Environment for ControlTask {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn reset(&mut self) -> Result<(), Error> {
        let mut rng = self.rng.clone();
        let done = self.reset_with(&mut rng);
        self.rng = rng;
        done
    }

    fn step(&mut self, action: &[f32]) -> Result<Step, Error> {
        check_action(action, &self.spec)?;
        let steps = self.steps.ok_or(Error::NotReset { what: "a step" })?;
        if steps >= self.spec.steps_per_episode {
            return Err(Error::EpisodeOver { steps });
        }
        let control: Vec<f64> = action.iter().map(|&value| f64::from(value)).collect();
        self.steps = None;
        let before = self.physics.as_start(vec![control.clone()]);
        self.physics
            .control_step(&control)
            .map_err(|error| before.with_state_before(error, steps))?;
        let steps = steps + 1;
        self.steps = Some(steps);
        Ok(Step {
            reward: (self.domain.reward)(&self.physics),
            terminal: false,
            last: steps == self.spec.steps_per_episode,
        })
    }

    fn frame(&mut self) -> Result<Array3<u8>, Error> {
        if self.steps.is_none() {
            return Err(Error::NotReset { what: "a frame" });
        }
        let renderer = match &mut self.renderer {
            Some(renderer) => renderer,
            empty => {
                let FrameShape { height, width, .. } = self.spec.frame;
                let (settings, device) = self.drawing;
                let size = (height, width);
                empty.insert(Renderer::new(&mut self.physics, size, settings, device)?)
            }
        };
        renderer.frame(&mut self.physics)
    }

    fn readings(&self) -> Vec<Vec<f64>> {
        (self.domain.probe)(&self.physics)
    }

    fn physical_state(&self) -> Option<PhysicalState> {
        Some(PhysicalState { qpos: self.qpos().to_vec(), qvel: self.qvel().to_vec() })
    }

    fn snapshot(&self) -> Result<Value, Error> {
        let state = State {
            task: self.spec.task.clone(),
            steps: self.steps,
            rng: self.rng.clone(),
            physics: self.physics.state(),
        };
        snapshot::write(&self.spec.task, &state)
    }

    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        let task = self.spec.task.as_str();
        let state: State = snapshot::read(task, snapshot)?;
        snapshot::same(task, "task", &state.task.as_str(), &task)?;
        snapshot::within_episode(&self.spec, state.steps)?;
        self.steps = None;
        self.physics.restore(&state.physics)?;
        self.rng = state.rng;
        self.steps = state.steps;
        Ok(())
    }
}
