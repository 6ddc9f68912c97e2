//! HKSL as a [`Learner`].

use candle_core::Tensor;
use hksl_core::optim::Adam;
use hksl_core::rng;
use rand_chacha::ChaCha8Rng;

use super::{Hksl, Schedule};
use crate::Result;
use crate::draw::Draw;
use crate::learner::{Acting, Learner, RecurrentState};
use crate::networks::Networks;
use crate::update_report::UpdateReport;

impl Learner for Hksl {
    /// Takes one step of algorithm 1.
    fn update(&mut self, draw: &mut Draw, agent_step: u64) -> Result<Option<UpdateReport>> {
        let Some((batch, noise)) = self.sample(draw)? else { return Ok(None) };
        let schedule = Schedule {
            actor: agent_step.is_multiple_of(self.architecture.hksl.actor_update_every),
            targets: agent_step.is_multiple_of(self.architecture.sac.target_update_every),
        };
        self.step(&batch, &noise, schedule).map(Some)
    }

    /// Samples `a ~ π(· | z^1 … z^h)`, or returns the squashed mean for [`Acting::Mean`].
    fn act(
        &self,
        observation: &Tensor,
        acting: Acting,
        random: &mut ChaCha8Rng,
        _: &mut RecurrentState,
    ) -> Result<Tensor> {
        let latents = self.hierarchy.encode(observation)?;
        if acting == Acting::Mean {
            return self.frozen_actor.mean(&latents);
        }
        let shape = [1, self.architecture.action_dims];
        let noise = rng::standard_normal(random, &shape, observation.device())?;
        Ok(self.frozen_actor.sample(&latents, &noise)?.action)
    }

    fn networks(&self) -> &Networks {
        &self.networks
    }

    fn optimizers(&mut self) -> Vec<(String, &mut Adam)> {
        self.optimizers.named()
    }

    fn diagnose(&self, draw: &mut Draw) -> Result<Vec<(String, f64)>> {
        match self.sample(draw)? {
            Some((batch, noise)) => self.diagnose_batch(&batch, &noise),
            None => Ok(Vec::new()),
        }
    }
}
