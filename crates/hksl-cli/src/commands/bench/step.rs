//! `hksl bench step`.

use std::io::Write;

use clap::Args;
use hksl_core::kernels::{Kernels, Operations};
use hksl_core::rng;
use hksl_sac::config::UpdateSchedule;
use hksl_train::bench::{StepTimes, measured_peak, median, time_encoder, time_steps};
use hksl_train::config::{Config, resolve};
use hksl_train::{Factories, Registry, device};
use serde_json::json;

use super::{extremes, progress};
use crate::exit::Code;
use crate::numbers::at_least;
use crate::run_settings::RunSettings;

/// Steps before the first timed one.
const WARM_UP: usize = 2;

/// Options of `hksl bench step`.
#[derive(Debug, Args)]
#[command(
    after_help = "Batches are random frames, so no episode is played. GFLOP count direct convolutions and linear \
                  layers;\n`executed` counts what the kernels compute, which is less with Winograd \
                  convolutions.\n\nExample: both schedules on two threads\n  hksl bench step cartpole-swingup --threads 2\n  hksl bench step \
                        cartpole-swingup --threads 2 --set hksl.update_schedule=joint"
)]
pub struct Arguments {
    #[command(flatten)]
    settings: RunSettings,

    /// Batch size: trajectories, transitions or sequences, as the method draws them [default: the configuration's]
    #[arg(long, value_name = "N", value_parser = at_least::<u32>(1), help_heading = "Measurement")]
    batch: Option<u32>,

    /// Number of timed steps
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = at_least::<u32>(1), help_heading = "Measurement")]
    runs: u32,

    /// Output as one JSON object
    #[arg(long, help_heading = "Measurement")]
    json: bool,
}

impl Arguments {
    /// Runs the command.
    pub fn run(self, out: &mut dyn Write, quiet: bool) -> anyhow::Result<Code> {
        let mut request = self.settings.request();
        let mut config = resolve(&request)?.config;
        if let Some(batch) = self.batch {
            request.sets.push(format!("{}={batch}", config.batch().0));
            config = resolve(&request)?.config;
        }
        device::set_threads(config.threads)?;
        let target = device::open(config.device_choice()?)?;
        let spec = Registry.environment(&config, rng::stream(config.seed, "env"))?.spec().clone();
        let runs = self.runs as usize;
        let bar = progress(!quiet && !self.json, WARM_UP + runs, "learning steps");
        let times = time_steps(&config, &Registry, &spec, &target, (WARM_UP, runs), &mut |step| {
            if let Some(bar) = &bar {
                bar.set_position(step as u64);
            }
        })?;
        if let Some(bar) = bar {
            bar.finish_and_clear();
        }
        let on_cpu = target.is_cpu();
        // Methods with other encoders count no images.
        let apart = on_cpu && times.operations.encoder_images > 0;
        let encoder = apart.then(|| time_encoder(&config, &spec, runs)).transpose()?;
        let measured = Measured {
            on_cpu,
            times,
            peak: if on_cpu { measured_peak() } else { None },
            encoder: encoder.map(|(seconds, operations)| (median(&seconds), operations)),
        };
        if self.json {
            writeln!(out, "{}", measured.json(&config, &device::name(&target)))?;
        } else {
            measured.write(out, &config, &device::name(&target))?;
        }
        Ok(Code::Done)
    }
}

struct Measured {
    on_cpu: bool,
    times: StepTimes,
    /// Operations per second.
    peak: Option<f64>,
    /// Seconds and operations of a forward and a backward pass of one encoder.
    encoder: Option<(f64, Operations)>,
}

/// In units of 10⁹ operations.
fn giga(operations: u64) -> f64 {
    operations as f64 / 1e9
}

