//! The configuration of a run: one typed, checked value, put together from layers.
//!
//! The layers, the later ones winning: `default.toml`, the method's file, the task's file, the distractor's
//! file, presets in the order given, the ablation, the user's file, `--set KEY=VALUE`, flags. [`resolve`] merges
//! them and remembers which layer each value comes from. What undoes the ablation that a run is named after is
//! refused, and so is a file of another ablation's or distractor's settings. The shipped files are part of the program.

mod device;
mod difference;
mod error;
mod labels;
mod layer;
pub(crate) mod methods;
mod names;
mod origin;
mod own_task;
mod print;
mod resolve;
mod schema;
mod shipped;
mod validate;

use std::path::Path;

use hksl_baselines::config::{
    BaselineConfig, CurlConfig, DbcConfig, DreamerConfig, DrqConfig, PiSacConfig,
};
use hksl_core::nn::PixelEncoderConfig;
use hksl_envs::Distractor;
use hksl_envs::distractors::{CameraSettings, ColorSettings};
use hksl_envs::render::{RenderDevice, RenderSettings};
use hksl_files::task_label;
pub use hksl_sac::config::ReplayStorage;
use hksl_sac::config::{AugmentationConfig, HkslConfig, ReplayConfig, SacConfig};
use serde::{Deserialize, Serialize};

use layer::Merged;

pub use device::{DeviceChoice, MOST_THREADS};
pub use difference::Difference;
pub use error::{Error, Result};
pub use methods::{METHODS, Method, default_method};
pub use origin::{Origin, Origins};
pub use own_task::OwnTask;
pub use resolve::{Flag, Request, Resolved, resolve, with_distractor};
pub use shipped::{
    ABLATION_NONE, DISTRACTOR_NONE, PRESET_PAPER, ablations, distractors, methods, presets, tasks,
};

/// Everything that describes a run. Units, the paper's values and effects of each key are stated in
/// `configs/default.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Name of the task.
    pub task: String,
    /// Name of the learning method.
    pub method: String,
    /// Name of the ablation, `none` for the full method.
    pub ablation: String,
    /// Name of the distractor, `none` for unmodified frames.
    pub distractor: String,
    /// Seed of every random number of the run.
    pub seed: u64,
    /// Budget, in environment steps.
    pub environment_steps: u64,
    /// Where networks are trained, in the grammar of [`DeviceChoice`].
    pub device: String,
    /// CPU threads; 0 stands for all logical cores.
    pub threads: usize,
    /// Section `[environment]`.
    pub environment: EnvironmentConfig,
    /// Section `[distractors]`.
    pub distractors: DistractorsConfig,
    /// Section `[render]`.
    pub render: RenderConfig,
    /// Section `[training]`.
    pub training: TrainingConfig,
    /// Section `[replay]`.
    pub replay: ReplayConfig,
    /// Section `[augmentation]`.
    pub augmentation: AugmentationConfig,
    /// Section `[encoder]`.
    pub encoder: PixelEncoderConfig,
    /// Section `[sac]`.
    pub sac: SacConfig,
    /// Section `[hksl]`.
    pub hksl: HkslConfig,
    /// Section `[baseline]`.
    pub baseline: BaselineConfig,
    /// Section `[drq]`.
    pub drq: DrqConfig,
    /// Section `[curl]`.
    pub curl: CurlConfig,
    /// Section `[pi_sac]`.
    pub pi_sac: PiSacConfig,
    /// Section `[dbc]`.
    pub dbc: DbcConfig,
    /// Section `[dreamer]`.
    pub dreamer: DreamerConfig,
    /// Section `[evaluation]`.
    pub evaluation: EvaluationConfig,
    /// Section `[checkpoint]`.
    pub checkpoint: CheckpointConfig,
    /// Section `[metrics]`.
    pub metrics: MetricsConfig,
}

