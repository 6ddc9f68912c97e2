//! `hksl attention`.

mod canvas;
mod sheet;

use std::collections::BTreeSet;
use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::Args;
use hksl_probe::attention::{Attention, attention};
use hksl_probe::episodes::Episode;
use hksl_train::config::{self, with_distractor};
use serde_json::json;

use self::sheet::Sheet;
use super::analysis::{Data, Options, Played, Source};
use crate::exit::{Code, Misuse};
use crate::names::Listed;
use crate::numbers::{at_least, grouped};
use crate::output::Output;
use crate::progress::counter;
use hksl_train::images::{Animation, write_png};

/// Options of `hksl attention`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    hksl attention runs/cartpole-swingup/hksl/seed-1\n  \
    hksl attention runs/cartpole-swingup/hksl/seed-1 --steps 0,12,13,14 --checkpoint 50000\n\n\
    The agent plays the episode with its deterministic actions. For the meaning and the limits of the maps, see\n\
    docs/analyses.md.")]
pub struct Arguments {
    /// Run folder
    #[arg(value_name = "RUN")]
    run: PathBuf,

    /// Environment step of the checkpoint [default: the last one]
    #[arg(long, value_name = "STEP", value_parser = at_least::<u64>(0))]
    checkpoint: Option<u64>,

    /// Agent steps to draw a sheet for [default: evenly spaced]
    #[arg(long, value_name = "STEPS", value_delimiter = ',', value_parser = at_least::<usize>(0), conflicts_with = "count")]
    steps: Vec<usize>,

    /// Number of evenly spaced steps
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = at_least::<usize>(1))]
    count: usize,

    /// Distractor [default: that of the run]
    #[arg(long, value_name = "NAME", value_parser = Listed(config::distractors))]
    distractor: Option<String>,

    #[command(flatten)]
    options: Options,
}

impl Arguments {
    /// Runs the command.
    pub fn run(self, out: &mut dyn Write, quiet: bool) -> anyhow::Result<Code> {
        let output = Output::new(self.options.out.as_deref(), "attention")?;
        let device = self.options.open()?;
        let source = Source::open(&self.run, &self.options)?;
        let step = source.step(self.checkpoint)?;
        let setting = match &self.distractor {
            Some(name) => with_distractor(&source.config, name)?,
            None => source.config.clone(),
        };
        let agent = source.agent(step, &device)?;
        let mut times = self.times(&setting.task, source.spec.steps_per_episode)?;
        let mut data = Data::new(self.options.cache.as_deref(), quiet);
        let played = Played::By(&source, step);
        let episodes = data.episodes(&setting, &played, 1, self.options.seed, &device)?;
        let Some(episode) = episodes.episodes.first() else { bail!("no episode was played") };
        let stack = source.config.environment.frame_stack;
        let levels = attention(&agent, episode, stack, &device)?;

        write_maps(&output, &levels)?;
        let sheet = Sheet::new(episode, stack, &levels);
        // A terminal state can end the episode early.
        times.retain(|&time| time <= episode.len());
        for &time in &times {
            let path = output.file(&format!("step-{time:06}.png"))?;
            write_png(&path, sheet.draw(time).view())
                .with_context(|| format!("cannot write {}", path.display()))?;
        }
        self.animate(&output, &sheet, episode, setting.agent_step_milliseconds(), quiet)?;
        let encoder = |level: &Attention| {
            let (low, high) = level.range();
            json!({
                "encoder": level.encoder,
                "map": [level.maps.dim().1, level.maps.dim().2],
                "pixels_a_place_looks_at": level.field.side,
                "pixels_between_places": level.field.spacing,
                "smallest": low,
                "largest": high,
            })
        };
        output.json(
            "summary.json",
            &json!({
                "run": self.run.display().to_string(),
                "task": setting.task_label(),
                "environment_step": step,
                "seed": self.options.seed,
                "agent_steps": episode.len(),
                "sheets": times,
                "encoders": levels.iter().map(encoder).collect::<Vec<_>>(),
            }),
        )?;
        if !quiet {
            writeln!(
                out,
                "{}: {} sheets, an animation and the maps as CSV, for an episode of {} agent steps at environment step {}",
                output.folder().display(),
                times.len(),
                episode.len(),
                grouped(step)
            )?;
        }
        Ok(Code::Done)
    }

    /// Agent steps to draw a sheet for.
    fn times(&self, task: &str, last: usize) -> anyhow::Result<Vec<usize>> {
        if let Some(step) = self.steps.iter().find(|&&step| step > last) {
            let said = format!(
                "--steps {step} is out of range: an episode of {task} has agent steps 0 to {last}"
            );
            return Err(Misuse(said).into());
        }
        if !self.steps.is_empty() {
            return Ok(self.steps.iter().copied().collect::<BTreeSet<_>>().into_iter().collect());
        }
        let count = self.count.min(last + 1);
        let time = |index: usize| if count > 1 { index * last / (count - 1) } else { 0 };
        Ok((0..count).map(time).collect())
    }

    fn animate(
        &self,
        output: &Output,
        sheet: &Sheet,
        episode: &Episode,
        milliseconds: Option<u32>,
        quiet: bool,
    ) -> anyhow::Result<()> {
        let path = output.file("episode.gif")?;
        let mut animation = Animation::new(&path, milliseconds);
        let bar = counter(quiet, episode.len() + 1, "frames");
        for time in 0..=episode.len() {
            animation
                .add(sheet.strip(time).view())
                .with_context(|| format!("cannot write {}", path.display()))?;
            bar.inc(1);
        }
        bar.finish_and_clear();
        Ok(())
    }
}

/// Writes every map of the episode, one CSV row per map row.
fn write_maps(output: &Output, levels: &[Attention]) -> anyhow::Result<()> {
    let width = levels.iter().map(|level| level.maps.dim().2).max().unwrap_or(0);
    let columns: Vec<String> = (0..width).map(|column| format!("column_{column}")).collect();
    let mut heading = vec!["agent_step", "encoder", "row"];
    heading.extend(columns.iter().map(String::as_str));
    let rows = levels.iter().flat_map(|level| {
        level.maps.outer_iter().enumerate().flat_map(move |(time, map)| {
            let row = move |(row, values): (usize, ndarray::ArrayView1<'_, f32>)| {
                let mut cells = vec![time.to_string(), level.encoder.clone(), row.to_string()];
                cells.extend(values.iter().map(|value| value.to_string()));
                cells.resize(3 + width, String::new());
                cells
            };
            map.outer_iter().enumerate().map(row).collect::<Vec<_>>()
        })
    });
    output.csv("maps.csv", &heading, rows)
}
