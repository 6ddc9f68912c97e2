//! How long a learning step takes, phase by phase, a frame, and a save.

mod checkpoint;

use std::collections::BTreeMap;
use std::time::Instant;

use candle_core::{DType, Device, Tensor};
use hksl_core::kernels::{Kernels, Operations, multiply_adds};
use hksl_core::nn::{Initialisation, PixelEncoder};
use hksl_core::{Builder, Encoder, Parameters, rng};
use hksl_envs::{Environment, Spec};
use hksl_sac::Agent;
use rand::{Rng, RngCore};

pub use checkpoint::{SaveTimes, time_saves};

use crate::Result;
use crate::config::Config;
use crate::factories::Factories;
use crate::synthetic::record;

/// Episodes that the replay holds while steps are timed.
const EPISODES: usize = 20;

/// Timed learning steps, every phase in each: actor and moving averages included.
#[derive(Debug, Clone, PartialEq)]
pub struct StepTimes {
    /// Seconds of each step.
    pub seconds: Vec<f64>,
    /// Median seconds of each phase.
    pub phases: BTreeMap<&'static str, f64>,
    /// Floating-point operations of the last step.
    pub operations: Operations,
    /// Numbers in the weights that are trained, the temperature not counted.
    pub parameters: usize,
    /// Page faults of each step that needed no disk, where the system tells.
    pub page_faults: Option<Vec<u64>>,
}

/// Times `runs` learning steps after `warm_up` others, on batches of random frames.
///
/// # Errors
/// Whatever the agent reports.
pub fn time_steps(
    config: &Config,
    factories: &dyn Factories,
    spec: &Spec,
    device: &Device,
    (warm_up, runs): (usize, usize),
    watch: &mut dyn FnMut(usize),
) -> Result<StepTimes> {
    let mut agent = factories.agent(config, spec, device)?;
    fill(&mut agent, config, spec)?;
    let mut times = StepTimes {
        seconds: Vec::new(),
        phases: BTreeMap::new(),
        operations: Operations::default(),
        parameters: agent.networks().sizes().iter().map(|(_, count)| count).sum(),
        page_faults: Some(Vec::new()),
    };
    let mut phases: BTreeMap<&'static str, Vec<f64>> = BTreeMap::new();
    for run in 0..warm_up + runs {
        let before = agent.networks().parameters.operations();
        let (start, faults) = (Instant::now(), minor_faults());
        // Agent step 0 is a multiple of every period.
        let report = agent.update(0)?;
        device.synchronize().map_err(hksl_core::Error::from)?;
        let seconds = start.elapsed().as_secs_f64();
        times.operations = agent.networks().parameters.operations() - before;
        watch(run + 1);
        if run < warm_up {
            continue;
        }
        times.seconds.push(seconds);
        for (phase, seconds) in report.iter().flat_map(|report| report.seconds()) {
            phases.entry(phase.name()).or_default().push(*seconds);
        }
        match (&mut times.page_faults, faults, minor_faults()) {
            (Some(counts), Some(before), Some(after)) => counts.push(after - before),
            (counts, ..) => *counts = None,
        }
    }
    times.phases = phases.into_iter().map(|(name, seconds)| (name, median(&seconds))).collect();
    Ok(times)
}

/// Times the forward and backward pass of one encoder over a batch. Returns the seconds of each run and the operations
/// of one.
///
/// # Errors
/// An encoder that cannot be built.
pub fn time_encoder(config: &Config, spec: &Spec, runs: usize) -> Result<(Vec<f64>, Operations)> {
    let (mut parameters, device) = (Parameters::default(), Device::Cpu);
    let mut random = rng::stream(config.seed, "bench");
    let mut builder =
        Builder::create(&mut parameters, &mut random, Initialisation::Uniform, &device);
    let observation = observation(config, spec);
    let encoder = PixelEncoder::new(&mut builder, observation, config.encoder)?;
    let [c, h, w] = observation;
    let batch = config.batch().1;
    let mut pixels = vec![0u8; batch * c * h * w];
    random.fill_bytes(&mut pixels);
    let shape = (batch, c, h, w);
    let images = Tensor::from_vec(pixels, shape, &device).map_err(hksl_core::Error::from)?;
    let weight = Tensor::ones((shape.0, config.encoder.latent_dims), DType::F32, &device)
        .map_err(hksl_core::Error::from)?;
    let mut operations = Operations::default();
    let seconds = (0..runs)
        .map(|_| {
            let (start, before) = (Instant::now(), parameters.operations());
            let latents = encoder.forward(&images)?;
            // Layer norm's outputs sum to nothing; squared, they have a gradient.
            let loss = || (latents.sqr()? * &weight)?.sum_all()?.backward();
            loss().map_err(hksl_core::Error::from)?;
            operations = parameters.operations() - before;
            Ok(start.elapsed().as_secs_f64())
        })
        .collect::<Result<_>>()?;
    Ok((seconds, operations))
}

