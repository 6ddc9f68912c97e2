//! Options that configure a run, shared by several commands.

use std::path::PathBuf;

use clap::Args;
use hksl_train::config::{self, Flag, Request};
use toml::Value;

use crate::exit::Misuse;
use crate::names::Listed;
use crate::numbers::any_whole;

/// Later layers win: defaults, method, task, distractor, presets, ablation, --config, --set, other flags.
#[derive(Debug, Clone, Default, Args)]
pub struct RunSettings {
    /// Task; see `hksl tasks` [default: falling-pixels]
    #[arg(value_name = "TASK", value_parser = Listed(config::tasks))]
    pub task: Option<String>,

    /// Learning method [default: hksl]
    #[arg(long, value_name = "NAME", value_parser = Listed(config::methods))]
    #[arg(help_heading = "Task and method")]
    pub method: Option<String>,

    /// Ablation of HKSL [default: none]
    ///
    /// From figure 4 of the paper: no-repr, all-n1, no-c, shared-encoder, h1, no-w. From figure 3,
    /// for falling-pixels only: h2, h3, h4.
    #[arg(long, value_name = "NAME", value_parser = Listed(config::ablations), hide_possible_values = true)]
    #[arg(help_heading = "Task and method")]
    pub ablation: Option<String>,

    /// Visual distractor of a control task [default: none]
    #[arg(long, value_name = "NAME", value_parser = Listed(config::distractors))]
    #[arg(help_heading = "Task and method")]
    pub distractor: Option<String>,

    /// Random seed [default: 1]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = any_whole)]
    #[arg(help_heading = "Task and method")]
    pub seed: Option<i64>,

    /// Budget in environment steps (agent steps × action repeat) [default: the task's]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = any_whole)]
    #[arg(help_heading = "Task and method")]
    pub environment_steps: Option<i64>,

    /// Preset, may be repeated and is applied in order; debug takes seconds [default: paper]
    #[arg(long = "preset", value_name = "NAME", value_parser = Listed(config::presets))]
    #[arg(help_heading = "Configuration")]
    pub presets: Vec<String>,

    /// TOML file with any subset of the keys that `hksl config show` prints
    #[arg(long, value_name = "FILE", help_heading = "Configuration")]
    pub config: Option<PathBuf>,

    /// Value of one key, as in --set hksl.learning_rate=1e-4; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE", help_heading = "Configuration")]
    pub sets: Vec<String>,

    /// Training device: auto, cpu, cuda or cuda:N [default: auto]
    #[arg(long, value_name = "DEVICE", help_heading = "Machine")]
    pub device: Option<String>,

    /// EGL device index for rendering [default: MUJOCO_EGL_DEVICE_ID, else the GPU of --device, else the first that
    /// works]
    #[arg(long, value_name = "N", help_heading = "Machine")]
    pub render_device: Option<String>,

    /// CPU threads, 0 for all logical cores [default: 0]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = any_whole)]
    #[arg(help_heading = "Machine")]
    pub threads: Option<i64>,
}

/// Options that affect the environment and its rendering, for commands that do not train.
pub const OF_ENVIRONMENT: [&str; 8] = [
    "TASK",
    "--distractor",
    "--seed",
    "--preset",
    "--config",
    "--set",
    "--device",
    "--render-device",
];

impl RunSettings {
    /// Rejects given options that are not in `allowed`.
    ///
    /// # Errors
    /// [`Misuse`] for the first such option, with the reason.
    pub fn refuse_all_but(&self, allowed: &[&str], reason: &str) -> anyhow::Result<()> {
        let given = [
            ("TASK", self.task.is_some()),
            ("--method", self.method.is_some()),
            ("--ablation", self.ablation.is_some()),
            ("--distractor", self.distractor.is_some()),
            ("--seed", self.seed.is_some()),
            ("--environment-steps", self.environment_steps.is_some()),
            ("--preset", !self.presets.is_empty()),
            ("--config", self.config.is_some()),
            ("--set", !self.sets.is_empty()),
            ("--device", self.device.is_some()),
            ("--render-device", self.render_device.is_some()),
            ("--threads", self.threads.is_some()),
        ];
        match given.iter().find(|(name, given)| *given && !allowed.contains(name)) {
            Some((name, _)) => {
                Err(Misuse(format!("{name} has no effect here: {reason}; leave it out")).into())
            }
            None => Ok(()),
        }
    }

