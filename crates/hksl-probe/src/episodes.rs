//! Episodes of frames with their ground truth, the data of all analyses.

use candle_core::{Device, Tensor};
use hksl_envs::Environment;
use hksl_sac::{Acting, Agent, Rollout};
use ndarray::{Array2, Array3, Array4, ArrayView3, Axis, s};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use crate::{Error, Result};

/// Observations per batch.
const BATCH: usize = 64;

/// One episode, with one entry per agent step.
#[derive(Debug, Clone, PartialEq)]
pub struct Episode {
    /// `(T+1, C, H, W)`: single frames. The first is the frame before the first step.
    pub frames: Array4<u8>,
    /// `(T, A)`.
    pub actions: Array2<f32>,
    /// `(T+1, R)`: all components of the ground truth, in the order of [`hksl_envs::Spec::readings`].
    pub readings: Array2<f64>,
}

/// The policy for collecting episodes.
pub enum Policy {
    /// Uniformly random actions in [−1, 1], from this generator.
    Random(Box<ChaCha8Rng>),
    /// The deterministic action of an agent.
    Trained {
        /// The agent.
        agent: Box<Agent>,
        /// Number of frames in its observation.
        frame_stack: usize,
    },
}

impl Episode {
    /// Number of agent steps, `T`.
    pub fn len(&self) -> usize {
        self.actions.nrows()
    }

    /// Whether the episode has no step.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The frame at a time from 0 to `T`, `(C, H, W)`.
    ///
    /// # Panics
    /// This and the methods below panic if a time is out of range.
    pub fn frame(&self, time: usize) -> ArrayView3<'_, u8> {
        self.frames.index_axis(Axis(0), time)
    }

    /// The observation at a time, `(stack·C, H, W)`: the last `stack` frames, oldest first. At the episode's start the first
    /// frame is repeated.
    pub fn observation(&self, time: usize, stack: usize) -> Array3<u8> {
        let (_, channels, height, width) = self.frames.dim();
        let mut observation = Array3::zeros((stack * channels, height, width));
        for position in 0..stack {
            let frame = self.frame((time + position).saturating_sub(stack - 1));
            observation
                .slice_mut(s![position * channels..(position + 1) * channels, .., ..])
                .assign(&frame);
        }
        observation
    }

    /// The observations at these times as one batch, `(B, stack·C, H, W)`.
    pub fn observations(&self, times: &[usize], stack: usize, device: &Device) -> Result<Tensor> {
        let (_, channels, height, width) = self.frames.dim();
        let mut pixels = Vec::with_capacity(times.len() * stack * channels * height * width);
        for &time in times {
            pixels.extend(self.observation(time, stack));
        }
        Ok(Tensor::from_vec(pixels, (times.len(), stack * channels, height, width), device)?)
    }

    /// Applies `of` to all observations in batches.
    pub(crate) fn each_batch(
        &self,
        stack: usize,
        device: &Device,
        mut of: impl FnMut(&Tensor) -> Result<()>,
    ) -> Result<()> {
        let times: Vec<usize> = (0..=self.len()).collect();
        for times in times.chunks(BATCH) {
            of(&self.observations(times, stack, device)?)?;
        }
        Ok(())
    }
}

/// Collects `count` episodes. Calls `watch` with the number of completed episodes.
///
/// # Errors
/// Whatever the environment or the agent reports.
pub fn collect(
    environment: &mut dyn Environment,
    policy: &mut Policy,
    count: usize,
    watch: &mut dyn FnMut(usize),
) -> Result<Vec<Episode>> {
    (0..count)
        .map(|index| {
            let episode = episode(environment, policy)?;
            watch(index + 1);
            Ok(episode)
        })
        .collect()
}

