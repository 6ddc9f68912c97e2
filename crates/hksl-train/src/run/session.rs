//! The training loop.

use std::collections::BTreeSet;
use std::sync::atomic::Ordering;
use std::time::Instant;

use hksl_core::rng;
use hksl_envs::{Environment, Step};
use hksl_sac::{Acting, Agent, Rollout, UpdateReport};
use ndarray::Array3;

use super::records::{Records, write_video};
use super::{Ending, Event, Outcome, Plan, Progress};
use crate::checkpoint::{Checkpoints, Content, Reason, RunState};
use crate::config::{ABLATION_NONE, Config, ReplayStorage};
use crate::evaluate::{Seen, evaluate, evaluation_environment};
use crate::metrics::EvaluationRow;
use crate::{Error, Result};

/// A run in progress: its parts, and where it is.
pub(super) struct Session<'a> {
    pub(super) plan: &'a Plan<'a>,
    pub(super) agent: Agent,
    pub(super) environment: Box<dyn Environment>,
    /// The running episode, as the policy has seen it.
    pub(super) rollout: Rollout,
    pub(super) state: RunState,
    pub(super) records: Records,
    pub(super) checkpoints: Checkpoints,
    pub(super) clock: Clock,
    /// The environment step of the newest save.
    pub(super) saved_at: Option<u64>,
    /// What the last update reported.
    pub(super) last_update: Vec<(String, f64)>,
    /// Where the weights of an interval were kept last; pretraining passes one step many times.
    pub(super) interval_at: Option<u64>,
}

/// A learning step that was taken, with its scalars copied from the device.
struct Learned {
    report: UpdateReport,
    values: Vec<(String, f64)>,
    seconds: f64,
}

/// An environment's step and the frame that it led to.
struct Stepped {
    step: Step,
    frame: Array3<u8>,
    seconds: f64,
}

/// Times of a run that may have been paused.
pub(super) struct Clock {
    started: Instant,
    seconds_before: f64,
    saved: Instant,
}

impl Clock {
    /// A clock of a run that has taken these seconds already.
    pub(super) fn going_on_from(seconds_before: f64) -> Self {
        let now = Instant::now();
        Self { started: now, seconds_before, saved: now }
    }

    fn seconds(&self) -> f64 {
        self.seconds_before + self.started.elapsed().as_secs_f64()
    }
}

