//! Training.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use hksl_envs::external::Interface;
use hksl_train::config::{Config, OwnTask, Request, resolve};
use hksl_train::{
    Ending, Event, Factories, Outcome, Own, Plan, Registry, Resume, RunFolder, RunId, Summary,
    check_name, device,
};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::{Error, Result};
use crate::interface::Brought;
use crate::request::Arguments;

/// Time between two reports of progress.
const BETWEEN_REPORTS: Duration = Duration::from_millis(100);

/// Where a run is kept, and what starts it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Place {
    runs: PathBuf,
    name: Option<String>,
    resume: bool,
    command: String,
}

/// Trains in a task of the registry, or in an environment of Python. `watch` receives the name of each event and its
/// figures. Returns how the run ended.
#[pyfunction]
#[pyo3(signature = (arguments, place, brought, watch))]
pub fn train<'py>(
    py: Python<'py>,
    arguments: Arguments<'py>,
    place: Place,
    brought: Option<Brought>,
    watch: Py<PyAny>,
) -> PyResult<Bound<'py, PyDict>> {
    let request = arguments.request()?;
    if let Some(reason) = place.name.as_deref().and_then(|name| check_name(name).err()) {
        let config = hksl_train::config::Error::OutOfRange {
            key: "name".to_owned(),
            value: format!("{:?}", place.name.unwrap_or_default()),
            origin: None,
            expected: format!("it {reason}"),
        };
        return Err(Error::from(config).into());
    }
    let id = RunId { presets: arguments.presets.clone(), name: place.name.clone() };
    let interface = brought.as_ref().map(Brought::interface).transpose().map_err(Error::from)?;
    let (outcome, folder, raised) =
        py.detach(|| carry_out(request, &place, &id, brought.as_ref(), interface, &watch))?;
    if let Some(exception) = raised {
        return Err(exception);
    }
    let result = PyDict::new(py);
    set_outcome(&result, &outcome)?;
    result.set_item("folder", folder)?;
    Ok(result)
}

type Ended = (Outcome, PathBuf, Option<PyErr>);

fn carry_out(
    mut request: Request,
    place: &Place,
    id: &RunId,
    brought: Option<&Brought>,
    interface: Option<Interface>,
    watch: &Py<PyAny>,
) -> Result<Ended> {
    hksl_cli::keep_freed_memory();
    request.own_task = brought.zip(interface.as_ref()).map(|(brought, interface)| OwnTask {
        name: interface.task.clone(),
        height: interface.frame.height,
        width: interface.frame.width,
        episode_steps: brought.episode_steps,
    });
    let config = resolve(&request)?.config;
    device::require_threads(config.threads)?;
    let folder = RunFolder::of(&place.runs, &config, id);
    match brought.zip(interface) {
        None => run(&config, &folder, place, &Registry, watch),
        Some((brought, interface)) => {
            let steps = config.environment.episode_steps;
            let make = |rng| Ok(brought.environment(&interface, steps, rng)?);
            let own = Own { make: &make, interface: Some(interface.clone()) };
            run(&config, &folder, place, &own, watch)
        }
    }
}

fn run(
    config: &Config,
    folder: &RunFolder,
    place: &Place,
    factories: &dyn Factories,
    watch: &Py<PyAny>,
) -> Result<Ended> {
    let stop = AtomicBool::new(false);
    let plan = Plan {
        config,
        folder,
        factories,
        device: device::open(config.device_choice()?)?,
        command: place.command.clone(),
        resume: if place.resume { Resume::Auto } else { Resume::Never },
        stop: &stop,
    };
    let mut watcher = Watcher { watch, stop: &stop, reported: Instant::now(), raised: None };
    let outcome = hksl_train::train(&plan, &mut |event| watcher.see(event, folder.path()));
    let raised = watcher.raised;
    match outcome {
        Ok(outcome) => Ok((outcome, folder.path().to_owned(), raised)),
        Err(error) => {
            let exception = PyErr::from(Error::from(error));
            if Python::attach(|py| exception.is_instance_of::<PyKeyboardInterrupt>(py)) {
                // The run is stopped and saved; it has not failed.
                folder.mark_going().map_err(hksl_train::Error::from)?;
            }
            Err(exception.into())
        }
    }
}

