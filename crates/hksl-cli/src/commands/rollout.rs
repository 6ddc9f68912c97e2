//! `hksl rollout`.

use std::fs;
use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use hksl_envs::rollout::{Start, play};

use crate::exit::Code;

/// Options of `hksl rollout`.
#[derive(Debug, Args)]
#[command(after_help = "Example: hksl rollout --from start.json --out steps.json\n\n\
    The file holds task, qpos, qvel and actions, one a control step, and may hold\n  \
    qacc_warmstart, time and model. What comes out has reward, discount, qpos, qvel and\n  \
    probe after each control step.")]
pub struct Arguments {
    /// State and actions to play, JSON
    #[arg(long, value_name = "FILE")]
    from: PathBuf,

    /// Where the steps go, JSON [default: the screen]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

impl Arguments {
    /// Carries the command out.
    pub fn run(self, out: &mut dyn Write, quiet: bool) -> anyhow::Result<Code> {
        let text = fs::read_to_string(&self.from)
            .with_context(|| format!("{} cannot be read", self.from.display()))?;
        let start = Start::parse(&text).with_context(|| self.from.display().to_string())?;
        let rollout = play(&start).with_context(|| self.from.display().to_string())?;
        let mut steps = serde_json::to_string(&rollout)?;
        steps.push('\n');
        let Some(path) = self.out else {
            out.write_all(steps.as_bytes())?;
            return Ok(Code::Done);
        };
        fs::write(&path, steps).with_context(|| format!("{} cannot be written", path.display()))?;
        if !quiet {
            writeln!(
                out,
                "{}: {} control steps of {}, return {:.3}",
                path.display(),
                rollout.reward.len(),
                start.task,
                rollout.reward.iter().sum::<f64>()
            )?;
        }
        Ok(Code::Done)
    }
}
