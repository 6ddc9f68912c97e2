//! Status of a run, from its folder alone.

use std::fs;

use hksl_files::{RunFolder, Standing, read_points};

use crate::checkpoint::{Checkpoints, Error};

/// Status of the run in this folder, given its budget in environment steps.
pub fn standing(folder: &RunFolder, environment_steps: u64) -> Standing {
    if folder.is_locked() {
        let environment_step = last_step(folder).unwrap_or(0);
        return Standing::Running { environment_step };
    }
    if !folder.is_begun() {
        return match folder.failure() {
            Some(reason) => Standing::Failed { reason },
            None => Standing::NotBegun,
        };
    }
    let saved = match Checkpoints::of_run(folder).newest_state() {
        Ok(saved) => saved,
        Err(error) => return Standing::Failed { reason: error.to_string() },
    };
    if folder.done_file().is_file() {
        // A finished run resumes if the study has raised its budget.
        let reached = match folder.reached(saved) {
            Ok(reached) => reached,
            Err(error) => return Standing::Failed { reason: error.to_string() },
        };
        if reached >= environment_steps {
            let (rows, _) = read_points(&folder.eval_file()).unwrap_or_default();
            let last_return = rows.last().map_or(f64::NAN, |row| row.episode_return);
            return Standing::Done { last_return };
        }
        if saved.is_none() {
            let error = Error::NoState { folder: folder.path().join("checkpoints") };
            return Standing::Failed { reason: error.to_string() };
        }
    }
    match folder.failure() {
        Some(reason) => Standing::Failed { reason },
        None => Standing::Stopped { environment_step: saved.unwrap_or(0) },
    }
}

/// Environment step of the last line of `metrics.jsonl`.
fn last_step(folder: &RunFolder) -> Option<u64> {
    let text = fs::read_to_string(folder.metrics_file()).ok()?;
    let line = text.lines().next_back()?;
    let value: serde_json::Value = serde_json::from_str(line).ok()?;
    value["environment_step"].as_u64()
}
