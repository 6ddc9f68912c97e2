//! Analysis of the outputs of communication managers (HKSL §5.4, figure 7).

use candle_core::{Device, Tensor};
use hksl_core::nn::PixelEncoder;
use hksl_core::{Hierarchy, Trajectories};
use ndarray::{Array2, Array3, ArrayView3, Axis};
use rand::seq::index;
use rand_chacha::ChaCha8Rng;

use crate::episodes::{Episode, unfit};
use crate::silhouette::distance;
use crate::{Error, Result};

/// Trajectories per batch.
const BATCH: usize = 64;

/// The start of a trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Start {
    /// Index of the episode.
    pub episode: usize,
    /// Agent step in the episode.
    pub time: usize,
}

/// Outputs of one communication manager.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// The sending level; 1 is the finest.
    pub from_level: usize,
    /// The receiving level, one level finer.
    pub to_level: usize,
    /// `(trajectories, N, Z)`: the context of each step of the receiving level.
    pub outputs: Array3<f64>,
}

/// Draws up to `count` different trajectories of `length` transitions uniformly from the episodes, in the order drawn.
///
/// # Errors
/// [`Error::NoTrajectory`] if all episodes are too short.
pub fn starts(
    episodes: &[Episode],
    length: usize,
    count: usize,
    random: &mut ChaCha8Rng,
) -> Result<Vec<Start>> {
    let all: Vec<Start> = episodes
        .iter()
        .enumerate()
        .flat_map(|(episode, of)| {
            (0..(of.len() + 1).saturating_sub(length)).map(move |time| Start { episode, time })
        })
        .collect();
    if all.is_empty() || length == 0 {
        let longest = episodes.iter().map(Episode::len).max().unwrap_or(0);
        return Err(Error::NoTrajectory { length, longest });
    }
    let drawn = index::sample(random, all.len(), count.min(all.len()));
    Ok(drawn.into_iter().map(|position| all[position]).collect())
}

/// Checks that a hierarchy has communication managers.
///
/// # Errors
/// [`Error::NoCommunication`] if it has none.
pub fn require_communication(hierarchy: &Hierarchy<PixelEncoder>) -> Result<()> {
    let config = hierarchy.config();
    if config.levels() < 2 || !config.communication {
        let reason = if config.levels() < 2 {
            "this agent's hierarchy has a single level".to_owned()
        } else {
            "this agent was trained with hksl.communication = false (the ablation no-c)".to_owned()
        };
        return Err(Error::NoCommunication { reason });
    }
    Ok(())
}

/// Computes the outputs of every communication manager in these trajectories. The manager for the finest level is first.
///
/// # Errors
/// [`Error::NoCommunication`] for a hierarchy of one level or without communication.
///
/// # Panics
/// If a start has no trajectory of the hierarchy's length in these episodes.
pub fn channels(
    hierarchy: &Hierarchy<PixelEncoder>,
    episodes: &[Episode],
    starts: &[Start],
    stack: usize,
    device: &Device,
) -> Result<Vec<Channel>> {
    require_communication(hierarchy)?;
    let config = hierarchy.config();
    let mut said: Vec<Vec<f64>> = vec![Vec::new(); config.levels() - 1];
    for part in starts.chunks(BATCH) {
        let part = trajectories(episodes, part, config.trajectory_length, stack, device)?;
        for (level, said) in said.iter_mut().enumerate() {
            let contexts = Tensor::stack(&hierarchy.contexts(level, &part)?, 1)?.detach();
            said.extend(contexts.flatten_all()?.to_vec1::<f32>()?.into_iter().map(f64::from));
        }
    }
    let channel = |(level, said)| {
        let size = (starts.len(), config.steps(level), config.latent_dims);
        let outputs = Array3::from_shape_vec(size, said);
        let outputs = outputs.map_err(|error| unfit("contexts", &error))?;
        Ok(Channel { from_level: level + 2, to_level: level + 1, outputs })
    };
    said.into_iter().enumerate().map(channel).collect()
}