/// Section `[environment]`: what the agent sees and how often it decides.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentConfig {
    /// Control steps that repeat one action.
    pub action_repeat: usize,
    /// Frames that form one observation.
    pub frame_stack: usize,
    /// Rows of a frame, in pixels.
    pub height: usize,
    /// Columns of a frame, in pixels.
    pub width: usize,
    /// Black pixels around a frame, on each side.
    pub border: usize,
    /// Control steps in an episode.
    pub episode_steps: usize,
}

/// Section `[distractors]`: what the distractor of the run does. A distractor's file sets its own part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DistractorsConfig {
    /// Whether it moves during an episode, or is only drawn anew at each reset.
    pub dynamic: bool,
    /// Section `[distractors.color]`.
    pub color: ColorSettings,
    /// Section `[distractors.camera]`.
    pub camera: CameraSettings,
}

/// Section `[render]`: rendering of control tasks.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RenderConfig {
    /// Whether things cast shadows.
    pub shadows: bool,
    /// Whether the floor mirrors.
    pub reflections: bool,
    /// Samples a pixel; 0: no anti-aliasing.
    pub samples: usize,
    /// Side of the shadow map, in pixels.
    pub shadow_map: usize,
    /// EGL's number of the device that draws, or `auto`.
    pub device: String,
}

/// Section `[training]`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingConfig {
    /// Agent steps with uniformly random actions before learning starts.
    pub initial_random_steps: u64,
}

/// Section `[evaluation]`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvaluationConfig {
    /// Environment steps between two evaluations, the first one at 0.
    pub every_environment_steps: u64,
    /// Episodes of one evaluation.
    pub episodes: usize,
    /// Whether the first episode of each is kept as an animation.
    pub video: bool,
}

/// Section `[checkpoint]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CheckpointConfig {
    /// Minutes between two saves of the full state.
    pub minutes: f64,
    /// Environment steps between two saves of the weights that are kept.
    pub weights_every_environment_steps: u64,
}

/// Section `[metrics]`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MetricsConfig {
    /// Agent steps between two lines of metrics.
    pub every_agent_steps: u64,
    /// Agent steps between two diagnoses.
    pub diagnostics_every_agent_steps: u64,
    /// Whether an event file for TensorBoard is written.
    pub tensorboard: bool,
}

/// Keys that earlier versions lack; `default.toml` has the values that match their behaviour.
const ADDED: [&str; 2] = ["environment.border", "augmentation.shift_per"];

impl Config {
    /// Reads and checks a complete configuration, such as a run's `config.toml`. Names of tasks, methods and distractors
    /// are not checked, because programs may define their own. Keys that the method does not use, and keys that do not
    /// affect results, may be missing, because earlier versions may lack them. `path` is used in error messages.
    ///
    /// # Errors
    /// Whatever [`resolve`] reports about a file, and [`Error::MissingKeys`].
    pub fn from_toml(text: &str, path: &Path) -> Result<Self> {
        let mut merged = Merged::empty();
        merged.add_text(text, &Origin::File(path.to_owned()))?;
        if let Some((method, _)) = merged.text("method") {
            let mut defaults = Merged::empty();
            defaults.add_text(shipped::default(), &Origin::Default)?;
            merged.reset_foreign(&defaults, &method);
            merged.fill(&defaults, |key| difference::may_change(key) || ADDED.contains(&key));
        }
        merged.complete(path)?;
        let (config, _) = merged.finish()?;
        Ok(config)
    }

    /// The distractor.
    pub fn distraction(&self) -> Distractor {
        let DistractorsConfig { dynamic, color, camera } = self.distractors;
        match self.distractor.split('-').next() {
            Some("color") => Distractor::Color(if dynamic { color } else { color.still() }),
            Some("camera") => Distractor::Camera(if dynamic { camera } else { camera.still() }),
            _ => Distractor::None,
        }
    }

