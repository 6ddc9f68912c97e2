//! Where a run is.

use std::collections::BTreeMap;
use std::path::Path;

use candle_core::{Device, Tensor};
use hksl_core::named::{prefixed, under};
use hksl_sac::RecurrentState;
use ndarray::Array3;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::metrics::Window;
use crate::{Error, Result};

/// Everything that the loop itself has to remember.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunState {
    /// Agent steps taken.
    pub agent_step: u64,
    /// Environment steps taken.
    pub environment_step: u64,
    /// Learning steps taken.
    pub updates: u64,
    /// Return of the running episode so far.
    pub episode_return: f64,
    /// Return of the last finished episode.
    pub last_return: Option<f64>,
    /// Environment step of the last evaluation.
    pub evaluated_at: Option<u64>,
    /// Mean return of the last evaluation.
    pub last_evaluation: Option<f64>,
    /// Mean return of the best evaluation, and its environment step.
    pub best_evaluation: Option<(f64, u64)>,
    /// The environment, as it gave itself.
    pub environment: Value,
    /// Values for the next line of metrics.
    pub window: Window,
    /// Bytes of `metrics.jsonl` that belong to this state.
    pub metrics_bytes: u64,
    /// Bytes of `eval.csv` that belong to this state.
    pub eval_bytes: u64,
    /// Bytes of the event file that belong to this state; 0 if there is none.
    #[serde(default)]
    pub event_bytes: u64,
    /// Seconds that the run has taken.
    pub wall_seconds: f64,
}

const FRAMES: &str = "frames";

/// Recurrent state of an agent and its number of actions, without the frames.
const MEMORY: &str = "memory";
const MEMORY_STEPS: &str = "memory_steps";

/// Frames of one shape as the tensor `frames`, `(count, C, H, W)`, with the agent's recurrent state, if any.
pub(super) fn seen_to_tensors(
    frames: &[Array3<u8>],
    memory: &RecurrentState,
) -> Result<BTreeMap<String, Tensor>> {
    let (c, h, w) = frames.first().map(Array3::dim).unwrap_or_default();
    let pixels: Vec<u8> = frames.iter().flatten().copied().collect();
    let tensor = Tensor::from_vec(pixels, (frames.len(), c, h, w), &Device::Cpu)?;
    let mut tensors = prefixed(MEMORY, memory.tensors.clone());
    tensors.insert(MEMORY_STEPS.to_owned(), Tensor::new(memory.steps, &Device::Cpu)?);
    tensors.insert(FRAMES.to_owned(), tensor);
    Ok(tensors)
}

/// The tensors in these bytes, the file `path`'s.
pub(super) fn tensors(path: &Path, bytes: &[u8]) -> Result<BTreeMap<String, Tensor>> {
    hksl_core::from_safetensors(bytes).map_err(|error| Error::damaged(path, error))
}

/// The frames and the memory of such tensors.
pub(super) fn seen_from_tensors(
    tensors: &BTreeMap<String, Tensor>,
) -> Result<(Vec<Array3<u8>>, RecurrentState)> {
    let steps = tensors.get(MEMORY_STEPS).map(Tensor::to_scalar::<u32>).transpose()?;
    let memory =
        RecurrentState { steps: steps.unwrap_or_default(), tensors: under(tensors, MEMORY) };
    Ok((frames(tensors)?, memory))
}

fn frames(tensors: &BTreeMap<String, Tensor>) -> Result<Vec<Array3<u8>>> {
    let missing = || hksl_core::Error::MissingParameter(FRAMES.to_owned());
    let tensor = tensors.get(FRAMES).ok_or_else(missing)?;
    let (count, c, h, w) = tensor.dims4()?;
    (0..count)
        .map(|index| {
            let pixels = tensor.get(index)?.flatten_all()?.to_vec1::<u8>()?;
            Array3::from_shape_vec((c, h, w), pixels).map_err(|error| {
                let reason = error.to_string();
                Error::Agent(hksl_sac::Error::SavedState { part: "frame stack".into(), reason })
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_come_back() {
        let frames: Vec<_> = (0..3u8).map(|i| Array3::from_elem((2, 3, 4), i)).collect();
        let state = Tensor::new(&[0.5f32, 2.0], &Device::Cpu).unwrap();
        let memory =
            RecurrentState { steps: 7, tensors: BTreeMap::from([("state".to_owned(), state)]) };
        let (seen, remembered) =
            seen_from_tensors(&seen_to_tensors(&frames, &memory).unwrap()).unwrap();
        assert_eq!((seen, remembered.steps, remembered.tensors.len()), (frames, 7, 1));
        assert_eq!(remembered.tensors["state"].to_vec1::<f32>().unwrap(), [0.5, 2.0]);
        assert!(seen_from_tensors(&BTreeMap::new()).is_err());
    }
}
