//! Rollouts: stacking frames, choosing actions and stepping environments.

use hksl_envs::{Environment, FrameShape, FrameStack, Step};
use ndarray::Array3;

use crate::Result;
use crate::agent::Agent;
use crate::learner::{Acting, RecurrentState};

/// Plays episodes with a policy: holds the stacked frames and the policy's recurrent state of the running episode.
///
/// Training, evaluation and probes call [`Self::reset`], then [`Self::act`] and [`Self::step`] in turn until
/// [`Step::last`].
///
/// ```
/// use hksl_envs::{Environment, FallingPixels, Settings};
/// use hksl_sac::Rollout;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
///
/// let random = ChaCha8Rng::seed_from_u64(7);
/// let mut environment = FallingPixels::new(&Settings::new(35, 15, 20), random)?;
/// let mut rollout = Rollout::new(3, environment.spec().frame);
/// rollout.reset(&mut environment)?;
/// let mut steps = 0;
/// loop {
///     steps += 1;
///     let (step, frame) = rollout.step(&mut environment, &[1.0])?;
///     assert_eq!((frame.dim(), rollout.observation().dim()), ((1, 35, 15), (3, 35, 15)));
///     if step.last {
///         break;
///     }
/// }
/// assert_eq!(steps, 20);
/// # Ok::<(), hksl_envs::Error>(())
/// ```
#[derive(Debug)]
pub struct Rollout {
    stack: FrameStack,
    state: RecurrentState,
}

impl Rollout {
    /// Creates a rollout for a policy that reads `stack` frames of this shape.
    pub fn new(stack: usize, frame: FrameShape) -> Self {
        Self { stack: FrameStack::new(stack, frame), state: RecurrentState::default() }
    }

    /// Resets the environment and returns the episode's first frame `(C, H, W)`.
    ///
    /// # Errors
    /// Whatever the environment reports.
    pub fn reset(
        &mut self,
        environment: &mut dyn Environment,
    ) -> std::result::Result<Array3<u8>, hksl_envs::Error> {
        environment.reset()?;
        let frame = environment.frame()?;
        self.stack.reset(&frame)?;
        self.state = RecurrentState::default();
        Ok(frame)
    }

    /// Chooses the agent's action for the latest observation.
    ///
    /// # Errors
    /// Frames whose shape differs from the agent's.
    pub fn act(&mut self, agent: &mut Agent, acting: Acting) -> Result<Vec<f32>> {
        agent.act(self.stack.observation().view(), acting, &mut self.state)
    }

    /// Takes the action in the environment and returns the step and its frame `(C, H, W)`.
    ///
    /// # Errors
    /// Whatever the environment reports.
    pub fn step(
        &mut self,
        environment: &mut dyn Environment,
        action: &[f32],
    ) -> std::result::Result<(Step, Array3<u8>), hksl_envs::Error> {
        let step = environment.step(action)?;
        let frame = environment.frame()?;
        self.stack.push(&frame)?;
        Ok((step, frame))
    }

    /// The latest observation, `(stack·C, H, W)`, oldest frame first.
    pub fn observation(&self) -> Array3<u8> {
        self.stack.observation()
    }

    /// The stacked frames, oldest first.
    pub fn frames(&self) -> Vec<Array3<u8>> {
        self.stack.frames().cloned().collect()
    }

    /// The policy's recurrent state.
    pub fn state(&self) -> &RecurrentState {
        &self.state
    }

    /// Restores saved [`Self::frames`] and [`Self::state`].
    ///
    /// # Errors
    /// Another number of frames, or frames of another shape.
    pub fn restore(
        &mut self,
        frames: Vec<Array3<u8>>,
        state: RecurrentState,
    ) -> std::result::Result<(), hksl_envs::Error> {
        self.stack.restore(frames)?;
        self.state = state;
        Ok(())
    }
}
