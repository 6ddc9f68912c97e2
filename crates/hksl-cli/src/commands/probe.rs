//! `hksl probe`.

mod fit;
mod results;
mod runs;

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use candle_core::Device;
use clap::Args;
use hksl_probe::coordinates::{Coordinates, horizons};
use hksl_probe::encoders::{self, probe_encoders};
use hksl_probe::episodes::Episode;
use hksl_probe::linear_probe::{Descent, Fit};
use hksl_train::checkpoint::Checkpoints;
use hksl_train::config::{self, Config, with_distractor};

use self::fit::{FitChoice, words};
use self::results::{Results, Row};
use self::runs::{tell_apart, unique_runs, unlike};
use super::analysis::{Data, Options, Played, Source};
use crate::exit::{Code, Misuse};
use crate::names::Listed;
use crate::numbers::{any_number, at_least, grouped, whole_within};
use crate::output::Output;
use crate::progress::counter;

/// Checkpoints probed by default, in environment steps.
const CHECKPOINTS: [u64; 2] = [50_000, 100_000];

/// Options of `hksl probe`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    hksl probe runs/cartpole-swingup/*/seed-1\n  \
    hksl probe runs/cartpole-swingup/hksl/seed-1 --checkpoints 0,50000,100000 --distractors color-easy,camera-easy\n\n\
    Each run is probed in the setting it was trained in; results in other settings are marked as transfer. All runs\n\
    share one data set per task, setting and --seed. For the meaning and the limits of the figures, see\n\
    docs/analyses.md.")]
pub struct Arguments {
    /// Run folders
    #[arg(value_name = "RUN", required = true)]
    runs: Vec<PathBuf>,

    /// Environment steps of the checkpoints [default: 50000,100000 if present, else the last]
    #[arg(long, value_name = "STEPS", value_delimiter = ',', value_parser = at_least::<u64>(0))]
    checkpoints: Vec<u64>,

    /// Prediction horizons in agent steps [default: the task's]
    #[arg(long, value_name = "STEPS", value_delimiter = ',', value_parser = at_least::<usize>(1))]
    horizons: Vec<usize>,

    /// Distractors to probe with, in addition to that of the run
    #[arg(long, value_name = "NAMES", value_delimiter = ',', value_parser = Listed(config::distractors))]
    distractors: Vec<String>,

    /// Ground-truth coordinates to predict, as in pole.x,pole.z [default: the task's]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    coordinates: Vec<String>,

    /// Policy that plays the episodes: random, or a run folder, for its last weights
    #[arg(long, value_name = "POLICY", default_value = "random")]
    policy: String,

    /// Number of episodes to fit the linear map on
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = whole_within::<usize>(1..=10_000))]
    train_episodes: usize,

    /// Number of episodes to test the linear map on
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = whole_within::<usize>(1..=10_000))]
    test_episodes: usize,

    /// Method to fit the linear map
    #[arg(long, value_enum, default_value_t = FitChoice::Ridge, help_heading = "Fit")]
    fit: FitChoice,

    /// Ridge penalty, relative to the latents' mean variance [default: 1e-6]
    #[arg(long, value_name = "NUMBER", value_parser = any_number, help_heading = "Fit")]
    penalty: Option<f64>,

    #[command(flatten)]
    options: Options,
}

/// A run with the checkpoints, settings and coordinates to probe.
struct Probed {
    source: Source,
    label: String,
    coordinates: Coordinates,
    horizons: Vec<usize>,
    steps: Vec<u64>,
    settings: Vec<Config>,
    /// Notes about defaults and skipped checkpoints.
    notes: Vec<String>,
}

