//! An environment of one's own, and HKSL trained in it.
//!
//! ```text
//! cargo run --release -p hksl-train --example own_environment
//! ```
//!
//! A first argument is the budget in agent steps. Given again, it goes on or says that the run is done.

use std::error::Error;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use candle_core::Device;
use hksl_envs::{ActionRepeat, Environment, FrameShape, ReadingSpec, Spec, Step};
use hksl_sac::Agent;
use hksl_train::config::{Config, Request, resolve};
use hksl_train::{Event, Factories, Plan, Resume, RunFolder, RunId, agent, train};
use ndarray::Array3;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use serde_json::Value;

const TASK: &str = "beacon";
const SIDE: usize = 16;
const STEPS: usize = 50;

/// A column of the picture is lit, and from time to time another one; an action points at a column. The reward is 1
/// where it points at the lit one, and falls to 0 at the far side.
struct Beacon {
    spec: Spec,
    state: State,
}

/// All that the future depends on.
#[derive(Serialize, Deserialize)]
struct State {
    rng: ChaCha8Rng,
    lit: usize,
    steps: usize,
}

impl Beacon {
    fn new(rng: ChaCha8Rng) -> Self {
        let spec = Spec {
            task: TASK.to_owned(),
            frame: FrameShape { channels: 1, height: SIDE, width: SIDE },
            action_dims: 1,
            steps_per_episode: STEPS,
            readings: vec![ReadingSpec::new("lit", "columns", 1)],
        };
        Self { spec, state: State { rng, lit: 0, steps: STEPS } }
    }
}

impl Environment for Beacon {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn reset(&mut self) -> Result<(), hksl_envs::Error> {
        self.state.lit = self.state.rng.random_range(0..SIDE);
        self.state.steps = 0;
        Ok(())
    }

    fn step(&mut self, action: &[f32]) -> Result<Step, hksl_envs::Error> {
        let State { rng, lit, steps } = &mut self.state;
        if *steps == STEPS {
            return Err(hksl_envs::Error::EpisodeOver { steps: STEPS });
        }
        let last_column = (SIDE - 1) as f64;
        let pointed_at = (f64::from(action[0]) + 1.0) / 2.0 * last_column;
        let reward = 1.0 - (pointed_at - *lit as f64).abs() / last_column;
        if rng.random_bool(0.2) {
            *lit = rng.random_range(0..SIDE);
        }
        *steps += 1;
        // No state ends the process here; the time limit does not count as one.
        Ok(Step { reward, terminal: false, last: *steps == STEPS })
    }

    fn frame(&mut self) -> Result<Array3<u8>, hksl_envs::Error> {
        let lit = self.state.lit;
        let shade = |(_, _, column)| if column == lit { 255 } else { 0 };
        Ok(Array3::from_shape_fn(self.spec.frame.dim(), shade))
    }

    fn readings(&self) -> Vec<Vec<f64>> {
        vec![vec![self.state.lit as f64]]
    }

    fn snapshot(&self) -> Result<Value, hksl_envs::Error> {
        serde_json::to_value(&self.state).map_err(unfit)
    }

    fn restore(&mut self, snapshot: &Value) -> Result<(), hksl_envs::Error> {
        self.state = State::deserialize(snapshot).map_err(unfit)?;
        Ok(())
    }
}

fn unfit(error: serde_json::Error) -> hksl_envs::Error {
    hksl_envs::Error::Snapshot { task: TASK.to_owned(), reason: error.to_string() }
}

/// What the training loop needs made: this environment, and the agent that the configuration names.
struct InBeacon;

impl Factories for InBeacon {
    fn environment(
        &self,
        config: &Config,
        rng: ChaCha8Rng,
    ) -> hksl_train::Result<Box<dyn Environment>> {
        let repeat = config.environment.action_repeat;
        Ok(Box::new(ActionRepeat::new(Box::new(Beacon::new(rng)), repeat)?))
    }

    fn agent(&self, config: &Config, spec: &Spec, device: &Device) -> hksl_train::Result<Agent> {
        agent(config, spec, device)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let budget = std::env::args().nth(1).unwrap_or_else(|| "1500".to_owned());
    // Sizes that fit the environment, and small networks; all else is as shipped.
    let settings = [
        &format!("environment_steps={budget}"),
        "environment.action_repeat=1",
        &format!("environment.height={SIDE}"),
        &format!("environment.width={SIDE}"),
        &format!("environment.episode_steps={STEPS}"),
        "training.initial_random_steps=200",
        "augmentation.pad=0", // where things are is all that matters here
        "encoder.filters=8",
        "sac.batch_size=32",
        "sac.hidden_units=64",
        "hksl.skips=[1, 3]",
        "evaluation.every_environment_steps=300",
        "device=cpu",
    ];
    let sets = settings.map(str::to_owned).to_vec();
    let mut config = resolve(&Request { sets, ..Request::default() })?.config;
    // The registry does not know it, so that it is named only now.
    config.task = TASK.to_owned();

    let folder = RunFolder::of(Path::new("runs"), &config, &RunId::default());
    let plan = Plan {
        config: &config,
        folder: &folder,
        factories: &InBeacon,
        device: Device::Cpu,
        command: std::env::args().collect::<Vec<_>>().join(" "),
        resume: Resume::Auto,
        stop: &AtomicBool::new(false),
    };
    let outcome = train(&plan, &mut |event| {
        if let Event::Evaluated(row) = event {
            println!("environment step {}: return {:.1}", row.environment_step, row.episode_return);
        }
    })?;
    println!("{}: return {:.1} of {STEPS}", folder.path().display(), outcome.final_return);
    Ok(())
}
