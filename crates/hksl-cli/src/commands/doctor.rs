//! `hksl doctor`.

mod finding;
mod gpus;
mod machine;
mod memory;
#[cfg(feature = "mujoco")]
mod mujoco;
mod runs_folder;
#[cfg(feature = "mujoco")]
mod test_frame;

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use hksl_train::memory::SystemMemory;

use crate::exit::Code;
use finding::Finding;
use memory::LargestRun;

/// Options of `hksl doctor`.
#[derive(Debug, Args)]
#[command(after_help = "Exit code: 0 if no check is marked `fail`, 3 if graphics, model files or \
                        MuJoCo are missing, else 1.\nWith --quiet, checks marked `ok` are not printed.")]
pub struct Arguments {
    /// Folder for runs, checked for access, speed and space
    #[arg(long, value_name = "DIR", default_value = "runs")]
    runs: PathBuf,
}

impl Arguments {
    /// Runs all checks and prints their findings.
    pub fn run(self, out: &mut dyn Write, quiet: bool) -> anyhow::Result<Code> {
        let mut findings = vec![machine::build(), machine::system(), machine::processor()];
        // Before the other checks allocate memory.
        let memory = SystemMemory::read();
        let largest = LargestRun::of_this_build();
        findings.push(memory::examine(memory, largest.as_ref()));
        findings.push(gpus::examine());
        findings.extend(tasks());
        findings.extend(runs_folder::examine(&self.runs, largest.as_ref()));
        for finding in findings.iter().filter(|finding| !quiet || !finding.is_fine()) {
            finding.write(out)?;
        }
        Ok(finding::exit_code(&findings))
    }
}

#[cfg(feature = "mujoco")]
fn tasks() -> Vec<Finding> {
    mujoco::examine()
}

/// A build without MuJoCo is a warning, not a failure.
#[cfg(not(feature = "mujoco"))]
fn tasks() -> Vec<Finding> {
    let names = |available| -> Vec<_> {
        let tasks = hksl_envs::tasks().iter().filter(|info| info.available == available);
        tasks.map(|info| info.name).collect()
    };
    let found = format!("not in this build; unavailable tasks: {}", names(false).join(", "));
    let advice = format!(
        "available: {}; for the others, run `make setup` in a checkout and build without \
         --no-default-features",
        names(true).join(", ")
    );
    vec![Finding::warn("MuJoCo", found, advice)]
}
