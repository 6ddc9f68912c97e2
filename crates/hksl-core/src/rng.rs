//! Named RNG streams derived from one seed.
//!
//! Every consumer of random numbers owns a [`ChaCha8Rng`] derived from the run's seed and the consumer's name. Adding a
//! consumer, or drawing more numbers in one, therefore does not change the numbers of another. The generator's serde
//! representation includes its position, so checkpoints can save it.
//!
//! ```
//! use hksl_core::rng::stream;
//! use rand::RngCore;
//!
//! let (mut replay, mut augment) = (stream(1, "replay"), stream(1, "augment"));
//! assert_ne!(replay.next_u64(), augment.next_u64());
//! assert_eq!(stream(1, "replay").next_u64(), stream(1, "replay").next_u64());
//! ```

use candle_core::{Device, Tensor};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::Result;

/// The RNG stream `name` of a run with this `seed`.
pub fn stream(seed: u64, name: &str) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(fnv1a(name.as_bytes()));
    rng
}

/// Draws a tensor from the standard normal distribution, on the host in row-major order.
pub fn standard_normal(rng: &mut ChaCha8Rng, shape: &[usize], device: &Device) -> Result<Tensor> {
    let numbers: Vec<f32> =
        (0..shape.iter().product()).map(|_| rng.sample(StandardNormal)).collect();
    Ok(Tensor::from_vec(numbers, shape, device)?)
}

/// The 64-bit FNV-1a hash, which is stable across platforms and releases, unlike the standard library's.
fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_as_published() {
        assert_eq!(fnv1a(b""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(fnv1a(b"foobar"), 0x8594_4171_f739_67e8);
    }

    #[test]
    fn normal_numbers_have_unit_variance() {
        let drawn = standard_normal(&mut stream(3, "test"), &[20_000], &Device::Cpu).unwrap();
        let numbers = drawn.to_vec1::<f32>().unwrap();
        let mean = numbers.iter().sum::<f32>() / 20_000.0;
        let variance = numbers.iter().map(|x| (x - mean).powi(2)).sum::<f32>() / 20_000.0;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.03, "{mean} {variance}");
    }
}