fn episode(environment: &mut dyn Environment, policy: &mut Policy) -> Result<Episode> {
    let shape = environment.spec().frame;
    let dims = environment.spec().action_dims;
    let stack = if let Policy::Trained { frame_stack, .. } = policy { *frame_stack } else { 1 };
    let mut rollout = Rollout::new(stack, shape);
    let mut frames: Vec<u8> = rollout.reset(environment)?.into_iter().collect();
    let mut readings: Vec<f64> = environment.readings().concat();
    let width = readings.len();
    let mut actions: Vec<f32> = Vec::new();
    let mut steps = 0;
    loop {
        let action = match policy {
            Policy::Random(random) => (0..dims).map(|_| random.random_range(-1.0..=1.0)).collect(),
            Policy::Trained { agent, .. } => rollout.act(agent, Acting::Mean)?,
        };
        let (step, frame) = rollout.step(environment, &action)?;
        steps += 1;
        frames.extend(frame);
        readings.extend(environment.readings().concat());
        actions.extend(action);
        if step.last {
            break;
        }
    }
    let (channels, height, columns) = shape.dim();
    let fits = |what| move |error: ndarray::ShapeError| unfit(what, &error);
    Ok(Episode {
        frames: Array4::from_shape_vec((steps + 1, channels, height, columns), frames)
            .map_err(fits("frames"))?,
        actions: Array2::from_shape_vec((steps, dims), actions).map_err(fits("actions"))?,
        readings: Array2::from_shape_vec((steps + 1, width), readings).map_err(fits("readings"))?,
    })
}

pub(crate) fn unfit(what: &'static str, error: &ndarray::ShapeError) -> Error {
    Error::Shape { what, got: error.to_string(), expected: "as many as its shape holds".to_owned() }
}

/// The latents of one encoder over one episode.
#[derive(Debug, Clone, PartialEq)]
pub struct Latents {
    /// The encoder's name.
    pub encoder: String,
    /// `(T+1, Z)`.
    pub values: Array2<f64>,
}

/// Computes the latents of each encoder of an agent for an episode's observations.
///
/// # Errors
/// Frames of another shape than the agent's.
pub fn latents(
    agent: &Agent,
    episode: &Episode,
    stack: usize,
    device: &Device,
) -> Result<Vec<Latents>> {
    let mut encoders: Vec<(String, Vec<f64>)> = Vec::new();
    episode.each_batch(stack, device, |observations| {
        for (index, (name, values)) in
            agent.networks().encode(observations)?.into_iter().enumerate()
        {
            let values = values.flatten_all()?.to_vec1::<f32>()?;
            if index == encoders.len() {
                encoders.push((name, Vec::new()));
            }
            encoders[index].1.extend(values.into_iter().map(f64::from));
        }
        Ok(())
    })?;
    let rows = episode.len() + 1;
    encoders
        .into_iter()
        .map(|(encoder, values)| {
            let shape = (rows, values.len() / rows);
            let values =
                Array2::from_shape_vec(shape, values).map_err(|error| unfit("latents", &error))?;
            Ok(Latents { encoder, values })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use hksl_envs::{ActionRepeat, FrameStack, Settings};
    use rand_chacha::rand_core::SeedableRng;

    use super::*;

    fn falling_pixels() -> ActionRepeat {
        let settings = Settings::new(35, 15, 20);
        let random = ChaCha8Rng::seed_from_u64(3);
        ActionRepeat::new(hksl_envs::make("falling-pixels", &settings, random).unwrap(), 2).unwrap()
    }

    #[test]
    fn observations_equal_those_of_a_frame_stack() {
        let mut policy = Policy::Random(Box::new(ChaCha8Rng::seed_from_u64(4)));
        let mut heard = Vec::new();
        let episodes =
            collect(&mut falling_pixels(), &mut policy, 2, &mut |done| heard.push(done)).unwrap();
        assert_eq!((episodes.len(), heard), (2, vec![1, 2]));
        let episode = &episodes[1];
        assert_eq!((episode.len(), episode.frames.dim()), (10, (11, 1, 35, 15)));
        assert_eq!(episode.readings.dim(), (11, 16));
        let mut stack = FrameStack::new(3, falling_pixels().spec().frame);
        stack.reset(&episode.frame(0).to_owned()).unwrap();
        for time in 0..=10 {
            if time > 0 {
                stack.push(&episode.frame(time).to_owned()).unwrap();
            }
            assert_eq!(episode.observation(time, 3), stack.observation(), "{time}");
            // The bottom row of the newest frame shows the agent.
            let column = episode.readings[(time, 0)] as usize;
            assert_eq!(episode.frame(time)[(0, 34, column)], 255);
        }
        let batch = episode.observations(&[0, 7], 3, &Device::Cpu).unwrap();
        let bytes = batch.get(1).unwrap().flatten_all().unwrap().to_vec1::<u8>().unwrap();
        assert_eq!(bytes, episode.observation(7, 3).into_raw_vec_and_offset().0);
    }
}