    /// The rendering settings.
    pub fn render_settings(&self) -> RenderSettings {
        let RenderConfig { shadows, reflections, samples, shadow_map, .. } = self.render;
        RenderSettings { shadows, reflections, samples, shadow_map }
    }

    /// What draws them: left to itself, the twin of the CUDA device that trains.
    pub fn render_device(&self) -> RenderDevice {
        match self.render.device.parse() {
            Ok(number) => RenderDevice::Number(number),
            Err(_) => {
                let cuda = match self.device_choice() {
                    Ok(DeviceChoice::Cuda(ordinal)) => Some(ordinal),
                    Ok(DeviceChoice::Auto) => Some(0),
                    _ => None,
                };
                RenderDevice::Auto { cuda }
            }
        }
    }

    /// The task, and its distractor if there is one: `cartpole-swingup-color-easy`.
    pub fn task_label(&self) -> String {
        task_label(&self.task, &self.distractor)
    }

    /// Rows and columns of a frame as the agent gets it, its border included.
    pub fn frame_size(&self) -> [usize; 2] {
        let EnvironmentConfig { height, width, border, .. } = self.environment;
        [height + 2 * border, width + 2 * border]
    }

    /// Simulated time of an agent step, milliseconds: control step × action repeat; none for a task without physics.
    pub fn agent_step_milliseconds(&self) -> Option<u32> {
        let task = hksl_envs::registry::find(&self.task).ok()?;
        let repeat = u32::try_from(self.environment.action_repeat).ok()?;
        task.control_step_milliseconds?.checked_mul(repeat)
    }

    /// How many agent steps an episode has at most.
    pub fn episode_agent_steps(&self) -> usize {
        self.environment.episode_steps / self.environment.action_repeat
    }

    /// The method's row of the registry.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a name that it lacks, which a checked configuration does not have.
    pub fn registered(&self) -> Result<&'static Method> {
        methods::find(&self.method).ok_or_else(|| Error::OutOfRange {
            key: "method".to_owned(),
            value: self.method.clone(),
            origin: None,
            expected: format!("it must be one of {}", methods().join(", ")),
        })
    }

    /// Transitions in what the method samples from an episode.
    pub fn sampled_transitions(&self) -> usize {
        self.registered().map_or(1, |method| (method.sampled)(self).0)
    }

    /// The settings of HKSL's hierarchy, if the method has one.
    pub fn hierarchy(&self) -> Option<&HkslConfig> {
        let method = self.registered().ok()?;
        method.sections.contains(&"hksl").then_some(&self.hksl)
    }

    /// How many learning steps go with agent steps within the budget, once the replay can be sampled.
    pub fn learning_steps(&self) -> u64 {
        let (first, end) = (self.training.initial_random_steps, self.budget_agent_steps());
        let every = self.registered().map_or(1, |method| (method.update_every)(self));
        end.div_ceil(every).saturating_sub(first.div_ceil(every))
    }

    /// The key of the number of items in a batch of the method, and its value.
    pub fn batch(&self) -> (&'static str, usize) {
        let mut config = self.clone();
        let (key, items) = config.batch_mut();
        (key, *items)
    }

    /// This configuration with another number of items in a batch.
    pub(crate) fn with_batch(&self, items: usize) -> Self {
        let mut config = self.clone();
        *config.batch_mut().1 = items;
        config
    }

    fn batch_mut(&mut self) -> (&'static str, &mut usize) {
        match self.registered() {
            Ok(method) => (method.batch)(self),
            Err(_) => ("sac.batch_size", &mut self.sac.batch_size),
        }
    }

    /// How many agent steps the budget allows.
    pub fn budget_agent_steps(&self) -> u64 {
        self.environment_steps / self.environment.action_repeat as u64
    }

    /// Where to train, as asked for; opening the device is the caller's.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] where `device` does not follow the grammar, which a checked
    /// configuration does.
    pub fn device_choice(&self) -> Result<DeviceChoice> {
        DeviceChoice::parse(&self.device, None)
    }
}
