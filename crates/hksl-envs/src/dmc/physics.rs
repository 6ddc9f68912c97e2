//! A MuJoCo simulation driven as dm_control drives it: its order of calls at reset and in a step.

mod object;
mod picture;
mod quantities;
mod start;

use std::path::PathBuf;

use mujoco_rs::prelude::{MjData, MjModel, MjtDisableBit, MjtIntegrator, MjtState, MjtWarning};
use serde::{Deserialize, Serialize};
use serde_json::Value;

pub(crate) use object::Object;
use object::Place;
pub(crate) use picture::View;

use super::{Domain, Draws, ModelEdits, log, model_edits};
use crate::rollout::Start;
use crate::{Error, models, snapshot};

/// The model's and simulation's state of one task.
pub(crate) struct Physics {
    task: &'static str,
    substeps: usize,
    runge_kutta: bool,
    data: MjData<Box<MjModel>>,
    /// The domain's objects, in its order.
    objects: Vec<Place>,
    /// Every row that was written over the model file's.
    edits: ModelEdits,
    /// The file's own rows in those places.
    originals: ModelEdits,
}

/// All that a simulation depends on.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PhysicsState {
    /// In MuJoCo's own order: time, qpos, qvel, …, warm start, controls, ….
    integration: Vec<f64>,
    model: ModelEdits,
}

/// A start state to put a simulation into.
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

    /// Starts an episode: dm_control's frame around the task's own reset.
    pub(crate) fn reset(&mut self, domain: &Domain, draws: &mut dyn Draws) -> Result<(), Error> {
        self.data.reset();
        self.forward_without_actuation();
        self.replace_edits(&ModelEdits::new())
            .map_err(|(field, reason)| Error::Start { field, reason })?;
        (domain.reset)(self, draws)?;
        self.forward_without_actuation();
        self.check_warnings()
    }

    /// Puts the simulation into a given state, as after a reset that led there.
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

    /// One control step under `control`, one number an actuator, not clipped here.
    ///
    /// The closing half step brings positions and velocity-dependent quantities up to the new
    /// state: rewards, readings and frames use them. Runge-Kutta needs whole steps; the other
    /// integrators finish the half step that the previous call (or the reset) began.
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

    /// Where the simulation is, as a start of other actions.
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

    /// Everything that the future depends on.
    pub(crate) fn state(&self) -> PhysicsState {
        PhysicsState {
            integration: self.data.state(INTEGRATION).into_vec(),
            model: self.edits.clone(),
        }
    }

    /// Goes back to a state that [`Physics::state`] gave.
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
        // What a control step leaves behind follows from the state by its closing half step.
        self.data.step1();
        self.check_warnings()
    }

    /// Writes rows into the model and remembers them.
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

    /// Makes the model its file's again, but for these rows.
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

    /// A warning means that the state is no longer the one the equations lead to.
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

    /// The simulation, for drawing.
    pub(crate) fn data_mut(&mut self) -> &mut MjData<Box<MjModel>> {
        &mut self.data
    }

    /// The task whose model this is.
    pub(crate) fn task(&self) -> &'static str {
        self.task
    }
}

/// MuJoCo's warnings with names to report them by.
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
