//! Carrying a run out, from its start or from where it was.

mod event;
mod facts;
mod health;
mod memory;
mod session;

use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;

use candle_core::{Device, Tensor};
use hksl_core::rng;
use hksl_envs::FrameStack;
use hksl_sac::Agent;
use serde_json::Value;

pub use event::{Event, Outcome, Progress, Summary};
use session::Session;

use crate::checkpoint::{RunState, Saved};
use crate::config::{Config, Difference};
use crate::factories::Factories;
use crate::folder::RunFolder;
use crate::metrics::{EvalCsv, MetricsFile, read_evaluations};
use crate::{Error, Result, device};

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
    /// What to do if it has begun already.
    pub resume: Resume,
    /// Set it to end the run after its agent step, saved.
    pub stop: &'a AtomicBool,
}

/// Carries a run out: starts it, or goes on with it, until its budget is used up. `watch` hears how it goes.
///
/// # Errors
/// A folder that holds another run or that another process works on, states that cannot be read, a disk that cannot
/// be written, too little memory, a number that is not finite; whatever the environment or the agent reports. What
/// was saved before stays.
pub fn train(plan: &Plan, watch: &mut dyn FnMut(&Event)) -> Result<Outcome> {
    let Plan { config, folder, .. } = *plan;
    if let Some(outcome) = finished_already(plan, check_resumable(plan)?)? {
        watch(&Event::Finished(&outcome));
        return Ok(outcome);
    }
    let mut environment = plan.factories.environment(rng::stream(config.seed, "env"))?;
    let mut agent = plan.factories.agent(environment.spec(), &plan.device)?;
    let _lock = folder.lock()?;
    // Again, for another process may have worked on it until now.
    check_resumable(plan)?;
    let mut stack = FrameStack::new(config.environment.frame_stack, environment.spec().frame);
    let mut checkpoints = folder.checkpoints();
    let layout = *agent.replay().layout();
    let (saved, passed_over) = checkpoints.load_newest(&layout, config.replay.storage)?;
    let saved_step = saved.as_ref().map(|saved| saved.run.environment_step);
    let facts = facts::gather(config, &plan.device);
    let summary = Summary::of(plan, environment.spec(), agent.as_ref(), &facts, saved_step);
    summary.check_memory()?;
    let state = match saved {
        Some(Saved { run, agent: agent_state, stack: frames, finished, running }) => {
            environment.restore(&run.environment)?;
            stack.restore(frames)?;
            agent.load(agent_state)?;
            agent.replay_mut().restore(finished, running)?;
            run
        }
        None => {
            environment.reset()?;
            let frame = environment.frame()?;
            stack.reset(&frame)?;
            agent.begin_episode(frame.view())?;
            RunState::default()
        }
    };
    for damage in passed_over {
        let moved_to = checkpoints.set_aside(&damage)?;
        watch(&Event::PassedOver { error: &damage.error, moved_to: &moved_to });
    }
    folder.describe(config, &plan.command, &facts)?;
    folder.mark_done(false)?;
    watch(&Event::Started(&summary));
    let metrics = MetricsFile::open(&folder.metrics_file(), state.metrics_bytes)?;
    let evaluations = EvalCsv::open(&folder.eval_file(), state.eval_bytes)?;
    let mut session =
        Session::new(plan, agent, environment, stack, state, metrics, evaluations, checkpoints);
    session.saved_at = saved_step;
    let outcome = session.run(watch).map_err(|error| keep_failure(folder, error))?;
    if outcome.stopped {
        watch(&Event::Stopped(&outcome));
    } else {
        folder.mark_done(true)?;
        watch(&Event::Finished(&outcome));
    }
    Ok(outcome)
}

/// What the first screen of the run would say; nothing is written.
///
/// # Errors
/// As [`train`], for what can be known beforehand.
pub fn preview(plan: &Plan) -> Result<Summary> {
    let resumed_at = check_resumable(plan)?;
    let environment = plan.factories.environment(rng::stream(plan.config.seed, "env"))?;
    let agent = plan.factories.agent(environment.spec(), &plan.device)?;
    let facts = facts::gather(plan.config, &plan.device);
    Ok(Summary::of(plan, environment.spec(), agent.as_ref(), &facts, resumed_at))
}

