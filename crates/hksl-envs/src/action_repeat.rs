//! Action repeat.

use ndarray::Array3;
use serde_json::Value;

use crate::environment::PhysicalState;
use crate::{Environment, Error, Spec, Step};

/// Applies each action `repeat` times, or until the episode ends, and sums the rewards. Only the last state is rendered.
/// One step of this wrapper is one *agent step*.
///
/// The number of steps per episode is that of the inner environment divided by `repeat`, rounded up.
pub struct ActionRepeat {
    inner: Box<dyn Environment>,
    repeat: usize,
    spec: Spec,
}

impl ActionRepeat {
    /// Wraps `inner`.
    ///
    /// # Errors
    /// A `repeat` of zero.
    pub fn new(inner: Box<dyn Environment>, repeat: usize) -> Result<Self, Error> {
        let mut spec = inner.spec().clone();
        if repeat == 0 {
            return Err(Error::Setting {
                task: spec.task,
                name: "action_repeat",
                value: repeat.to_string(),
                expected: "at least 1".to_owned(),
            });
        }
        spec.steps_per_episode = spec.steps_per_episode.div_ceil(repeat);
        Ok(Self { inner, repeat, spec })
    }

    /// The action repeat.
    pub fn repeat(&self) -> usize {
        self.repeat
    }
}

impl Environment for ActionRepeat {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn reset(&mut self) -> Result<(), Error> {
        self.inner.reset()
    }

    fn step(&mut self, action: &[f32]) -> Result<Step, Error> {
        let mut total = self.inner.step(action)?;
        for _ in 1..self.repeat {
            if total.last {
                break;
            }
            let step = self.inner.step(action)?;
            total = Step { reward: total.reward + step.reward, ..step };
        }
        Ok(total)
    }

    fn frame(&mut self) -> Result<Array3<u8>, Error> {
        self.inner.frame()
    }

    fn readings(&self) -> Vec<Vec<f64>> {
        self.inner.readings()
    }

    fn physical_state(&self) -> Option<PhysicalState> {
        self.inner.physical_state()
    }

    fn snapshot(&self) -> Result<Value, Error> {
        self.inner.snapshot()
    }

    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        self.inner.restore(snapshot)
    }

    fn restores_episodes(&self) -> bool {
        self.inner.restores_episodes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FrameShape;

    /// Rewards 1, 2, 3, …; ends after `limit` steps.
    struct Counter {
        spec: Spec,
        steps: usize,
        terminal: bool,
    }

    fn repeated(limit: usize, repeat: usize, terminal: bool) -> ActionRepeat {
        let frame = FrameShape { channels: 1, height: 1, width: 1 };
        let spec = Spec {
            task: "counter".to_owned(),
            frame,
            action_dims: 1,
            steps_per_episode: limit,
            readings: Vec::new(),
        };
        ActionRepeat::new(Box::new(Counter { spec, steps: 0, terminal }), repeat).unwrap()
    }

    impl Environment for Counter {
        fn spec(&self) -> &Spec {
            &self.spec
        }
        fn reset(&mut self) -> Result<(), Error> {
            self.steps = 0;
            Ok(())
        }
        fn step(&mut self, action: &[f32]) -> Result<Step, Error> {
            assert_eq!(action, [0.5]);
            self.steps += 1;
            assert!(self.steps <= self.spec.steps_per_episode, "stepped past the end");
            let last = self.steps == self.spec.steps_per_episode;
            Ok(Step { reward: self.steps as f64, terminal: last && self.terminal, last })
        }
        fn frame(&mut self) -> Result<Array3<u8>, Error> {
            Ok(Array3::from_elem(self.spec.frame.dim(), self.steps as u8))
        }
        fn readings(&self) -> Vec<Vec<f64>> {
            Vec::new()
        }
        fn snapshot(&self) -> Result<Value, Error> {
            Ok(self.steps.into())
        }
        fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
            self.steps = snapshot.as_u64().unwrap() as usize;
            Ok(())
        }
    }

    #[test]
    fn sums_rewards_and_stops_at_the_end() {
        for terminal in [false, true] {
            let mut environment = repeated(10, 4, terminal);
            assert_eq!(environment.spec().steps_per_episode, 3);
            for _ in 0..2 {
                environment.reset().unwrap();
                for (reward, terminal, last) in
                    [(10.0, false, false), (26.0, false, false), (19.0, terminal, true)]
                {
                    let step = environment.step(&[0.5]).unwrap();
                    assert_eq!(step, Step { reward, terminal, last });
                }
            }
        }
    }

    #[test]
    fn a_repeat_of_one_changes_nothing_and_zero_is_rejected() {
        let mut environment = repeated(2, 1, false);
        assert_eq!(environment.spec().steps_per_episode, 2);
        assert_eq!(environment.step(&[0.5]).unwrap().reward, 1.0);
        assert_eq!(environment.frame().unwrap()[(0, 0, 0)], 1);
        let refused = ActionRepeat::new(Box::new(environment), 0);
        assert!(refused.err().unwrap().to_string().contains("action_repeat = 0"));
    }
}
