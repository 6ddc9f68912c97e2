//! `hksl rollout`.

mod frame_writer;

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use hksl_envs::rollout::Steps;
use hksl_train::checkpoint::Checkpoints;
use hksl_train::config::{Config, DeviceChoice, resolve, with_distractor};
use hksl_train::evaluate::load_weights;
use hksl_train::play::{Policy, play};
use hksl_train::{Factories, Registry, RunFolder, device};

use self::frame_writer::FrameWriter;
use crate::exit::{Code, Misuse};
use crate::numbers::at_least;
use crate::output::{check_new, remark, write_file};
use crate::progress::counter;
use crate::run_settings::{OF_ENVIRONMENT, RunSettings};

/// Options of `hksl rollout`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    hksl rollout walker-walk --policy zero --gif fall.gif\n  \
    hksl rollout --policy runs/cartpole-swingup/hksl/seed-1 --out steps.json --frames frames\n  \
    hksl rollout --from start.json --out steps.json\n\n\
    The --from file has the keys task, qpos, qvel and actions (one action per control step), and optionally\n\
    qacc_warmstart, time and model. It is played without action repeat and without a time limit.\n\n\
    The output has reward, discount, qpos, qvel and probe (readings, see docs/environments.md) after each\n\
    control step and, without --from, also action and last (whether the episode ended).")]
pub struct Arguments {
    #[command(flatten)]
    settings: RunSettings,

    /// Policy: random, zero, or a run folder, for its last weights and its settings
    #[arg(long, value_name = "POLICY", default_value = "random", help_heading = "Rollout")]
    policy: String,

    /// Number of control steps [default: one episode]
    #[arg(long, value_name = "N", value_parser = at_least::<u32>(1), help_heading = "Rollout")]
    steps: Option<u32>,

    /// JSON file with a state and actions to play
    #[arg(long, value_name = "FILE", help_heading = "Rollout", conflicts_with_all = ["task", "steps", "policy"])]
    from: Option<PathBuf>,

    /// New JSON file for the steps [default: standard output, unless --frames or --gif is given]
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    out: Option<PathBuf>,

    /// New folder for the observed frames as PNG, named by control step; the first frame of a later episode has the
    /// number of the last frame before it and ends in `_reset`
    #[arg(long, value_name = "DIR", help_heading = "Output", conflicts_with = "from")]
    frames: Option<PathBuf>,

    /// New file for the frames as a magnified animated GIF, in the task's own time
    #[arg(long, value_name = "FILE.gif", help_heading = "Output", conflicts_with = "from")]
    gif: Option<PathBuf>,
}

impl Arguments {
    /// Whether standard output carries the steps.
    pub fn prints_data(&self) -> bool {
        self.out.is_none() && self.gif.is_none() && self.frames.is_none()
    }

    /// Runs the command.
    pub fn run(self, out: &mut dyn Write, quiet: bool) -> anyhow::Result<Code> {
        self.out.as_deref().map_or(Ok(()), check_new)?;
        let (task, steps) = match &self.from {
            Some(path) => {
                let reason = "--from takes the task and the state from its file";
                self.settings.refuse_all_but(&[], reason)?;
                replay(path)?
            }
            None => self.play(quiet)?,
        };
        let mut text = serde_json::to_string(&steps)?;
        text.push('\n');
        let summary = format!(
            "{} control steps of {task}, return {:.3}",
            steps.reward.len(),
            steps.reward.iter().sum::<f64>()
        );
        if self.prints_data() {
            out.write_all(text.as_bytes())?;
            return Ok(Code::Done);
        }
        if let Some(path) = &self.out {
            write_file(path, text.as_bytes())?;
        }
        let files = [&self.out, &self.frames, &self.gif].map(Option::as_deref);
        let told = if self.out.is_some() { &files[..1] } else { &files[1..] };
        for path in told.iter().flatten().filter(|_| !quiet) {
            remark(out, &files, &format!("{}: {summary}", path.display()))?;
        }
        Ok(Code::Done)
    }

