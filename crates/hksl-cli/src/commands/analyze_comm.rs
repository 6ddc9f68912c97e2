//! `hksl analyze-comm`.

use std::io::Write;
use std::path::PathBuf;

use anyhow::bail;
use clap::Args;
use hksl_core::rng;
use hksl_probe::communication::{
    ByDifference, Channel, by_difference, channels, require_communication, starts, step_distances,
    vectors,
};
use hksl_probe::pca::{Pca, pca};
use hksl_probe::silhouette::silhouette;
use hksl_report::plot::{Curve, CurvePoint, ScatterGroup, curves, heat_map, scatter};
use hksl_train::config::Config;
use ndarray::Array2;
use serde_json::{Value, json};

use super::analysis::{Data, Options, Played, Source};
use crate::exit::Code;
use crate::numbers::{at_least, grouped};
use crate::output::Output;
use crate::table::{self, Align};

/// Options of `hksl analyze-comm`.
#[derive(Debug, Args)]
#[command(after_help = "Example: figure 7 of the paper, for a run's last checkpoint\n  \
    hksl analyze-comm runs/cartpole-swingup/hksl/seed-1\n\n\
    For the meaning and the limits of each figure, see docs/analyses.md.")]
pub struct Arguments {
    /// Run folder
    #[arg(value_name = "RUN")]
    run: PathBuf,

    /// Environment step of the checkpoint [default: the last one]
    #[arg(long, value_name = "STEP", value_parser = at_least::<u64>(0))]
    checkpoint: Option<u64>,

    /// Number of random-policy episodes to sample trajectories from
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = at_least::<usize>(1))]
    episodes: usize,

    /// Number of trajectories to average distances over
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = at_least::<usize>(2))]
    trajectories: usize,

    /// Number of trajectories to project
    #[arg(long, value_name = "N", default_value_t = 18, value_parser = at_least::<usize>(2))]
    projected: usize,

    #[command(flatten)]
    options: Options,
}

/// Results for one channel.
struct Finding {
    channel: Channel,
    distances: Array2<f64>,
    by_difference: Vec<ByDifference>,
    pca: Pca,
    trajectory: Vec<usize>,
    /// Silhouette by trajectory, of the outputs and of their projections; none if trajectories have a single step.
    silhouettes: Option<(f64, f64)>,
}

impl Finding {
    fn new(channel: Channel, projected: usize) -> anyhow::Result<Self> {
        let distances = step_distances(channel.outputs.view());
        let (all, trajectory) = vectors(&channel, projected);
        let pca = pca(all.view(), 2)?;
        let silhouettes = if distances.nrows() > 1 {
            Some((
                silhouette(all.view(), &trajectory)?,
                silhouette(pca.projections.view(), &trajectory)?,
            ))
        } else {
            None
        };
        let by_difference = by_difference(&distances);
        Ok(Self { channel, distances, by_difference, pca, trajectory, silhouettes })
    }

    fn name(&self) -> String {
        format!("{}-to-{}", self.channel.from_level, self.channel.to_level)
    }

    fn title(&self) -> String {
        format!("from level {} to level {}", self.channel.from_level, self.channel.to_level)
    }
}

