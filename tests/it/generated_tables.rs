//! The documentation's tables of tasks and methods follow the registries.

use std::fmt::Write;
use std::fs;

use hksl_envs::{RewardKind, tasks};
use hksl_tests::book::root;
use hksl_train::config::{METHODS, Request, default_method, resolve};

/// Rewrites the tables: `HKSL_WRITE_TABLES=1 cargo test --workspace --release --test it generated_tables`.
const WRITE: &str = "HKSL_WRITE_TABLES";

/// Compares the lines between `<!-- NAME -->` and `<!-- end -->` with this table.
fn compare(page: &str, name: &str, table: &str) {
    let path = root().join(page);
    let text = fs::read_to_string(&path).unwrap();
    let start = format!("<!-- {name} -->\n");
    let (before, rest) = text.split_once(&start).unwrap();
    let (current, after) = rest.split_once("<!-- end -->").unwrap();
    let table = format!("\n{table}\n");
    if std::env::var_os(WRITE).is_some() {
        fs::write(&path, [before, &start, &table, "<!-- end -->", after].concat()).unwrap();
    } else {
        let command =
            format!("{WRITE}=1 cargo test --workspace --release --test it generated_tables");
        assert_eq!(
            current, table,
            "{page} is out of date; to regenerate its table, run\n{command}\n"
        );
    }
}

#[test]
fn the_page_of_environments_lists_every_task() {
    let mut table =
        "| task | action dimensions | action repeat | control step, s | agent steps per episode \
                     | reward per control step | goal |\n|---|---|---|---|---|---|---|\n"
            .to_owned();
    for task in tasks() {
        let request = Request { task: Some(task.name.to_owned()), ..Request::default() };
        let config = resolve(&request).unwrap().config;
        let seconds = task.control_step_milliseconds;
        let seconds = seconds.map_or("–".to_owned(), |ms| (f64::from(ms) / 1000.0).to_string());
        let reward = match task.reward {
            RewardKind::ZeroOne => "0 or 1",
            RewardKind::Graded => "0 to 1",
        };
        writeln!(
            table,
            "| `{}` | {} | {} | {seconds} | {} | {reward} | {} |",
            task.name,
            task.action_dims,
            config.environment.action_repeat,
            config.episode_agent_steps(),
            task.summary
        )
        .unwrap();
    }
    compare("docs/environments.md", "tasks", &table);
}

#[test]
fn the_page_of_concepts_lists_every_method() {
    let mut table = "| `--method` | learns by |\n|---|---|\n".to_owned();
    for method in METHODS {
        writeln!(table, "| `{}` | {} |", method.name, method.summary).unwrap();
    }
    compare("docs/concepts.md", "methods", &table);
}

/// Papers and original code stand beside the names, so people write this table.
#[test]
fn the_page_of_baselines_describes_every_baseline() {
    let text = fs::read_to_string(root().join("docs/baselines.md")).unwrap();
    let table = text.lines().skip_while(|line| !line.starts_with("| `--method`")).skip(2);
    let rows = table.take_while(|line| line.starts_with('|'));
    let listed: Vec<&str> = rows.filter_map(|row| row.split('`').nth(1)).collect();
    let names = METHODS.iter().map(|method| method.name);
    let baselines: Vec<&str> = names.filter(|name| *name != default_method()).collect();
    assert_eq!(listed, baselines, "the first table of docs/baselines.md");
}
