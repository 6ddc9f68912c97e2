//! `hksl bench step`.

use std::io::Write;

use clap::Args;
use hksl_core::kernels::Kernels;
use hksl_core::nn::PixelEncoder;
use hksl_core::rng;
use hksl_sac::Operations;
use hksl_sac::config::UpdateSchedule;
use hksl_train::bench::{StepTimes, measured_peak, median, observation, time_encoder, time_steps};
use hksl_train::config::{Config, METHOD_HKSL, resolve};
use hksl_train::{Configured, Factories, device};
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

    /// Batch size: trajectories, transitions or, for dreamer-v2, sequences [default: the configuration's]
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
        let factories = Configured(&config);
        let spec = factories.environment(rng::stream(config.seed, "env"))?.spec().clone();
        let runs = self.runs as usize;
        let bar = progress(!quiet && !self.json, WARM_UP + runs, "learning steps");
        let times =
            time_steps(&config, &factories, &spec, &target, (WARM_UP, runs), &mut |step| {
                if let Some(bar) = &bar {
                    bar.set_position(step as u64);
                }
            })?;
        if let Some(bar) = bar {
            bar.finish_and_clear();
        }
        let on_cpu = target.is_cpu();
        // DreamerV2's encoder reads whole sequences and may be a different one, so it is not timed separately.
        let apart = on_cpu && config.method != "dreamer-v2";
        let encoder = if apart { Some(median(&time_encoder(&config, &spec, runs)?)) } else { None };
        let of_one = PixelEncoder::operations(observation(&config, &spec), config.encoder)?;
        let measured = Measured {
            on_cpu,
            operations: times.operations,
            times,
            peak: if on_cpu { measured_peak() } else { None },
            encoder,
            encoder_operations: (of_one.forward + of_one.backward) * config.batch().1 as f64,
            encoder_executed: (of_one.forward_executed + of_one.backward_executed)
                * config.batch().1 as f64,
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
    operations: Operations,
    /// Operations per second.
    peak: Option<f64>,
    /// Seconds of a forward and a backward pass.
    encoder: Option<f64>,
    encoder_operations: f64,
    encoder_executed: f64,
}

impl Measured {
    fn kernels(&self) -> &'static str {
        if self.on_cpu { Kernels::detect().name() } else { "cuda" }
    }

    /// Executed GFLOP, fewer than for direct convolutions where the kernels use Winograd convolutions.
    fn executed(&self) -> Option<f64> {
        let executed = self.operations.encoders_executed + self.operations.networks;
        self.on_cpu.then_some(executed / 1e9)
    }

    /// Largest number of page faults in a step.
    fn page_faults(&self) -> Option<u64> {
        self.times.page_faults.as_ref().and_then(|faults| faults.iter().copied().max())
    }

    fn json(&self, config: &Config, device: &str) -> serde_json::Value {
        let (least, most) = extremes(&self.times.seconds);
        let hksl = (config.method == METHOD_HKSL).then_some(&config.hksl);
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
            "encoder_passes": self.operations.encoder_passes,
            "gflop": self.operations.total() / 1e9,
            "gflop_executed": self.executed(),
            "peak_gflops": self.peak.map(|peak| peak / 1e9),
            "encoder_forward_backward_s": self.encoder,
            "encoder_gflop": self.encoder_operations / 1e9,
            "encoder_gflop_executed": self.encoder_executed / 1e9,
            "page_faults_per_step": self.page_faults(),
        })
    }

    fn write(&self, out: &mut dyn Write, config: &Config, device: &str) -> std::io::Result<()> {
        let (least, most) = extremes(&self.times.seconds);
        let middle = median(&self.times.seconds);
        let schedule = match config.hksl.update_schedule {
            _ if config.method != METHOD_HKSL => "",
            UpdateSchedule::Sequential => ", sequential schedule",
            UpdateSchedule::Joint => ", joint schedule",
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
        self.rate(out, "operations", middle, self.operations.total(), self.executed())?;
        writeln!(out, "  encoder passes   {:8}", self.operations.encoder_passes)?;
        if let Some(seconds) = self.encoder {
            writeln!(out, "  one encoder, forward and backward: {seconds:.4} s")?;
            let executed = Some(self.encoder_executed / 1e9);
            self.rate(out, "operations", seconds, self.encoder_operations, executed)?;
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
        name: &str,
        seconds: f64,
        operations: f64,
        executed: Option<f64>,
    ) -> std::io::Result<()> {
        let (total, rate) = (operations / 1e9, operations / seconds / 1e9);
        let share = self.peak.map_or(String::new(), |peak| {
            format!(", {:.0} % of the peak", 100.0 * operations / seconds / peak)
        });
        let executed = executed.map_or(String::new(), |most| format!("; {most:.1} executed"));
        writeln!(out, "    {name:<14} {total:8.1} GFLOP, {rate:.0} GFLOP/s{share}{executed}")
    }
}

fn threads() -> usize {
    device::threads()
}
