//! A control task with a distractor.

use ndarray::Array3;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::camera::{CameraBehaviour, CameraState, CameraWalk};
use super::color::{ColorState, ColorWalk};
use super::{CameraSettings, ColorSettings};
use crate::dmc::{ControlTask, Draws};
use crate::environment::PhysicalState;
use crate::{Environment, Error, Spec, Step, snapshot};

/// A task of the Control Suite with a distractor in its frames.
pub struct Distracted {
    task: ControlTask,
    walk: Walk,
    rng: ChaCha8Rng,
}

#[derive(Clone)]
enum Walk {
    Color(ColorWalk),
    Camera(CameraWalk),
}

/// Complete state for snapshots.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct State {
    task: Value,
    rng: ChaCha8Rng,
    walk: WalkState,
}

#[derive(Serialize, Deserialize)]
enum WalkState {
    Color(ColorState),
    Camera(Option<CameraState>),
}

impl Distracted {
    /// Wraps `task` with a colour walk that draws from `rng`.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn by_colors(
        task: ControlTask,
        settings: ColorSettings,
        rng: ChaCha8Rng,
    ) -> Result<Self, Error> {
        settings.check(&task.spec().task)?;
        let walk = Walk::Color(ColorWalk::new(settings, &task.physics().colors()));
        Ok(Self { task, walk, rng })
    }

    /// Wraps `task` with a camera walk that draws from `rng`.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn by_camera(
        task: ControlTask,
        settings: CameraSettings,
        rng: ChaCha8Rng,
    ) -> Result<Self, Error> {
        settings.check(&task.spec().task)?;
        let tracking = task.physics().camera_tracks();
        let behaviour = CameraBehaviour { tracking, upper_quadrant: !task.seen_from_above() };
        Ok(Self { task, walk: Walk::Camera(CameraWalk::new(settings, behaviour)), rng })
    }

    fn restart(&mut self, draws: &mut dyn Draws) {
        match &mut self.walk {
            Walk::Color(walk) => walk.restart(draws),
            Walk::Camera(walk) => walk.restart(&self.task.physics().view(), draws),
        }
        self.show();
    }

    fn advance(&mut self, draws: &mut dyn Draws) {
        match &mut self.walk {
            Walk::Color(walk) => walk.advance(draws),
            Walk::Camera(walk) => walk.advance(draws),
        }
        self.show();
    }

    /// Applies the distractor to the next frame. The camera must be at the model's position.
    fn show(&mut self) {
        let physics = self.task.physics_mut();
        match &self.walk {
            Walk::Color(walk) => physics.paint(walk.current()),
            Walk::Camera(walk) => {
                if let Some((position, axes)) = walk.pose(&physics.view()) {
                    physics.aim(position, axes);
                }
            }
        }
    }
}

impl Environment for Distracted {
    fn spec(&self) -> &Spec {
        self.task.spec()
    }

    fn reset(&mut self) -> Result<(), Error> {
        self.task.reset()?;
        let mut rng = self.rng.clone();
        self.restart(&mut rng);
        self.rng = rng;
        Ok(())
    }

    fn step(&mut self, action: &[f32]) -> Result<Step, Error> {
        let step = self.task.step(action)?;
        let mut rng = self.rng.clone();
        self.advance(&mut rng);
        self.rng = rng;
        Ok(step)
    }

    fn frame(&mut self) -> Result<Array3<u8>, Error> {
        self.task.frame()
    }

    fn readings(&self) -> Vec<Vec<f64>> {
        self.task.readings()
    }

    fn physical_state(&self) -> Option<PhysicalState> {
        self.task.physical_state()
    }

    fn snapshot(&self) -> Result<Value, Error> {
        let walk = match &self.walk {
            Walk::Color(walk) => WalkState::Color(walk.state()),
            Walk::Camera(walk) => WalkState::Camera(walk.state()),
        };
        let state = State { task: self.task.snapshot()?, rng: self.rng.clone(), walk };
        snapshot::write(&self.spec().task, &state)
    }

    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        let task = self.spec().task.clone();
        let state: State = snapshot::read(&task, snapshot)?;
        // Restored into a copy first, so that a snapshot of another task changes nothing.
        let mut walk = self.walk.clone();
        match (&mut walk, state.walk) {
            (Walk::Color(walk), WalkState::Color(state)) => {
                walk.restore(state).map_err(|reason| snapshot::unfit(&task, reason))?;
            }
            (Walk::Camera(walk), WalkState::Camera(state)) => {
                walk.restore(state).map_err(|reason| snapshot::unfit(&task, reason))?;
            }
            _ => return Err(snapshot::unfit(&task, "it was taken with another distractor")),
        }
        self.task.restore(&state.task)?;
        self.walk = walk;
        self.rng = state.rng;
        self.show();
        Ok(())
    }
}