impl Arguments {
    /// Runs the command.
    pub fn run(self, out: &mut dyn Write, quiet: bool) -> anyhow::Result<Code> {
        let output = Output::new(self.options.out.as_deref(), "analyze-comm")?;
        let device = self.options.open()?;
        let source = Source::open(&self.run, &self.options)?;
        let step = source.step(self.checkpoint)?;
        let learner = source.hksl(step, &device)?;
        let config = &source.config;
        if !quiet {
            writeln!(
                out,
                "{} at environment step {}, over {} random episodes of {}",
                self.run.display(),
                grouped(step),
                self.episodes,
                config.task_label()
            )?;
        }
        // Fail before collecting episodes.
        require_communication(learner.hierarchy())?;
        if config.encoder.latent_dims < 2 {
            bail!(
                "encoder.latent_dims = 1 is too small for a projection onto two components; choose a run with at least 2"
            );
        }
        if let Some(reason) = untrained(config, step).filter(|_| !quiet) {
            writeln!(out, "{reason}: its channels are untrained")?;
        }
        let mut data = Data::new(self.options.cache.as_deref(), quiet);
        let seed = self.options.seed;
        let episodes = data.episodes(config, &Played::Random, self.episodes, seed, &device)?;
        let mut random = rng::stream(seed, "analysis trajectories");
        let length = config.hksl.trajectory_length;
        let episodes = &episodes.episodes;
        let starts = starts(episodes, length, self.trajectories, &mut random)?;
        if starts.len() < 2 {
            bail!(
                "the episodes contain only one trajectory of {length} transitions; increase --episodes"
            );
        }
        if starts.len() < self.trajectories && !quiet {
            writeln!(
                out,
                "the episodes contain {} different trajectories of {length} transitions, fewer than the {} requested; \
                 using all of them",
                starts.len(),
                self.trajectories
            )?;
        }
        let projected = self.projected.min(starts.len());
        if projected < self.projected && !quiet {
            writeln!(out, "projecting {projected} trajectories instead of {}", self.projected)?;
        }
        let stack = config.environment.frame_stack;
        let channels = channels(learner.hierarchy(), episodes, &starts, stack, &device)?;
        let findings = channels
            .into_iter()
            .map(|channel| Finding::new(channel, projected))
            .collect::<anyhow::Result<Vec<_>>>()?;
        for finding in &findings {
            write_distances(&output, finding)?;
            write_projections(&output, finding)?;
        }
        output.json("summary.json", &self.summary(&source, step, starts.len(), &findings))?;
        if !quiet {
            print(out, &findings)?;
            writeln!(
                out,
                "{}: results as CSV and JSON, figures as SVG",
                output.folder().display()
            )?;
        }
        Ok(Code::Done)
    }

    fn summary(&self, source: &Source, step: u64, drawn: usize, findings: &[Finding]) -> Value {
        let channel = |finding: &Finding| {
            json!({
                "from_level": finding.channel.from_level,
                "to_level": finding.channel.to_level,
                "distances": finding.distances.rows().into_iter().map(|row| row.to_vec()).collect::<Vec<_>>(),
                "by_step_difference": finding.by_difference.iter().map(|of| json!({
                    "difference": of.difference, "pairs": of.pairs, "mean": of.mean, "min": of.min, "max": of.max,
                })).collect::<Vec<_>>(),
                "explained_variance_ratio": finding.pca.explained_variance_ratio.to_vec(),
                "silhouette": finding.silhouettes.map(|of| of.0),
                "silhouette_of_projections": finding.silhouettes.map(|of| of.1),
            })
        };
        json!({
            "run": self.run.display().to_string(),
            "task": source.config.task_label(),
            "environment_step": step,
            "seed": self.options.seed,
            "episodes": self.episodes,
            "channels_trained": untrained(&source.config, step).is_none(),
            "trajectories": drawn,
            "trajectories_asked_for": self.trajectories,
            "projected_trajectories": self.projected.min(drawn),
            "channels": findings.iter().map(channel).collect::<Vec<_>>(),
        })
    }
}

/// The reason why the channels are untrained at this environment step, if they are.
fn untrained(config: &Config, step: u64) -> Option<&'static str> {
    let first = config.training.initial_random_steps * config.environment.action_repeat as u64;
    if !config.hksl.representation {
        Some("this run does not train its hierarchy (ablation no-repr)")
    } else if step <= first {
        Some("learning had not started at this step")
    } else {
        None
    }
}