fn trajectories(
    episodes: &[Episode],
    starts: &[Start],
    length: usize,
    stack: usize,
    device: &Device,
) -> Result<Trajectories> {
    let mut times = Vec::with_capacity(length + 1);
    for step in 0..=length {
        let batch = starts.iter().map(|start| {
            let episode = &episodes[start.episode];
            episode.observations(&[start.time + step], stack, device)
        });
        times.push(Tensor::cat(&batch.collect::<Result<Vec<_>>>()?, 0)?);
    }
    let dims = episodes.first().map_or(0, |episode| episode.actions.ncols());
    let mut actions: Vec<f32> = Vec::with_capacity(starts.len() * length * dims);
    for start in starts {
        let rows = &episodes[start.episode].actions;
        for step in 0..length {
            actions.extend(rows.row(start.time + step));
        }
    }
    Ok(Trajectories {
        observations: Tensor::stack(&times, 0)?,
        actions: Tensor::from_vec(actions, (starts.len(), length, dims), device)?,
    })
}

/// The ℓ2 distance between the contexts of each pair of steps of a trajectory, averaged over trajectories.
///
/// # Shapes
/// - `outputs`: `(trajectories, N, Z)`
/// - output: `(N, N)`, symmetric, 0 on the diagonal
pub fn step_distances(outputs: ArrayView3<'_, f64>) -> Array2<f64> {
    let (trajectories, steps, _) = outputs.dim();
    let mut sums = Array2::zeros((steps, steps));
    for trajectory in outputs.axis_iter(Axis(0)) {
        for one in 0..steps {
            for other in 0..one {
                let distance = distance(trajectory, one, other);
                sums[(one, other)] += distance;
                sums[(other, one)] += distance;
            }
        }
    }
    sums / trajectories.max(1) as f64
}

/// Statistics of the distances of all pairs of steps with the same difference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ByDifference {
    /// Difference of the steps.
    pub difference: usize,
    /// Number of pairs.
    pub pairs: usize,
    /// Mean distance.
    pub mean: f64,
    /// Minimal distance.
    pub min: f64,
    /// Maximal distance.
    pub max: f64,
}

/// Groups the entries of [`step_distances`] by the difference of the steps, from 1.
pub fn by_difference(distances: &Array2<f64>) -> Vec<ByDifference> {
    let steps = distances.nrows();
    (1..steps)
        .map(|difference| {
            let values: Vec<f64> =
                (difference..steps).map(|step| distances[(step, step - difference)]).collect();
            ByDifference {
                difference,
                pairs: values.len(),
                mean: values.iter().sum::<f64>() / values.len() as f64,
                min: values.iter().copied().fold(f64::INFINITY, f64::min),
                max: values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            }
        })
        .collect()
}

/// All outputs of the first `count` trajectories as vectors `(count·N, Z)`, and the index of each vector's trajectory.
pub fn vectors(channel: &Channel, count: usize) -> (Array2<f64>, Vec<usize>) {
    let (trajectories, steps, dims) = channel.outputs.dim();
    let count = count.min(trajectories);
    let vectors = Array2::from_shape_fn((count * steps, dims), |(row, dim)| {
        channel.outputs[(row / steps, row % steps, dim)]
    });
    (vectors, (0..count * steps).map(|row| row / steps).collect())
}

#[cfg(test)]
mod tests {
    use ndarray::{Array4, array};
    use rand_chacha::rand_core::SeedableRng;

    use super::*;

    #[test]
    fn distances_are_averaged_and_grouped() {
        // Two trajectories of three steps on a line.
        let outputs = array![[[0.0], [1.0], [3.0]], [[0.0], [3.0], [3.0]]];
        let distances = step_distances(outputs.view());
        assert_eq!(distances, array![[0.0, 2.0, 3.0], [2.0, 0.0, 1.0], [3.0, 1.0, 0.0]]);
        let grouped = by_difference(&distances);
        let one = ByDifference { difference: 1, pairs: 2, mean: 1.5, min: 1.0, max: 2.0 };
        assert_eq!(grouped[0], one);
        assert_eq!((grouped.len(), grouped[1].mean), (2, 3.0));
    }

    #[test]
    fn trajectories_are_drawn_once_each() {
        let episode = |steps| Episode {
            frames: Array4::zeros((steps + 1, 1, 1, 1)),
            actions: Array2::zeros((steps, 1)),
            readings: Array2::zeros((steps + 1, 1)),
        };
        let episodes = [episode(4), episode(2)];
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut drawn = starts(&episodes, 3, 100, &mut random).unwrap();
        drawn.sort();
        assert_eq!(drawn, [0, 1].map(|time| Start { episode: 0, time }));
        assert_eq!(starts(&episodes, 1, 3, &mut random).unwrap().len(), 3);
        let message = starts(&episodes, 5, 1, &mut random).unwrap_err().to_string();
        assert!(
            message.contains("5 transitions") && message.contains("4 agent steps"),
            "{message}"
        );
    }
}
