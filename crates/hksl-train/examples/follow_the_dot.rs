//! Trains methods on "follow the dot", a task of minutes: a random policy returns about 33 of 50, a good one 45 to 47.
//!
//! ```text
//! cargo run --release -p hksl-train --example follow_the_dot -- drq curl --set augmentation.pad=1
//! ```
//!
//! Three seeds of each method for 3,000 agent steps. The exit code is 1 if a run does not come to 44 of 50.
#![allow(clippy::unwrap_used)]

#[path = "../tests/support/dot.rs"]
mod dot;
#[path = "../tests/support/learning.rs"]
mod learning;

use std::process::ExitCode;

use learning::follow_the_dot;

const SEEDS: u64 = 3;
const AGENT_STEPS: u64 = 3000;
const ENOUGH: f64 = 44.0;

fn main() -> ExitCode {
    let (mut methods, mut sets) = (Vec::new(), Vec::new());
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        if argument == "--set" {
            sets.extend(arguments.next());
        } else {
            methods.push(argument);
        }
    }
    if methods.is_empty() {
        eprintln!("usage: follow_the_dot METHOD… [--set KEY=VALUE]…");
        return ExitCode::from(2);
    }
    let mut all_learnt = true;
    for method in methods {
        for seed in 1..=SEEDS {
            let returns = follow_the_dot(&method, seed, AGENT_STEPS, &sets);
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