impl Arguments {
    /// Runs the command.
    pub fn run(self, out: &mut dyn Write, quiet: bool) -> anyhow::Result<Code> {
        let output = Output::new(self.options.out.as_deref(), "probe")?;
        let device = self.options.open()?;
        let fit = self.fit()?;
        let mut probed = unique_runs(&self.runs)
            .into_iter()
            .map(|path| self.probed(path))
            .collect::<anyhow::Result<Vec<_>>>()?;
        tell_apart(&mut probed);
        let policy = self.policy(&probed)?;
        let played = match &policy {
            Some((source, step)) => Played::By(source, *step),
            None => Played::Random,
        };
        let mut data = Data::new(self.options.cache.as_deref(), quiet);
        let mut rows = Vec::new();
        let checkpoints: usize = probed.iter().map(|of| of.steps.len() * of.settings.len()).sum();
        if !quiet {
            for of in &probed {
                let steps: Vec<_> = of.steps.iter().map(|&step| grouped(step)).collect();
                writeln!(
                    out,
                    "{}: {} of {}, at environment steps {}",
                    of.source.folder.path().display(),
                    of.label,
                    of.source.config.task_label(),
                    steps.join(", ")
                )?;
                for note in &of.notes {
                    writeln!(out, "  {note}")?;
                }
            }
            let acts = policy.as_ref().map_or("random actions".to_owned(), |(source, step)| {
                let run = source.folder.path().display();
                format!("actions of {run} at environment step {}", grouped(*step))
            });
            writeln!(
                out,
                "episodes: {acts}, seed {}; linear map: {}",
                self.options.seed,
                words(&fit)
            )?;
            for note in unlike(&probed)? {
                writeln!(out, "{note}")?;
            }
        }
        for of in &probed {
            for setting in &of.settings {
                let count = self.train_episodes + self.test_episodes;
                data.episodes(setting, &played, count, self.options.seed, &device)?;
            }
        }
        let bar = counter(quiet, checkpoints, "checkpoints");
        for of in &probed {
            for setting in &of.settings {
                let count = self.train_episodes + self.test_episodes;
                let seed = self.options.seed;
                let episodes = data.episodes(setting, &played, count, seed, &device)?;
                for &step in &of.steps {
                    let seen = (episodes.name.as_str(), episodes.episodes.as_slice());
                    rows.extend(self.rows(of, setting, step, seen, &fit, &device)?);
                    bar.inc(1);
                }
            }
        }
        bar.finish_and_clear();
        let results = Results::new(rows);
        let policy = policy.as_ref().map(|(source, step)| (source.folder.path(), *step));
        results.write(&output, &self.settings(&probed, &fit, policy))?;
        if !quiet {
            for task in results.divided() {
                writeln!(
                    out,
                    "the runs of {task} have different environment or rendering settings, so each group of runs has its \
                     own episodes: compare results only within a group"
                )?;
            }
            results.print(out)?;
            writeln!(
                out,
                "{}: results as CSV and JSON, figures as SVG",
                output.folder().display()
            )?;
        }
        Ok(Code::Done)
    }

    fn fit(&self) -> anyhow::Result<Fit> {
        Ok(match (self.fit, self.penalty) {
            (FitChoice::Ridge, None) => Fit::default(),
            (FitChoice::Ridge, Some(penalty)) if penalty.is_finite() && penalty > 0.0 => {
                Fit::Ridge { penalty }
            }
            (FitChoice::Ridge, Some(penalty)) => {
                let said = format!(
                    "--penalty {penalty} is not valid: it must be a number above 0, as in 1e-6"
                );
                return Err(Misuse(said).into());
            }
            (FitChoice::GradientDescent, Some(_)) => {
                let said = "--penalty applies only to --fit ridge; leave out --penalty or --fit gradient-descent";
                return Err(Misuse(said.to_owned()).into());
            }
            (FitChoice::GradientDescent, None) => {
                Fit::GradientDescent(Descent { seed: self.options.seed, ..Descent::default() })
            }
        })
    }

    /// Opens and checks a run before any episodes are collected.
    fn probed(&self, path: &Path) -> anyhow::Result<Probed> {
        let source = Source::open(path, &self.options)?;
        let config = &source.config;
        let coordinates = if self.coordinates.is_empty() {
            Coordinates::of_task(&source.spec)?
        } else {
            Coordinates::named(&source.spec, &self.coordinates)?
        };
        let horizons = if self.horizons.is_empty() {
            horizons(&config.task).to_vec()
        } else {
            self.horizons.iter().copied().collect::<BTreeSet<_>>().into_iter().collect()
        };
        let steps = source.spec.steps_per_episode;
        if let Some(&horizon) = horizons.iter().find(|&&horizon| horizon > steps) {
            return Err(
                hksl_probe::Error::Horizon { task: config.task.clone(), horizon, steps }.into()
            );
        }
        let mut settings = vec![config.clone()];
        for name in &self.distractors {
            if settings.iter().all(|setting| setting.distractor != *name) {
                settings.push(with_distractor(config, name)?);
            }
        }
        let mut notes = Vec::new();
        let steps = self.steps(&source, &mut notes).with_context(|| path.display().to_string())?;
        let label = source.label();
        Ok(Probed { source, label, coordinates, horizons, steps, settings, notes })
    }

