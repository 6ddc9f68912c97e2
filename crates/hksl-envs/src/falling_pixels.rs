//! Falling Pixels: catch pixels in the agent's column (introduced by the paper, section 5).
//!
//! The frame is a grid with one 8-bit channel. The agent is one cell of the bottom row. Pixels fall from the top row at
//! different speeds, which the agent can only infer from successive frames.

use ndarray::Array3;
use rand::Rng;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::environment::check_action;
use crate::settings::{Settings, check_setting};
use crate::{Environment, Error, FrameShape, ReadingSpec, Spec, Step, snapshot};

/// The task's name.
pub const TASK: &str = "falling-pixels";
/// Possible speeds of a pixel, rows per step.
pub const SPEEDS: [usize; 3] = [1, 3, 5];
/// Probability per step that a pixel appears in an empty column. A column emptied in a step stays empty in that step.
pub const SPAWN_PROBABILITY: f64 = 0.025;
/// Absolute value of an action above which the agent moves one column.
pub const MOVE_THRESHOLD: f32 = 1.0 / 3.0;
/// The value of a lit cell.
pub const LIT: u8 = 255;

/// One falling pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Pixel {
    row: usize,
    /// Rows per step.
    speed: usize,
}

/// State of the environment.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct State {
    agent_column: usize,
    /// The pixel of each column, if any.
    pixels: Vec<Option<Pixel>>,
    /// Steps taken in this episode. None before the first reset.
    steps: Option<usize>,
    rng: ChaCha8Rng,
}

/// The environment. [`crate::make`] creates it by name.
#[derive(Clone, Debug)]
pub struct FallingPixels {
    spec: Spec,
    state: State,
}

impl FallingPixels {
    /// Creates a grid of `settings.height` rows and `settings.width` columns (paper: 35 × 15).
    ///
    /// # Errors
    /// Fewer than 2 rows, no column, or an episode length of 0.
    pub fn new(settings: &Settings, rng: ChaCha8Rng) -> Result<Self, Error> {
        check_setting(TASK, "height", settings.height, 2)?;
        check_setting(TASK, "width", settings.width, 1)?;
        check_setting(TASK, "episode_steps", settings.episode_steps, 1)?;
        let spec = Spec {
            task: TASK.to_owned(),
            frame: FrameShape { channels: 1, height: settings.height, width: settings.width },
            action_dims: 1,
            steps_per_episode: settings.episode_steps,
            readings: vec![
                ReadingSpec::new("agent_column", "column", 1),
                ReadingSpec::new("pixel_row", "row", settings.width),
            ],
        };
        let state = State { agent_column: 0, pixels: vec![None; settings.width], steps: None, rng };
        Ok(Self { spec, state })
    }

    fn bottom_row(&self) -> usize {
        self.spec.frame.height - 1
    }

    fn new_pixel(rng: &mut ChaCha8Rng) -> Pixel {
        Pixel { row: 0, speed: SPEEDS.choose(rng).copied().unwrap_or(SPEEDS[0]) }
    }

    fn move_agent(&mut self, action: f32) {
        let column = self.state.agent_column;
        self.state.agent_column = if action < -MOVE_THRESHOLD {
            column.saturating_sub(1)
        } else if action > MOVE_THRESHOLD {
            (column + 1).min(self.spec.frame.width - 1)
        } else {
            column
        };
    }
}

impl Environment for FallingPixels {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn reset(&mut self) -> Result<(), Error> {
        let state = &mut self.state;
        state.agent_column = state.rng.random_range(0..self.spec.frame.width);
        for place in &mut state.pixels {
            *place = Some(Self::new_pixel(&mut state.rng));
        }
        state.steps = Some(0);
        Ok(())
    }

    fn step(&mut self, action: &[f32]) -> Result<Step, Error> {
        check_action(action, &self.spec)?;
        let steps = self.state.steps.ok_or(Error::NotReset { what: "a step" })?;
        if steps >= self.spec.steps_per_episode {
            return Err(Error::EpisodeOver { steps });
        }
        self.move_agent(action[0]);

        let bottom = self.bottom_row();
        let state = &mut self.state;
        let mut reward = 0.0;
        for (column, place) in state.pixels.iter_mut().enumerate() {
            match place {
                Some(pixel) => {
                    pixel.row = (pixel.row + pixel.speed).min(bottom);
                    if pixel.row == bottom {
                        if column == state.agent_column {
                            reward += 1.0;
                        }
                        // A column emptied in this step stays empty in this step.
                        *place = None;
                    }
                }
                None => {
                    if state.rng.random_bool(SPAWN_PROBABILITY) {
                        *place = Some(Self::new_pixel(&mut state.rng));
                    }
                }
            }
        }
        let steps = steps + 1;
        state.steps = Some(steps);
        Ok(Step { reward, terminal: false, last: steps == self.spec.steps_per_episode })
    }

    fn frame(&mut self) -> Result<Array3<u8>, Error> {
        if self.state.steps.is_none() {
            return Err(Error::NotReset { what: "a frame" });
        }
        let mut frame = Array3::zeros(self.spec.frame.dim());
        frame[(0, self.bottom_row(), self.state.agent_column)] = LIT;
        for (column, place) in self.state.pixels.iter().enumerate() {
            if let Some(pixel) = place {
                frame[(0, pixel.row, column)] = LIT;
            }
        }
        Ok(frame)
    }

    /// `agent_column`, then `pixel_row` for each column, with -1 for a column without pixel.
    fn readings(&self) -> Vec<Vec<f64>> {
        let row = |place: &Option<Pixel>| place.map_or(-1.0, |pixel| pixel.row as f64);
        vec![vec![self.state.agent_column as f64], self.state.pixels.iter().map(row).collect()]
    }

    fn snapshot(&self) -> Result<Value, Error> {
        snapshot::write(TASK, &self.state)
    }

    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        let state: State = snapshot::read(TASK, snapshot)?;
        let FrameShape { height, width, .. } = self.spec.frame;
        snapshot::same(TASK, "a grid width of", &state.pixels.len(), &width)?;
        snapshot::within_episode(&self.spec, state.steps)?;
        let valid = |pixel: &Pixel| pixel.row < height && SPEEDS.contains(&pixel.speed);
        if state.agent_column >= width || !state.pixels.iter().flatten().all(valid) {
            return Err(snapshot::unfit(TASK, format!("a cell lies outside {height} x {width}")));
        }
        self.state = state;
        Ok(())
    }
}

#[cfg(test)]
#[path = "falling_pixels/tests.rs"]
mod tests;
