//! Checks across keys.

use hksl_core::nn::PixelEncoder;
use hksl_envs::Distractor;

use super::error::{Error, Result};

use super::{Config, DeviceChoice, Origins};

impl Config {
    /// Checks settings that depend on each other: the hierarchy, the frame size against the encoder, and
    /// step counts against the action repeat.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] with the first invalid value and the valid ones.
    pub fn validate(&self) -> Result<()> {
        self.validate_with(&Origins::new())
    }

    pub(super) fn validate_with(&self, origins: &Origins) -> Result<()> {
        let check = Check { origins };
        DeviceChoice::parse(&self.device, origins.get("device"))?;
        check.positive("environment.action_repeat", self.environment.action_repeat)?;
        check.distractor(self)?;
        if self.render.device != "auto" && self.render.device.parse::<usize>().is_err() {
            let expected = "it must be auto or an EGL device index, as listed by hksl doctor";
            return Err(check.refused(
                "render.device",
                format!("{:?}", self.render.device),
                expected,
            ));
        }
        check.image(self)?;
        (self.registered()?.check)(self)
            .map_err(|(key, value, expected)| check.refused(&key, value, expected))?;
        check.steps(self)?;
        check.replay(self)?;
        if self.sac.log_std_minimum >= self.sac.log_std_maximum {
            let expected =
                format!("it must be below sac.log_std_maximum = {}", self.sac.log_std_maximum);
            return Err(check.refused("sac.log_std_minimum", self.sac.log_std_minimum, expected));
        }
        Ok(())
    }
}

struct Check<'a> {
    origins: &'a Origins,
}

impl Check<'_> {
    fn distractor(&self, config: &Config) -> Result<()> {
        let needs_mujoco = hksl_envs::registry::find(&config.task).map(|task| task.needs_mujoco);
        if config.distraction() == Distractor::None || needs_mujoco.unwrap_or(true) {
            return Ok(());
        }
        let error = hksl_envs::Error::Distractor { task: config.task.clone() };
        Err(self.refused("distractor", &config.distractor, error.to_string()))
    }

    fn image(&self, config: &Config) -> Result<()> {
        let [height, width] = config.frame_size();
        PixelEncoder::map_size(height, width).map(|_| ()).map_err(|error| {
            let environment = &config.environment;
            let (key, value) = if width < height {
                ("environment.width", environment.width)
            } else {
                ("environment.height", environment.height)
            };
            self.refused(key, value, error.to_string())
        })
    }

    fn steps(&self, config: &Config) -> Result<()> {
        let repeat = config.environment.action_repeat as u64;
        for (key, value) in [
            ("environment.episode_steps", config.environment.episode_steps as u64),
            ("environment_steps", config.environment_steps),
            ("evaluation.every_environment_steps", config.evaluation.every_environment_steps),
            (
                "checkpoint.weights_every_environment_steps",
                config.checkpoint.weights_every_environment_steps,
            ),
        ] {
            self.multiple(key, value, repeat)?;
        }
        let steps = config.episode_agent_steps();
        let (k, key) = (config.registered()?.sampled)(config);
        if steps < k {
            let expected = format!(
                "an episode has {steps} agent steps, but {} samples {k} at a time{}; it \
                 must be at least {}",
                config.method,
                key.map_or(String::new(), |key| format!(" ({key})")),
                k * config.environment.action_repeat
            );
            let value = config.environment.episode_steps;
            return Err(self.refused("environment.episode_steps", value, expected));
        }
        Ok(())
    }

    /// The running episode and a finished one must fit; otherwise there may be nothing to sample.
    fn replay(&self, config: &Config) -> Result<()> {
        let least = 2 * config.episode_agent_steps();
        if config.replay.capacity >= least {
            return Ok(());
        }
        let expected =
            format!("it must be at least {least}, two episodes of {} agent steps", least / 2);
        Err(self.refused("replay.capacity", config.replay.capacity, expected))
    }

    fn positive(&self, key: &str, value: usize) -> Result<()> {
        if value > 0 { Ok(()) } else { Err(self.refused(key, value, "it must be at least 1")) }
    }

    fn multiple(&self, key: &str, value: u64, repeat: u64) -> Result<()> {
        if value > 0 && value.is_multiple_of(repeat) {
            return Ok(());
        }
        let below = value / repeat * repeat;
        let nearest = match below {
            0 => format!("{repeat}"),
            below => format!("{below} or {}", below + repeat),
        };
        let expected = format!(
            "it must be a multiple of environment.action_repeat = {repeat}; nearest: {nearest}"
        );
        Err(self.refused(key, value, expected))
    }

    fn refused(&self, key: &str, value: impl ToString, expected: impl ToString) -> Error {
        Error::OutOfRange {
            key: key.to_owned(),
            value: value.to_string(),
            origin: self.origins.get(key).cloned(),
            expected: expected.to_string(),
        }
    }
}
