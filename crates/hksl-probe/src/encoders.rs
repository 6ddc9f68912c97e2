//! Linear probes of all encoders of an agent.

use candle_core::Device;
use hksl_sac::Agent;
use ndarray::{Array2, Axis, concatenate};

use crate::Result;
use crate::coordinates::Coordinates;
use crate::episodes::{Episode, Latents, latents};
use crate::linear_probe::{Errors, Example, Fit, probe};

/// Name of the concatenated latents of all encoders, which HKSL's actor reads.
pub const ALL_ENCODERS: &str = "all";

/// How well one encoder's latents predict the coordinates at one horizon.
#[derive(Debug, Clone, PartialEq)]
pub struct Probed {
    /// The encoder, or [`ALL_ENCODERS`].
    pub encoder: String,
    /// Agent steps between latent and coordinates.
    pub horizon: usize,
    /// Prediction errors on the test episodes.
    pub errors: Errors,
}

/// Probes every encoder of an agent at every horizon. The linear maps are fitted on the first `train` episodes and tested
/// on the others. If there are several encoders, their concatenated latents come last.
///
/// # Errors
/// Episodes of another environment, too few or too short; errors of [`probe`].
pub fn probe_encoders(
    agent: &Agent,
    frame_stack: usize,
    (episodes, train): (&[Episode], usize),
    coordinates: &Coordinates,
    horizons: &[usize],
    fit: &Fit,
    device: &Device,
) -> Result<Vec<Probed>> {
    let encoded = episodes
        .iter()
        .map(|episode| Ok(with_all(latents(agent, episode, frame_stack, device)?)))
        .collect::<Result<Vec<_>>>()?;
    let coordinates: Vec<Array2<f64>> =
        episodes.iter().map(|episode| coordinates.values(episode)).collect();
    let encoders = encoded.first().map_or(0, Vec::len);
    let mut probed = Vec::new();
    for index in 0..encoders {
        let examples: Vec<Example> = encoded
            .iter()
            .zip(&coordinates)
            .map(|(encoders, coordinates)| Example {
                latents: encoders[index].values.view(),
                coordinates: coordinates.view(),
            })
            .collect();
        let (train, test) = examples.split_at(train.min(examples.len()));
        for &horizon in horizons {
            let encoder = encoded[0][index].encoder.clone();
            probed.push(Probed { encoder, horizon, errors: probe(train, test, horizon, fit)? });
        }
    }
    Ok(probed)
}

/// Appends the concatenation of all encoders' latents, if there are several.
fn with_all(mut encoders: Vec<Latents>) -> Vec<Latents> {
    if encoders.len() > 1 {
        let views: Vec<_> = encoders.iter().map(|of| of.values.view()).collect();
        // Each has one row per observation of the episode.
        if let Ok(values) = concatenate(Axis(1), &views) {
            encoders.push(Latents { encoder: ALL_ENCODERS.to_owned(), values });
        }
    }
    encoders
}
