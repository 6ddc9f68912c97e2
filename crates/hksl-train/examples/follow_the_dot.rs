//! Trains methods on "follow the dot", a task of minutes: a random policy returns about 33 of 50, a good one 45 to 47.
//!
//! ```text
//! cargo run --release -p hksl-train --example follow_the_dot -- sac drq curl pi-sac dbc
//! ```
//!
//! Seeds 1, 2 and 3 of each method, or `--seed N`, for 3,000 agent steps, or `--agent-steps N`; `--set KEY=VALUE` sets a
//! key, as for `hksl train`. FrameWriter are shifted where the method compares views of one (`drq`, `curl`: pad 1), and
//! nowhere else, for a shift moves the agent beside the dot. The exit code is 1 if a run does not come to 44 of 50.
#![allow(clippy::unwrap_used)]

#[path = "../tests/it/support/dot.rs"]
mod dot;
#[path = "../tests/it/support/learning.rs"]
mod learning;

use std::process::ExitCode;

use learning::follow_the_dot;

const ENOUGH: f64 = 44.0;

fn main() -> ExitCode {
    let (mut methods, mut sets) = (Vec::new(), Vec::new());
    let (mut agent_steps, mut seeds) = (3000, 1..=3);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let understood = match argument.as_str() {
            "--set" => arguments.next().map(|set| sets.push(set)).is_some(),
            "--agent-steps" => number(arguments.next()).map(|given| agent_steps = given).is_some(),
            "--seed" => number(arguments.next()).map(|seed| seeds = seed..=seed).is_some(),
            option if option.starts_with('-') => false,
            method => {
                methods.push(method.to_owned());
                true
            }
        };
        if !understood {
            methods.clear();
            break;
        }
    }
    if methods.is_empty() {
        eprintln!("usage: follow_the_dot METHOD… [--agent-steps N] [--seed N] [--set KEY=VALUE]…");
        return ExitCode::from(2);
    }
    let mut all_learnt = true;
    for method in methods {
        let views = ["drq", "curl"].contains(&method.as_str());
        let mut sets = sets.clone();
        sets.insert(0, format!("augmentation.pad={}", u8::from(views)));
        for seed in seeds.clone() {
            let returns = follow_the_dot(&method, seed, agent_steps, &sets);
            let best = returns.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let verdict = if best >= ENOUGH { "learnt" } else { "NOT learnt" };
            println!(
                "{method}, seed {seed}: best {best:.1} of 50, {verdict}; every 250 steps {returns:.1?}"
            );
            all_learnt &= best >= ENOUGH;
        }
    }
    if all_learnt { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn number(argument: Option<String>) -> Option<u64> {
    argument?.parse().ok()
}
