//! The tasks by name, and how to build one.

use std::fmt;

use rand_chacha::ChaCha8Rng;

use crate::settings::Settings;
use crate::{Distraction, Environment, Error, FallingPixels, falling_pixels, nearest};

/// How graded a task's rewards are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RewardKind {
    /// Each control step brings 0 or 1.
    ZeroOne,
    /// Each control step brings a number from 0 to 1.
    Graded,
}

impl fmt::Display for RewardKind {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.pad(match self {
            RewardKind::ZeroOne => "0/1",
            RewardKind::Graded => "graded",
        })
    }
}

/// What there is to say about a task without building it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TaskInfo {
    /// Its name.
    pub name: &'static str,
    /// Numbers in an action.
    pub action_dims: usize,
    /// The time limit of its full-length episode, control steps.
    pub control_steps_per_episode: usize,
    /// Simulated time of a control step, milliseconds; none for a task without physics.
    pub control_step_milliseconds: Option<u32>,
    /// How graded its rewards are.
    pub reward: RewardKind,
    /// True if it runs on MuJoCo.
    pub needs_mujoco: bool,
    /// True if this build has it.
    pub available: bool,
    /// One line on what to do in it.
    pub summary: &'static str,
}

use RewardKind::{Graded, ZeroOne};

/// A task of the Control Suite; all have the same length.
const fn suite(
    name: &'static str,
    action_dims: usize,
    control_step_milliseconds: u32,
    reward: RewardKind,
    summary: &'static str,
) -> TaskInfo {
    TaskInfo {
        name,
        action_dims,
        control_steps_per_episode: 1000,
        control_step_milliseconds: Some(control_step_milliseconds),
        reward,
        needs_mujoco: true,
        available: cfg!(feature = "mujoco"),
        summary,
    }
}

const TASKS: &[TaskInfo] = &[
    TaskInfo {
        name: falling_pixels::TASK,
        action_dims: 1,
        control_steps_per_episode: 250,
        control_step_milliseconds: None,
        reward: ZeroOne,
        needs_mujoco: false,
        available: true,
        summary: "move along the bottom row and catch pixels that fall at speeds of their own",
    },
    suite(
        "cartpole-swingup",
        1,
        10,
        Graded,
        "swing a hanging pole up and balance it by pushing its cart",
    ),
    suite("finger-spin", 2, 20, ZeroOne, "keep a spinner turning with a finger of two joints"),
    suite("reacher-easy", 2, 20, ZeroOne, "bring the end of a two-link arm to a large target"),
    suite("cheetah-run", 6, 10, Graded, "run forward on two legs, as fast as 10 m/s"),
    suite("walker-walk", 6, 25, Graded, "stand up and walk forward on two legs"),
    suite(
        "ball_in_cup-catch",
        2,
        20,
        ZeroOne,
        "swing a ball on a string into a cup and keep it there",
    ),
];

/// Every task there is, those that this build leaves out included.
pub fn tasks() -> &'static [TaskInfo] {
    TASKS
}

/// Tells a distractor's stream from its task's, whose seed it shares.
#[cfg(feature = "mujoco")]
const DISTRACTOR_STREAM: u64 = 0x6469_7374_7261_6374;

/// Builds the environment named `task`, which draws all its randomness from `rng`; a distractor, from another
/// stream of the same seed, so that the episodes are the same without it.
///
/// # Errors
/// An unknown task (the nearest names are given), a task this build leaves out, a setting out of
/// range, a distractor where there is none, a missing or unusable model file.
pub fn make(
    task: &str,
    settings: &Settings,
    rng: ChaCha8Rng,
) -> Result<Box<dyn Environment>, Error> {
    let info = find(task)?;
    if info.name == falling_pixels::TASK {
        if settings.distraction != Distraction::None {
            return Err(Error::Distractor { task: task.to_owned() });
        }
        return Ok(Box::new(FallingPixels::new(settings, rng)?));
    }
    control_suite(info.name, settings, rng)
}

/// The entry of `task`.
///
/// # Errors
/// An unknown task; the nearest names are given.
pub fn find(task: &str) -> Result<&'static TaskInfo, Error> {
    TASKS.iter().find(|info| info.name == task).ok_or_else(|| unknown(task))
}

fn unknown(task: &str) -> Error {
    let names = || TASKS.iter().map(|info| info.name);
    let near = nearest(task, names());
    let hint = if near.is_empty() {
        format!("valid: {}", names().collect::<Vec<_>>().join(", "))
    } else {
        format!("did you mean {}?", near.join(" or "))
    };
    Error::UnknownTask { task: task.to_owned(), hint }
}

#[cfg(feature = "mujoco")]
fn control_suite(
    task: &str,
    settings: &Settings,
    rng: ChaCha8Rng,
) -> Result<Box<dyn Environment>, Error> {
    let mut distractor = rng.clone();
    distractor.set_stream(rng.get_stream() ^ DISTRACTOR_STREAM);
    let inside = crate::dmc::ControlTask::new(task, settings, rng)?;
    Ok(match settings.distraction {
        Distraction::None => Box::new(inside),
        Distraction::Color(settings) => {
            Box::new(crate::Distracted::by_colors(inside, settings, distractor)?)
        }
        Distraction::Camera(settings) => {
            Box::new(crate::Distracted::by_camera(inside, settings, distractor)?)
        }
    })
}

#[cfg(not(feature = "mujoco"))]
fn control_suite(
    task: &str,
    _settings: &Settings,
    _rng: ChaCha8Rng,
) -> Result<Box<dyn Environment>, Error> {
    Err(Error::NeedsMujoco { task: task.to_owned() })
}

#[cfg(test)]
mod tests {
    use rand_chacha::rand_core::SeedableRng;

    use super::*;

    const SETTINGS: Settings = Settings::new(35, 15, 250);

    #[test]
    fn an_unknown_task_is_named_beside_the_nearest() {
        let message =
            |task| make(task, &SETTINGS, ChaCha8Rng::seed_from_u64(0)).err().unwrap().to_string();
        assert!(message("falling_pixel").contains("'falling_pixel'"));
        assert!(message("falling_pixel").contains("did you mean falling-pixels?"));
        assert!(message("humanoid-stand").contains("valid: falling-pixels, cartpole-swingup"));
    }

    #[test]
    fn what_the_registry_says_is_what_make_builds() {
        for info in tasks().iter().filter(|info| info.available) {
            let settings = Settings { episode_steps: info.control_steps_per_episode, ..SETTINGS };
            let environment = make(info.name, &settings, ChaCha8Rng::seed_from_u64(0)).unwrap();
            assert_eq!(environment.spec().task, info.name);
            assert_eq!(environment.spec().action_dims, info.action_dims);
            assert_eq!(environment.spec().steps_per_episode, info.control_steps_per_episode);
        }
    }

    #[cfg(not(feature = "mujoco"))]
    #[test]
    fn without_mujoco_its_tasks_say_how_to_get_it() {
        let error =
            make("cartpole-swingup", &SETTINGS, ChaCha8Rng::seed_from_u64(0)).err().unwrap();
        assert!(error.is_native());
        assert!(error.to_string().contains("make setup"));
    }
}
