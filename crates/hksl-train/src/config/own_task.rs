//! Tasks that programs bring.

use toml::Value;

use super::error::{Error, Result};
use super::layer::Merged;
use super::{DISTRACTOR_NONE, Origin, shipped};

/// A task that a program brings, which has no file of settings: its layer says what its environment is like.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OwnTask {
    /// Its name.
    pub name: String,
    /// Rows of a frame.
    pub height: usize,
    /// Columns of a frame.
    pub width: usize,
    /// Steps in an episode, if the environment has a time limit of its own.
    pub episode_steps: Option<usize>,
}

impl OwnTask {
    /// Puts the task's layer on top.
    ///
    /// # Errors
    /// A name that is no folder's or that a task of hksl has; a layer of the user's that names another task.
    pub(super) fn add_to(&self, merged: &mut Merged, user: &Merged) -> Result<()> {
        let refused = |expected: &str| Error::OutOfRange {
            key: "task".to_owned(),
            value: format!("{:?}", self.name),
            origin: Some(Origin::Environment),
            expected: expected.to_owned(),
        };
        if shipped::tasks().contains(&self.name.as_str()) {
            return Err(refused("a task of hksl has this name; give the environment another one"));
        }
        let plain = |c: char| c.is_alphanumeric() || matches!(c, '-' | '_' | '.');
        if self.name.is_empty() || self.name.starts_with('.') || !self.name.chars().all(plain) {
            return Err(refused(
                "it names a folder, so it must consist of letters, digits, '-', '_' and '.', and must not begin with '.'",
            ));
        }
        if let Some((task, origin)) = user.text("task").filter(|(task, _)| *task != self.name) {
            return Err(Error::OutOfRange {
                key: "task".to_owned(),
                value: format!("{task:?}"),
                origin: Some(origin),
                expected: format!("the environment is {:?}; leave the key out", self.name),
            });
        }
        let whole = |value: usize| Value::Integer(i64::try_from(value).unwrap_or(i64::MAX));
        let sizes = [
            ("environment.action_repeat", Some(1)),
            ("environment.height", Some(self.height)),
            ("environment.width", Some(self.width)),
            ("environment.episode_steps", self.episode_steps),
        ];
        merged.add("task", Value::String(self.name.clone()), &Origin::Environment)?;
        for (key, value) in sizes {
            let Some(value) = value else { continue };
            merged.add(key, whole(value), &Origin::Environment)?;
        }
        Ok(())
    }

    /// Checks that no layer contradicts the environment: its frames are used as they are.
    ///
    /// # Errors
    /// Another size of frames, no time limit, or a distractor.
    pub(super) fn check(&self, merged: &Merged) -> Result<()> {
        for (key, size) in [("environment.height", self.height), ("environment.width", self.width)]
        {
            let Some(value) =
                merged.value(key).filter(|value| value.as_integer() != Some(size as i64))
            else {
                continue;
            };
            return Err(Error::OutOfRange {
                key: key.to_owned(),
                value: value.to_string(),
                origin: merged.origin(key),
                expected: format!(
                    "frames of {} have {}×{} pixels, and hksl does not resize frames; leave the key out, and resize them in \
                 the environment",
                    self.name, self.height, self.width
                ),
            });
        }
        let unlimited = merged.origin("environment.episode_steps") == Some(Origin::Default);
        if unlimited && self.episode_steps.is_none() {
            return Err(Error::NoTimeLimit { task: self.name.clone() });
        }
        if let Some((distractor, origin)) =
            merged.text("distractor").filter(|of| of.0 != DISTRACTOR_NONE)
        {
            return Err(Error::OutOfRange {
                key: "distractor".to_owned(),
                value: format!("{distractor:?}"),
                origin: Some(origin),
                expected: format!(
                    "distractors change control tasks only, not {}; leave it out",
                    self.name
                ),
            });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Request, Resolved, resolve};

    fn own(sets: &[&str], episode_steps: Option<usize>) -> Result<Resolved> {
        let own_task = OwnTask { name: "walk".to_owned(), height: 40, width: 30, episode_steps };
        let sets = sets.iter().map(|set| (*set).to_owned()).collect();
        resolve(&Request { own_task: Some(own_task), sets, ..Request::default() })
    }

    #[test]
    fn a_programs_own_task_is_the_layer_of_its_environment() {
        let Resolved { config, origins, .. } = own(&["sac.batch_size=7"], Some(200)).unwrap();
        let environment = &config.environment;
        assert_eq!((config.task.as_str(), config.frame_size()), ("walk", [40, 30]));
        assert_eq!((environment.action_repeat, environment.episode_steps), (1, 200));
        assert_eq!(origins["environment.height"], Origin::Environment);
        assert_eq!(
            own(&["environment.episode_steps=50"], None).unwrap().config.sac.batch_size,
            128
        );
    }

    #[test]
    fn what_contradicts_the_environment_is_refused() {
        for (sets, steps, words) in [
            (&["environment.width=84"][..], Some(200), "30 pixels, and hksl does not resize"),
            (&[], None, "no time limit"),
            (&["task=\"cartpole-swingup\""], Some(200), "the environment is \"walk\""),
            (&["distractor=color-easy"], Some(200), "control tasks only"),
        ] {
            let message = own(sets, steps).unwrap_err().to_string();
            assert!(message.contains(words), "{message}");
        }
    }

    #[test]
    fn the_smallest_frames_are_the_encoders() {
        let side = hksl_envs::external::MINIMUM_SIDE;
        let size = |side| hksl_core::nn::PixelEncoder::map_size(side, side);
        assert!(size(side).is_ok() && size(side - 1).is_err());
    }
}
