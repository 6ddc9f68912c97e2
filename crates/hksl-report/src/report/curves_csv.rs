//! Curves in CSV files: published ones, and `eval.csv` outside its run.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use hksl_files::{ABLATION_NONE, CsvTable, DISTRACTOR_NONE, Names, Point, read_points};

use super::collected::Collected;
use super::error::{Error, Result};
use super::record::{Record, ignored_columns, in_order};
use super::suite::Suite;

const DRQV2: [&str; 5] = ["agent", "task", "seed", "frame", "episode_reward"];
/// Columns of `eval.csv` that a learning curve needs.
const EVALUATIONS: [&str; 6] =
    ["agent", "task", "distractor", "seed", "environment_step", "episode_return"];

/// Format of a file, by its columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    /// Curves published with drqv2 (github.com/facebookresearch/drqv2, `curves`).
    Drqv2,
    /// A run's `eval.csv`.
    Evaluations,
}

/// Detects the format of a file, or returns the missing columns of the most similar format.
///
/// # Errors
/// A file that cannot be read.
pub(super) fn format(file: &Path) -> Result<std::result::Result<Format, Vec<&'static str>>> {
    let table = match CsvTable::open(file) {
        Err(hksl_files::Error::Damaged { .. }) => return Ok(Err(DRQV2.to_vec())),
        table => table?,
    };
    let (drqv2, evaluations) = (table.lacking(&DRQV2), table.lacking(&EVALUATIONS));
    Ok(match (drqv2.is_empty(), evaluations.is_empty()) {
        (true, _) => Ok(Format::Drqv2),
        (_, true) => Ok(Format::Evaluations),
        _ if evaluations.len() < drqv2.len() => Err(evaluations),
        _ => Err(drqv2),
    })
}

/// Reads the runs in a file.
///
/// # Errors
/// Invalid rows.
pub(super) fn read(file: &Path, format: Format, names: &Names) -> Result<Collected> {
    let mut collected = match format {
        Format::Drqv2 => read_drqv2(file, names)?,
        Format::Evaluations => {
            let mut runs: BTreeMap<_, Vec<(u64, f64)>> = BTreeMap::new();
            let (points, ignored) = read_points(file)?;
            for point in points {
                let Point { agent, task, distractor, seed, environment_step, episode_return } =
                    point;
                let (Some(agent), Some(task), Some(distractor), Some(seed)) =
                    (agent, task, distractor, seed)
                else {
                    let reason = format!(
                        "the row of environment step {environment_step} lacks its agent, task, distractor or seed"
                    );
                    return Err(Error::damaged(file, reason));
                };
                let points = runs.entry((agent, task, distractor, seed)).or_default();
                points.push((environment_step, episode_return));
            }
            let mut records = Vec::new();
            for ((agent, task, distractor, seed), points) in runs {
                let labels = [agent, task, distractor];
                records.push(Record::of_points(labels, seed, points, file, names)?);
            }
            let said = ignored_columns(&ignored).map(|said| (file.to_owned(), said));
            Collected { records, skipped: said.into_iter().collect(), ..Collected::default() }
        }
    };
    if collected.records.is_empty() && collected.skipped.is_empty() {
        collected.skipped.push((file.to_owned(), "it has no rows".to_owned()));
    }
    Ok(collected)
}

fn read_drqv2(file: &Path, names: &Names) -> Result<Collected> {
    let mut runs: BTreeMap<(String, String, u64), Vec<(u64, f64)>> = BTreeMap::new();
    let mut table = CsvTable::open(file)?;
    let ignored = table.others(&[&DRQV2[..], &["hour"]].concat());
    while let Some(row) = table.next_row()? {
        let run = (row.text("agent")?.to_owned(), row.text("task")?.to_owned(), row.whole("seed")?);
        let point = (row.whole("frame")?, row.number("episode_reward")?);
        runs.entry(run).or_default().push(point);
    }
    let mut collected = Collected::default();
    collected.skipped.extend(ignored_columns(&ignored).map(|said| (file.to_owned(), said)));
    let mut unknown = BTreeSet::new();
    for ((agent, task, seed), points) in runs {
        let points = in_order(points, file)?;
        let Some((known, suite)) = ours(&task, names) else {
            unknown.insert(task);
            continue;
        };
        collected.records.push(Record {
            variant: agent.clone(),
            method: agent,
            ablation: ABLATION_NONE.to_owned(),
            task: known.to_owned(),
            distractor: DISTRACTOR_NONE.to_owned(),
            suite,
            seed,
            budget: points.last().map_or(0, |point| point.0),
            points,
            origin: file.to_owned(),
            run: None,
        });
    }
    if !unknown.is_empty() {
        let names: Vec<String> = unknown.into_iter().collect();
        let reason = format!("unknown task: {}; see `hksl tasks`", names.join(", "));
        collected.skipped.push((file.to_owned(), reason));
    }
    Ok(collected)
}

