//! What can go wrong, each with the offending value and the way out.

use std::path::PathBuf;

use serde_json::Value;

/// Packages that draw without a screen, as Debian names them.
pub const GRAPHICS_PACKAGES: &str = "libegl1 libgl1-mesa-dri";

/// An error of an environment.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A task's name that the registry does not know.
    #[error("unknown task '{task}'; {hint}")]
    UnknownTask {
        /// The name that was asked for.
        task: String,
        /// The nearest valid names.
        hint: String,
    },
    /// A task that this build leaves out.
    #[error(
        "task '{task}' needs MuJoCo, which this build leaves out; run `make setup` and build with \
         the feature `mujoco` (on by default in hksl: leave out --no-default-features)"
    )]
    NeedsMujoco {
        /// The task that was asked for.
        task: String,
    },
    /// A setting out of range.
    #[error("{name} = {value} is out of range for {task}: expected {expected}")]
    Setting {
        /// The task.
        task: String,
        /// The setting.
        name: &'static str,
        /// Its value.
        value: String,
        /// What would be valid.
        expected: String,
    },
    /// A distractor on a task that has none.
    #[error(
        "{task} has no distractors: they change a MuJoCo task's colours or camera; leave the distractor out"
    )]
    Distractor {
        /// The task.
        task: String,
    },
    /// An action with too few or too many numbers.
    #[error("an action of {got} numbers; {task} takes {expected}")]
    ActionLength {
        /// The task.
        task: String,
        /// The task's action dimensions.
        expected: usize,
        /// The length of the action given.
        got: usize,
    },
    /// An action with a number that is not finite.
    #[error("action[{index}] of {task} is {value}; actions are finite numbers in [-1, 1]")]
    ActionNotFinite {
        /// The task.
        task: String,
        /// The position in the action.
        index: usize,
        /// The number there.
        value: f32,
    },
    /// A step or a frame before the first reset.
    #[error("{what} before the first reset; call reset() first")]
    NotReset {
        /// What was asked for.
        what: &'static str,
    },
    /// A step after the end of an episode.
    #[error("a step after the last one of an episode ({steps} steps); call reset() first")]
    EpisodeOver {
        /// Steps taken in that episode.
        steps: usize,
    },
    /// A frame of another shape than the stack's.
    #[error("a frame of shape {got:?}; this stack holds frames of {expected:?}")]
    FrameShape {
        /// The stack's frame shape (channels, height, width).
        expected: (usize, usize, usize),
        /// The shape given.
        got: (usize, usize, usize),
    },
    /// A snapshot that does not fit.
    #[error("this snapshot does not fit {task}: {reason}")]
    Snapshot {
        /// The task of the environment.
        task: String,
        /// What is wrong with the snapshot.
        reason: String,
    },
    /// A model file that is nowhere to be found.
    #[error(
        "model file '{file}' is missing; looked in {}; run `make setup` in a checkout, or set \
         HKSL_MODELS to a folder that holds suite/*.xml of dm_control 1.0.50",
        folders(.tried)
    )]
    MissingModel {
        /// The file, relative to the models' folder.
        file: String,
        /// The folders tried, in order.
        tried: Vec<PathBuf>,
    },
    /// A model file that is not dm_control's, or that MuJoCo refuses.
    #[error(
        "cannot use the model file '{}' of {task}: {reason}; run `make setup` in a checkout, which fetches what is \
         damaged, or set HKSL_MODELS to a folder that holds suite/*.xml of dm_control 1.0.50",
        path.display()
    )]
    Model {
        /// The task.
        task: String,
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// No off-screen drawing on this machine.
    #[error(
        "cannot draw off-screen through EGL: {reason}; install the graphics libraries (Debian: \
         apt-get install {GRAPHICS_PACKAGES})"
    )]
    Graphics {
        /// What failed.
        reason: String,
    },
    /// A device to draw on that there is not.
    #[error("{asked} names no device to draw on: {expected}")]
    RenderDevice {
        /// The device asked for, and where.
        asked: String,
        /// What there is.
        expected: String,
    },
    /// MuJoCo warned: the state is no longer to be trusted.
    #[error(
        "physics of {task} failed in control step {control_step}, {time} s into the episode: MuJoCo warning \
         {warning}; reset the episode"
    )]
    Physics {
        /// The task.
        task: String,
        /// MuJoCo's name of the warning.
        warning: &'static str,
        /// Simulated time, seconds.
        time: f64,
        /// Control steps taken before it, of this episode or of the rollout.
        control_step: usize,
        /// The state before that step and its action, for `hksl rollout --from`; `Null` where an episode begins.
        before: Box<Value>,
    },
    /// No start state in which nothing touches.
    #[error("{task}: {tries} start states were drawn, and in each something touched")]
    NoStart {
        /// The task.
        task: String,
        /// How many were drawn.
        tries: usize,
    },
    /// A space of another program's environment that agents cannot use.
    #[error("the {space} of {task} is {got}; expected {expected}")]
    Space {
        /// The task.
        task: String,
        /// Which space.
        space: &'static str,
        /// What it is.
        got: String,
        /// What would be valid, and the way out.
        expected: String,
    },
    /// Another program's environment failed.
    #[error("the environment {task} failed: {source}")]
    External {
        /// The task.
        task: String,
        /// The program's own error.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A frame of another program's environment with another shape than it declares.
    #[error(
        "{task} returned a frame of shape {got:?}, but its observation space has shape {expected:?}; frames must keep \
         their shape: resize them in the environment"
    )]
    ExternalFrame {
        /// The task.
        task: String,
        /// The declared shape.
        expected: Vec<usize>,
        /// The shape of the frame.
        got: Vec<usize>,
    },
    /// A reading of another program's environment that changed its size.
    #[error(
        "{task} returned {got} numbers for the reading '{name}', and {expected} before; readings must keep their size"
    )]
    ExternalReading {
        /// The task.
        task: String,
        /// The reading.
        name: String,
        /// Its first size.
        expected: usize,
        /// Its size now.
        got: usize,
    },
    /// A reward of another program's environment that is NaN or infinity.
    #[error(
        "{task} returned the reward {value} in step {step} of an episode; rewards must be finite: check the \
         environment's reward"
    )]
    ExternalReward {
        /// The task.
        task: String,
        /// The reward.
        value: f64,
        /// The step, counted from 1.
        step: usize,
    },
    /// A start state (rollout file) that is malformed.
    #[error("malformed start state: {field}: {reason}")]
    Start {
        /// The field, or where in the file.
        field: String,
        /// What is wrong and what is expected.
        reason: String,
    },
}

impl Error {
    /// True if a native part is missing or fails (graphics, model files, MuJoCo itself): the
    /// command line answers these with an exit code of their own.
    pub fn is_native(&self) -> bool {
        matches!(
            self,
            Error::NeedsMujoco { .. }
                | Error::MissingModel { .. }
                | Error::Model { .. }
                | Error::Graphics { .. }
                | Error::RenderDevice { .. }
        )
    }
}

impl Error {
    /// Whether another program's environment failed or returned what it must not. The agent and its run are sound.
    pub fn is_external(&self) -> bool {
        matches!(
            self,
            Error::External { .. }
                | Error::ExternalFrame { .. }
                | Error::ExternalReading { .. }
                | Error::ExternalReward { .. }
        )
    }
}

/// Folders in a row, quoted.
fn folders(tried: &[PathBuf]) -> String {
    tried.iter().map(|folder| format!("'{}'", folder.display())).collect::<Vec<_>>().join(", ")
}
