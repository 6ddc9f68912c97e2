//! Physical start states.

use serde::{Deserialize, Serialize};

use super::Steps;
use crate::dmc::{Domain, ModelEdits, Physics, StartState};
use crate::{Error, nearest, registry};

/// A physical state with the actions to apply, one per control step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// A task of the Control Suite.
    pub task: String,
    /// Generalised positions, m and rad.
    pub qpos: Vec<f64>,
    /// Generalised velocities, m/s and rad/s.
    pub qvel: Vec<f64>,
    /// Warm-start accelerations of the constraint solver. Zeros by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub qacc_warmstart: Option<Vec<f64>>,
    /// Simulated time, s.
    #[serde(default)]
    pub time: f64,
    /// Modified rows of the model, by field and object.
    #[serde(default)]
    pub model: ModelEdits,
    /// One row of unclipped controls for each control step.
    pub actions: Vec<Vec<f64>>,
}

impl Start {
    /// Parses a start state from JSON.
    ///
    /// # Errors
    /// [`Error::Start`] with the field and the reason.
    pub fn parse(text: &str) -> Result<Self, Error> {
        serde_json::from_str(text).map_err(|error| {
            let field = match (error.line(), error.column()) {
                (0, _) => "the file".to_owned(),
                (line, column) => format!("line {line}, column {column}"),
            };
            let message = error.to_string();
            let reason = message.split(" at line ").next().unwrap_or(&message).to_owned();
            Error::Start { field, reason }
        })
    }

    /// Adds this state to a physics error as the state before the failed step.
    pub(crate) fn with_state_before(&self, error: Error, steps: usize) -> Error {
        match error {
            // MuJoCo resets a diverged simulation, including its time.
            Error::Physics { task, warning, .. } => {
                let before = Box::new(serde_json::to_value(self).unwrap_or_default());
                Error::Physics { task, warning, time: self.time, control_step: steps, before }
            }
            error => error,
        }
    }

    fn domain(&self) -> Result<&'static Domain, Error> {
        registry::domain(&self.task).ok_or_else(|| {
            let suite = registry::tasks().iter().filter(|info| info.needs_mujoco);
            let names: Vec<_> = suite.map(|info| info.name).collect();
            let near = nearest(&self.task, names.iter().copied());
            let hint = match near.first() {
                Some(name) => format!("did you mean {name}?"),
                None => format!("a rollout from a state takes one of: {}", names.join(", ")),
            };
            fault("task", format!("unknown task '{}'; {hint}", self.task))
        })
    }

    /// Sets `physics` to the start state after checking that it fits the task.
    pub(crate) fn enter(&self, physics: &mut Physics) -> Result<(), Error> {
        if self.task != physics.task() {
            let reason = format!("'{}', expected '{}'", self.task, physics.task());
            return Err(fault("task", reason));
        }
        self.check(physics)?;
        physics.start(&StartState {
            qpos: &self.qpos,
            qvel: &self.qvel,
            qacc_warmstart: self.qacc_warmstart.as_deref(),
            time: self.time,
            model: &self.model,
        })
    }

    /// Checks lengths and that all values are finite. Model edits are checked when they are applied.
    fn check(&self, physics: &Physics) -> Result<(), Error> {
        check_row("qpos", &self.qpos, physics.qpos().len())?;
        check_row("qvel", &self.qvel, physics.qvel().len())?;
        if let Some(warmstart) = &self.qacc_warmstart {
            check_row("qacc_warmstart", warmstart, physics.qvel().len())?;
        }
        check_row("time", &[self.time], 1)?;
        for (index, action) in self.actions.iter().enumerate() {
            check_row(&format!("actions[{index}]"), action, physics.control_dims())?;
        }
        Ok(())
    }
}

/// Applies the actions of `start`, without action repeat, time limit and reset.
///
/// # Errors
/// [`Error::Start`] for a start that does not fit the task; a missing model file; a physics warning.
pub fn play(start: &Start) -> Result<Steps, Error> {
    let domain = start.domain()?;
    let mut physics = Physics::load(domain)?;
    start.enter(&mut physics)?;
    let mut rollout = Steps::default();
    for (step, action) in start.actions.iter().enumerate() {
        let before = physics.as_start(vec![action.clone()]);
        physics.control_step(action).map_err(|error| before.with_state_before(error, step))?;
        rollout.reward.push((domain.reward)(&physics));
        rollout.qpos.push(physics.qpos().to_vec());
        rollout.qvel.push(physics.qvel().to_vec());
        rollout.discount.push(1.0);
        let names = domain.readings.iter().map(|reading| reading.name.clone().into_owned());
        rollout.probe.push(names.zip((domain.probe)(&physics)).collect());
    }
    Ok(rollout)
}

fn fault(field: &str, reason: String) -> Error {
    Error::Start { field: field.to_owned(), reason }
}

fn check_row(field: &str, row: &[f64], expected: usize) -> Result<(), Error> {
    if row.len() != expected {
        return Err(fault(field, format!("{} numbers, expected {expected}", row.len())));
    }
    match row.iter().position(|value| !value.is_finite()) {
        Some(index) => {
            let reason = format!("number {index} is {}, expected a finite one", row[index]);
            Err(fault(field, reason))
        }
        None => Ok(()),
    }
}
