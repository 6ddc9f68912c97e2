//! PI-SAC: predictive information soft actor-critic.

mod head;

use std::time::Instant;

use candle_core::{D, Device, Tensor};
use hksl_core::kernels::Kernels;
use hksl_core::nn::PixelEncoder;
use hksl_core::optim::{Adam, MovingAverage};
use hksl_core::{Builder, Encoder, parallel};
use hksl_sac::{Acting, Draw, Learner, Networks, Phase, RecurrentState, Result, UpdateReport};
use rand_chacha::ChaCha8Rng;

use head::Head;

use crate::actor_critic::{ActorCritic, ActorInput, Architecture, init_stream};
use crate::config::PiSacConfig;
use crate::contrastive::CebTerms;
use crate::transitions::Transitions;

/// PI-SAC (Lee et al., arXiv 2007.12401): SAC whose actor reads the critics' latent, with a predictive auxiliary task. The
/// latent and the next actions predict a later observation; the conditional entropy bottleneck (CEB) loss penalises
/// all other information in the latent with weight β.
///
/// Parameters: `forward_head`, `backward_head`, `targets.backward_encoder`.
#[derive(Debug)]
pub struct PiSac {
    core: ActorCritic,
    config: PiSacConfig,
    forward_head: Head,
    backward_head: Head,
    backward_encoder: PixelEncoder,
    adam: Adam,
    average: MovingAverage,
    pretrained: u64,
}

/// A batch of one learning step. `F` is the number of frames in an observation.
#[derive(Debug, Clone)]
pub struct PiSacBatch {
    /// The first transitions of the trajectories.
    pub batch: Transitions,
    /// The first `F` actions, `(B, F·A)`.
    pub actions: Tensor,
    /// The first `F + 1` rewards, `(B, F + 1)`.
    pub rewards: Tensor,
    /// `o_F`, `(B, C, H, W)`: the first later observation that shares no frame with `o_0`.
    pub future: Tensor,
    /// `o_{F+1}`, `(B, C, H, W)`.
    pub later: Tensor,
    /// Noise of the latent, `(B, Z)`.
    pub latent_noise: Tensor,
    /// Noise of the next action, `(B, A)`.
    pub target_noise: Tensor,
    /// Noise of the action in the actor loss, `(B, A)`.
    pub actor_noise: Tensor,
}

impl PiSac {
    /// Creates the networks for observations of `frames` frames and initialises their weights with the RNG stream `init` of
    /// `seed`.
    ///
    /// # Errors
    /// Sizes out of range.
    pub fn new(
        architecture: Architecture,
        config: PiSacConfig,
        frames: usize,
        kernels: Kernels,
        seed: u64,
        device: &Device,
    ) -> Result<Self> {
        let rng = &mut init_stream(seed);
        let Architecture { observation, encoder, action_dims, .. } = architecture;
        let start = architecture.baseline.initialisation;
        let mut core = ActorCritic::new(architecture, ActorInput::Latent, kernels, rng, device)?;
        let (dims, units) = (encoder.latent_dims, config.head_units);
        let mut head = |(name, prefix): (&str, &str), more: usize| {
            core.add((name, prefix), start, rng, device, |b| Head::new(b, dims + more, units, dims))
        };
        let forward_head = head(("forward head", "forward_head"), frames * action_dims)?;
        let backward_head = head(("backward head", "backward_head"), frames)?;
        let parameters = &mut core.networks.parameters;
        parameters.copy_under("encoder", BACKWARD_ENCODER)?;
        let mut view = Builder::view(parameters, device);
        let backward_encoder =
            PixelEncoder::new(&mut view.under(BACKWARD_ENCODER), observation, encoder)?;
        let trained = ["encoder", "forward_head", "backward_head"]
            .map(|name| parameters.under(name))
            .into_iter()
            .reduce(|all, part| all.union(&part))
            .unwrap_or_default();
        let tau = config.backward_tau;
        Ok(Self {
            adam: Adam::new(trained, config.learning_rate)?,
            average: MovingAverage::new(parameters, "encoder", BACKWARD_ENCODER, tau)?,
            core,
            config,
            forward_head,
            backward_head,
            backward_encoder,
            pretrained: 0,
        })
    }

    /// The actor-critic.
    pub fn core(&self) -> &ActorCritic {
        &self.core
    }