/// Converts drqv2's task names, which have underscores for hyphens and no `ball_in_` before `cup`.
fn ours(task: &str, names: &Names) -> Option<(&'static str, Suite)> {
    let underscored = |name: &str| name.replace('-', "_");
    let task = underscored(task);
    let known = names.tasks.iter().copied().find(|name| {
        let name = underscored(name);
        name == task || name.strip_prefix("ball_in_").is_some_and(|short| short == task)
    })?;
    Some((known, Suite::of(known, names)?))
}

/// Appends the file name to methods of published curves that have the same name as a method of the runs.
pub(super) fn name_apart(records: &mut [Record]) {
    let own: BTreeSet<String> = records
        .iter()
        .filter(|record| record.run.is_some())
        .map(|record| record.variant.clone())
        .collect();
    for record in
        records.iter_mut().filter(|record| record.run.is_none() && own.contains(&record.variant))
    {
        let file = record.origin.file_name().map(|name| name.to_string_lossy().into_owned());
        record.variant = format!("{} ({})", record.variant, file.unwrap_or_default());
        record.method = record.variant.clone();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hksl_files::EVALUATION_COLUMNS;

    fn names() -> Names {
        let control_tasks = vec!["cartpole-swingup", "walker-walk", "ball_in_cup-catch"];
        let tasks = [vec!["falling-pixels"], control_tasks.clone()].concat();
        Names { tasks, control_tasks, ..Names::default() }
    }

    #[test]
    fn drqv2s_tasks_are_ours() {
        for (theirs, name) in [
            ("cartpole_swingup", Some("cartpole-swingup")),
            ("cup_catch", Some("ball_in_cup-catch")),
            ("walker_walk", Some("walker-walk")),
            ("falling-pixels", Some("falling-pixels")),
            ("humanoid_walk", None),
        ] {
            assert_eq!(ours(theirs, &names()).map(|(name, _)| name), name);
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
        assert_eq!(of(",agent,task,seed,frame,episode_reward,hour\n"), Ok(Format::Drqv2));
        assert_eq!(of("agent, task, seed, frame, episode_reward\n"), Ok(Format::Drqv2));
        let columns = EVALUATION_COLUMNS.join(",");
        assert_eq!(of(&columns), Ok(Format::Evaluations));
        assert_eq!(of(&columns.replace("distractor,", "")), Err(vec!["distractor"]));
        assert_eq!(of("agent,task,seed,frame\n"), Err(vec!["episode_reward"]));
        assert_eq!(of("").unwrap_err().len(), 5);
    }

    #[test]
    fn curves_of_others_become_runs() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("curves.csv");
        let text = ",agent,task,seed,frame,episode_reward,hour\n\
                    0,DrQ-v2,cup_catch,2,0,10.5,0.1\n1,DrQ-v2,cup_catch,2,20000.0,900,0.2\n\
                    0,DrQ-v2,humanoid_walk,1,0,1,0\n0,DrQ-v2,humanoid_run,2,0,1,0\n";
        std::fs::write(&file, text).unwrap();
        let collected = read(&file, Format::Drqv2, &names()).unwrap();
        let [record] = &collected.records[..] else { panic!("{collected:?}") };
        assert_eq!(record.cell(), "DrQ-v2 on ball_in_cup-catch, seed 2");
        let points = &[(0, 10.5), (20_000, 900.0)][..];
        assert_eq!((record.points.as_slice(), record.budget), (points, 20_000));
        let [(_, reason)] = &collected.skipped[..] else { panic!("{collected:?}") };
        assert_eq!(reason, "unknown task: humanoid_run, humanoid_walk; see `hksl tasks`");
        std::fs::write(&file, text.replace("20000.0", "0")).unwrap();
        let message = read(&file, Format::Drqv2, &names()).unwrap_err().to_string();
        assert!(message.contains("two evaluations of one run at environment step 0"), "{message}");
        std::fs::write(&file, "agent,task,seed,frame,episode_reward\n").unwrap();
        assert_eq!(read(&file, Format::Drqv2, &names()).unwrap().skipped[0].1, "it has no rows");
    }
}