/// Tells Python of a run's events, and stops the run on a signal or an exception.
struct Watcher<'a> {
    watch: &'a Py<PyAny>,
    stop: &'a AtomicBool,
    reported: Instant,
    raised: Option<PyErr>,
}

impl Watcher<'_> {
    fn see(&mut self, event: &Event, folder: &Path) {
        if self.raised.is_some() {
            return;
        }
        let frequent = matches!(
            event,
            Event::Stepped(_) | Event::Pretrained { .. } | Event::EvaluationStepped
        );
        let report = !frequent || self.reported.elapsed() >= BETWEEN_REPORTS;
        let seen = Python::attach(|py| {
            py.check_signals()?;
            if !report {
                return Ok(());
            }
            self.reported = Instant::now();
            let figures = PyDict::new(py);
            let name = describe(event, &figures)?;
            figures.set_item("folder", folder)?;
            self.watch.call1(py, (name, figures)).map(drop)
        });
        if let Err(exception) = seen {
            self.raised = Some(exception);
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}

/// The event's name; puts its figures into the dictionary.
fn describe(event: &Event, figures: &Bound<'_, PyDict>) -> PyResult<&'static str> {
    Ok(match event {
        Event::SkippedCheckpoint { error, moved_to } => {
            figures.set_item("error", error.to_string())?;
            figures.set_item("moved_to", moved_to)?;
            "skipped_checkpoint"
        }
        Event::Started(summary) => {
            let Summary { task, method, environment_steps, resumed_at, .. } = *summary;
            figures.set_item("task", task)?;
            figures.set_item("method", method)?;
            figures.set_item("environment_steps", environment_steps)?;
            figures.set_item("resumed_at", resumed_at)?;
            "started"
        }
        Event::Measuring => "measuring",
        Event::NewEpisode => "new_episode",
        Event::Pretrained { done, of } => {
            figures.set_item("done", done)?;
            figures.set_item("of", of)?;
            "pretrained"
        }
        Event::Stepped(progress) => {
            figures.set_item("agent_step", progress.agent_step)?;
            figures.set_item("environment_step", progress.environment_step)?;
            figures.set_item("updates", progress.updates)?;
            figures.set_item("last_return", progress.last_return)?;
            figures.set_item("last_evaluation", progress.last_evaluation)?;
            "stepped"
        }
        Event::EvaluationStepped => "evaluation_stepped",
        Event::EvaluationEpisode { done, of } => {
            figures.set_item("done", done)?;
            figures.set_item("of", of)?;
            "evaluation_episode"
        }
        Event::Evaluated(row) => {
            figures.set_item("agent_step", row.agent_step)?;
            figures.set_item("environment_step", row.environment_step)?;
            figures.set_item("episodes", row.episodes)?;
            figures.set_item("episode_return", row.episode_return)?;
            figures.set_item("episode_return_std", row.episode_return_std)?;
            "evaluated"
        }
        Event::Saved { environment_step } => {
            figures.set_item("environment_step", environment_step)?;
            "saved"
        }
        Event::Stopped(outcome) => {
            set_outcome(figures, outcome)?;
            "stopped"
        }
        Event::Finished(outcome) => {
            set_outcome(figures, outcome)?;
            "finished"
        }
    })
}

fn set_outcome(figures: &Bound<'_, PyDict>, outcome: &Outcome) -> PyResult<()> {
    let ending = match outcome.ending {
        Ending::Done => "done",
        Ending::DoneBefore => "done before",
        Ending::Stopped => "stopped",
    };
    figures.set_item("ending", ending)?;
    figures.set_item("final_return", outcome.final_return)?;
    figures.set_item("best_evaluation", outcome.best_evaluation)?;
    figures.set_item("environment_step", outcome.environment_step)?;
    figures.set_item("agent_step", outcome.agent_step)?;
    figures.set_item("wall_seconds", outcome.wall_seconds)
}
