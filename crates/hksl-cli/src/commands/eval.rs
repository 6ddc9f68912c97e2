//! `hksl eval`.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use hksl_train::checkpoint::Checkpoints;
use hksl_train::config::{self, Config, DeviceChoice};
use hksl_train::evaluate::{Seen, evaluate_weights};
use hksl_train::images::Animation;
use hksl_train::{Registry, RunFolder, device};

use crate::exit::Code;
use crate::names::Listed;
use crate::numbers::{at_least, grouped};
use crate::output::{check_new_gif, remark};
use crate::progress::counter;

/// Options of `hksl eval`.
#[derive(Debug, Args)]
#[command(after_help = "Example: the policy after 50,000 environment steps, over 100 episodes\n  \
    hksl eval runs/cartpole-swingup/hksl/seed-1 --checkpoint 50000 --episodes 100\n\n\
    The same weights, seed and device give the same returns. At the step of an evaluation and with the\n\
    run's own number of episodes, the result equals that row of eval.csv.")]
pub struct Arguments {
    /// Run folder
    #[arg(value_name = "RUN")]
    run: PathBuf,

    /// Environment step of the checkpoint [default: the last one]
    #[arg(long, value_name = "STEP", value_parser = at_least::<u64>(0))]
    checkpoint: Option<u64>,

    /// Number of episodes [default: that of the run's evaluations]
    #[arg(long, value_name = "N", value_parser = at_least::<u32>(1))]
    episodes: Option<u32>,

    /// Distractor [default: that of the run]
    #[arg(long, value_name = "NAME", value_parser = Listed(config::distractors))]
    distractor: Option<String>,

    /// New file for an animated GIF of the first episode, in the task's own time
    #[arg(long, value_name = "FILE.gif")]
    video: Option<PathBuf>,

    /// Device for the networks: auto, cpu, cuda or cuda:N
    #[arg(long, value_name = "DEVICE", default_value = "auto", help_heading = "Machine")]
    device: String,

    /// CPU threads, 0 for all logical cores
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = at_least::<usize>(0), help_heading = "Machine")]
    threads: usize,
}

impl Arguments {
    /// Runs the command.
    pub fn run(self, out: &mut dyn Write, quiet: bool) -> anyhow::Result<Code> {
        self.video.as_deref().map_or(Ok(()), |video| check_new_gif(video, "--video"))?;
        let device = device::open(DeviceChoice::from_option(&self.device, "--device")?)?;
        device::set_threads(self.threads)?;
        let folder = RunFolder::existing(&self.run)?;
        let mut config = Config::of_run(&folder)?;
        // The training machine may have had other EGL devices.
        config.render.device = "auto".to_owned();
        if let Some(distractor) = &self.distractor {
            config = config::with_distractor(&config, distractor)?;
        }
        let checkpoints = Checkpoints::of_run(&folder);
        let step = self.checkpoint.map_or_else(|| checkpoints.newest(), Ok)?;
        let weights = checkpoints.weights(step)?;
        let episodes = self.episodes.map_or(config.evaluation.episodes, |n| n as usize);
        let bar = counter(quiet, episodes, "episodes");
        let milliseconds = config.agent_step_milliseconds();
        let animation = self.video.as_deref().map(|video| Animation::new(video, milliseconds));
        let (mut animation, mut drawn) = (animation, Ok(()));
        let evaluation =
            evaluate_weights(&config, &Registry, &weights, step, episodes, &device, &mut |seen| {
                match seen {
                    Seen::Frame { episode: 0, frame } => {
                        if let (Some(animation), Ok(())) = (&mut animation, &drawn) {
                            drawn = animation.add(frame);
                        }
                    }
                    Seen::Frame { .. } => {}
                    Seen::Return { episode, .. } => bar.set_position(episode as u64 + 1),
                }
            })?;
        let failed = || {
            format!(
                "cannot write {}",
                self.video.iter().map(|p| p.display().to_string()).collect::<String>()
            )
        };
        bar.finish_and_clear();
        let text = format!(
            "{} seed {} at environment step {}: return {:.2} ± {:.2} over {episodes} episodes, from \
             {:.2} to {:.2}",
            config.task_label(),
            config.seed,
            grouped(step),
            evaluation.mean(),
            evaluation.std(),
            evaluation.min(),
            evaluation.max()
        );
        remark(out, &[self.video.as_deref()], &text)?;
        // The returns are printed even if the animation cannot be written.
        drawn.with_context(failed)?;
        Ok(Code::Done)
    }
}
