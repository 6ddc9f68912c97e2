//! Carrying a run out, from its start or from where it was.

mod error;
mod event;
pub(crate) mod facts;
mod health;
mod memory;
mod opening;
mod records;
mod session;
mod summary;

use std::sync::atomic::AtomicBool;

use candle_core::Device;
use hksl_core::rng;

pub use error::Error;
pub use event::{Ending, Event, Outcome, Progress, Summary};
pub use memory::RunMemory;
use session::Session;

use crate::checkpoint::Checkpoints;
use crate::config::{Config, Difference};
use crate::factories::Factories;
use crate::memory::SystemMemory;
use crate::metrics::read_evaluations;
use crate::{Result, checkpoint};
use hksl_files::RunFolder;

/// What to do with a run that has begun already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resume {
    /// Go on where it was.
    Auto,
    /// Leave it untouched, with an error.
    Never,
}

/// A run to be carried out.
pub struct Plan<'a> {
    /// Its configuration.
    pub config: &'a Config,
    /// Where it is kept.
    pub folder: &'a RunFolder,
    /// What makes its environment and its agent.
    pub factories: &'a dyn Factories,
    /// Where its networks live.
    pub device: Device,
    /// The command that was given, for `command.txt`.
    pub command: String,
    /// Handling of an existing run.
    pub resume: Resume,
    /// If set, the run stops after its agent step and is saved.
    pub stop: &'a AtomicBool,
}

/// Starts or resumes a run and trains until its budget is used up. `watch` receives its events.
///
/// # Errors
/// A folder with another run or locked by another process, unreadable states, an unwritable disk, too little memory,
/// NaN or infinite values, and errors of the environment or the agent. Earlier saves are kept.
pub fn train(plan: &Plan, watch: &mut dyn FnMut(&Event)) -> Result<Outcome> {
    let folder = plan.folder;
    if let Some(outcome) = finished_already(plan, check_resumable(plan)?)? {
        watch(&Event::Finished(&outcome));
        return Ok(outcome);
    }
    // From here on, this process holds the run; earlier refusals are not failures of the run.
    let _lock = folder.lock()?;
    let session = Session::open(plan, watch).inspect_err(|error| {
        if !error.is_usage() {
            folder.mark_failed(error);
        }
    })?;
    let outcome = session.run(watch).map_err(|error| keep_failure(folder, error));
    let outcome = outcome.inspect_err(|error| folder.mark_failed(error))?;
    if outcome.ending == Ending::Stopped {
        watch(&Event::Stopped(&outcome));
    } else {
        folder.mark_done(true)?;
        watch(&Event::Finished(&outcome));
    }
    Ok(outcome)
}

/// Summary of the run, as on its first screen, without writing anything.
///
/// # Errors
/// As [`train`], except that memory and locks are not checked.
pub fn preview(plan: &Plan) -> Result<Summary> {
    let free = SystemMemory::read();
    let resumed_at = check_resumable(plan)?;
    let memory = RunMemory::measure(plan, free)?;
    let environment =
        plan.factories.environment(plan.config, rng::stream(plan.config.seed, "env"))?;
    let mut agent = plan.factories.agent(plan.config, environment.spec(), &plan.device)?;
    let facts = facts::gather(plan, environment.spec());
    let summary = Summary::of(plan, environment.spec(), &mut agent, &facts)?;
    Ok(Summary { memory, available_bytes: free.map(|free| free.available), resumed_at, ..summary })
}

/// Checks that the run in a folder has these settings, but for those that may change on resume.
///
/// # Errors
/// [`Error::OtherConfig`] with every difference; an unreadable file of settings.
pub(crate) fn check_settings(folder: &RunFolder, config: &Config) -> Result<()> {
    let differences = Config::of_run(folder)?.difference(config)?;
    let differences: Vec<Difference> =
        differences.into_iter().filter(|difference| !difference.may_change).collect();
    if differences.is_empty() {
        return Ok(());
    }
    Err(Error::OtherConfig { folder: folder.path().to_owned(), differences }.into())
}

/// Checks whether the run can be resumed, and returns the environment step of its newest state; none if the run has
/// not started, or was stopped before its first save.
fn check_resumable(plan: &Plan) -> Result<Option<u64>> {
    let Plan { config, folder, .. } = *plan;
    // An unreadable file may still exist.
    let file = folder.config_file();
    if !file.try_exists().map_err(|source| crate::Error::read(&file, source))? {
        return Ok(None);
    }
    if plan.resume == Resume::Never {
        return Err(Error::RunExists { folder: folder.path().to_owned() }.into());
    }
    check_settings(folder, config)?;
    let step = Checkpoints::of_run(folder).newest_state()?;
    if let Some(done) = step.filter(|&done| done > config.environment_steps) {
        let (folder, budget) = (folder.path().to_owned(), config.environment_steps);
        return Err(Error::SmallerBudget { folder, done, budget }.into());
    }
    Ok(step)
}

/// The last screen's figures, if the budget is used up.
///
/// # Errors
/// [`checkpoint::Error::NoState`] for more than a run did whose states are gone, [`Error::SmallerBudget`] for less.
fn finished_already(plan: &Plan, saved_step: Option<u64>) -> Result<Option<Outcome>> {
    let Plan { config, folder, .. } = *plan;
    if !folder.done_file().is_file() {
        return Ok(None);
    }
    let reached = folder.reached(saved_step)?;
    match reached.cmp(&config.environment_steps) {
        std::cmp::Ordering::Equal => {}
        std::cmp::Ordering::Greater => {
            let (folder, budget) = (folder.path().to_owned(), config.environment_steps);
            return Err(Error::SmallerBudget { folder, done: reached, budget }.into());
        }
        std::cmp::Ordering::Less if saved_step.is_none() => {
            let folder = folder.path().join("checkpoints");
            return Err(checkpoint::Error::NoState { folder }.into());
        }
        std::cmp::Ordering::Less => return Ok(None),
    }
    let file = folder.eval_file();
    let rows = if file.is_file() { read_evaluations(&file)? } else { Vec::new() };
    Ok(rows.last().map(|last| Outcome {
        final_return: last.episode_return,
        best_evaluation: rows
            .iter()
            .map(|row| (row.episode_return, row.environment_step))
            .reduce(|best, row| if row.0 > best.0 { row } else { best }),
        environment_step: last.environment_step,
        agent_step: last.agent_step,
        wall_seconds: last.wall_seconds,
        ending: Ending::DoneBefore,
    }))
}

/// Writes down what a simulation failed on.
fn keep_failure(folder: &RunFolder, error: crate::Error) -> crate::Error {
    use crate::Error::Environment;
    let Environment(hksl_envs::Error::Physics { before, .. }) = &error else { return error };
    let path = folder.failure_file();
    match (std::fs::write(&path, format!("{before:#}\n")), error) {
        (Ok(()), Environment(source)) => {
            Error::Simulation { path, source: Box::new(source) }.into()
        }
        // Why the run ended matters more than that this could not be written.
        (_, error) => error,
    }
}
