//! CURL: contrastive unsupervised representations.

use std::time::Instant;

use candle_core::{Device, Tensor};
use hksl_core::kernels::Kernels;
use hksl_core::nn::Initializer;
use hksl_core::optim::Adam;
use hksl_core::{Builder, Encoder, parallel};
use hksl_sac::{Acting, Draw, Learner, Networks, Phase, RecurrentState, Result, UpdateReport};
use rand_chacha::ChaCha8Rng;

use crate::actor_critic::{ActorCritic, ActorInput, Architecture, init_stream};
use crate::config::CurlConfig;
use crate::contrastive::bilinear_loss;
use crate::transitions::Transitions;

/// CURL (Laskin et al., arXiv 2004.04136): SAC with a contrastive loss between two augmented views of each observation.
/// The encoder encodes the query, the target encoder the key; the other keys of the batch are negatives.
///
/// Parameter: `bilinear`, `(Z, Z)`.
#[derive(Debug)]
pub struct Curl {
    core: ActorCritic,
    bilinear: Tensor,
    /// The original's second optimiser of the encoder; `module_adam` optimises encoder and bilinear map.
    encoder_adam: Option<Adam>,
    module_adam: Adam,
}

/// A batch of one learning step.
#[derive(Debug, Clone)]
pub struct CurlBatch {
    /// Transitions, whose observations are the queries.
    pub batch: Transitions,
    /// The keys: another augmented view of the same observations, `(B, C, H, W)`.
    pub positives: Tensor,
    /// Noise of the next action, `(B, A)`.
    pub target_noise: Tensor,
    /// Noise of the action in the actor loss, `(B, A)`.
    pub actor_noise: Tensor,
}

impl Curl {
    /// Creates the networks and initialises their weights with the RNG stream `init` of `seed`.
    ///
    /// # Errors
    /// Sizes out of range.
    pub fn new(
        architecture: Architecture,
        config: &CurlConfig,
        kernels: Kernels,
        seed: u64,
        device: &Device,
    ) -> Result<Self> {
        let (rng, rate) = (&mut init_stream(seed), architecture.sac.learning_rate);
        let (dims, start) =
            (architecture.encoder.latent_dims, architecture.baseline.initialisation);
        let mut core = ActorCritic::new(architecture, ActorInput::OwnHead, kernels, rng, device)?;
        core.networks.trained.push(("bilinear map".to_owned(), vec!["bilinear".to_owned()]));
        let mut builder = Builder::create(&mut core.networks.parameters, rng, start, device);
        let bilinear = builder.parameter("bilinear", &[dims, dims], Initializer::UnitUniform)?;
        let encoder = core.networks.parameters.under("encoder");
        let encoder_adam =
            config.double_encoder_step.then(|| Adam::new(encoder.clone(), rate)).transpose()?;
        let module = encoder.union(&core.networks.parameters.under("bilinear"));
        Ok(Self { core, bilinear, encoder_adam, module_adam: Adam::new(module, rate)? })
    }

    /// The actor-critic.
    pub fn core(&self) -> &ActorCritic {
        &self.core
    }

    /// The contrastive loss. The gradient reaches the bilinear map and, through the queries, the encoder.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn contrastive_loss(&self, queries: &Tensor, keys: &Tensor) -> Result<Tensor> {
        let queries = self.core.encoder().forward(queries)?;
        bilinear_loss(&queries, &self.core.target_encoder().forward(keys)?, &self.bilinear)
    }

    /// Takes one learning step: updates critics, actor and temperature, targets, then encoder and bilinear map with the
    /// contrastive loss, whose keys come from the updated target encoder.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn step(&mut self, pairs: &CurlBatch, agent_step: u64) -> Result<UpdateReport> {
        let (mut report, mut clock) = (UpdateReport::default(), Instant::now());
        let CurlBatch { batch, positives, target_noise, actor_noise } = pairs;
        let target = self.core.critic_target(batch, &batch.next_observations, target_noise)?;
        let views = std::slice::from_ref(&batch.observations);
        self.core.step_critic(views, &batch.actions, &target, &mut report)?;
        report.lap(Phase::Critics, &mut clock);
        self.core.step_actor(&batch.observations, actor_noise, agent_step, &mut report)?;
        report.lap(Phase::Actor, &mut clock);
        self.core.update_targets(agent_step)?;
        report.lap(Phase::TargetNetworks, &mut clock);
        let loss = self.contrastive_loss(&batch.observations, positives)?;
        let gradients = loss.backward()?;
        if let Some(adam) = &mut self.encoder_adam {
            adam.step(&gradients)?;
        }
        self.module_adam.step(&gradients)?;
        report.add("contrastive_loss", loss.detach());
        report.lap(Phase::Representation, &mut clock);
        Ok(report)
    }

    fn draw(&self, draw: &mut Draw) -> Result<Option<CurlBatch>> {
        let Architecture { sac, action_dims, .. } = self.core.architecture();
        let (count, shape) = (sac.batch_size, [sac.batch_size, *action_dims]);
        let Some(starts) = draw.starts(count, 1) else { return Ok(None) };
        let batch = Transitions::first_of(&draw.batch(&starts, 1)?)?;
        let positives = draw.batch(&starts, 0)?.trajectories.at(0)?;
        let target_noise = draw.normal(&shape)?;
        Ok(Some(CurlBatch { batch, positives, target_noise, actor_noise: draw.normal(&shape)? }))
    }
}

impl Learner for Curl {
    fn update(&mut self, draw: &mut Draw, agent_step: u64) -> Result<Option<UpdateReport>> {
        let Some(pairs) = self.draw(draw)? else { return Ok(None) };
        parallel::inside(draw.device(), || self.step(&pairs, agent_step)).map(Some)
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
        let mut all = self.core.optimizers();
        let encoder = self.encoder_adam.iter_mut();
        all.extend(encoder.map(|adam| ("contrastive_encoder".to_owned(), adam)));
        all.push(("contrastive".to_owned(), &mut self.module_adam));
        all
    }

    fn diagnose(&self, draw: &mut Draw) -> Result<Vec<(String, f64)>> {
        self.core.diagnose(draw, |draw| self.auxiliary_losses(draw))
    }
}

impl Curl {
    fn auxiliary_losses(&self, draw: &mut Draw) -> Result<Vec<(&'static str, Tensor)>> {
        let Some(CurlBatch { batch, positives, .. }) = self.draw(draw)? else {
            return Ok(Vec::new());
        };
        let loss = self.contrastive_loss(&batch.observations, &positives)?;
        Ok(vec![("contrastive", loss)])
    }
}
