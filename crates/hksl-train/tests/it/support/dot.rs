//! "Follow the dot": a task that a small agent learns in minutes.

use hksl_envs::{Environment, Error, FrameShape, Spec, Step};
use ndarray::Array3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

const SIDE: usize = 16;
const STEPS: usize = 50;

/// 16×16 pixels, one channel. A dot near the top drifts one column with probability 0.2 a step; the agent in
/// the bottom rows moves by −1, 0 or +1 column as in Falling Pixels. The reward is 1 − distance/15.
pub struct FollowTheDot {
    spec: Spec,
    rng: ChaCha8Rng,
    dot: usize,
    agent: usize,
    step: usize,
}

impl FollowTheDot {
    pub fn new(rng: ChaCha8Rng) -> Self {
        let spec = Spec {
            task: "follow-the-dot".to_owned(),
            frame: FrameShape { channels: 1, height: SIDE, width: SIDE },
            action_dims: 1,
            steps_per_episode: STEPS,
            readings: Vec::new(),
        };
        Self { spec, rng, dot: 0, agent: 0, step: STEPS }
    }
}

fn moved(column: usize, by: isize) -> usize {
    column.saturating_add_signed(by).min(SIDE - 1)
}

impl Environment for FollowTheDot {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn reset(&mut self) -> Result<(), Error> {
        self.dot = self.rng.random_range(0..SIDE);
        self.agent = self.rng.random_range(0..SIDE);
        self.step = 0;
        Ok(())
    }

    fn step(&mut self, action: &[f32]) -> Result<Step, Error> {
        let by = match action[0] {
            a if a < -1.0 / 3.0 => -1,
            a if a > 1.0 / 3.0 => 1,
            _ => 0,
        };
        self.agent = moved(self.agent, by);
        if self.rng.random_bool(0.2) {
            let by = if self.rng.random_bool(0.5) { 1 } else { -1 };
            self.dot = moved(self.dot, by);
        }
        self.step += 1;
        let distance = self.dot.abs_diff(self.agent);
        let reward = 1.0 - distance as f64 / (SIDE - 1) as f64;
        Ok(Step { reward, terminal: false, last: self.step == STEPS })
    }

    fn frame(&mut self) -> Result<Array3<u8>, Error> {
        let mut frame = Array3::zeros((1, SIDE, SIDE));
        for row in 2..4 {
            frame[[0, row, self.dot]] = 255;
        }
        for row in 12..15 {
            frame[[0, row, self.agent]] = 255;
        }
        Ok(frame)
    }

    fn readings(&self) -> Vec<Vec<f64>> {
        Vec::new()
    }

    fn snapshot(&self) -> Result<Value, Error> {
        let seed: Vec<u8> = self.rng.get_seed().to_vec();
        let (stream, position) = (self.rng.get_stream(), self.rng.get_word_pos().to_string());
        Ok(json!([seed, stream, position, self.dot, self.agent, self.step]))
    }

    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        type Saved = (Vec<u8>, u64, String, usize, usize, usize);
        let saved: Saved = serde_json::from_value(snapshot.clone()).unwrap();
        self.rng = ChaCha8Rng::from_seed(saved.0.try_into().unwrap());
        self.rng.set_stream(saved.1);
        self.rng.set_word_pos(saved.2.parse().unwrap());
        (self.dot, self.agent, self.step) = (saved.3, saved.4, saved.5);
        Ok(())
    }
}