    /// The checkpoints of a run to probe.
    fn steps(&self, source: &Source, notes: &mut Vec<String>) -> anyhow::Result<Vec<u64>> {
        let checkpoints = Checkpoints::of_run(&source.folder);
        let asked: BTreeSet<u64> = self.checkpoints.iter().copied().collect();
        for &step in &asked {
            checkpoints.weights(step)?;
        }
        if !asked.is_empty() {
            return Ok(asked.into_iter().collect());
        }
        let listing = checkpoints.list()?;
        notes.extend(listing.damaged.iter().map(|damage| format!("skipped: {}", damage.error)));
        let (there, absent): (Vec<u64>, Vec<u64>) =
            CHECKPOINTS.into_iter().partition(|step| listing.sound.contains_key(step));
        if !there.is_empty() {
            notes.extend(absent.iter().map(|&step| format!("no checkpoint at {}", grouped(step))));
            return Ok(there);
        }
        let newest = checkpoints.newest()?;
        let absent: Vec<_> = absent.into_iter().map(grouped).collect();
        notes.push(format!("no checkpoint at {}: using the last one", absent.join(" or ")));
        Ok(vec![newest])
    }

    /// The run whose agent plays the episodes, unless the policy is random.
    fn policy(&self, probed: &[Probed]) -> anyhow::Result<Option<(Source, u64)>> {
        if self.policy == "random" {
            return Ok(None);
        }
        let source = Source::open(self.policy.as_ref(), &self.options)
            .with_context(|| "--policy must be random or a run folder")?;
        let task = &source.config.task;
        if let Some(other) = probed.iter().find(|of| of.source.config.task != *task) {
            let said = format!(
                "--policy {} was trained on {task}, but {} on {}: choose runs of one task",
                self.policy,
                other.source.folder.path().display(),
                other.source.config.task
            );
            return Err(Misuse(said).into());
        }
        let sees = |of: &Source| (of.spec.frame, of.config.environment.action_repeat);
        if let Some(other) = probed.iter().find(|of| sees(&of.source) != sees(&source)) {
            let said = format!(
                "--policy {} has a different frame size or action repeat than {}: choose a policy with the same ones",
                self.policy,
                other.source.folder.path().display()
            );
            return Err(Misuse(said).into());
        }
        let step = source.step(None)?;
        Ok(Some((source, step)))
    }

    /// Probes every encoder at every horizon, for one checkpoint in one setting.
    fn rows(
        &self,
        of: &Probed,
        setting: &Config,
        step: u64,
        (data, episodes): (&str, &[Episode]),
        fit: &Fit,
        device: &Device,
    ) -> anyhow::Result<Vec<Row>> {
        let agent = of.source.agent(step, device)?;
        let stack = of.source.config.environment.frame_stack;
        let data_set = (episodes, self.train_episodes);
        let probed =
            probe_encoders(&agent, stack, data_set, &of.coordinates, &of.horizons, fit, device)?;
        let row = |encoders::Probed { encoder, horizon, errors }: encoders::Probed| Row {
            run: of.source.folder.path().display().to_string(),
            label: of.label.clone(),
            seed: of.source.config.seed,
            task: of.source.config.task.clone(),
            trained_in: of.source.config.distractor.clone(),
            probed_in: setting.distractor.clone(),
            data: data.to_owned(),
            environment_step: step,
            encoder,
            horizon,
            unit: of.coordinates.unit.clone(),
            errors,
        };
        Ok(probed.into_iter().map(row).collect())
    }

    fn settings(
        &self,
        probed: &[Probed],
        fit: &Fit,
        policy: Option<(&Path, u64)>,
    ) -> serde_json::Value {
        let coordinates: std::collections::BTreeMap<&str, &[String]> = probed
            .iter()
            .map(|of| (of.source.config.task.as_str(), of.coordinates.names.as_slice()))
            .collect();
        serde_json::json!({
            "seed": self.options.seed,
            "policy": match policy {
                None => serde_json::json!("random"),
                Some((run, step)) => serde_json::json!({ "run": run, "environment_step": step }),
            },
            "train_episodes": self.train_episodes,
            "test_episodes": self.test_episodes,
            "fit": match fit {
                Fit::Ridge { penalty } => serde_json::json!({ "ridge": { "penalty": penalty } }),
                Fit::GradientDescent(descent) => serde_json::json!({ "gradient_descent": {
                    "learning_rate": descent.learning_rate,
                    "epochs": descent.epochs,
                    "batch_size": descent.batch_size,
                } }),
            },
            "coordinates": coordinates,
        })
    }
}
