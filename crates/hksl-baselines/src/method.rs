//! What the model-free methods differ in, and the agent that is made of one.

use std::collections::BTreeMap;
use std::fmt;

use candle_core::{DType, Device, Tensor};
use hksl_core::named::{nothing_left, prefixed, take, take_count};
use hksl_core::nn::PixelEncoder;
use hksl_core::optim::{Adam, gradient_norm, load_into, state_of};
use hksl_core::{Encoder, Parameters, rng};
use hksl_sac::config::{AugmentationConfig, ReplayConfig};
use hksl_sac::diagnosis::{saturated, spread};
use hksl_sac::learner::{Operations, UpdateReport};
use hksl_sac::replay::Layout;
use hksl_sac::{Acting, Draw, FeatureMaps, Learner, Memory, PixelAgent, Result, feature_maps_of};
use rand_chacha::ChaCha8Rng;

use crate::Transitions;
use crate::actor_critic::{ActorCritic, Architecture};

/// A method on one [`ActorCritic`].
pub trait Method: fmt::Debug {
    /// The networks that all methods have.
    fn core(&self) -> &ActorCritic;

    /// The same, to be trained.
    fn core_mut(&mut self) -> &mut ActorCritic;

    /// One learning step at this agent step; none if nothing can be sampled yet.
    fn update(&mut self, draw: &mut Draw, agent_step: u64) -> Result<Option<UpdateReport>>;

    /// One learning step before those; none if there are no more, or nothing can be sampled yet.
    fn pretrain(&mut self, _: &mut Draw) -> Result<Option<UpdateReport>> {
        Ok(None)
    }

    /// Such steps taken, and such steps in all.
    fn pretraining(&self) -> (u64, u64) {
        (0, 0)
    }

    /// Takes such steps as taken.
    fn set_pretrained(&mut self, _: u64) {}

    /// The losses beside the actor-critic's that train the encoder, on a batch, by name; nothing learns.
    fn auxiliary_losses(&self, _: &mut Draw) -> Result<Vec<(&'static str, Tensor)>> {
        Ok(Vec::new())
    }

    /// Its own optimisers by name, beside those of the core.
    fn own_optimisers(&self) -> Vec<(&'static str, &Adam)> {
        Vec::new()
    }

    /// All optimisers by name, those of the core first, to be loaded.
    fn optimisers_mut(&mut self) -> Vec<(&'static str, &mut Adam)> {
        self.core_mut().optimisers_mut()
    }

    /// Its own networks: what people call them, and the prefix of their parameters.
    fn own_networks(&self) -> Vec<(&'static str, &'static str)> {
        Vec::new()
    }

    /// How often a learning step runs which network.
    fn passes(&self) -> Passes;
}

/// Passes of one batch through networks in a learning step with every phase.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Passes {
    /// Forward through an encoder.
    pub forward: u64,
    /// Those of them that are followed by a backward pass.
    pub backward: u64,
    /// Views whose critics' losses are summed.
    pub views: u64,
    /// Views over which targets are averaged.
    pub targets: u64,
    /// Operations in the method's own networks.
    pub own: f64,
}

/// A method as a learner.
#[derive(Debug)]
pub struct ModelFree<M>(
    /// The method.
    pub M,
);

/// An agent that learns by `method`, for frames of this `layout`.
///
/// # Errors
/// A layout that does not give the observations that the method was built for.
pub fn agent<M: Method>(
    method: M,
    layout: Layout,
    replay: &ReplayConfig,
    augmentation: &AugmentationConfig,
    seed: u64,
    device: &Device,
) -> Result<PixelAgent<ModelFree<M>>> {
    let observation = method.core().architecture().observation;
    PixelAgent::of(ModelFree(method), observation, layout, replay, augmentation, seed, device)
}

/// How many steps of pretraining are done, in a saved state.
const PRETRAINED: &str = "pretrained";

/// The name of the one encoder, and of its parameters.
const ENCODER: &str = "encoder";

/// What allocator and bookkeeping add.
const MARGIN: f64 = 1.2;

impl<M: Method> Learner for ModelFree<M> {
    fn parameters(&self) -> &Parameters {
        self.0.core().parameters()
    }

    fn discount(&self) -> f64 {
        self.0.core().architecture().sac.discount
    }

    fn action(
        &self,
        observation: &Tensor,
        acting: Acting,
        random: &mut ChaCha8Rng,
        _: &mut Memory,
    ) -> Result<Tensor> {
        let core = self.0.core();
        if acting == Acting::Sample {
            let shape = [1, core.architecture().action_dims];
            let noise = rng::standard_normal(random, &shape, observation.device())?;
            return core.action(observation, Some(&noise));
        }
        core.action(observation, None)
    }

    fn pretrain(&mut self, draw: &mut Draw) -> Result<Option<UpdateReport>> {
        self.0.pretrain(draw)
    }

    fn pretraining(&self) -> (u64, u64) {
        self.0.pretraining()
    }

    fn update(&mut self, draw: &mut Draw, agent_step: u64) -> Result<Option<UpdateReport>> {
        self.0.update(draw, agent_step)
    }