impl Session<'_> {
    /// Trains, and saves the run if the environment of another program fails: agent and replay are sound, and only the
    /// agent step is lost.
    pub(super) fn run(mut self, watch: &mut dyn FnMut(&Event)) -> Result<Outcome> {
        let outcome = self.train(watch);
        if let Err(Error::Environment(error)) = &outcome
            && error.is_external()
            && self.saved_at != Some(self.state.environment_step)
        {
            self.save(BTreeSet::new(), watch)?;
        }
        outcome
    }

    /// Until the budget is used up or the run is asked to stop: evaluate and save where that is due, then take an
    /// agent step.
    fn train(&mut self, watch: &mut dyn FnMut(&Event)) -> Result<Outcome> {
        let Config { evaluation, checkpoint, .. } = self.plan.config;
        let budget = self.plan.config.budget_agent_steps();
        loop {
            let step = self.state.environment_step;
            let finished = self.state.agent_step >= budget;
            let keep = step.is_multiple_of(checkpoint.weights_every_environment_steps);
            let evaluate = finished || step.is_multiple_of(evaluation.every_environment_steps);
            if evaluate && self.state.evaluated_at != Some(step) {
                if let Some(best) = self.evaluate(watch)? {
                    let reasons =
                        [(keep, Reason::Interval), (best, Reason::Best), (finished, Reason::End)];
                    let kept = reasons.into_iter().filter(|(holds, _)| *holds);
                    self.save(kept.map(|(_, reason)| reason).collect(), watch)?;
                }
            } else if keep && !evaluate && self.interval_at != Some(step) {
                self.save(BTreeSet::from([Reason::Interval]), watch)?;
            } else if self.clock.saved.elapsed().as_secs_f64() >= 60.0 * checkpoint.minutes
                && self.saved_at != Some(step)
            {
                self.save(BTreeSet::new(), watch)?;
            }
            let evaluated = !evaluate || self.state.evaluated_at == Some(step);
            if finished && evaluated {
                return Ok(self.outcome(Ending::Done));
            }
            if self.plan.stop.load(Ordering::Relaxed) {
                if self.saved_at != Some(step) {
                    self.save(BTreeSet::new(), watch)?;
                }
                return Ok(self.outcome(Ending::Stopped));
            }
            if self.learns() && self.pretrain()? {
                let (done, of) = self.agent.learner().pretraining();
                watch(&Event::Pretrained { done, of });
                continue;
            }
            self.step()?;
            watch(&Event::Stepped(&Progress {
                agent_step: self.state.agent_step,
                environment_step: self.state.environment_step,
                updates: self.state.updates,
                last_return: self.state.last_return,
                last_evaluation: self.state.last_evaluation,
            }));
        }
    }

    /// Whether the initial random steps are over.
    fn learns(&self) -> bool {
        self.state.agent_step >= self.plan.config.training.initial_random_steps
    }

    /// One agent step in the order of the algorithm: choose, learn, act, store.
    fn step(&mut self) -> Result<()> {
        let config = self.plan.config;
        let began = Instant::now();
        let learns = self.learns();
        let acting = if learns { Acting::Sample } else { Acting::Uniform };
        let action = self.rollout.act(&mut self.agent, acting)?;
        self.state.window.add("act_seconds", began.elapsed().as_secs_f64());
        for number in &action {
            self.check_finite("action", f64::from(*number))?;
        }

        let (learned, stepped) = self.learn_and_step(learns, &action);
        if let Some(learned) = learned.map_err(|error| self.diagnosed(error))? {
            self.record_update(learned)?;
        }
        let Stepped { step, frame, seconds: mut environment_seconds } = stepped?;
        self.check_finite("reward", step.reward)?;
        let stored = self.agent.observe(&action, step.reward, step.terminal, frame.view());
        stored.map_err(|error| self.diagnosed(error))?;
        self.state.episode_return += step.reward;
        if step.last {
            self.agent.end_episode();
            self.state.window.add("episode_return", self.state.episode_return);
            self.state.last_return = Some(std::mem::take(&mut self.state.episode_return));
            let clock = Instant::now();
            let frame = self.rollout.reset(self.environment.as_mut())?;
            environment_seconds += clock.elapsed().as_secs_f64();
            self.agent.begin_episode(frame.view())?;
        }
        self.state.window.add("environment_seconds", environment_seconds);
        self.state.window.add("agent_step_seconds", began.elapsed().as_secs_f64());
        self.state.agent_step += 1;
        self.state.environment_step += config.environment.action_repeat as u64;
        let every = config.metrics.diagnostics_every_agent_steps;
        if self.state.updates > 0 && self.state.agent_step.is_multiple_of(every) {
            // A stream of its own for each time: nothing to be saved.
            let name = format!("diagnosis {}", self.state.agent_step);
            for (name, figure) in self.agent.diagnose(&mut rng::stream(config.seed, &name))? {
                self.state.window.add(&name, figure);
            }
        }
        if self.state.agent_step.is_multiple_of(config.metrics.every_agent_steps) {
            self.write_metrics()?;
        }
        Ok(())
    }

    /// A learning step, if the run `learns`, and the environment's step with its frame and its seconds. The learning step
    /// samples finished episodes only, so that with two threads or more both run at the same time, with the same results.
    fn learn_and_step(
        &mut self,
        learns: bool,
        action: &[f32],
    ) -> (hksl_sac::Result<Option<Learned>>, Result<Stepped>) {
        let Self { agent, environment, rollout, state, .. } = self;
        let agent_step = state.agent_step;
        let mut learn = || {
            let clock = Instant::now();
            let Some(report) = agent.update(agent_step)? else { return Ok(None) };
            let values = report.values()?;
            Ok(Some(Learned { report, values, seconds: clock.elapsed().as_secs_f64() }))
        };
        let mut step = || {
            let clock = Instant::now();
            let (step, frame) = rollout.step(environment.as_mut(), action)?;
            Ok(Stepped { step, frame, seconds: clock.elapsed().as_secs_f64() })
        };
        match (learns, rayon::current_num_threads()) {
            (false, _) => (Ok(None), step()),
            (true, 1) => (learn(), step()),
            (true, _) => {
                let mut learned = Ok(None);
                // The environment stays on this thread, to which its renderer belongs.
                let stepped = rayon::in_place_scope(|scope| {
                    scope.spawn(|_| learned = learn());
                    step()
                });
                (learned, stepped)
            }
        }
    }

    /// One learning step of those that come before the first agent step that learns; whether there was one.
    fn pretrain(&mut self) -> Result<bool> {
        let report = self.agent.pretrain();
        let report = report.map_err(|error| self.diagnosed(error))?;
        let Some(report) = report else { return Ok(false) };
        // Its figures belong to no agent step: they are checked, and no line of metrics mixes them with others.
        self.last_update = report.values()?;
        for (name, value) in &self.last_update {
            self.check_finite(name, *value)?;
        }
        // The same environment step, and another state.
        self.saved_at = None;
        Ok(true)
    }

    fn record_update(&mut self, Learned { report, values, seconds }: Learned) -> Result<()> {
        self.last_update = values;
        for (name, value) in &self.last_update {
            self.check_finite(name, *value)?;
            self.state.window.add(name, *value);
        }
        for (phase, seconds) in report.seconds() {
            self.state.window.add(&format!("{}_seconds", phase.name()), *seconds);
        }
        self.state.window.add("update_seconds", seconds);
        self.state.updates += 1;
        Ok(())
    }

    fn write_metrics(&mut self) -> Result<()> {
        let state = &mut self.state;
        let (updates, steps) =
            (state.window.count("update_seconds"), state.window.count("agent_step_seconds"));
        let mut values = state.window.take();
        let step_seconds = values.get("agent_step_seconds").copied().unwrap_or_default();
        if updates > 0 && step_seconds > 0.0 {
            let rate = updates as f64 / (steps as f64 * step_seconds);
            values.insert("updates_per_second".to_owned(), rate);
        }
        values.insert("updates".to_owned(), state.updates as f64);
        values.insert("replay_transitions".to_owned(), self.agent.replay().transitions() as f64);
        values.insert("wall_seconds".to_owned(), self.clock.seconds());
        self.records.metrics((state.agent_step, state.environment_step), &values)
    }

    /// Evaluates, writes the row, and says whether it is the best one so far; none, and no row, if the run was asked
    /// to stop meanwhile.
    fn evaluate(&mut self, watch: &mut dyn FnMut(&Event)) -> Result<Option<bool>> {
        let Plan { config, factories, .. } = self.plan;
        let step = self.state.environment_step;
        let mut environment = evaluation_environment(*factories, config, step)?;
        let keep = config.evaluation.video || config.metrics.tensorboard;
        let mut frames = Vec::new();
        let evaluation = evaluate(
            &mut self.agent,
            environment.as_mut(),
            config.environment.frame_stack,
            config.evaluation.episodes,
            self.plan.stop,
            &mut |seen| match seen {
                Seen::Frame { episode, frame } => {
                    if keep && episode == 0 {
                        frames.push(frame.to_owned());
                    }
                    watch(&Event::EvaluationStepped);
                }
                Seen::Return { episode, .. } => {
                    let of = config.evaluation.episodes;
                    watch(&Event::EvaluationEpisode { done: episode + 1, of });
                }
            },
        )?;
        let Some(evaluation) = evaluation else { return Ok(None) };
        let mut agent = config.method.clone();
        if config.ablation != ABLATION_NONE {
            agent.push_str(&format!("-{}", config.ablation));
        }
        let row = EvaluationRow {
            agent,
            task: config.task.clone(),
            distractor: config.distractor.clone(),
            seed: config.seed,
            environment_step: step,
            agent_step: self.state.agent_step,
            episodes: evaluation.returns.len(),
            episode_return: evaluation.mean(),
            episode_return_std: evaluation.std(),
            episode_return_min: evaluation.min(),
            episode_return_max: evaluation.max(),
            wall_seconds: self.clock.seconds(),
        };
        self.records.evaluation(&row, &frames)?;
        if config.evaluation.video {
            write_video(self.plan.folder, config, step, &frames)?;
        }
        watch(&Event::Evaluated(&row));
        let mean = row.episode_return;
        let best = self.state.best_evaluation.is_none_or(|(best, _)| mean > best);
        if best {
            self.state.best_evaluation = Some((mean, step));
        }
        self.state.evaluated_at = Some(step);
        self.state.last_evaluation = Some(mean);
        Ok(Some(best))
    }

    fn save(&mut self, reasons: BTreeSet<Reason>, watch: &mut dyn FnMut(&Event)) -> Result<()> {
        self.records.sync(&mut self.state)?;
        self.state.environment = self.environment.snapshot()?;
        self.state.wall_seconds = self.clock.seconds();
        let interval = reasons.contains(&Reason::Interval);
        let agent = self.agent.save()?;
        self.check_tensors(&agent.tensors)?;
        self.checkpoints.save(&Content {
            agent,
            replay: self.agent.replay(),
            run: &self.state,
            stack: self.rollout.frames(),
            memory: self.rollout.state().clone(),
            reasons,
        })?;
        self.saved_at = Some(self.state.environment_step);
        if interval {
            self.interval_at = self.saved_at;
        }
        if self.plan.config.replay.storage == ReplayStorage::File {
            let in_memory = self.agent.replay().finished().filter(|e| e.memory_bytes() > 0);
            let numbers: Vec<u64> = in_memory.map(|episode| episode.number()).collect();
            for number in numbers {
                let path = self.checkpoints.episode_file(number);
                match self.agent.replay_mut().keep_in_file(number, &path) {
                    // It is whole in memory, and tried again after the next save.
                    Err(hksl_sac::Error::Read { source, .. }) => {
                        tracing::warn!(
                            "cannot map {}, so it stays in memory: {source}",
                            path.display()
                        );
                    }
                    kept => kept?,
                }
            }
        }
        self.clock.saved = Instant::now();
        watch(&Event::Saved { environment_step: self.state.environment_step });
        Ok(())
    }

    fn outcome(&self, ending: Ending) -> Outcome {
        Outcome {
            ending,
            final_return: self.state.last_evaluation.unwrap_or(f64::NAN),
            best_evaluation: self.state.best_evaluation,
            environment_step: self.state.environment_step,
            agent_step: self.state.agent_step,
            wall_seconds: self.clock.seconds(),
        }
    }
}
