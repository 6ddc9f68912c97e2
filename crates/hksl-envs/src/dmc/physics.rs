//! A MuJoCo simulation with dm_control's order of calls in resets and steps.

mod object;
mod quantities;
mod start;
mod view;

use std::path::PathBuf;

use mujoco_rs::prelude::{MjData, MjModel, MjtDisableBit, MjtIntegrator, MjtState, MjtWarning};
use serde::{Deserialize, Serialize};
use serde_json::Value;

pub(crate) use object::Object;
use object::Place;
pub(crate) use view::View;

use super::{Domain, Draws, ModelEdits, log, model_edits};
use crate::rollout::Start;
use crate::{Error, models, snapshot};

/// Model and simulation state of a task.
pub(crate) struct Physics {
    task: &'static str,
    substeps: usize,
    runge_kutta: bool,
    data: MjData<Box<MjModel>>,
    /// The domain's objects, in the domain's order.
    objects: Vec<Place>,
    /// Modified rows of the model.
    edits: ModelEdits,
    /// The model file's rows for the modified ones.
    originals: ModelEdits,
}

/// The complete state of a simulation.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PhysicsState {
    /// In MuJoCo's order: time, qpos, qvel, …, warm start, controls, ….
    integration: Vec<f64>,
    model: ModelEdits,
}

/// A start state of a simulation.
pub(crate) struct StartState<'a> {
    pub qpos: &'a [f64],
    pub qvel: &'a [f64],
    pub qacc_warmstart: Option<&'a [f64]>,
    pub time: f64,
    pub model: &'a ModelEdits,
}

const INTEGRATION: u32 = MjtState::mjSTATE_INTEGRATION as u32;

/// The version of the MuJoCo library in use.
pub fn mujoco_version() -> &'static str {
    mujoco_rs::mujoco_version()
}

impl Physics {
    /// Loads the model of `domain`.
    pub(crate) fn load(domain: &Domain) -> Result<Self, Error> {
        log::redirect();
        let path = models::find(domain.model)?;
        let unusable =
            |path: PathBuf, reason| Error::Model { task: domain.task.to_owned(), path, reason };
        models::check(&path).map_err(|(path, reason)| unusable(path, reason))?;
        let unusable = |reason: String| unusable(path.clone(), reason);
        let model = MjModel::from_xml(&path).map_err(|error| unusable(error.to_string()))?;
        let mut objects = Vec::new();
        for object in domain.objects {
            let place =
                object.find(&model).ok_or_else(|| unusable(format!("it has no {object}")))?;
            objects.push(place);
        }
        let runge_kutta = model.opt().integrator == MjtIntegrator::mjINT_RK4 as i32;
        let data = MjData::try_new(Box::new(model)).map_err(|error| unusable(error.to_string()))?;
        let (task, substeps) = (domain.task, domain.substeps);
        let (edits, originals) = (ModelEdits::new(), ModelEdits::new());
        Ok(Self { task, substeps, runge_kutta, data, objects, edits, originals })
    }

    /// Starts an episode with dm_control's reset sequence around the task's reset.
    pub(crate) fn reset(&mut self, domain: &Domain, draws: &mut dyn Draws) -> Result<(), Error> {
        self.data.reset();
        self.forward_without_actuation();
        self.replace_edits(&ModelEdits::new())
            .map_err(|(field, reason)| Error::Start { field, reason })?;
        (domain.reset)(self, draws)?;
        self.forward_without_actuation();
        self.check_warnings()
    }

    /// Sets the simulation to a given state, as after a reset to that state.
    ///
    /// # Errors
    /// [`Error::Start`] for a part that does not fit the model.
    pub(crate) fn start(&mut self, state: &StartState<'_>) -> Result<(), Error> {
        self.data.reset();
        self.forward_without_actuation();
        self.replace_edits(state.model)
            .map_err(|(field, reason)| Error::Start { field, reason })?;
        self.data.qpos_mut().copy_from_slice(state.qpos);
        self.data.qvel_mut().copy_from_slice(state.qvel);
        if let Some(warmstart) = state.qacc_warmstart {
            self.data.qacc_warmstart_mut().copy_from_slice(warmstart);
        }
        self.data.set_time(state.time);
        self.forward_without_actuation();
        self.check_warnings()
    }

    /// Takes one control step with `control`, one value per actuator, not clipped here.
    ///
    /// The final half step updates position- and velocity-dependent quantities for rewards, readings and frames. Runge-Kutta
    /// needs whole steps; the other integrators complete the half step begun by the previous call or the reset.
    pub(crate) fn control_step(&mut self, control: &[f64]) -> Result<(), Error> {
        self.data.ctrl_mut().copy_from_slice(control);
        self.steps(self.substeps);
        self.check_warnings()
    }

    fn steps(&mut self, count: usize) {
        let whole_steps = if self.runge_kutta {
            count
        } else {
            self.data.step2();
            count - 1
        };
        for _ in 0..whole_steps {
            self.data.step();
        }
        self.data.step1();
    }

