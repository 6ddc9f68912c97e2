//! The registry of tasks.

use std::fmt;

use rand_chacha::ChaCha8Rng;

#[cfg(feature = "mujoco")]
use crate::dmc::Domain;
use crate::settings::Settings;
use crate::{Distractor, Environment, Error, FallingPixels, falling_pixels, nearest};

/// Kind of a task's rewards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RewardKind {
    /// The reward of each control step is 0 or 1.
    ZeroOne,
    /// The reward of each control step is in [0, 1].
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

/// A row of the registry: properties of a task.
#[derive(Clone, Copy, Debug)]
pub struct TaskInfo {
    /// Its name.
    pub name: &'static str,
    /// Action dimensions.
    pub action_dims: usize,
    /// Time limit of a full-length episode, control steps.
    pub control_steps_per_episode: usize,
    /// Simulated time per control step, ms. None for a task without physics.
    pub control_step_milliseconds: Option<u32>,
    /// Kind of its rewards.
    pub reward: RewardKind,
    /// Whether it needs MuJoCo.
    pub needs_mujoco: bool,
    /// Whether this build contains it.
    pub available: bool,
    /// One-line description of the goal.
    pub summary: &'static str,
    /// Default targets of linear probes.
    pub probe: Option<ProbeTargets>,
    /// Whether HKSL's paper varies the number of levels on it (figure 3, right).
    pub varies_levels: bool,
    kind: Kind,
}

/// How a task is built.
#[derive(Clone, Copy, Debug)]
enum Kind {
    FallingPixels,
    #[cfg(feature = "mujoco")]
    Control(&'static Domain),
    #[cfg(not(feature = "mujoco"))]
    Control,
}

/// Default targets of linear probes in a task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProbeTargets {
    /// Names of readings or of their components: `cart.x`.
    pub coordinates: &'static [&'static str],
    /// Prediction horizons, agent steps.
    pub horizons: &'static [usize],
}

use RewardKind::{Graded, ZeroOne};

/// A row of a Control Suite task: domain, name, action dimensions, milliseconds per control step, kind of reward, summary
/// and probe targets.
macro_rules! suite {
    ($domain:ident::$task:ident, $name:literal, $dims:literal, $milliseconds:literal, $reward:ident, $summary:literal, $probe:expr $(,)?) => {
        TaskInfo {
            name: $name,
            action_dims: $dims,
            control_steps_per_episode: 1000,
            control_step_milliseconds: Some($milliseconds),
            reward: $reward,
            needs_mujoco: true,
            available: cfg!(feature = "mujoco"),
            summary: $summary,
            probe: $probe,
            varies_levels: false,
            #[cfg(feature = "mujoco")]
            kind: Kind::Control(&crate::dmc::$domain::$task),
            #[cfg(not(feature = "mujoco"))]
            kind: Kind::Control,
        }
    };
}

static TASKS: &[TaskInfo] = &[
    TaskInfo {
        name: falling_pixels::TASK,
        action_dims: 1,
        control_steps_per_episode: 250,
        control_step_milliseconds: None,
        reward: ZeroOne,
        needs_mujoco: false,
        available: true,
        summary: "move along the bottom row and catch pixels that fall at speeds of their own",
        probe: Some(ProbeTargets { coordinates: &["agent_column"], horizons: &[1, 3, 5] }),
        varies_levels: true,
        kind: Kind::FallingPixels,
    },
    suite!(
        cartpole::SWINGUP,
        "cartpole-swingup",
        1,
        10,
        Graded,
        "swing a hanging pole up and balance it by pushing its cart",
        Some(ProbeTargets { coordinates: &["cart.x", "pole.x", "pole.z"], horizons: &[1, 5, 10] }),
    ),
    suite!(
        finger::SPIN,
        "finger-spin",
        2,
        20,
        ZeroOne,
        "keep a spinner turning with a finger of two joints",
        None,
    ),
    suite!(
        reacher::EASY,
        "reacher-easy",
        2,
        20,
        ZeroOne,
        "bring the end of a two-link arm to a large target",
        None,
    ),
    suite!(
        cheetah::RUN,
        "cheetah-run",
        6,
        10,
        Graded,
        "run forward on two legs, as fast as 10 m/s",
        None,
    ),
    suite!(
        walker::WALK,
        "walker-walk",
        6,
        25,
        Graded,
        "stand up and walk forward on two legs",
        None,
    ),
    suite!(
        ball_in_cup::CATCH,
        "ball_in_cup-catch",
        2,
        20,
        ZeroOne,
        "swing a ball on a string into a cup and keep it there",
        Some(ProbeTargets { coordinates: &["ball.x", "ball.z"], horizons: &[1, 2, 3] }),
    ),
];

