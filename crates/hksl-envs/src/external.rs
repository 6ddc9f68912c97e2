//! Environments of other programs, such as those of Python's Gymnasium.
//!
//! A program declares its spaces, [`Interface::new`] checks them, and [`External`] makes an [`Environment`] of the
//! program's [`Simulator`]: it scales actions, orders axes, applies the time limit and checks what the simulator returns.
//! Frames are never resized.
//!
//! ```
//! use hksl_envs::external::{Declaration, Interface, Space};
//!
//! let interface = Interface::new(&Declaration {
//!     task: "pendulum".to_owned(),
//!     observation: Space::Box {
//!         dtype: "uint8".to_owned(),
//!         shape: vec![84, 96, 3],
//!         low: vec![0.0],
//!         high: vec![255.0],
//!     },
//!     action: Space::Box {
//!         dtype: "float32".to_owned(),
//!         shape: vec![1],
//!         low: vec![-2.0],
//!         high: vec![2.0],
//!     },
//! })?;
//! assert_eq!(interface.frame.dim(), (3, 84, 96));
//! assert_eq!(interface.action(&[0.5]), [1.0]);
//! # Ok::<(), hksl_envs::Error>(())
//! ```

mod interface;

use ndarray::Array3;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

use crate::environment::check_action;
use crate::settings::check_setting;
use crate::{Environment, Error, ReadingSpec, Spec, Step, snapshot};

pub use interface::{Declaration, Interface, MINIMUM_SIDE, Space};

/// What another program simulates.
pub trait Simulator {
    /// Starts an episode whose random numbers come from this seed, below 2³¹.
    ///
    /// # Errors
    /// [`Error::External`] and [`Error::ExternalFrame`].
    fn reset(&mut self, seed: u32) -> Result<Scene, Error>;

    /// Applies an action within the declared bounds.
    ///
    /// # Errors
    /// [`Error::External`] and [`Error::ExternalFrame`].
    fn step(&mut self, action: &[f64]) -> Result<Outcome, Error>;
}

/// What there is to see and to know of a state.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// `(channels, height, width)`, from [`Interface::frame`].
    pub frame: Array3<u8>,
    /// The ground-truth readings, in the order of their names.
    pub readings: Vec<Vec<f64>>,
}

/// What a step of a simulator leads to.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The new state.
    pub scene: Scene,
    /// The reward of the step.
    pub reward: f64,
    /// Whether the new state is terminal.
    pub terminated: bool,
    /// Whether the episode ended for another reason.
    pub truncated: bool,
}

/// An environment of another program.
///
/// Each episode starts from a seed of its own, drawn from the generator of [`External::new`]. The simulator cannot be
/// restored in the middle of an episode, so a snapshot holds only that generator.
pub struct External {
    interface: Interface,
    spec: Spec,
    simulator: Box<dyn Simulator>,
    rng: ChaCha8Rng,
    scene: Option<Scene>,
    /// Steps taken in this episode. None before the first reset and after a failure.
    steps: Option<usize>,
    over: bool,
}

impl External {
    /// Wraps a simulator whose episodes are truncated after `episode_steps` steps at the latest. With names of readings,
    /// it is reset once to learn their sizes.
    ///
    /// # Errors
    /// An episode length of 0; whatever the simulator reports.
    pub fn new(
        interface: Interface,
        simulator: Box<dyn Simulator>,
        episode_steps: usize,
        readings: &[String],
        rng: ChaCha8Rng,
    ) -> Result<Self, Error> {
        check_setting(&interface.task, "episode_steps", episode_steps, 1)?;
        let spec = Spec {
            task: interface.task.clone(),
            frame: interface.frame,
            action_dims: interface.action_dims(),
            steps_per_episode: episode_steps,
            readings: Vec::new(),
        };
        let mut external =
            Self { interface, spec, simulator, rng, scene: None, steps: None, over: false };
        if !readings.is_empty() {
            // A copy of the generator: whether readings are asked for does not change the episodes.
            let scene = external.simulator.reset(seed(&mut external.rng.clone()))?;
            let sizes = scene.readings.iter().map(Vec::len);
            external.spec.readings = readings
                .iter()
                .zip(sizes)
                .map(|(name, len)| ReadingSpec { name: name.clone().into(), unit: "".into(), len })
                .collect();
        }
        Ok(external)
    }

    fn keep(&mut self, scene: Scene) -> Result<(), Error> {
        if scene.frame.dim() != self.spec.frame.dim() {
            let (channels, height, width) = scene.frame.dim();
            return Err(self.interface.wrong_frame(&[channels, height, width]));
        }
        for (spec, reading) in self.spec.readings.iter().zip(&scene.readings) {
            if reading.len() != spec.len {
                return Err(Error::ExternalReading {
                    task: self.spec.task.clone(),
                    name: spec.name.clone().into_owned(),
                    expected: spec.len,
                    got: reading.len(),
                });
            }
        }
        self.scene = Some(scene);
        Ok(())
    }
}

/// Every program's seeds can be that large.
fn seed(rng: &mut ChaCha8Rng) -> u32 {
    rng.random_range(0..1 << 31)
}

impl Environment for External {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn reset(&mut self) -> Result<(), Error> {
        self.steps = None;
        let scene = self.simulator.reset(seed(&mut self.rng))?;
        self.keep(scene)?;
        (self.steps, self.over) = (Some(0), false);
        Ok(())
    }

    fn step(&mut self, action: &[f32]) -> Result<Step, Error> {
        check_action(action, &self.spec)?;
        let steps = self.steps.ok_or(Error::NotReset { what: "a step" })?;
        if self.over {
            return Err(Error::EpisodeOver { steps });
        }
        // If the simulator fails, the next call must be a reset.
        self.steps = None;
        let Outcome { scene, reward, terminated, truncated } =
            self.simulator.step(&self.interface.action(action))?;
        self.keep(scene)?;
        let steps = steps + 1;
        if !reward.is_finite() {
            return Err(Error::ExternalReward {
                task: self.spec.task.clone(),
                value: reward,
                step: steps,
            });
        }
        self.steps = Some(steps);
        self.over = terminated || truncated || steps >= self.spec.steps_per_episode;
        Ok(Step { reward, terminal: terminated, last: self.over })
    }

    fn frame(&mut self) -> Result<Array3<u8>, Error> {
        match &self.scene {
            Some(scene) => Ok(scene.frame.clone()),
            None => Err(Error::NotReset { what: "a frame" }),
        }
    }

    fn readings(&self) -> Vec<Vec<f64>> {
        match (&self.scene, self.spec.readings.is_empty()) {
            (Some(scene), false) => scene.readings.clone(),
            _ => Vec::new(),
        }
    }

    fn snapshot(&self) -> Result<Value, Error> {
        snapshot::write(&self.spec.task, &self.rng)
    }

    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        self.rng = snapshot::read(&self.spec.task, snapshot)?;
        self.steps = None;
        Ok(())
    }

    fn restores_episodes(&self) -> bool {
        false
    }
}

#[cfg(test)]
#[path = "external/tests.rs"]
mod tests;
