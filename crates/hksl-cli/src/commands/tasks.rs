//! `hksl tasks`.

use std::io::Write;

use hksl_envs::TaskInfo;
use hksl_train::config::{Request, distractors, resolve};

use crate::exit::Code;
use crate::table::{self, Align};

/// Prints one line per task, from its configuration and its environment.
pub fn run(out: &mut dyn Write, quiet: bool) -> anyhow::Result<Code> {
    let rows = hksl_envs::tasks().iter().map(row).collect::<anyhow::Result<Vec<_>>>()?;
    let columns = [
        ("TASK", Align::Left),
        ("ACTION DIMENSIONS", Align::Right),
        ("ACTION REPEAT", Align::Right),
        ("STEPS/EPISODE", Align::Right),
        ("REWARD", Align::Left),
        ("NEEDS MUJOCO", Align::Left),
        ("IN THIS BUILD", Align::Left),
    ];
    table::write(out, &columns, &rows)?;
    if !quiet {
        writeln!(out)?;
        for info in hksl_envs::tasks() {
            writeln!(out, "{}: {}", info.name, info.summary)?;
        }
        writeln!(
            out,
            "\nSTEPS/EPISODE counts agent steps; each repeats its action for ACTION REPEAT \
             environment steps.\nValues of `--distractor`, for tasks that need MuJoCo: {}.",
            distractors().join(", ")
        )?;
    }
    Ok(Code::Done)
}

fn row(info: &TaskInfo) -> anyhow::Result<Vec<String>> {
    let request = Request { task: Some(info.name.to_owned()), ..Request::default() };
    let config = resolve(&request)?.config;
    Ok(vec![
        info.name.to_owned(),
        info.action_dims.to_string(),
        config.environment.action_repeat.to_string(),
        config.episode_agent_steps().to_string(),
        info.reward.to_string(),
        yes_no(info.needs_mujoco),
        yes_no(info.available),
    ])
}

fn yes_no(yes: bool) -> String {
    if yes { "yes" } else { "no" }.to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_task_has_a_line_with_its_own_figures() {
        let mut out = Vec::new();
        run(&mut out, true).unwrap();
        let text = String::from_utf8(out).unwrap();
        assert_eq!(text.lines().count(), 1 + hksl_envs::tasks().len());
        let cells = |name: &str| -> Vec<String> {
            let line = text.lines().find(|line| line.starts_with(name)).unwrap();
            line.split_whitespace().skip(1).take(3).map(str::to_owned).collect()
        };
        assert_eq!(cells("falling-pixels"), ["1", "1", "250"]);
        assert_eq!(cells("cartpole-swingup"), ["1", "8", "125"]);
    }
}