    /// The current state as a start with the given actions.
    pub(crate) fn as_start(&self, actions: Vec<Vec<f64>>) -> Start {
        Start {
            task: self.task.to_owned(),
            qpos: self.data.qpos().to_vec(),
            qvel: self.data.qvel().to_vec(),
            qacc_warmstart: Some(self.data.qacc_warmstart().to_vec()),
            time: self.data.time(),
            model: self.edits.clone(),
            actions,
        }
    }

    /// The complete state.
    pub(crate) fn state(&self) -> PhysicsState {
        PhysicsState {
            integration: self.data.state(INTEGRATION).into_vec(),
            model: self.edits.clone(),
        }
    }

    /// Restores a state from [`Physics::state`].
    pub(crate) fn restore(&mut self, state: &PhysicsState) -> Result<(), Error> {
        let task = self.task;
        let expected = self.data.model().state_size(INTEGRATION);
        snapshot::same(task, "a state length of", &state.integration.len(), &expected)?;
        self.data.reset();
        self.replace_edits(&state.model)
            .map_err(|(place, reason)| snapshot::unfit(task, format!("{place}: {reason}")))?;
        self.data
            .set_state(&state.integration, INTEGRATION)
            .map_err(|error| snapshot::unfit(task, error.to_string()))?;
        // The final half step recomputes all derived quantities from the state.
        self.data.step1();
        self.check_warnings()
    }

    /// Writes rows to the model and records them.
    #[allow(unsafe_code)]
    fn edit_model(&mut self, edits: &ModelEdits) -> Result<(), (String, String)> {
        // SAFETY: the model may be changed but not replaced by one of another layout. `apply`
        // writes numbers into rows whose ids and lengths it checks, and replaces nothing.
        let model = unsafe { self.data.model_mut() };
        for (field, objects) in model_edits::apply(model, edits)? {
            let originals = self.originals.entry(field).or_default();
            for (object, row) in objects {
                originals.entry(object).or_insert(row);
            }
        }
        for (field, objects) in edits {
            self.edits.entry(field.clone()).or_default().extend(objects.clone());
        }
        Ok(())
    }

    /// Restores the model file's rows, then writes these rows.
    fn replace_edits(&mut self, edits: &ModelEdits) -> Result<(), (String, String)> {
        let originals = std::mem::take(&mut self.originals);
        self.edit_model(&originals)?;
        self.edits.clear();
        self.originals.clear();
        self.edit_model(edits)
    }

    fn forward_without_actuation(&mut self) {
        let flags = self.data.model_opt().disableflags;
        self.data.model_opt_mut().disableflags = flags | MjtDisableBit::mjDSBL_ACTUATION as i32;
        self.data.forward();
        self.data.model_opt_mut().disableflags = flags;
    }

    /// Returns an error for MuJoCo warnings, after which the state is no longer valid.
    fn check_warnings(&self) -> Result<(), Error> {
        let counts = self.data.warning();
        match WARNINGS.iter().find(|(kind, _)| counts[*kind as usize].number > 0) {
            Some((_, warning)) => {
                let (task, time) = (self.task.to_owned(), self.data.time());
                let before = Box::new(Value::Null);
                Err(Error::Physics { task, warning, time, control_step: 0, before })
            }
            None => Ok(()),
        }
    }

    /// The simulation, for rendering.
    pub(crate) fn data_mut(&mut self) -> &mut MjData<Box<MjModel>> {
        &mut self.data
    }

    /// The model's task.
    pub(crate) fn task(&self) -> &'static str {
        self.task
    }
}

/// MuJoCo's warnings with their names.
const WARNINGS: [(MjtWarning, &str); 7] = [
    (MjtWarning::mjWARN_INERTIA, "INERTIA (singular inertia matrix)"),
    (MjtWarning::mjWARN_CONTACTFULL, "CONTACTFULL (too many contacts)"),
    (MjtWarning::mjWARN_CNSTRFULL, "CNSTRFULL (too many constraints)"),
    (MjtWarning::mjWARN_BADQPOS, "BADQPOS (a position is not a number or huge)"),
    (MjtWarning::mjWARN_BADQVEL, "BADQVEL (a velocity is not a number or huge)"),
    (MjtWarning::mjWARN_BADQACC, "BADQACC (an acceleration is not a number or huge)"),
    (MjtWarning::mjWARN_BADCTRL, "BADCTRL (a control is not a number or huge)"),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_registry_has_the_time_of_a_control_step() {
        for info in crate::tasks().iter().filter(|info| info.needs_mujoco) {
            let physics = Physics::load(crate::registry::domain(info.name).unwrap()).unwrap();
            let seconds = physics.data.model_opt().timestep * physics.substeps as f64;
            let milliseconds = f64::from(info.control_step_milliseconds.unwrap());
            assert!((1000.0 * seconds - milliseconds).abs() < 1e-9, "{}: {seconds}", info.name);
        }
    }
}
