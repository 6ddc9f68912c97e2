//! Episodes of random frames, for measurements without an environment.

use hksl_envs::Spec;
use hksl_sac::Agent;
use ndarray::Array3;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use crate::Result;

/// Adds episodes of random frames, actions and rewards to the agent's replay.
///
/// # Errors
/// Whatever the agent reports.
pub(crate) fn record(
    agent: &mut Agent,
    spec: &Spec,
    random: &mut ChaCha8Rng,
    episodes: usize,
    length: usize,
) -> Result<()> {
    let shape = (spec.frame.channels, spec.frame.height, spec.frame.width);
    let mut frame = Array3::<u8>::zeros(shape);
    for _ in 0..episodes {
        frame.mapv_inplace(|_| random.random());
        agent.begin_episode(frame.view())?;
        for _ in 0..length {
            let action: Vec<f32> =
                (0..spec.action_dims).map(|_| random.random_range(-1f32..=1.0)).collect();
            frame.mapv_inplace(|_| random.random());
            agent.observe(&action, random.random(), false, frame.view())?;
        }
        agent.end_episode();
    }
    Ok(())
}