    /// The terms of the predictive task's CEB loss. The gradient reaches the encoder and both heads.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn terms(&self, windows: &PiSacBatch) -> Result<CebTerms> {
        let PiSacBatch { batch, actions, rewards, future, later, latent_noise, .. } = windows;
        let frames = rewards.dim(1)? - 1;
        let latent = self.core.encoder().forward(&batch.observations)?;
        let forward = self.forward_head.forward(&Tensor::cat(&[&latent, actions], D::Minus1)?)?;
        let backward = |observations: &Tensor, first: usize| -> Result<Tensor> {
            let latent = self.backward_encoder.forward(observations)?;
            let rewards = rewards.narrow(1, first, frames)?;
            self.backward_head.forward(&Tensor::cat(&[latent, rewards], D::Minus1)?)
        };
        let drawn = (&forward + latent_noise)?;
        CebTerms::new(&forward, &backward(future, 0)?, &backward(later, 1)?, &drawn)
    }

    /// Takes one learning step: updates critics, actor and temperature, targets, the predictive task, then the backward
    /// encoder.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn step(&mut self, windows: &PiSacBatch, agent_step: u64) -> Result<UpdateReport> {
        let (mut report, mut clock) = (UpdateReport::default(), Instant::now());
        let PiSacBatch { batch, target_noise, actor_noise, .. } = windows;
        let target = self.core.critic_target(batch, &batch.next_observations, target_noise)?;
        let views = std::slice::from_ref(&batch.observations);
        self.core.step_critic(views, &batch.actions, &target, &mut report)?;
        report.lap(Phase::Critics, &mut clock);
        self.core.step_actor(&batch.observations, actor_noise, agent_step, &mut report)?;
        report.lap(Phase::Actor, &mut clock);
        self.core.update_targets(agent_step)?;
        report.lap(Phase::TargetNetworks, &mut clock);
        self.step_prediction(windows, &mut report)?;
        report.lap(Phase::Representation, &mut clock);
        Ok(report)
    }

    fn step_prediction(&mut self, windows: &PiSacBatch, report: &mut UpdateReport) -> Result<()> {
        let terms = self.terms(windows)?;
        let loss = terms.loss(self.config.compression, self.config.smoothing)?;
        self.adam.step(&loss.backward()?)?;
        self.average.update()?;
        report.add("ceb_loss", loss.detach());
        report.add("residual_information", terms.residual.mean_all()?.detach());
        report.add("predictive_information", terms.predictive.mean_all()?.detach());
        Ok(())
    }

    fn draw(&self, draw: &mut Draw) -> Result<Option<PiSacBatch>> {
        let Architecture { sac, action_dims, encoder, .. } = self.core.architecture();
        let count = sac.batch_size;
        let frames = self.frames();
        let Some(starts) = draw.starts(count, frames + 1) else { return Ok(None) };
        let window = draw.batch(&starts, frames + 1)?;
        let latent_noise = draw.normal(&[count, encoder.latent_dims])?;
        let target_noise = draw.normal(&[count, *action_dims])?;
        let actor_noise = draw.normal(&[count, *action_dims])?;
        Ok(Some(PiSacBatch {
            batch: Transitions::first_of(&window)?,
            actions: window.trajectories.actions.narrow(1, 0, frames)?.flatten_from(1)?,
            rewards: window.rewards,
            future: window.trajectories.at(frames)?,
            later: window.trajectories.at(frames + 1)?,
            latent_noise,
            target_noise,
            actor_noise,
        }))
    }

    /// Number of frames in an observation.
    fn frames(&self) -> usize {
        self.backward_head.inputs() - self.core.architecture().encoder.latent_dims
    }
}

const BACKWARD_ENCODER: &str = "targets.backward_encoder";

impl Learner for PiSac {
    fn update(&mut self, draw: &mut Draw, agent_step: u64) -> Result<Option<UpdateReport>> {
        let Some(windows) = self.draw(draw)? else { return Ok(None) };
        parallel::inside(draw.device(), || self.step(&windows, agent_step)).map(Some)
    }

    fn pretrain(&mut self, draw: &mut Draw) -> Result<Option<UpdateReport>> {
        if self.pretrained >= self.config.pretraining_steps {
            return Ok(None);
        }
        let Some(windows) = self.draw(draw)? else { return Ok(None) };
        let (mut report, mut clock) = (UpdateReport::default(), Instant::now());
        parallel::inside(draw.device(), || self.step_prediction(&windows, &mut report))?;
        report.lap(Phase::Representation, &mut clock);
        self.pretrained += 1;
        Ok(Some(report))
    }

    fn pretraining(&self) -> (u64, u64) {
        (self.pretrained, self.config.pretraining_steps)
    }

    fn counters(&mut self) -> Vec<(&'static str, &mut u64)> {
        // Checkpoints of runs without pretraining do not contain this counter.
        let pretrains = self.config.pretraining_steps > 0;
        pretrains.then_some(("pretrained", &mut self.pretrained)).into_iter().collect()
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
        all.push(("ceb".to_owned(), &mut self.adam));
        all
    }

    fn diagnose(&self, draw: &mut Draw) -> Result<Vec<(String, f64)>> {
        self.core.diagnose(draw, |draw| self.auxiliary_losses(draw))
    }
}

