//! `hksl bench checkpoint`.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use hksl_train::bench::{SaveTimes, time_saves};
use hksl_train::config::resolve;
use hksl_train::{Registry, device};
use serde_json::json;

use super::progress;
use crate::exit::Code;
use crate::numbers::{at_least, bytes, grouped};
use crate::run_settings::RunSettings;

/// Options of `hksl bench checkpoint`.
#[derive(Debug, Args)]
#[command(
    after_help = "Saves an agent with a replay buffer of random frames: first with the whole buffer, then with one more \
                  episode,\nas every save of a run after the first does. Then loads the state.\n\n\
                        Example:\n  hksl bench checkpoint cartpole-swingup --transitions 12500,100000"
)]
pub struct Arguments {
    #[command(flatten)]
    settings: RunSettings,

    /// Transitions in the replay buffer; one measurement for each value
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_values_t = [12_500, 100_000], value_parser = at_least::<u32>(1), help_heading = "Measurement")]
    transitions: Vec<u32>,

    /// Folder on the disk to measure; all files written there are removed
    #[arg(long, value_name = "DIR", default_value = ".", help_heading = "Measurement")]
    folder: PathBuf,

    /// Output as one JSON object
    #[arg(long, help_heading = "Measurement")]
    json: bool,
}

impl Arguments {
    /// Runs the command.
    pub fn run(self, out: &mut dyn Write, quiet: bool) -> anyhow::Result<Code> {
        let mut config = resolve(&self.settings.request())?.config;
        device::set_threads(config.threads)?;
        let device = device::open(config.device_choice()?)?;
        let bar = progress(!quiet && !self.json, self.transitions.len(), "saves");
        let mut all = Vec::new();
        for &transitions in &self.transitions {
            let aside = tempfile::Builder::new().prefix(".hksl-bench-").tempdir_in(&self.folder);
            let aside = aside.with_context(|| format!("--folder {}", self.folder.display()))?;
            // One more episode is saved at the end.
            config.replay.capacity = transitions as usize + 2 * config.episode_agent_steps();
            let (factories, count) = (Registry, transitions as usize);
            all.push(time_saves(&config, &factories, &device, count, aside.path())?);
            if let Some(bar) = &bar {
                bar.inc(1);
            }
        }
        if let Some(bar) = bar {
            bar.finish_and_clear();
        }
        if self.json {
            let saves: Vec<_> = all.iter().map(as_json).collect();
            writeln!(out, "{}", json!({ "task": config.task_label(), "saves": saves }))?;
        } else {
            for times in &all {
                writeln!(out, "{}", in_words(times))?;
            }
        }
        Ok(Code::Done)
    }
}

fn as_json(times: &SaveTimes) -> serde_json::Value {
    json!({
        "transitions": times.transitions,
        "whole_s": times.whole_seconds,
        "next_s": times.next_seconds,
        "load_s": times.load_seconds,
        "checkpoint_bytes": times.checkpoint_bytes,
        "replay_bytes": times.replay_bytes,
    })
}

fn in_words(times: &SaveTimes) -> String {
    format!(
        "{:>9} transitions: {:.2} s to save the whole replay buffer, {:.2} s to save one more episode, {:.2} s to load; \
         checkpoint {}, replay {}",
        grouped(times.transitions as u64),
        times.whole_seconds,
        times.next_seconds,
        times.load_seconds,
        bytes(times.checkpoint_bytes),
        bytes(times.replay_bytes)
    )
}
