//! Opening a session from a plan.

use hksl_core::rng;
use hksl_sac::Rollout;

use super::memory::{RunMemory, check_least};
use super::records::Records;
use super::session::{Clock, Session};
use super::{Event, Plan, Summary, check_resumable, facts};
use crate::Result;
use crate::checkpoint::{self, Checkpoints, RunState, Saved};
use crate::memory::SystemMemory;

impl<'a> Session<'a> {
    /// Starts a run, or resumes it from the newest intact state, after all checks. The caller holds the run's lock.
    ///
    /// # Errors
    /// As [`super::train`].
    pub(super) fn open(plan: &'a Plan<'a>, watch: &mut dyn FnMut(&Event)) -> Result<Self> {
        let Plan { config, folder, .. } = *plan;
        // Read before this run allocates memory.
        let memory = SystemMemory::read();
        check_least(plan.device.is_cpu(), memory)?;
        watch(&Event::Measuring);
        let measured = RunMemory::measure(plan, memory)?;
        let mut environment =
            plan.factories.environment(config, rng::stream(config.seed, "env"))?;
        let mut agent = plan.factories.agent(config, environment.spec(), &plan.device)?;
        let facts = facts::gather(plan, environment.spec());
        let mut summary = Summary {
            memory: measured,
            available_bytes: memory.map(|memory| memory.available),
            ..Summary::of(plan, environment.spec(), &agent, &facts)?
        };
        summary.check_memory(memory)?;
        // Checked again, because another process may have written to the run in the meantime.
        check_resumable(plan)?;
        let mut rollout = Rollout::new(config.environment.frame_stack, environment.spec().frame);
        let mut checkpoints = Checkpoints::of_run(folder);
        let layout = *agent.replay().layout();
        let (saved, skipped) = checkpoints.load_newest(&layout, config.replay.storage)?;
        let saved_at = saved.as_ref().map(|saved| saved.run.environment_step);
        let mut new_episode = false;
        let state = match saved {
            Some(saved) => {
                let Saved { run, agent: agent_state, stack: frames, finished, running, .. } = saved;
                let mut run = run;
                environment.restore(&run.environment)?;
                rollout.restore(frames, saved.memory)?;
                agent.load(agent_state).map_err(|error| checkpoint::Error::OtherWeights {
                    environment_step: run.environment_step,
                    method: config.method.clone(),
                    reason: error.to_string(),
                })?;
                agent.replay_mut().restore(finished, running)?;
                if !environment.restores_episodes() {
                    new_episode = true;
                    run.episode_return = 0.0;
                    let frame = rollout.reset(environment.as_mut())?;
                    // Ends the interrupted episode without a terminal state.
                    agent.begin_episode(frame.view())?;
                }
                run
            }
            None => {
                let frame = rollout.reset(environment.as_mut())?;
                agent.begin_episode(frame.view())?;
                RunState::default()
            }
        };
        for damage in skipped {
            let moved_to = checkpoints.set_aside(&damage)?;
            watch(&Event::SkippedCheckpoint { error: &damage.error, moved_to: &moved_to });
        }
        let records = Records::open(folder, config, &state)?;
        folder.describe(&config.to_toml()?, &plan.command, &facts)?;
        folder.mark_done(false)?;
        folder.mark_going()?;
        summary.resumed_at = saved_at;
        watch(&Event::Started(&summary));
        if new_episode {
            watch(&Event::NewEpisode);
        }
        Ok(Self {
            records,
            clock: Clock::going_on_from(state.wall_seconds),
            plan,
            agent,
            environment,
            rollout,
            state,
            checkpoints,
            saved_at,
            last_update: Vec::new(),
            interval_at: saved_at,
        })
    }
}
