//! `hksl bench render`.

use std::io::Write;

use clap::Args;
use hksl_core::rng;
use hksl_train::bench::{FrameTimes, median, time_frames};
use hksl_train::config::{Config, resolve};
use hksl_train::{Factories, Registry};
use serde_json::json;

use super::{extremes, progress};
use crate::exit::Code;
use crate::numbers::at_least;
use crate::run_settings::{OF_ENVIRONMENT, RunSettings};

/// Steps before the first timed one.
const WARM_UP: usize = 20;

/// Options of `hksl bench render`.
#[derive(Debug, Args)]
#[command(
    after_help = "Each measurement is one agent step with a random action and its action repeat, and \
                        the frame\nafter it, as in training.\n\n\
                        Example:\n  hksl bench render cartpole-swingup --runs 500"
)]
pub struct Arguments {
    #[command(flatten)]
    settings: RunSettings,

    /// Number of timed frames
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = at_least::<u32>(1), help_heading = "Measurement")]
    runs: u32,

    /// Output as one JSON object
    #[arg(long, help_heading = "Measurement")]
    json: bool,
}

impl Arguments {
    /// Runs the command.
    pub fn run(self, out: &mut dyn Write, quiet: bool) -> anyhow::Result<Code> {
        self.settings
            .refuse_all_but(&OF_ENVIRONMENT, "nothing is trained, and rendering uses one thread")?;
        let config = resolve(&self.settings.request())?.config;
        let mut environment = Registry.environment(&config, rng::stream(config.seed, "env"))?;
        let frame = environment.spec().frame;
        let runs = self.runs as usize;
        let bar = progress(!quiet && !self.json, WARM_UP + runs, "frames");
        let times = time_frames(environment.as_mut(), config.seed, (WARM_UP, runs), &mut |step| {
            if let Some(bar) = &bar {
                bar.set_position(step as u64);
            }
        })?;
        if let Some(bar) = bar {
            bar.finish_and_clear();
        }
        let shape = [frame.channels, frame.height, frame.width];
        if self.json {
            writeln!(out, "{}", as_json(&times, &config, shape))?;
        } else {
            write(out, &times, &config, shape)?;
        }
        Ok(Code::Done)
    }
}

fn renderer(config: &Config) -> Option<String> {
    let needs =
        hksl_envs::registry::find(&config.task).is_ok_and(|information| information.needs_mujoco);
    #[cfg(feature = "mujoco")]
    if needs {
        let description = hksl_envs::render::renderer_description(config.render_device());
        return description.ok().map(|description| description.to_string());
    }
    let _ = needs;
    None
}

fn as_json(times: &FrameTimes, config: &Config, frame: [usize; 3]) -> serde_json::Value {
    let (least, most) = extremes(&times.seconds);
    json!({
        "implementation": format!("hksl {}", env!("CARGO_PKG_VERSION")),
        "task": config.task_label(),
        "frame": frame,
        "renderer": renderer(config),
        "threads": 1,
        "runs": times.seconds.len(),
        "median_s": median(&times.seconds),
        "min_s": least,
        "max_s": most,
        "phases": times.phases,
    })
}

fn write(
    out: &mut dyn Write,
    times: &FrameTimes,
    config: &Config,
    [channels, height, width]: [usize; 3],
) -> std::io::Result<()> {
    let (least, most) = extremes(&times.seconds);
    let middle = median(&times.seconds);
    writeln!(out, "{}, frames of {channels}×{height}×{width}, one thread", config.task_label())?;
    if let Some(renderer) = renderer(config) {
        writeln!(out, "  rendered by {renderer}")?;
    }
    writeln!(
        out,
        "  step and frame  {:8.3} ms  ({:.3} to {:.3} ms in {} runs), {:.0} per second",
        1e3 * middle,
        1e3 * least,
        1e3 * most,
        times.seconds.len(),
        1.0 / middle
    )?;
    for (phase, seconds) in &times.phases {
        writeln!(out, "    {phase:<13} {:8.3} ms", 1e3 * seconds)?;
    }
    Ok(())
}