    fn play(&self, quiet: bool) -> anyhow::Result<(String, Steps)> {
        let (config, policy) = self.policy()?;
        let steps = self.steps.map_or(config.environment.episode_steps, |steps| steps as usize);
        let (frames, gif) = (self.frames.as_deref(), self.gif.as_deref());
        let mut writer = FrameWriter::create(frames, gif, config.agent_step_milliseconds())?;
        let bar = counter(quiet, steps, "control steps");
        let wanted = !writer.is_empty();
        let played = play(&config, policy, config.seed, steps, wanted, &mut |step, frame| {
            bar.set_position(step as u64);
            match frame {
                Some(frame) => writer.add(step, frame),
                None => Ok(()),
            }
        })?;
        bar.finish_and_clear();
        Ok((config.task_label(), played))
    }

    /// The configuration and the policy.
    fn policy(&self) -> anyhow::Result<(Config, Policy)> {
        match self.policy.as_str() {
            "random" => Ok((self.untrained()?, Policy::Random)),
            "zero" => Ok((self.untrained()?, Policy::Zero)),
            folder => self.trained(Path::new(folder)),
        }
    }

    fn untrained(&self) -> anyhow::Result<Config> {
        let reason = "no agent is trained, and rendering uses one thread; --policy RUN plays a trained agent";
        self.settings.refuse_all_but(&OF_ENVIRONMENT, reason)?;
        Ok(resolve(&self.settings.request())?.config)
    }

    fn trained(&self, path: &Path) -> anyhow::Result<(Config, Policy)> {
        let folder = RunFolder::existing(path)
            .with_context(|| "--policy must be random, zero or a run folder")?;
        self.settings.refuse_all_but(
            &["TASK", "--distractor", "--seed", "--device", "--render-device", "--threads"],
            "with --policy RUN, the settings are those of the run",
        )?;
        let threads = self.settings.threads.unwrap_or(0);
        let refused = |_| Misuse(format!("--threads {threads} is not valid: it must be 0 or more"));
        device::set_threads(usize::try_from(threads).map_err(refused)?)?;
        let mut config = Config::of_run(&folder)?;
        // The training machine may have had other EGL devices.
        config.render.device = self.settings.render_device.clone().unwrap_or_else(|| "auto".into());
        if let Some(task) = self.settings.task.as_ref().filter(|task| **task != config.task) {
            bail!(
                "{} was trained on {}, not on {task}; leave out TASK or choose another run",
                path.display(),
                config.task
            );
        }
        if let Some(distractor) = &self.settings.distractor {
            config = with_distractor(&config, distractor)?;
        }
        if let Some(seed) = self.settings.seed {
            config.seed = u64::try_from(seed).with_context(|| format!("--seed {seed}"))?;
        }
        config.validate()?;
        let asked = self.settings.device.as_deref().unwrap_or("auto");
        let device = device::open(DeviceChoice::from_option(asked, "--device")?)?;
        let checkpoints = Checkpoints::of_run(&folder);
        let last = checkpoints.newest()?;
        let random = hksl_core::rng::stream(config.seed, "rollout");
        let spec = Registry.environment(&config, random)?.spec().clone();
        let agent = Registry.agent(&config, &spec, &device)?;
        load_weights(agent.networks(), &config, &checkpoints.weights(last)?, last)?;
        Ok((config, Policy::Trained(Box::new(agent))))
    }
}

#[cfg(feature = "mujoco")]
fn replay(path: &Path) -> anyhow::Result<(String, Steps)> {
    use hksl_envs::rollout::{Start, play};

    let text =
        hksl_files::text::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let start = Start::parse(&text).with_context(|| path.display().to_string())?;
    let steps = play(&start).with_context(|| path.display().to_string())?;
    Ok((start.task, steps))
}

#[cfg(not(feature = "mujoco"))]
fn replay(path: &Path) -> anyhow::Result<(String, Steps)> {
    bail!(
        "{}: --from needs MuJoCo, which this build lacks; build without --no-default-features",
        path.display()
    )
}
