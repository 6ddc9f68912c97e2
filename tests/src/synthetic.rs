//! Runs that nobody trained: folders as `hksl train` leaves them, with returns from a formula.

use std::fs;
use std::path::{Path, PathBuf};

use hksl_train::config::{Config, Request, resolve};
use hksl_train::metrics::{EvalCsv, EvaluationRow};
use hksl_train::{RunFolder, RunId};

/// The evaluations that the paper makes: every 10,000 environment steps, 11 in all.
pub const STEPS: std::ops::RangeInclusive<u64> = 0..=10;

/// A run to be made up.
#[derive(Debug, Clone)]
pub struct Synthetic<'a> {
    /// The task.
    pub task: &'a str,
    /// The distractor.
    pub distractor: &'a str,
    /// The method.
    pub method: &'a str,
    /// The ablation.
    pub ablation: &'a str,
    /// The seed.
    pub seed: u64,
    /// Further settings, as `--set`.
    pub sets: &'a [&'a str],
    /// How many of its eleven evaluations there are; with all of them it is done.
    pub evaluations: usize,
}

impl Default for Synthetic<'_> {
    fn default() -> Self {
        Self {
            task: "cartpole-swingup",
            distractor: "none",
            method: "hksl",
            ablation: "none",
            seed: 1,
            sets: &[],
            evaluations: STEPS.count(),
        }
    }
}

impl Synthetic<'_> {
    /// Its configuration.
    pub fn config(&self) -> Config {
        let named = |name: &str| Some(name.to_owned());
        let seed = format!("seed={}", self.seed);
        let request = Request {
            task: named(self.task),
            method: named(self.method),
            ablation: named(self.ablation),
            distractor: named(self.distractor),
            sets: self.sets.iter().copied().chain([seed.as_str()]).map(str::to_owned).collect(),
            ..Request::default()
        };
        resolve(&request).unwrap().config
    }

    /// Its returns at the first, second, … evaluation: rising towards a level of its own, and not evenly.
    pub fn returns(&self) -> Vec<f64> {
        let parts = [self.task, self.distractor, self.method, self.ablation];
        let salt = parts
            .iter()
            .flat_map(|part| part.bytes())
            .fold(7u64, |hash, byte| hash.wrapping_mul(31).wrapping_add(u64::from(byte)));
        let level = 0.3 + 0.6 * ((salt % 97) as f64 / 97.0);
        let scale = if self.task == "falling-pixels" { 30.0 } else { 1000.0 };
        let of = |index: usize| {
            let progress = 1.0 - (-(index as f64) / 3.0).exp();
            let noise = ((salt % 1009 + 37 * self.seed + 11 * index as u64) as f64).sin();
            scale * (level * progress + 0.05 + 0.04 * noise)
        };
        (0..self.evaluations).map(of).collect()
    }

    /// Writes its folder.
    pub fn write(&self, runs: &Path) -> PathBuf {
        let config = self.config();
        let folder = RunFolder::of(runs, &config, &RunId::default());
        fs::create_dir_all(folder.path()).unwrap();
        fs::write(folder.config_file(), config.to_toml().unwrap()).unwrap();
        let command =
            format!("hksl train {} --method {} --seed {}\n", self.task, self.method, self.seed);
        fs::write(folder.path().join("command.txt"), command).unwrap();
        let mut file = EvalCsv::open(&folder.eval_file(), 0, 0).unwrap();
        for (index, episode_return) in self.returns().into_iter().enumerate() {
            let environment_step = config.environment_steps / 10 * index as u64;
            let agent = match self.ablation {
                "none" => self.method.to_owned(),
                ablation => format!("{}-{ablation}", self.method),
            };
            file.write(&EvaluationRow {
                agent,
                task: self.task.to_owned(),
                distractor: self.distractor.to_owned(),
                seed: self.seed,
                environment_step,
                agent_step: environment_step / config.environment.action_repeat as u64,
                episodes: 10,
                episode_return,
                episode_return_std: 1.0,
                episode_return_min: episode_return - 1.0,
                episode_return_max: episode_return + 1.0,
                wall_seconds: index as f64,
            })
            .unwrap();
        }
        if self.evaluations == STEPS.count() {
            fs::write(folder.done_file(), "").unwrap();
        }
        folder.path().to_owned()
    }
}
