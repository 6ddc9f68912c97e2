//! A learning method of one's own: soft actor-critic whose encoder also predicts rewards.
//!
//! ```text
//! cargo run --release -p hksl-train --example own_method
//! ```
//!
//! It trains for seconds on Falling Pixels, with the preset `debug`.

use std::error::Error;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use candle_core::{Device, Tensor};
use hksl_baselines::{ActorCritic, ActorInput, Architecture, Transitions};
use hksl_core::kernels::Kernels;
use hksl_core::nn::Mlp;
use hksl_core::optim::Adam;
use hksl_core::{Encoder, parallel, rng};
use hksl_envs::{Environment, Spec};
use hksl_sac::replay::Layout;
use hksl_sac::{Acting, Agent, Draw, Learner, Networks, Phase, RecurrentState, UpdateReport};
use hksl_train::config::{Config, Request, resolve};
use hksl_train::{Factories, Plan, Registry, Resume, RunFolder, RunId, train};
use rand_chacha::ChaCha8Rng;

const UNITS: usize = 32;

/// Plain SAC, and after it a step of encoder and reward model towards `mean_B (R(e(o), a) − r)²`.
#[derive(Debug)]
struct RewardSac {
    core: ActorCritic,
    reward: Mlp,
    reward_adam: Adam,
}

impl RewardSac {
    fn new(architecture: Architecture, seed: u64, device: &Device) -> hksl_sac::Result<Self> {
        let rng = &mut rng::stream(seed, "init");
        let inputs = architecture.encoder.latent_dims + architecture.action_dims;
        let (start, rate) = (architecture.baseline.initialisation, architecture.sac.learning_rate);
        let kernels = Kernels::detect();
        let mut core = ActorCritic::new(architecture, ActorInput::OwnHead, kernels, rng, device)?;
        let reward = core.add(("reward model", "reward"), start, rng, device, |builder| {
            Ok(Mlp::new(builder, &[inputs, UNITS, 1])?)
        })?;
        let all = &core.networks().parameters;
        let reward_adam = Adam::new(all.under("encoder").union(&all.under("reward")), rate)?;
        Ok(Self { core, reward, reward_adam })
    }

    fn reward_loss(&self, batch: &Transitions) -> hksl_sac::Result<Tensor> {
        let latents = self.core.encoder().forward(&batch.observations)?;
        let inputs = Tensor::cat(&[&latents, &batch.actions], 1)?;
        Ok((self.reward.forward(&inputs)? - &batch.rewards)?.sqr()?.mean_all()?)
    }

    /// Critics and their encoder, actor and temperature, the slow networks; then what is new.
    fn step(
        &mut self,
        batch: &Transitions,
        [target_noise, actor_noise]: &[Tensor; 2],
        agent_step: u64,
    ) -> hksl_sac::Result<UpdateReport> {
        let (mut report, mut clock) = (UpdateReport::default(), Instant::now());
        let target = self.core.critic_target(batch, &batch.next_observations, target_noise)?;
        let views = std::slice::from_ref(&batch.observations);
        self.core.step_critic(views, &batch.actions, &target, &mut report)?;
        report.lap(Phase::Critics, &mut clock);
        self.core.step_actor(&batch.observations, actor_noise, agent_step, &mut report)?;
        report.lap(Phase::Actor, &mut clock);
        self.core.update_targets(agent_step)?;
        report.lap(Phase::TargetNetworks, &mut clock);
        let loss = self.reward_loss(batch)?;
        self.reward_adam.step(&loss.backward()?)?;
        report.add("reward_loss", loss.detach());
        report.lap(Phase::Representation, &mut clock);
        Ok(report)
    }
}

impl Learner for RewardSac {
    fn networks(&self) -> &Networks {
        self.core.networks()
    }

    fn optimizers(&mut self) -> Vec<(String, &mut Adam)> {
        let mut all = self.core.optimizers();
        all.push(("reward".to_owned(), &mut self.reward_adam));
        all
    }

    fn act(
        &self,
        observation: &Tensor,
        acting: Acting,
        random: &mut ChaCha8Rng,
        _: &mut RecurrentState,
    ) -> hksl_sac::Result<Tensor> {
        self.core.choose_action(observation, acting, random)
    }

    fn update(
        &mut self,
        draw: &mut Draw,
        agent_step: u64,
    ) -> hksl_sac::Result<Option<UpdateReport>> {
        let Architecture { sac, action_dims, .. } = self.core.architecture();
        let (count, noise) = (sac.batch_size, [sac.batch_size, *action_dims]);
        // None until an episode has ended.
        let Some(starts) = draw.starts(count, 1) else { return Ok(None) };
        let batch = Transitions::first_of(&draw.batch(&starts, 1)?)?;
        let noise = [draw.normal(&noise)?, draw.normal(&noise)?];
        parallel::inside(draw.device(), || self.step(&batch, &noise, agent_step)).map(Some)
    }

    fn diagnose(&self, draw: &mut Draw) -> hksl_sac::Result<Vec<(String, f64)>> {
        self.core.diagnose(draw, |draw| {
            let count = self.core.architecture().sac.batch_size;
            let Some(starts) = draw.starts(count, 1) else { return Ok(Vec::new()) };
            let batch = Transitions::first_of(&draw.batch(&starts, 1)?)?;
            Ok(vec![("reward", self.reward_loss(&batch)?)])
        })
    }
}

/// What the training loop needs made: the environment that the configuration names, and this agent.
struct WithRewards;

impl Factories for WithRewards {
    fn environment(
        &self,
        config: &Config,
        rng: ChaCha8Rng,
    ) -> hksl_train::Result<Box<dyn Environment>> {
        Registry.environment(config, rng)
    }

    fn agent(&self, config: &Config, spec: &Spec, device: &Device) -> hksl_train::Result<Agent> {
        let Config { environment, encoder, sac, baseline, replay, augmentation, seed, .. } = config;
        let layout = Layout {
            frame: [spec.frame.channels, spec.frame.height, spec.frame.width],
            stack: environment.frame_stack,
            action_dims: spec.action_dims,
        };
        let architecture = Architecture {
            observation: layout.observation(),
            action_dims: spec.action_dims,
            encoder: *encoder,
            sac: sac.clone(),
            baseline: baseline.clone(),
        };
        let method = RewardSac::new(architecture, *seed, device)?;
        Ok(Agent::new(Box::new(method), layout, replay, augmentation, *seed, device)?)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    // The settings of `sac`, which the configuration knows; the name tells the runs apart.
    let config = resolve(&Request {
        method: Some("sac".to_owned()),
        presets: vec!["debug".to_owned()],
        sets: vec!["device=cpu".to_owned()],
        ..Request::default()
    })?
    .config;
    let id = RunId { name: Some("reward".to_owned()), ..RunId::default() };
    let folder = RunFolder::of(Path::new("runs"), &config, &id);
    let plan = Plan {
        config: &config,
        folder: &folder,
        factories: &WithRewards,
        device: Device::Cpu,
        command: std::env::args().collect::<Vec<_>>().join(" "),
        resume: Resume::Auto,
        stop: &AtomicBool::new(false),
    };
    let outcome = train(&plan, &mut |_| {})?;
    println!("{}: mean return {}", folder.path().display(), outcome.final_return);
    Ok(())
}
