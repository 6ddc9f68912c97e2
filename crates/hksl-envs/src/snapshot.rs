//! Helpers for snapshots as JSON.

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::{Error, Spec};

/// Serialises a state.
pub(crate) fn write<T: Serialize>(task: &str, state: &T) -> Result<Value, Error> {
    serde_json::to_value(state)
        .map_err(|error| Error::Snapshot { task: task.to_owned(), reason: error.to_string() })
}

/// Deserialises a state.
pub(crate) fn read<T: DeserializeOwned>(task: &str, snapshot: &Value) -> Result<T, Error> {
    T::deserialize(snapshot).map_err(|error| unfit(task, error.to_string()))
}

/// An error for a snapshot that does not fit.
pub(crate) fn unfit(task: &str, reason: impl Into<String>) -> Error {
    Error::Snapshot { task: task.to_owned(), reason: reason.into() }
}

/// Checks that a snapshot lies within this environment's episode length.
pub(crate) fn within_episode(spec: &Spec, steps: Option<usize>) -> Result<(), Error> {
    let limit = spec.steps_per_episode;
    match steps.filter(|&steps| steps > limit) {
        Some(steps) => {
            let reason = format!("it is {steps} steps into an episode, and these have {limit}");
            Err(unfit(&spec.task, reason))
        }
        None => Ok(()),
    }
}

/// Checks that the snapshot's value of `name` equals this environment's.
pub(crate) fn same<T: PartialEq + std::fmt::Debug>(
    task: &str,
    name: &str,
    saved: &T,
    own: &T,
) -> Result<(), Error> {
    if saved == own {
        return Ok(());
    }
    Err(unfit(task, format!("it has {name} {saved:?}, this environment {own:?}")))
}
