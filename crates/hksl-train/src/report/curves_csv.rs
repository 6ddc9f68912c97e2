//! Curves in CSV files: other people's, and `eval.csv` away from its run.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::collect::Collected;
use super::record::{Record, in_order};
use crate::config::{ABLATION_NONE, DISTRACTOR_NONE, tasks};
use crate::metrics::{EvaluationRow, read_evaluations};
use crate::{Error, Result};

/// What a file of curves has to have.
pub(super) const EXPECTED: &str = "a file of curves has the columns agent, task, seed, frame and episode_reward, as those \
                                   that drqv2 published, or the columns of eval.csv";

/// Whose columns a file has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    /// Those of the curves that drqv2 published (github.com/facebookresearch/drqv2, `curves`).
    Drqv2,
    /// Those of a run's `eval.csv`.
    Evaluations,
}

/// A row of drqv2's; its other columns, an index and hours, do not matter here.
#[derive(Debug, Deserialize)]
struct Drqv2Row {
    agent: String,
    task: String,
    seed: u64,
    /// Environment steps.
    frame: f64,
    episode_reward: f64,
}

/// Whose columns a file has, if they are known ones.
///
/// # Errors
/// A file that cannot be read.
pub(super) fn format(file: &Path) -> Result<Option<Format>> {
    let opened = std::fs::File::open(file).map_err(|source| Error::read(file, source))?;
    let mut reader = csv::Reader::from_reader(opened);
    let Ok(header) = reader.headers() else {
        return Ok(None);
    };
    let has = |names: &[&str]| names.iter().all(|name| header.iter().any(|column| column == *name));
    Ok(if has(&["agent", "task", "seed", "frame", "episode_reward"]) {
        Some(Format::Drqv2)
    } else if has(&["agent", "task", "distractor", "seed", "environment_step", "episode_return"]) {
        Some(Format::Evaluations)
    } else {
        None
    })
}

/// Adds a file's runs.
///
/// # Errors
/// Rows that do not fit.
pub(super) fn read(file: &Path, format: Format, collected: &mut Collected) -> Result<()> {
    match format {
        Format::Drqv2 => read_drqv2(file, collected),
        Format::Evaluations => {
            let mut runs: BTreeMap<_, Vec<EvaluationRow>> = BTreeMap::new();
            for row in read_evaluations(file)? {
                let run = (row.agent.clone(), row.task.clone(), row.distractor.clone(), row.seed);
                runs.entry(run).or_default().push(row);
            }
            for rows in runs.values() {
                collected.records.push(Record::of_rows(rows, file)?);
            }
            Ok(())
        }
    }
}

fn read_drqv2(file: &Path, collected: &mut Collected) -> Result<()> {
    let damaged = |error: csv::Error| Error::damaged(file, error);
    let mut runs: BTreeMap<(String, String, u64), Vec<(u64, f64)>> = BTreeMap::new();
    for row in csv::Reader::from_path(file).map_err(damaged)?.deserialize() {
        let row: Drqv2Row = row.map_err(damaged)?;
        if !(row.frame >= 0.0 && row.frame.fract() == 0.0 && row.frame < 1e15) {
            return Err(Error::damaged(file, format!("frame {} is no number of steps", row.frame)));
        }
        let run = (row.agent, row.task, row.seed);
        runs.entry(run).or_default().push((row.frame as u64, row.episode_reward));
    }
    for ((agent, task, seed), points) in runs {
        let Some(known) = ours(&task) else {
            let reason = format!("`{task}` is none of the tasks of `hksl tasks`");
            if collected
                .left_out
                .last()
                .is_none_or(|(path, last)| (path.as_path(), last) != (file, &reason))
            {
                collected.left_out.push((file.to_owned(), reason));
            }
            continue;
        };
        let points = in_order(points, file)?;
        collected.records.push(Record {
            variant: agent.clone(),
            method: agent,
            ablation: ABLATION_NONE.to_owned(),
            task: known.to_owned(),
            distractor: DISTRACTOR_NONE.to_owned(),
            seed,
            budget: points.last().map_or(0, |point| point.0),
            points,
            origin: file.to_owned(),
            run: None,
        });
    }
    Ok(())
}

/// Our name of a task that is called as in drqv2: all underscores, and no ball before the cup.
fn ours(task: &str) -> Option<&'static str> {
    let underscored = |name: &str| name.replace('-', "_");
    let task = underscored(task);
    tasks().into_iter().find(|name| {
        let name = underscored(name);
        name == task || name.strip_prefix("ball_in_").is_some_and(|short| short == task)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drqv2s_tasks_are_ours() {
        for (theirs, name) in [
            ("cartpole_swingup", Some("cartpole-swingup")),
            ("cup_catch", Some("ball_in_cup-catch")),
            ("walker_walk", Some("walker-walk")),
            ("falling-pixels", Some("falling-pixels")),
            ("humanoid_walk", None),
        ] {
            assert_eq!(ours(theirs), name);
        }
    }

    #[test]
    fn files_are_told_apart_by_their_columns() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.csv");
        let of = |text: &str| {
            std::fs::write(&file, text).unwrap();
            format(&file).unwrap()
        };
        assert_eq!(of(",agent,task,seed,frame,episode_reward,hour\n"), Some(Format::Drqv2));
        let columns =
            "agent,task,distractor,seed,environment_step,agent_step,episodes,episode_return";
        assert_eq!(of(columns), Some(Format::Evaluations));
        assert_eq!(of("agent,task,seed,frame\n"), None);
        assert_eq!(of(""), None);
    }

    #[test]
    fn curves_of_others_become_runs() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("curves.csv");
        let text = ",agent,task,seed,frame,episode_reward,hour\n\
                    0,DrQ-v2,cup_catch,2,0,10.5,0.1\n1,DrQ-v2,cup_catch,2,20000,900,0.2\n\
                    0,DrQ-v2,humanoid_walk,1,0,1,0\n0,DrQ-v2,humanoid_walk,2,0,1,0\n";
        std::fs::write(&file, text).unwrap();
        let mut collected = Collected::default();
        read(&file, Format::Drqv2, &mut collected).unwrap();
        let [record] = &collected.records[..] else { panic!("{collected:?}") };
        assert_eq!(record.cell(), "DrQ-v2 on ball_in_cup-catch, seed 2");
        assert_eq!(
            (record.points.as_slice(), record.budget),
            (&[(0, 10.5), (20_000, 900.0)][..], 20_000)
        );
        assert_eq!(collected.left_out.len(), 1, "{:?}", collected.left_out);
        std::fs::write(&file, text.replace("20000", "0")).unwrap();
        let message = read(&file, Format::Drqv2, &mut collected).unwrap_err().to_string();
        assert!(message.contains("two evaluations at environment step 0"), "{message}");
    }
}
