//! A physical state to start from.

use serde::{Deserialize, Serialize};

use super::Steps;
use crate::dmc::{Domain, ModelEdits, Physics, StartState};
use crate::{Error, nearest, registry};

/// A physical state and the actions to apply from it, one a control step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// A task of the Control Suite.
    pub task: String,
    /// Generalised positions, m and rad.
    pub qpos: Vec<f64>,
    /// Generalised velocities, m/s and rad/s.
    pub qvel: Vec<f64>,
    /// The accelerations that the constraint solver starts from; zeros when left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub qacc_warmstart: Option<Vec<f64>>,
    /// Simulated time, s.
    #[serde(default)]
    pub time: f64,
    /// Rows of the model to write: field, object, row.
    #[serde(default)]
    pub model: ModelEdits,
    /// One row of controls for each control step; not clipped.
    pub actions: Vec<Vec<f64>>,
}

impl Start {
    /// Reads a start from JSON text.
    ///
    /// # Errors
    /// [`Error::Start`] with the field and what is expected there.
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

    /// The same error, with this state as the one before it.
    pub(crate) fn told_by(&self, error: Error, steps: usize) -> Error {
        match error {
            // MuJoCo resets what has diverged, and with it the time that it tells.
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

    /// Puts `physics` into the start state, or refuses what does not fit its task.
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

    /// Lengths and finite numbers. The model's edits are checked as they are made.
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

/// Plays the actions of `start`: no action repeat, no time limit, no reset at the end.
///
/// # Errors
/// [`Error::Start`] for what does not fit the task; a missing model file; a physics warning.
pub fn play(start: &Start) -> Result<Steps, Error> {
    let domain = start.domain()?;
    let mut physics = Physics::load(domain)?;
    start.enter(&mut physics)?;
    let mut rollout = Steps::default();
    for (step, action) in start.actions.iter().enumerate() {
        let before = physics.as_start(vec![action.clone()]);
        physics.control_step(action).map_err(|error| before.told_by(error, step))?;
        rollout.reward.push((domain.reward)(&physics));
        rollout.qpos.push(physics.qpos().to_vec());
        rollout.qvel.push(physics.qvel().to_vec());
        rollout.discount.push(1.0);
        let names = domain.readings.iter().map(|reading| reading.name.to_owned());
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