impl PiSac {
    fn auxiliary_losses(&self, draw: &mut Draw) -> Result<Vec<(&'static str, Tensor)>> {
        let Some(windows) = self.draw(draw)? else { return Ok(Vec::new()) };
        let terms = self.terms(&windows)?;
        Ok(vec![("ceb", terms.loss(self.config.compression, self.config.smoothing)?)])
    }
}

#[cfg(test)]
mod tests {
    use hksl_core::nn::{Initialisation, PixelEncoderConfig};
    use hksl_core::rng;
    use hksl_sac::config::SacConfig;
    use hksl_sac::replay::{Layout, Replay, Sampler};

    use super::*;
    use crate::config::BaselineConfig;

    const SIDE: usize = 15;

    fn method() -> PiSac {
        let architecture = Architecture {
            observation: [3, SIDE, SIDE],
            action_dims: 1,
            encoder: PixelEncoderConfig { filters: 2, latent_dims: 4 },
            sac: SacConfig {
                batch_size: 16,
                learning_rate: 1e-3,
                discount: 0.99,
                initial_temperature: 0.1,
                hidden_units: 8,
                log_std_minimum: -10.0,
                log_std_maximum: 2.0,
                target_update_every: 2,
                critic_tau: 0.01,
                encoder_tau: 0.05,
            },
            baseline: BaselineConfig {
                actor_update_every: 1,
                initialisation: Initialisation::Orthogonal,
            },
        };
        let config = PiSacConfig {
            learning_rate: 3e-4,
            compression: 0.01,
            smoothing: 0.6,
            head_units: 8,
            backward_tau: 0.05,
            pretraining_steps: 2,
        };
        PiSac::new(architecture, config, 3, Kernels::detect(), 1, &Device::Cpu).unwrap()
    }

    /// One episode whose frame, action and reward at time `t` are `t`.
    fn replay() -> Replay {
        let layout = Layout { frame: [1, SIDE, SIDE], stack: 3, action_dims: 1 };
        let mut replay = Replay::new(layout, 100);
        replay.begin_episode(&[0; SIDE * SIDE]).unwrap();
        for time in 0..20u8 {
            let frame = [time + 1; SIDE * SIDE];
            replay.push(&[f32::from(time)], f32::from(time), false, &frame).unwrap();
        }
        replay.end_episode();
        replay
    }

    #[test]
    fn windows_are_aligned() {
        let (replay, sampler, mut random) = (replay(), Sampler::new(0), rng::stream(1, "test"));
        let mut draw = Draw::for_diagnosis(&replay, &sampler, &Device::Cpu, &mut random);
        let windows = method().draw(&mut draw).unwrap().unwrap();
        let newest = |observations: &Tensor, index: usize| {
            let observation = observations.get(index).unwrap().get(2).unwrap();
            f32::from(observation.flatten_all().unwrap().to_vec1::<u8>().unwrap()[0])
        };
        for index in 0..16 {
            let row = |x: &Tensor| x.get(index).unwrap().to_vec1::<f32>().unwrap();
            let start = newest(&windows.batch.observations, index);
            assert!(start <= 16.0);
            assert_eq!(newest(&windows.batch.next_observations, index), start + 1.0);
            assert_eq!(newest(&windows.future, index), start + 3.0);
            assert_eq!(newest(&windows.later, index), start + 4.0);
            assert_eq!(row(&windows.actions), [start, start + 1.0, start + 2.0]);
            assert_eq!(row(&windows.rewards), [start, start + 1.0, start + 2.0, start + 3.0]);
            assert_eq!(row(&windows.batch.rewards), [start]);
        }
    }

    /// Pretraining updates the encoder and both heads, but neither actor nor critics, and ends.
    #[test]
    fn pretraining_is_of_the_predictive_task_alone() {
        let (replay, sampler, mut random) = (replay(), Sampler::new(0), rng::stream(1, "test"));
        let mut draw = Draw::for_diagnosis(&replay, &sampler, &Device::Cpu, &mut random);
        let mut method = method();
        let before: std::collections::BTreeMap<String, Vec<f32>> = numbers(&method);
        for _ in 0..2 {
            assert!(method.pretrain(&mut draw).unwrap().is_some());
        }
        assert!(method.pretrain(&mut draw).unwrap().is_none());
        assert_eq!(method.pretraining(), (2, 2));
        for (name, after) in numbers(&method) {
            let learns = ["encoder.", "forward_head.", "backward_head.", BACKWARD_ENCODER];
            let may_move = learns.iter().any(|prefix| name.starts_with(prefix));
            assert!(may_move || after == before[&name], "{name} has moved");
        }
        let name = "encoder.linear.weight";
        assert!(numbers(&method)[name] != before[name]);
    }

    fn numbers(method: &PiSac) -> std::collections::BTreeMap<String, Vec<f32>> {
        let tensors = method.core.networks.parameters.tensors().into_iter();
        tensors
            .map(|(n, x)| (n, x.copy().unwrap().flatten_all().unwrap().to_vec1().unwrap()))
            .collect()
    }
}