impl Measured {
    fn kernels(&self) -> &'static str {
        if self.on_cpu { Kernels::detect().name() } else { "cuda" }
    }

    /// Passes of a batch through an encoder, forward once and backward twice.
    fn encoder_passes(&self, config: &Config) -> u64 {
        self.times.operations.encoder_images / config.batch().1 as u64
    }

    /// Largest number of page faults in a step.
    fn page_faults(&self) -> Option<u64> {
        self.times.page_faults.as_ref().and_then(|faults| faults.iter().copied().max())
    }

    fn json(&self, config: &Config, device: &str) -> serde_json::Value {
        let (least, most) = extremes(&self.times.seconds);
        let hksl = config.hierarchy();
        json!({
            "implementation": format!("hksl {}", env!("CARGO_PKG_VERSION")),
            "task": config.task,
            "method": config.method,
            "update_schedule": hksl.map(|hksl| hksl.update_schedule),
            "levels": hksl.map(|hksl| hksl.skips.len()),
            "batch": config.batch().1,
            "device": device,
            "kernels": self.kernels(),
            "threads": threads(),
            "runs": self.times.seconds.len(),
            "median_s": median(&self.times.seconds),
            "min_s": least,
            "max_s": most,
            "phases": self.times.phases,
            "parameters": self.times.parameters,
            "encoder_passes": self.encoder_passes(config),
            "gflop": giga(self.times.operations.defined),
            "gflop_executed": giga(self.times.operations.executed),
            "peak_gflops": self.peak.map(|peak| peak / 1e9),
            "encoder_forward_backward_s": self.encoder.map(|(seconds, _)| seconds),
            "encoder_gflop": self.encoder.map(|(_, operations)| giga(operations.defined)),
            "encoder_gflop_executed": self.encoder.map(|(_, operations)| giga(operations.executed)),
            "page_faults_per_step": self.page_faults(),
        })
    }

    fn write(&self, out: &mut dyn Write, config: &Config, device: &str) -> std::io::Result<()> {
        let (least, most) = extremes(&self.times.seconds);
        let middle = median(&self.times.seconds);
        let schedule = match config.hierarchy().map(|hksl| hksl.update_schedule) {
            None => "",
            Some(UpdateSchedule::Sequential) => ", sequential schedule",
            Some(UpdateSchedule::Joint) => ", joint schedule",
        };
        writeln!(
            out,
            "{}{schedule}, {} on {device}, batch {}, {} threads, {} kernels",
            config.method,
            config.task,
            config.batch().1,
            threads(),
            self.kernels(),
        )?;
        writeln!(
            out,
            "  learning step    {middle:8.4} s  ({least:.4} to {most:.4} s in {} runs)",
            self.times.seconds.len()
        )?;
        for (phase, seconds) in &self.times.phases {
            let share = 100.0 * seconds / middle;
            writeln!(out, "    {:<14} {seconds:8.4} s  {share:3.0} %", phase.replace('_', " "))?;
        }
        self.rate(out, middle, self.times.operations)?;
        writeln!(out, "  encoder passes   {:8}", self.encoder_passes(config))?;
        if let Some((seconds, operations)) = self.encoder {
            writeln!(out, "  one encoder, forward and backward: {seconds:.4} s")?;
            self.rate(out, seconds, operations)?;
        }
        if let Some(peak) = self.peak {
            writeln!(out, "  peak of this CPU {:8.0} GFLOP/s (fused multiply-adds)", peak / 1e9)?;
        }
        if let Some(faults) = self.page_faults() {
            writeln!(out, "  page faults      {faults:8} per step at most")?;
        }
        Ok(())
    }

    fn rate(
        &self,
        out: &mut dyn Write,
        seconds: f64,
        operations: Operations,
    ) -> std::io::Result<()> {
        let Operations { defined, executed, .. } = operations;
        let per_second = defined as f64 / seconds;
        let share = self.peak.map_or(String::new(), |peak| {
            format!(", {:.0} % of the peak", 100.0 * per_second / peak)
        });
        writeln!(
            out,
            "    {:<14} {:8.1} GFLOP, {:.0} GFLOP/s{share}; {:.1} executed",
            "operations",
            giga(defined),
            per_second / 1e9,
            giga(executed)
        )
    }
}

fn threads() -> usize {
    device::threads()
}
