//! What a run writes down: metrics, evaluations, and both for TensorBoard.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::SystemTime;

use ndarray::Array3;

use crate::checkpoint::RunState;
use crate::config::Config;
use crate::images::{Animation, png_bytes, strip};
use crate::metrics::{Colorspace, EvalCsv, EvaluationRow, EventFile, MetricsFile, Picture, Value};
use crate::{Error, Result};
use hksl_files::{Files, RunFolder, damaged};

/// Frames of an evaluation's image.
const FRAMES: usize = 8;

/// The open files.
pub(super) struct Records {
    metrics: MetricsFile,
    evaluations: EvalCsv,
    events: Option<EventFile>,
}

impl Records {
    /// Opens them, cut to what `state` vouches for.
    pub(super) fn open(folder: &RunFolder, config: &Config, state: &RunState) -> Result<Self> {
        let events = config.metrics.tensorboard.then(|| events(folder, config, state.event_bytes));
        Ok(Self {
            metrics: MetricsFile::open(&folder.metrics_file(), state.metrics_bytes)?,
            evaluations: EvalCsv::open(
                &folder.eval_file(),
                state.eval_bytes,
                state.environment_step,
            )?,
            events: events.transpose()?,
        })
    }

    /// A line of metrics.
    pub(super) fn metrics(
        &mut self,
        (agent_step, environment_step): (u64, u64),
        values: &BTreeMap<String, f64>,
    ) -> Result<()> {
        self.metrics.write(agent_step, environment_step, values)?;
        let Some(events) = &mut self.events else { return Ok(()) };
        let tagged = |(name, value): (&String, &f64)| (format!("training/{name}"), *value);
        let tagged: Vec<(String, f64)> = values.iter().map(tagged).collect();
        let scalars = tagged.iter().map(|(tag, value)| Value::Scalar { tag, value: *value });
        events.write(now(), environment_step as i64, scalars)
    }

    /// An evaluation, with the frames of its first episode.
    pub(super) fn evaluation(&mut self, row: &EvaluationRow, frames: &[Array3<u8>]) -> Result<()> {
        self.evaluations.write(row)?;
        let Some(events) = &mut self.events else { return Ok(()) };
        let scalars = [
            ("evaluation/episode_return", row.episode_return),
            ("evaluation/episode_return_std", row.episode_return_std),
            ("evaluation/episode_return_min", row.episode_return_min),
            ("evaluation/episode_return_max", row.episode_return_max),
        ];
        let mut values: Vec<Value> =
            scalars.iter().map(|&(tag, value)| Value::Scalar { tag, value }).collect();
        // A failure to make the image must not end the run.
        let picture = strip(frames, FRAMES);
        let png = picture.as_ref().and_then(|picture| png_bytes(picture.view()).ok());
        if let (Some(png), Some(picture)) = (&png, &picture) {
            let (_, height, width) = picture.dim();
            let (width, height) = (width as u32, height as u32);
            let picture = Picture { png, width, height, colorspace: Colorspace::Rgb };
            values.push(Value::Image { tag: "evaluation/first_episode", picture });
        }
        events.write(now(), row.environment_step as i64, values)
    }

    /// Puts everything on the disk, and into `state` how much that is.
    pub(super) fn sync(&self, state: &mut RunState) -> Result<()> {
        self.metrics.sync()?;
        self.evaluations.sync()?;
        state.metrics_bytes = self.metrics.length();
        state.eval_bytes = self.evaluations.length();
        // Without event files, what there was of them stays to be gone on with.
        if let Some(events) = &self.events {
            events.sync()?;
            state.event_bytes = events.length();
        }
        Ok(())
    }
}

/// The event file as far as it is vouched for; a new one, begun with the configuration, if there was none or it is no
/// longer whole, which is put aside: no run hangs on it.
fn events(folder: &RunFolder, config: &Config, length: u64) -> Result<EventFile> {
    let path = folder.event_file();
    if length > 0 {
        match EventFile::open(&path, length, now()) {
            Err(Error::Files(hksl_files::Error::Damaged { path, reason })) => {
                // TensorBoard reads every file with `tfevents` in its name.
                let aside = damaged(path.parent().unwrap_or(Path::new("")), "events");
                let kept =
                    if std::fs::rename(&path, &aside).is_ok() { " and kept aside" } else { "" };
                tracing::warn!("starting a new {}{kept}: {reason}", path.display());
            }
            opened => return opened,
        }
    }
    let mut events = EventFile::open(&path, 0, now())?;
    let markdown = format!("```toml\n{}```\n", config.to_toml()?);
    events.write(now(), 0, [Value::Text { tag: "configuration", markdown: &markdown }])?;
    Ok(events)
}

/// Seconds since 1970.
fn now() -> f64 {
    SystemTime::UNIX_EPOCH.elapsed().map_or(0.0, |time| time.as_secs_f64())
}

/// Writes an episode as an animation.
pub(super) fn write_video(
    folder: &RunFolder,
    config: &Config,
    environment_step: u64,
    frames: &[Array3<u8>],
) -> Result<()> {
    let path = folder.video_file(environment_step);
    let files = Files::default();
    path.parent().map(|folder| files.create_folder(folder)).transpose()?;
    let written = files.write_with(&path, |aside| {
        let mut animation = Animation::new(aside, config.agent_step_milliseconds());
        frames.iter().try_for_each(|frame| animation.add(frame.view()))
    });
    Ok(written?)
}