fn print(out: &mut dyn Write, findings: &[Finding]) -> anyhow::Result<()> {
    use Align::{Left, Right};
    let columns = [
        ("CHANNEL", Left),
        ("STEPS APART", Right),
        ("MEAN DISTANCE", Right),
        ("SMALLEST", Right),
        ("LARGEST", Right),
    ];
    let rows = findings.iter().flat_map(|finding| {
        finding.by_difference.iter().map(|of| {
            vec![
                finding.title(),
                of.difference.to_string(),
                format!("{:.4}", of.mean),
                format!("{:.4}", of.min),
                format!("{:.4}", of.max),
            ]
        })
    });
    table::write(out, &columns, &rows.collect::<Vec<_>>())?;
    for finding in findings {
        let ratio = &finding.pca.explained_variance_ratio;
        let separate = match finding.silhouettes {
            Some((all, plane)) => format!(
                "silhouette by trajectory {all:.3} of the outputs, {plane:.3} of the projections"
            ),
            None => "no silhouette: each trajectory has a single step".to_owned(),
        };
        writeln!(
            out,
            "{}: two components explain {:.1} % and {:.1} % of the variance; {separate}",
            finding.title(),
            100.0 * ratio[0],
            100.0 * ratio[1],
        )?;
    }
    Ok(())
}

fn write_distances(output: &Output, finding: &Finding) -> anyhow::Result<()> {
    let (name, distances) = (finding.name(), &finding.distances);
    let rows = distances.indexed_iter().map(|((one, other), distance)| {
        vec![(one + 1).to_string(), (other + 1).to_string(), distance.to_string()]
    });
    output.csv(&format!("distances-{name}.csv"), &["step", "other_step", "mean_distance"], rows)?;
    let title = format!("ℓ2 distance, {}", finding.title());
    let figure = heat_map(&title, "step t", distances.view())?;
    output.text(&format!("distances-{name}.svg"), &figure)?;
    if finding.by_difference.is_empty() {
        return Ok(());
    }
    let heading = ["step_difference", "pairs", "mean_distance", "smallest", "largest"];
    let rows = finding.by_difference.iter().map(|of| {
        let numbers = [of.mean, of.min, of.max].map(|value| value.to_string());
        [vec![of.difference.to_string(), of.pairs.to_string()], numbers.to_vec()].concat()
    });
    output.csv(&format!("distances-by-difference-{name}.csv"), &heading, rows)?;
    let curve = |label: &str, value: fn(&ByDifference) -> f64| Curve {
        name: label.to_owned(),
        points: finding
            .by_difference
            .iter()
            .map(|of| CurvePoint::new(of.difference as f64, value(of), 0.0))
            .collect(),
    };
    let drawn = [
        curve("mean of the pairs", |of| of.mean),
        curve("smallest", |of| of.min),
        curve("largest", |of| of.max),
    ];
    let figure = curves(&title, "steps between the pair", "mean ℓ2 distance", &drawn, &[])?;
    output.text(&format!("distances-by-difference-{name}.svg"), &figure)
}

fn write_projections(output: &Output, finding: &Finding) -> anyhow::Result<()> {
    let (name, pca) = (finding.name(), &finding.pca);
    let steps = finding.distances.nrows();
    let rows = pca.projections.rows().into_iter().enumerate().map(|(row, at)| {
        let trajectory = finding.trajectory[row] + 1;
        let step = row % steps + 1;
        vec![trajectory.to_string(), step.to_string(), at[0].to_string(), at[1].to_string()]
    });
    let heading = ["trajectory", "step", "component_1", "component_2"];
    output.csv(&format!("pca-{name}.csv"), &heading, rows)?;
    let count = finding.trajectory.last().map_or(0, |last| last + 1);
    let groups: Vec<ScatterGroup> = (0..count)
        .map(|trajectory| ScatterGroup {
            name: format!("trajectory {}", trajectory + 1),
            points: (0..steps)
                .map(|step| trajectory * steps + step)
                .map(|row| (pca.projections[(row, 0)], pca.projections[(row, 1)]))
                .collect(),
        })
        .collect();
    let axis = |index: usize| {
        let share = 100.0 * pca.explained_variance_ratio[index];
        format!("component {} ({share:.1} % of the variance)", index + 1)
    };
    let title = format!("{count} trajectories, {}", finding.title());
    let figure = scatter(&title, (&axis(0), &axis(1)), &groups)?;
    output.text(&format!("pca-{name}.svg"), &figure)
}
