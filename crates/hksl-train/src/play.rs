//! Playing a policy without learning, step by step, for people and programs to look at.

use hksl_core::rng;
use hksl_envs::rollout::Steps;
use hksl_envs::{Environment, FrameStack};
use hksl_sac::{Acting, Agent, RecurrentState};
use ndarray::ArrayView3;
use rand::Rng;

use crate::Result;
use crate::config::Config;
use crate::factories::settings;

/// Where actions come from, one for each agent step.
pub enum Policy {
    /// Uniformly random.
    Random,
    /// No push at all.
    Zero,
    /// The deterministic action of a trained agent.
    Trained(Box<Agent>),
}

/// Progress of [`play`]: the control step, and the frame if one is rendered.
pub type Watch<'a> = &'a mut dyn FnMut(usize, Option<ArrayView3<u8>>) -> Result<()>;

/// Plays `control_steps` control steps from a reset; episodes that end are followed by the next. Each action is held
/// for the configuration's action repeat; frames are rendered, if `render` is set or if the policy needs them, where the
/// agent would see one.
///
/// # Errors
/// Whatever the environment, the agent or `watch` reports.
pub fn play(
    config: &Config,
    mut policy: Policy,
    seed: u64,
    control_steps: usize,
    render: bool,
    watch: Watch<'_>,
) -> Result<Steps> {
    let mut environment =
        hksl_envs::make(&config.task, &settings(config), rng::stream(seed, "rollout"))?;
    let mut random = rng::stream(seed, "rollout actions");
    let mut stack = FrameStack::new(config.environment.frame_stack, environment.spec().frame);
    let render = render || matches!(policy, Policy::Trained(_));
    let mut steps = Steps::default();
    let mut action = Vec::new();
    let mut held = 0;
    let mut memory = RecurrentState::default();
    let mut begins = true;
    for step in 0..control_steps {
        if begins {
            environment.reset()?;
            held = 0;
            memory = RecurrentState::default();
            if render {
                let frame = environment.frame()?;
                stack.reset(&frame)?;
                watch(step, Some(frame.view()))?;
            }
        }
        if held == 0 {
            let environment = environment.as_ref();
            action = decide(&mut policy, &mut random, &stack, &mut memory, environment)?;
        }
        let outcome = environment.step(&action)?;
        steps.push(environment.as_ref(), &action, outcome);
        held = (held + 1) % config.environment.action_repeat;
        let mut seen = None;
        if render && (held == 0 || outcome.last) {
            let frame = environment.frame()?;
            stack.push(&frame)?;
            seen = Some(frame);
        }
        watch(step + 1, seen.as_ref().map(|frame| frame.view()))?;
        begins = outcome.last;
    }
    Ok(steps)
}

fn decide(
    policy: &mut Policy,
    random: &mut impl Rng,
    stack: &FrameStack,
    memory: &mut RecurrentState,
    environment: &dyn Environment,
) -> Result<Vec<f32>> {
    let dims = environment.spec().action_dims;
    Ok(match policy {
        Policy::Random => (0..dims).map(|_| random.random_range(-1.0..=1.0)).collect(),
        Policy::Zero => vec![0.0; dims],
        Policy::Trained(agent) => agent.act(stack.observation().view(), Acting::Mean, memory)?,
    })
}
