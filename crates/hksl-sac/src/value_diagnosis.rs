//! Diagnostic metrics of the critics on the last episode: bias against observed returns, and spread over actions and
//! states.

use candle_core::{Device, Tensor};
use hksl_core::Trajectories;
use rand_chacha::ChaCha8Rng;

use crate::Result;
use crate::networks::Networks;
use crate::replay::{Episode, Replay, Sampler, Start};

/// Maximal number of observations to evaluate, without the last one.
const TIMES: usize = 64;

/// Computes for each critic, over observations of the last finished episode:
///
/// - `q_bias`: the mean of the Q-value minus the observed discounted return. Unless the last transition was terminal, the
///   critic's own Q-value replaces its reward.
/// - `q_action_spread`, `q_state_spread`: see [`spreads`].
///
/// Empty if the episode has fewer than two transitions.
pub(crate) fn value_figures(
    networks: &Networks,
    replay: &Replay,
    device: &Device,
    random: &mut ChaCha8Rng,
) -> Result<Vec<(String, f64)>> {
    let Some(index) = replay.finished().len().checked_sub(1) else { return Ok(Vec::new()) };
    let episode = replay.episode(index);
    let Some(last) = episode.len().checked_sub(1).filter(|last| *last > 0) else {
        return Ok(Vec::new());
    };
    let mut times: Vec<usize> = (0..TIMES.min(last)).map(|i| i * last / TIMES.min(last)).collect();
    times.push(last);
    let starts: Vec<Start> = times.iter().map(|&time| Start { episode: index, time }).collect();
    let batch = Sampler::new(0).batch(replay, &starts, 1, random);
    let (Trajectories { observations, actions }, ..) = batch.to_device(device)?;
    let (observations, taken) = (observations.get(0)?, actions.squeeze(1)?);
    let probes = probe_actions(taken.dim(1)?);
    let probes = probes.iter().map(|action| repeated(action, times.len(), device));
    let actions: Vec<Tensor> = [Ok(taken)].into_iter().chain(probes).collect::<Result<_>>()?;
    let values = networks.q_values(&observations, &actions)?;
    let (mut biases, mut spread_figures) = (Vec::new(), Vec::new());
    for (q, values) in networks.critics.iter().zip(&values) {
        let (taken, probed) = (&values[0], &values[1..]);
        let observed = observed(episode, q.discount, taken[times.len() - 1]);
        let pairs = times.iter().zip(taken).take(times.len() - 1);
        let sum: f64 = pairs.map(|(&time, value)| value - observed[time]).sum();
        biases.push((format!("q_bias{}", q.suffix), sum / (times.len() - 1) as f64));
        let probed: Vec<&[f64]> = probed.iter().map(Vec::as_slice).collect();
        let (action, state) = spreads(&probed);
        spread_figures.push((format!("q_action_spread{}", q.suffix), action));
        spread_figures.push((format!("q_state_spread{}", q.suffix), state));
    }
    biases.extend(spread_figures);
    Ok(biases)
}

/// The zero action, and for each dimension the actions −1 and 1 in that dimension with zeros elsewhere.
fn probe_actions(dims: usize) -> Vec<Vec<f32>> {
    let mut probes = vec![vec![0.0; dims]];
    for (dim, value) in (0..dims).flat_map(|dim| [(dim, -1.0), (dim, 1.0)]) {
        let mut action = vec![0.0; dims];
        action[dim] = value;
        probes.push(action);
    }
    probes
}

/// One action repeated `count` times, `(count, A)`.
fn repeated(action: &[f32], count: usize, device: &Device) -> Result<Tensor> {
    Ok(Tensor::from_vec(action.repeat(count), (count, action.len()), device)?)
}

/// Spread of Q-values over actions and over states. `values` is indexed `[action][state]`.
///
/// The first result is the square root of the variance over actions, averaged over states: how strongly the critic
/// distinguishes actions. The second is the standard deviation over states of the mean over actions: how strongly it
/// distinguishes states.
///
/// ```text
/// values    state 1  state 2      mean over actions: 2, 6; spread over states 2
/// action 1     1        6         spread over actions: 1 in state 1, 0 in state 2;
/// action 2     3        6         together sqrt((1 + 0) / 2)
/// ```
fn spreads(values: &[&[f64]]) -> (f64, f64) {
    let (actions, states) = (values.len() as f64, values[0].len());
    let mean = |state: usize| values.iter().map(|of| of[state]).sum::<f64>() / actions;
    let means: Vec<f64> = (0..states).map(mean).collect();
    let squares: f64 = values
        .iter()
        .flat_map(|of| of.iter().zip(&means))
        .map(|(value, mean)| (value - mean).powi(2))
        .sum();
    let overall = means.iter().sum::<f64>() / states as f64;
    let between: f64 = means.iter().map(|mean| (mean - overall).powi(2)).sum();
    ((squares / actions / states as f64).sqrt(), (between / states as f64).sqrt())
}

/// The observed discounted return from each time of an episode. If the last transition is not terminal, `end` replaces
/// its reward.
fn observed(episode: &Episode, discount: f64, end: f64) -> Vec<f64> {
    let rewards = episode.rewards(0, episode.len());
    let ended = episode.not_done(episode.len() - 1, 1).next() == Some(0.0);
    let mut observed: Vec<f64> = rewards.iter().map(|&reward| f64::from(reward)).collect();
    if let (Some(last), false) = (observed.last_mut(), ended) {
        *last = end;
    }
    for time in (0..observed.len() - 1).rev() {
        observed[time] += discount * observed[time + 1];
    }
    observed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay::Layout;

    #[test]
    fn spreads_tell_actions_from_states() {
        let (action, state) = spreads(&[&[1.0, 6.0], &[3.0, 6.0]]);
        assert!((action - 0.5f64.sqrt()).abs() < 1e-12, "{action}");
        assert!((state - 2.0).abs() < 1e-12, "{state}");
        assert_eq!(probe_actions(1), [[0.0], [-1.0], [1.0]]);
        assert_eq!(probe_actions(2).len(), 5);
    }

    #[test]
    fn rewards_are_discounted_from_the_end() {
        let layout = Layout { frame: [1, 1, 1], stack: 1, action_dims: 1 };
        for (terminal, expected) in [(false, [2.5, 3.0, 4.0]), (true, [2.0, 2.0, 2.0])] {
            let mut replay = Replay::new(layout, 10);
            replay.begin_episode(&[0]).unwrap();
            for time in 0..3 {
                let reward = f32::from(time as u8 == 2) + 1.0;
                replay.push(&[0.0], reward, terminal && time == 2, &[0]).unwrap();
            }
            replay.end_episode();
            assert_eq!(observed(replay.episode(0), 0.5, 4.0), expected);
        }
    }
}
