//! `hksl rollout`.

mod pictures;

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use hksl_envs::rollout::Steps;
use hksl_train::checkpoint::Checkpoints;
use hksl_train::config::{Config, DeviceChoice, resolve, with_distractor};
use hksl_train::evaluate::load_weights;
use hksl_train::play::{Policy, play};
use hksl_train::{Configured, Factories, RunFolder, device};

use self::pictures::Pictures;
use crate::exit::{Code, Misuse};
use crate::numbers::at_least;
use crate::output::{check_new, remark, write_file};
use crate::progress::counter;
use crate::run_settings::{OF_ENVIRONMENT, RunSettings};

/// Options of `hksl rollout`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    hksl rollout walker-walk --policy zero --gif fall.gif\n  \
    hksl rollout --policy runs/cartpole-swingup/hksl/seed-1 --out steps.json --frames pictures\n  \
    hksl rollout --from start.json --out steps.json\n\n\
    --from: the file holds task, qpos, qvel and actions, one a control step, and may hold qacc_warmstart,\n  \
    time and model. No action is repeated, no time limit ends an episode.\n\
    What comes out has reward, discount, qpos, qvel and probe (readings, docs/environments.md) after each\n  \
    control step; but with --from, also action and last (the episode ended).")]
pub struct Arguments {
    #[command(flatten)]
    settings: RunSettings,

    /// What acts: random, zero, or the folder of a run, whose last weights and settings are taken
    #[arg(long, value_name = "POLICY", default_value = "random", help_heading = "What to play")]
    policy: String,

    /// Control steps [default: one episode]
    #[arg(long, value_name = "N", value_parser = at_least::<u32>(1), help_heading = "What to play")]
    steps: Option<u32>,

    /// State and actions to play instead, JSON
    #[arg(long, value_name = "FILE", help_heading = "What to play", conflicts_with_all = ["task", "steps", "policy"])]
    from: Option<PathBuf>,

    /// A new file for the steps, JSON [default: the screen, unless pictures are asked for]
    #[arg(long, value_name = "FILE", help_heading = "What comes out")]
    out: Option<PathBuf>,

    /// A new folder for the pictures that the agent sees, PNG, named by control step; the first of a later episode, which
    /// has the number of the last one before it, ends in `_reset`
    #[arg(long, value_name = "DIR", help_heading = "What comes out", conflicts_with = "from")]
    frames: Option<PathBuf>,

    /// A new file for the same as an animated GIF, magnified, in the task's own time
    #[arg(long, value_name = "FILE.gif", help_heading = "What comes out", conflicts_with = "from")]
    gif: Option<PathBuf>,
}

impl Arguments {
    /// Whether the steps themselves are printed.
    pub fn prints_data(&self) -> bool {
        self.out.is_none() && self.gif.is_none() && self.frames.is_none()
    }

    /// Carries the command out.
    pub fn run(self, out: &mut dyn Write, quiet: bool) -> anyhow::Result<Code> {
        self.out.as_deref().map_or(Ok(()), check_new)?;
        let (task, steps) = match &self.from {
            Some(path) => {
                let reason = "--from plays from a state that the file holds";
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
        let mut pictures = Pictures::create(frames, gif, config.agent_step_milliseconds())?;
        let bar = counter(quiet, steps, "control steps");
        let wanted = !pictures.is_empty();
        let played = play(&config, policy, config.seed, steps, wanted, &mut |step, frame| {
            bar.set_position(step as u64);
            match frame {
                Some(frame) => pictures.add(step, frame),
                None => Ok(()),
            }
        })?;
        bar.finish_and_clear();
        Ok((config.task_label(), played))
    }

    /// The configuration to play in, and what acts.
    fn policy(&self) -> anyhow::Result<(Config, Policy)> {
        match self.policy.as_str() {
            "random" => Ok((self.untrained()?, Policy::Random)),
            "zero" => Ok((self.untrained()?, Policy::Zero)),
            folder => self.trained(Path::new(folder)),
        }
    }

    fn untrained(&self) -> anyhow::Result<Config> {
        let reason = "nothing learns, and one thread draws; --policy RUN plays a trained agent";
        self.settings.refuse_all_but(&OF_ENVIRONMENT, reason)?;
        Ok(resolve(&self.settings.request())?.config)
    }

    fn trained(&self, path: &Path) -> anyhow::Result<(Config, Policy)> {
        let folder = RunFolder::existing(path)
            .with_context(|| "--policy takes random, zero or the folder of a run")?;
        self.settings.refuse_all_but(
            &["TASK", "--distractor", "--seed", "--device", "--render-device", "--threads"],
            "with --policy RUN the settings are the run's own",
        )?;
        let threads = self.settings.threads.unwrap_or(0);
        let refused = |_| Misuse(format!("--threads {threads} is not valid: it must be 0 or more"));
        device::set_threads(usize::try_from(threads).map_err(refused)?)?;
        let mut config = Config::of_run(&folder)?;
        // The machine that trained may have had other ones.
        config.render.device = self.settings.render_device.clone().unwrap_or_else(|| "auto".into());
        if let Some(task) = self.settings.task.as_ref().filter(|task| **task != config.task) {
            bail!("{} was trained on {}, not on {task}", path.display(), config.task);
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
        let factories = Configured(&config);
        let random = hksl_core::rng::stream(config.seed, "rollout");
        let spec = factories.environment(random)?.spec().clone();
        let agent = factories.agent(&spec, &device)?;
        load_weights(agent.networks(), &config, &checkpoints.weights(last)?, last)?;
        Ok((config, Policy::Trained(agent)))
    }
}

#[cfg(feature = "mujoco")]
fn replay(path: &Path) -> anyhow::Result<(String, Steps)> {
    use hksl_envs::rollout::{Start, play};

    let text = hksl_files::text::read(path)
        .with_context(|| format!("{} cannot be read", path.display()))?;
    let start = Start::parse(&text).with_context(|| path.display().to_string())?;
    let steps = play(&start).with_context(|| path.display().to_string())?;
    Ok((start.task, steps))
}

#[cfg(not(feature = "mujoco"))]
fn replay(path: &Path) -> anyhow::Result<(String, Steps)> {
    bail!("{}: playing from a state needs MuJoCo, which this build leaves out", path.display())
}