    /// The configuration request that these options describe.
    pub fn request(&self) -> Request {
        let integer = |value: Option<i64>| value.map(Value::Integer);
        let flags = [
            ("seed", integer(self.seed), "--seed"),
            ("environment_steps", integer(self.environment_steps), "--environment-steps"),
            ("device", self.device.clone().map(Value::String), "--device"),
            ("threads", integer(self.threads), "--threads"),
            ("render.device", self.render_device.clone().map(Value::String), "--render-device"),
        ];
        let flag = |(key, value, name): (_, Option<Value>, _)| {
            value.map(|value| Flag { key, value, name })
        };
        Request {
            task: self.task.clone(),
            own_task: None,
            method: self.method.clone(),
            ablation: self.ablation.clone(),
            distractor: self.distractor.clone(),
            presets: self.presets.clone(),
            file: self.config.clone(),
            sets: self.sets.clone(),
            values: Vec::new(),
            flags: flags.into_iter().filter_map(flag).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use hksl_train::config::{Origin, resolve};

    use super::*;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        settings: RunSettings,
    }

    fn settings(arguments: &[&str]) -> RunSettings {
        let arguments = ["hksl"].iter().chain(arguments);
        Command::try_parse_from(arguments).unwrap_or_else(|error| panic!("{error}")).settings
    }

    #[test]
    fn every_option_reaches_its_key_under_its_own_name() {
        let settings = settings(&[
            "cartpole-swingup",
            "--method=hksl",
            "--ablation=no-c",
            "--distractor=camera-easy",
            "--preset=debug",
            "--set=sac.batch_size=16",
            "--seed=7",
            "--environment-steps=960",
            "--device=cpu",
            "--threads=2",
            "--render-device=0",
        ]);
        let resolved = resolve(&settings.request()).unwrap();
        let config = &resolved.config;
        assert_eq!((config.seed, config.environment_steps, config.threads), (7, 960, 2));
        assert_eq!((config.task.as_str(), config.device.as_str()), ("cartpole-swingup", "cpu"));
        assert_eq!((config.sac.batch_size, config.hksl.communication), (16, false));
        for (key, name) in [
            ("task", "TASK"),
            ("method", "--method"),
            ("ablation", "--ablation"),
            ("distractor", "--distractor"),
            ("seed", "--seed"),
            ("environment_steps", "--environment-steps"),
            ("device", "--device"),
            ("threads", "--threads"),
            ("render.device", "--render-device"),
        ] {
            assert_eq!(resolved.origins[key], Origin::Flag(name));
        }
    }

    #[test]
    fn the_defaults_that_help_states_are_the_files() {
        let config = resolve(&settings(&[]).request()).unwrap().config;
        let stated = (config.task.as_str(), config.method.as_str(), config.ablation.as_str());
        assert_eq!(stated, ("falling-pixels", "hksl", "none"));
        assert_eq!((config.seed, config.device.as_str(), config.threads), (1, "auto", 0));
    }

    #[test]
    fn a_negative_number_is_a_value_out_of_range_and_no_option() {
        for option in ["--seed", "--environment-steps", "--threads"] {
            let error = resolve(&settings(&[option, "-1"]).request()).unwrap_err().to_string();
            assert!(error.contains(&format!("-1 ({option})")), "{error}");
            assert!(error.contains("must be an integer from") || error.contains("at least 0"));
        }
    }

    #[test]
    fn an_unknown_name_is_the_librarys_to_judge() {
        let error = resolve(&settings(&["cartpole"]).request()).unwrap_err();
        assert!(error.to_string().contains("did you mean `cartpole-swingup`"), "{error}");
    }
}