/// All tasks, including those not contained in this build.
pub fn tasks() -> &'static [TaskInfo] {
    TASKS
}

/// RNG stream number of a distractor, which shares the seed of its task.
#[cfg(feature = "mujoco")]
const DISTRACTOR_STREAM: u64 = 0x6469_7374_7261_6374;

/// Creates the environment of `task`, with random numbers from `rng`. A distractor uses another stream of the same seed,
/// so that the episodes are the same without it.
///
/// # Errors
/// An unknown task (with similar names), a task not contained in this build, a setting out of range, a distractor for a
/// task that has none, a missing or unusable model file.
pub fn make(
    task: &str,
    settings: &Settings,
    rng: ChaCha8Rng,
) -> Result<Box<dyn Environment>, Error> {
    let info = find(task)?;
    match info.kind {
        Kind::FallingPixels if settings.distraction != Distractor::None => {
            Err(Error::Distractor { task: task.to_owned() })
        }
        Kind::FallingPixels => Ok(Box::new(FallingPixels::new(settings, rng)?)),
        #[cfg(feature = "mujoco")]
        Kind::Control(domain) => distracted_control_task(domain, settings, rng),
        #[cfg(not(feature = "mujoco"))]
        Kind::Control => Err(Error::NeedsMujoco { task: task.to_owned() }),
    }
}

/// Looks up `task`.
///
/// # Errors
/// An unknown task, with similar names.
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

/// Creates a Control Suite task as a [`crate::dmc::ControlTask`], which can start from any physical state.
///
/// # Errors
/// A task that is not in the suite, a setting out of range, a missing or unusable model file.
#[cfg(feature = "mujoco")]
pub fn control_task(
    task: &str,
    settings: &Settings,
    rng: ChaCha8Rng,
) -> Result<crate::dmc::ControlTask, Error> {
    let Some(domain) = domain(task) else {
        let names: Vec<&str> =
            TASKS.iter().filter(|info| info.needs_mujoco).map(|i| i.name).collect();
        let hint = format!("valid: {}", names.join(", "));
        return Err(Error::UnknownTask { task: task.to_owned(), hint });
    };
    crate::dmc::ControlTask::new(domain, settings, rng)
}

/// The domain of a Control Suite task.
#[cfg(feature = "mujoco")]
pub(crate) fn domain(task: &str) -> Option<&'static Domain> {
    match TASKS.iter().find(|info| info.name == task)?.kind {
        Kind::FallingPixels => None,
        Kind::Control(domain) => Some(domain),
    }
}

#[cfg(feature = "mujoco")]
fn distracted_control_task(
    domain: &'static Domain,
    settings: &Settings,
    rng: ChaCha8Rng,
) -> Result<Box<dyn Environment>, Error> {
    let mut distractor = rng.clone();
    distractor.set_stream(rng.get_stream() ^ DISTRACTOR_STREAM);
    let inside = crate::dmc::ControlTask::new(domain, settings, rng)?;
    Ok(match settings.distraction {
        Distractor::None => Box::new(inside),
        Distractor::Color(settings) => {
            Box::new(crate::Distracted::by_colors(inside, settings, distractor)?)
        }
        Distractor::Camera(settings) => {
            Box::new(crate::Distracted::by_camera(inside, settings, distractor)?)
        }
    })
}

#[cfg(test)]
mod tests {
    use rand_chacha::rand_core::SeedableRng;

    use super::*;

    const SETTINGS: Settings = Settings::new(35, 15, 250);

    #[test]
    fn an_unknown_task_has_suggestions() {
        let message =
            |task| make(task, &SETTINGS, ChaCha8Rng::seed_from_u64(0)).err().unwrap().to_string();
        assert!(message("falling_pixel").contains("'falling_pixel'"));
        assert!(message("falling_pixel").contains("did you mean falling-pixels?"));
        assert!(message("humanoid-stand").contains("valid: falling-pixels, cartpole-swingup"));
    }

    #[test]
    fn make_agrees_with_the_registry() {
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
    fn without_mujoco_the_error_says_how_to_get_it() {
        let error =
            make("cartpole-swingup", &SETTINGS, ChaCha8Rng::seed_from_u64(0)).err().unwrap();
        assert!(error.is_native());
        assert!(error.to_string().contains("make setup"));
    }
}