/// The environment step of the newest state, after every check that forbids to go on from it; none if the run has
/// not begun, or was stopped before its first save.
fn check_resumable(plan: &Plan) -> Result<Option<u64>> {
    let Plan { config, folder, .. } = *plan;
    if !folder.is_begun() {
        return Ok(None);
    }
    if plan.resume == Resume::Never {
        return Err(Error::RunExists { folder: folder.path().to_owned() });
    }
    let differences: Vec<Difference> =
        folder.config()?.difference(config)?.into_iter().filter(|d| !d.may_change).collect();
    if !differences.is_empty() {
        return Err(Error::OtherConfig { folder: folder.path().to_owned(), differences });
    }
    let step = folder.checkpoints().newest_state()?;
    if let Some(done) = step.filter(|&done| done > config.environment_steps) {
        let (folder, budget) = (folder.path().to_owned(), config.environment_steps);
        return Err(Error::SmallerBudget { folder, done, budget });
    }
    Ok(step)
}

/// The last screen's figures, if the budget is used up.
fn finished_already(plan: &Plan, saved_step: Option<u64>) -> Result<Option<Outcome>> {
    let Plan { config, folder, .. } = *plan;
    if !folder.done_file().is_file() || saved_step != Some(config.environment_steps) {
        return Ok(None);
    }
    let rows = read_evaluations(&folder.eval_file())?;
    Ok(rows.last().map(|last| Outcome {
        final_return: last.episode_return,
        best_evaluation: rows
            .iter()
            .map(|row| (row.episode_return, row.environment_step))
            .reduce(|best, row| if row.0 > best.0 { row } else { best }),
        environment_step: last.environment_step,
        agent_step: last.agent_step,
        wall_seconds: last.wall_seconds,
        was_done: true,
        stopped: false,
    }))
}

/// Writes down what a simulation failed on.
fn keep_failure(folder: &RunFolder, error: Error) -> Error {
    let Error::Environment(hksl_envs::Error::Physics { before, .. }) = &error else { return error };
    let path = folder.failure_file();
    match std::fs::write(&path, format!("{before:#}\n")) {
        Ok(()) => match error {
            Error::Environment(source) => Error::Simulation { path, source: Box::new(source) },
            error => error,
        },
        // Why the run ended matters more than that this could not be written.
        Err(_) => error,
    }
}

/// Bytes of the run's folder: weights at each interval, the best and the last; three states while one is written;
/// and the episodes of all three.
fn disk_bytes(config: &Config, agent: &dyn Agent, episode: usize, replay_bytes: u64) -> u64 {
    let bytes = |numbers: usize| 4 * numbers as u64;
    let weights = bytes(agent.weights().values().map(Tensor::elem_count).sum());
    let trained = bytes(agent.networks().iter().map(|(_, count)| count).sum());
    let kept = config.environment_steps / config.checkpoint.weights_every_environment_steps + 3;
    // All weights and their slow copies, two moments of each that is trained.
    let state = 2 * weights + 2 * trained;
    let ahead = 3 * (episode * agent.replay().layout().transition_bytes()) as u64;
    kept * weights + 3 * (weights + state) + replay_bytes + ahead
}

impl Summary {
    fn of(
        plan: &Plan,
        spec: &hksl_envs::Spec,
        agent: &dyn hksl_sac::Agent,
        facts: &BTreeMap<String, Value>,
        resumed_at: Option<u64>,
    ) -> Self {
        let config = plan.config;
        let layout = agent.replay().layout();
        let stored = config.replay.capacity.min(config.budget_agent_steps() as usize);
        let replay_bytes = (stored * layout.transition_bytes()) as u64;
        Self {
            task: config.task_label(),
            method: config.method.clone(),
            ablation: config.ablation.clone(),
            observation: layout.observation(),
            action_dims: spec.action_dims,
            agent_steps_per_episode: spec.steps_per_episode,
            networks: agent.networks(),
            replay_transitions: stored,
            replay_bytes,
            replay_storage: config.replay.storage,
            disk_bytes: disk_bytes(config, agent, spec.steps_per_episode, replay_bytes),
            learning_bytes: agent.learning_bytes(),
            available_bytes: memory::available(),
            device: device::name(&plan.device),
            threads: rayon::current_num_threads(),
            renderer: facts.get("renderer").and_then(Value::as_str).map(str::to_owned),
            environment_steps: config.environment_steps,
            agent_steps: config.budget_agent_steps(),
            learning_steps: config
                .budget_agent_steps()
                .saturating_sub(config.training.initial_random_steps),
            folder: std::path::absolute(plan.folder.path())
                .unwrap_or_else(|_| plan.folder.path().to_owned()),
            resumed_at,
        }
    }
}
