//! Small sizes and random batches.

use candle_core::{Device, Tensor};
use hksl_baselines::config::BaselineConfig;
use hksl_baselines::{Architecture, Transitions};
use hksl_core::nn::{Initialisation, PixelEncoderConfig};
use hksl_core::rng;
use hksl_sac::config::SacConfig;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::RngCore;

pub const IMAGE: [usize; 3] = [3, 19, 17];
pub const ACTION_DIMS: usize = 2;
pub const LATENT: usize = 6;
pub const BATCH: usize = 8;

pub fn architecture() -> Architecture {
    Architecture {
        observation: IMAGE,
        action_dims: ACTION_DIMS,
        encoder: PixelEncoderConfig { filters: 8, latent_dims: LATENT },
        sac: SacConfig {
            batch_size: BATCH,
            learning_rate: 1e-3,
            discount: 0.99,
            initial_temperature: 0.1,
            hidden_units: 32,
            log_std_minimum: -10.0,
            log_std_maximum: 2.0,
            target_update_every: 2,
            critic_tau: 0.01,
            encoder_tau: 0.05,
        },
        baseline: BaselineConfig {
            actor_update_every: 2,
            initialisation: Initialisation::Orthogonal,
        },
    }
}

pub struct Draws(pub ChaCha8Rng);

impl Draws {
    pub fn new() -> Self {
        Self(rng::stream(11, "small"))
    }

    pub fn normal(&mut self, shape: &[usize]) -> Tensor {
        rng::standard_normal(&mut self.0, shape, &Device::Cpu).unwrap()
    }

    /// `(count, C, H, W)` u8.
    pub fn images(&mut self, count: usize) -> Tensor {
        let [c, h, w] = IMAGE;
        let mut pixels = vec![0u8; count * c * h * w];
        self.0.fill_bytes(&mut pixels);
        Tensor::from_vec(pixels, (count, c, h, w), &Device::Cpu).unwrap()
    }

    pub fn transitions(&mut self) -> Transitions {
        Transitions {
            observations: self.images(BATCH),
            actions: self.normal(&[BATCH, ACTION_DIMS]).tanh().unwrap(),
            rewards: self.normal(&[BATCH, 1]),
            not_done: Tensor::ones((BATCH, 1), candle_core::DType::F32, &Device::Cpu).unwrap(),
            next_observations: self.images(BATCH),
        }
    }
}
