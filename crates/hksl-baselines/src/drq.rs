//! DrQ, and plain SAC as DrQ with one view.

use std::time::Instant;

use candle_core::{Device, Tensor};
use hksl_core::kernels::Kernels;
use hksl_core::optim::Adam;
use hksl_core::parallel;
use hksl_sac::{Acting, Draw, Learner, Networks, Phase, RecurrentState, Result, UpdateReport};
use rand_chacha::ChaCha8Rng;

use crate::actor_critic::{ActorCritic, ActorInput, Architecture, init_stream};
use crate::config::DrqConfig;
use crate::transitions::Transitions;

/// DrQ (Kostrikov et al., arXiv 2004.13649, algorithm 1): SAC with targets averaged over `K` augmented views of the next
/// observation and a critic loss summed over `M` augmented views of the observation.
#[derive(Debug)]
pub struct Drq {
    core: ActorCritic,
    config: DrqConfig,
}

/// A batch of one learning step.
#[derive(Debug, Clone)]
pub struct DrqBatch {
    /// Transitions, whose observations are the first view.
    pub batch: Transitions,
    /// `M` views of the observations, `(B, C, H, W)` each.
    pub observations: Vec<Tensor>,
    /// `K` views of the next observations, each with the noise of the next action, `(B, A)`.
    pub next_observations: Vec<(Tensor, Tensor)>,
    /// Noise of the action in the actor loss, `(B, A)`.
    pub actor_noise: Tensor,
}

impl Drq {
    /// Creates the networks and initialises their weights with the RNG stream `init` of `seed`.
    ///
    /// # Errors
    /// Sizes out of range.
    pub fn new(
        architecture: Architecture,
        config: DrqConfig,
        kernels: Kernels,
        seed: u64,
        device: &Device,
    ) -> Result<Self> {
        let rng = &mut init_stream(seed);
        let core = ActorCritic::new(architecture, ActorInput::OwnHead, kernels, rng, device)?;
        Ok(Self { core, config })
    }

    /// The actor-critic.
    pub fn core(&self) -> &ActorCritic {
        &self.core
    }

    /// The critic target averaged over the views, `(B, 1)`, without gradient.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn target(&self, views: &DrqBatch) -> Result<Tensor> {
        let targets = views.next_observations.iter();
        let targets: Vec<Tensor> = targets
            .map(|(next, noise)| self.core.critic_target(&views.batch, next, noise))
            .collect::<Result<_>>()?;
        Ok(Tensor::stack(&targets, 0)?.mean(0)?)
    }

    /// Takes one learning step: updates critics, then actor and temperature, then targets.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn step(&mut self, views: &DrqBatch, agent_step: u64) -> Result<UpdateReport> {
        let (mut report, mut clock) = (UpdateReport::default(), Instant::now());
        let target = self.target(views)?;
        let actions = &views.batch.actions;
        self.core.step_critic(&views.observations, actions, &target, &mut report)?;
        report.lap(Phase::Critics, &mut clock);
        let first = &views.observations[0];
        self.core.step_actor(first, &views.actor_noise, agent_step, &mut report)?;
        report.lap(Phase::Actor, &mut clock);
        self.core.update_targets(agent_step)?;
        report.lap(Phase::TargetNetworks, &mut clock);
        Ok(report)
    }

    fn draw(&self, draw: &mut Draw) -> Result<Option<DrqBatch>> {
        let Architecture { sac, action_dims, .. } = self.core.architecture();
        let (count, shape) = (sac.batch_size, [sac.batch_size, *action_dims]);
        let Some(starts) = draw.starts(count, 1) else { return Ok(None) };
        let DrqConfig { target_views, critic_views } = self.config;
        let batch = Transitions::first_of(&draw.batch(&starts, 1)?)?;
        let mut observations = vec![batch.observations.clone()];
        let mut next = vec![batch.next_observations.clone()];
        while observations.len() < critic_views.max(target_views) {
            let again = Transitions::first_of(&draw.batch(&starts, 1)?)?;
            observations.push(again.observations);
            next.push(again.next_observations);
        }
        observations.truncate(critic_views);
        next.truncate(target_views);
        let noisy = |view: Tensor| Ok((view, draw.normal(&shape)?));
        let next_observations = next.into_iter().map(noisy).collect::<Result<_>>()?;
        let actor_noise = draw.normal(&shape)?;
        Ok(Some(DrqBatch { batch, observations, next_observations, actor_noise }))
    }
}

impl Learner for Drq {
    fn update(&mut self, draw: &mut Draw, agent_step: u64) -> Result<Option<UpdateReport>> {
        let Some(views) = self.draw(draw)? else { return Ok(None) };
        parallel::inside(draw.device(), || self.step(&views, agent_step)).map(Some)
    }

    fn act(
        &self,
        observation: &Tensor,
        acting: Acting,
        random: &mut ChaCha8Rng,
        _: &mut RecurrentState,
    ) -> Result<Tensor> {
        self.core.choose_action(observation, acting, random)
    }

    fn networks(&self) -> &Networks {
        &self.core.networks
    }

    fn optimizers(&mut self) -> Vec<(String, &mut Adam)> {
        self.core.optimizers()
    }

    fn diagnose(&self, draw: &mut Draw) -> Result<Vec<(String, f64)>> {
        self.core.diagnose(draw, |_| Ok(Vec::new()))
    }
}