    fn diagnose(&self, draw: &mut Draw) -> Result<Vec<(String, f64)>> {
        let core = self.0.core();
        let Architecture { sac, action_dims, .. } = core.architecture();
        let Some(starts) = draw.starts(sac.batch_size, 1) else { return Ok(Vec::new()) };
        let batch = Transitions::first_of(&draw.batch(&starts, 1)?)?;
        let noise = draw.normal(&[sac.batch_size, *action_dims])?;
        let target = core.critic_target(&batch, &batch.next_observations, &noise)?;
        let views = std::slice::from_ref(&batch.observations);
        let encoder = core.parameters().under(ENCODER);
        let gradient =
            |loss: &Tensor| -> Result<f64> { Ok(gradient_norm(&encoder, &loss.backward()?)?) };
        let mut figures = Vec::new();
        let (loss, _) = core.critic_loss(views, &batch.actions, &target)?;
        figures.push(("critic_gradient".to_owned(), gradient(&loss)?));
        for (name, loss) in self.0.auxiliary_losses(draw)? {
            figures.push((format!("{name}_gradient"), gradient(&loss)?));
        }
        let (std, rank) = spread(&core.frozen_encoder().forward(&batch.observations)?)?;
        figures.extend([("latent_std".to_owned(), std), ("latent_rank".to_owned(), rank)]);
        let actions = core.action(&batch.observations, Some(&noise))?;
        figures.push(("saturated_actions".to_owned(), saturated(&actions)?));
        Ok(figures)
    }

    fn values(&self, observations: &Tensor, actions: &Tensor) -> Result<Vec<(String, Vec<f64>)>> {
        let values = self.0.core().values(observations, actions)?;
        Ok(vec![(String::new(), values.to_dtype(DType::F64)?.to_vec1()?)])
    }

    fn encode(&self, observations: &Tensor) -> Result<Vec<(String, Tensor)>> {
        let latents = self.0.core().frozen_encoder().forward(observations)?;
        Ok(vec![(ENCODER.to_owned(), latents)])
    }

    fn feature_maps(&self, observations: &Tensor) -> Result<Vec<FeatureMaps>> {
        let encoder = self.0.core().frozen_encoder();
        Ok(vec![feature_maps_of(ENCODER.to_owned(), encoder, observations)?])
    }

    fn networks(&self) -> Vec<(String, usize)> {
        let shared = [(ENCODER, ENCODER), ("twin critics", "critic"), ("actor", "actor")];
        let own = self.0.own_networks();
        let count = |(name, prefix): (&str, &str)| {
            (name.to_owned(), self.parameters().under(prefix).elements())
        };
        shared.into_iter().chain(own).map(count).collect()
    }

    fn operations(&self) -> Result<Operations> {
        let Architecture { observation, action_dims, encoder, sac, .. } =
            self.0.core().architecture();
        let Passes { forward, backward, views, targets, own } = self.0.passes();
        let one = PixelEncoder::operations(*observation, *encoder)?;
        let batch = sac.batch_size as f64;
        let encoders = |forward_one: f64, backward_one: f64| {
            batch * (forward as f64 * forward_one + backward as f64 * backward_one)
        };
        let hidden = sac.hidden_units as f64;
        let network = |inputs: usize, outputs: usize| {
            2.0 * batch * (inputs as f64 * hidden + hidden * hidden + hidden * outputs as f64)
        };
        let q = network(encoder.latent_dims + action_dims, 1);
        let actor = network(encoder.latent_dims, 2 * action_dims);
        let (views, targets) = (views as f64, targets as f64);
        // Two target networks forward for each view of the next observation; two critics forward and backward, three
        // times a forward pass, for each view of the observation; two forward and, towards the action, backward for
        // the actor. The actor runs for each next action and once with its gradient.
        let networks = q * (2.0 * targets + 6.0 * views + 4.0) + actor * (targets + 3.0) + own;
        Ok(Operations {
            encoder_passes: forward + 2 * backward,
            encoders: encoders(one.forward, one.backward),
            encoders_executed: encoders(one.forward_executed, one.backward_executed),
            networks,
        })
    }

    fn memory_bytes(&self) -> u64 {
        let Architecture { observation, encoder, sac, .. } = self.0.core().architecture();
        let parameters = self.parameters();
        let slow = parameters.under("targets").elements();
        let own: usize =
            self.0.own_optimisers().iter().map(|(_, a)| a.parameters().elements()).sum();
        let trained = parameters.elements() - slow;
        let networks = (4 * trained + 2 * own + slow) * size_of::<f32>();
        let passes = self.0.passes();
        let pixels = 4 * sac.batch_size * observation.iter().product::<usize>();
        let frames = (passes.forward as usize + 2) * pixels;
        let (all, last) = PixelEncoder::map_bytes(*observation, *encoder).unwrap_or((0, 0));
        let tracked = passes.views.max(1) as usize * sac.batch_size * (all + 2 * last);
        let hidden = 24 * sac.batch_size * sac.hidden_units * size_of::<f32>();
        let maps = tracked + 2 * sac.batch_size * last;
        (MARGIN * (networks + frames + maps + hidden) as f64) as u64
    }

    fn state(&self) -> Result<BTreeMap<String, Tensor>> {
        let mut state = prefixed("weights", self.parameters().snapshot()?);
        let optimisers = self.0.core().optimisers().into_iter().chain(self.0.own_optimisers());
        state.extend(prefixed("moments", state_of(optimisers)?));
        let (taken, all) = self.0.pretraining();
        if all > 0 {
            state.insert(PRETRAINED.to_owned(), Tensor::new(taken as i64, &Device::Cpu)?);
        }
        Ok(state)
    }

    fn load(&mut self, state: &BTreeMap<String, Tensor>) -> Result<()> {
        let mut rest = state.clone();
        let (weights, moments) = (take(&mut rest, "weights"), take(&mut rest, "moments"));
        let (_, all) = self.0.pretraining();
        let taken = if all > 0 { Some(take_count(&mut rest, PRETRAINED)?) } else { None };
        nothing_left(&rest)?;
        self.parameters().check(&weights)?;
        load_into(self.0.optimisers_mut(), moments)?;
        self.parameters().load(&weights)?;
        if let Some(taken) = taken {
            self.0.set_pretrained(taken);
        }
        Ok(())
    }
}