/// One observation of a configuration's agent, `(C, H, W)`.
pub fn observation(config: &Config, spec: &Spec) -> [usize; 3] {
    let hksl_envs::FrameShape { channels, height, width } = spec.frame;
    [config.environment.frame_stack * channels, height, width]
}

/// Seconds of an environment's steps and of the frames after them.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameTimes {
    /// Of each step with its frame.
    pub seconds: Vec<f64>,
    /// Median seconds of `simulate` and `draw`.
    pub phases: BTreeMap<&'static str, f64>,
}

/// Times `runs` steps of this environment (with [`hksl_envs::ActionRepeat`] around it, agent steps) with random actions
/// and a frame after each, after `warm_up` others.
///
/// # Errors
/// Whatever the environment reports.
pub fn time_frames(
    environment: &mut dyn Environment,
    seed: u64,
    (warm_up, runs): (usize, usize),
    watch: &mut dyn FnMut(usize),
) -> Result<FrameTimes> {
    let mut random = rng::stream(seed, "bench");
    let action_dims = environment.spec().action_dims;
    let (mut seconds, mut simulate, mut draw) = (Vec::new(), Vec::new(), Vec::new());
    let mut ended = true;
    for run in 0..warm_up + runs {
        if ended {
            environment.reset()?;
        }
        let action: Vec<f32> = (0..action_dims).map(|_| random.random_range(-1f32..=1.0)).collect();
        let start = Instant::now();
        let step = environment.step(&action)?;
        let simulated = start.elapsed().as_secs_f64();
        std::hint::black_box(environment.frame()?);
        let total = start.elapsed().as_secs_f64();
        ended = step.last;
        watch(run + 1);
        if run >= warm_up {
            seconds.push(total);
            simulate.push(simulated);
            draw.push(total - simulated);
        }
    }
    let phases = [("simulate", median(&simulate)), ("draw", median(&draw))];
    Ok(FrameTimes { seconds, phases: phases.into() })
}

/// The CPU's fused multiply-adds in operations per second, the best of some measurements; none for the
/// portable kernels.
pub fn measured_peak() -> Option<f64> {
    (0..5)
        .map(|_| {
            let start = Instant::now();
            Some(multiply_adds(Kernels::detect())? / start.elapsed().as_secs_f64())
        })
        .collect::<Option<Vec<f64>>>()
        .and_then(|flops| flops.into_iter().reduce(f64::max))
}

/// The middle one, or the mean of the two in the middle; 0 of none.
pub fn median(numbers: &[f64]) -> f64 {
    let mut sorted = numbers.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => 0.0,
        count if count % 2 == 1 => sorted[count / 2],
        count => f64::midpoint(sorted[count / 2 - 1], sorted[count / 2]),
    }
}

/// Adds finished episodes of random frames to an agent's replay.
fn fill(agent: &mut Agent, config: &Config, spec: &Spec) -> Result<()> {
    let length = (3 * config.sampled_transitions()).max(20).min(spec.steps_per_episode);
    record(agent, spec, &mut rng::stream(config.seed, "bench"), EPISODES, length)
}

/// Page faults of this process so far that needed no disk, from `/proc/self/stat`.
fn minor_faults() -> Option<u64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The fields after the command's name, which may hold spaces: state is the first, minflt the eighth.
    stat.rsplit_once(')')?.1.split_whitespace().nth(7)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_lies_in_the_middle() {
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.5);
        assert_eq!(median(&[]), 0.0);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn touching_new_pages_counts() {
        let before = minor_faults().unwrap();
        let pages = std::hint::black_box(vec![1u8; 64 << 20]);
        assert!(minor_faults().unwrap() > before, "{}", pages.len());
    }
}
