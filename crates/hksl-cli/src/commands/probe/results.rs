//! Results of probes as files, figures and a table.

use std::collections::BTreeSet;
use std::io::Write;

use hksl_probe::encoders::ALL_ENCODERS;
use hksl_probe::linear_probe::Errors;
use hksl_report::plot::{BarPanel, bars};
use serde_json::{Value, json};

use crate::numbers::grouped;
use crate::output::Output;
use crate::table::{self, Align};

/// Result of one encoder at one horizon.
pub struct Row {
    /// The run's folder.
    pub run: String,
    /// Its method, ablation and name.
    pub label: String,
    /// Its seed.
    pub seed: u64,
    /// Its task.
    pub task: String,
    /// The distractor of the training.
    pub trained_in: String,
    /// The distractor of the episodes.
    pub probed_in: String,
    /// Fingerprint of the episodes.
    pub data: String,
    /// Environment step of the checkpoint.
    pub environment_step: u64,
    /// Name of the encoder, or `all`.
    pub encoder: String,
    /// Horizon in agent steps.
    pub horizon: usize,
    /// Unit of the coordinates, if they share one.
    pub unit: Option<String>,
    /// Prediction errors.
    pub errors: Errors,
}

impl Row {
    fn transfer(&self) -> bool {
        self.trained_in != self.probed_in
    }

    fn setting(&self) -> String {
        if self.transfer() {
            format!("{} (transfer from {})", self.probed_in, self.trained_in)
        } else {
            self.probed_in.clone()
        }
    }
}

/// All results, in the order of the probes.
pub struct Results {
    /// One row for each run, setting, checkpoint, encoder and horizon.
    rows: Vec<Row>,
    /// Tasks with a setting in which runs were probed on different episodes.
    divided: BTreeSet<String>,
}

impl Results {
    /// Results of these rows.
    pub fn new(rows: Vec<Row>) -> Self {
        let seen: BTreeSet<_> =
            rows.iter().map(|row| (&row.task, &row.probed_in, &row.data)).collect();
        let pairs = seen.iter().zip(seen.iter().skip(1));
        let divided = pairs.filter(|(one, next)| (one.0, one.1) == (next.0, next.1));
        let divided = divided.map(|(one, _)| one.0.clone()).collect();
        Self { rows, divided }
    }

    /// Tasks with a setting in which runs were probed on different episodes.
    pub fn divided(&self) -> impl Iterator<Item = &str> {
        self.divided.iter().map(String::as_str)
    }

    /// The group of comparable rows: the setting, and the data set if there are several.
    fn setting(&self, row: &Row) -> String {
        if self.divided.contains(&row.task) {
            return format!("{}, data {}", row.setting(), row.data);
        }
        row.setting()
    }

    /// Writes CSV, JSON and figures.
    pub fn write(&self, output: &Output, settings: &Value) -> anyhow::Result<()> {
        let heading = [
            "run",
            "label",
            "seed",
            "task",
            "trained_in",
            "probed_in",
            "transfer",
            "data",
            "environment_step",
            "encoder",
            "horizon_agent_steps",
            "mse",
            "mse_std",
            "constant_mse",
            "test_episodes",
        ];
        let rows = self.rows.iter().map(|row| {
            let errors = &row.errors;
            let numbers = [errors.mean(), errors.std(), errors.constant_mean()];
            let mut cells = self.cells(row);
            cells.extend(numbers.map(|number| number.to_string()));
            cells.push(errors.by_episode.len().to_string());
            cells
        });
        output.csv("probe.csv", &heading, rows)?;
        let mut heading = heading.to_vec();
        heading.splice(11.., ["episode", "mse", "constant_mse"]);
        let rows = self.rows.iter().flat_map(|row| {
            let pairs = row.errors.by_episode.iter().zip(&row.errors.constant_by_episode);
            pairs.enumerate().map(|(episode, (mse, constant))| {
                let mut cells = self.cells(row);
                cells.extend([(episode + 1).to_string(), mse.to_string(), constant.to_string()]);
                cells
            })
        });
        output.csv("probe-episodes.csv", &heading, rows)?;
        let rows: Vec<Value> = self.rows.iter().map(to_json).collect();
        output.json("probe.json", &json!({ "settings": settings, "results": rows }))?;
        self.draw(output)
    }

    fn cells(&self, row: &Row) -> Vec<String> {
        vec![
            row.run.clone(),
            row.label.clone(),
            row.seed.to_string(),
            row.task.clone(),
            row.trained_in.clone(),
            row.probed_in.clone(),
            row.transfer().to_string(),
            row.data.clone(),
            row.environment_step.to_string(),
            row.encoder.clone(),
            row.horizon.to_string(),
        ]
    }

    /// Draws one figure for each task and step with all encoders of a run together, and one with each separately.
    fn draw(&self, output: &Output) -> anyhow::Result<()> {
        for (task, step) in
            unique(self.rows.iter().map(|row| (row.task.clone(), row.environment_step)))
        {
            let rows: Vec<&Row> = self
                .rows
                .iter()
                .filter(|row| row.task == task && row.environment_step == step)
                .collect();
            let has_all = |row: &Row| {
                rows.iter().any(|other| other.run == row.run && other.encoder == ALL_ENCODERS)
            };
            let whole: Vec<&Row> = rows
                .iter()
                .filter(|row| row.encoder == ALL_ENCODERS || !has_all(row))
                .copied()
                .collect();
            let title =
                format!("linear probes of {task} after {} environment steps", grouped(step));
            let file = format!("probe-{task}-{step}");
            self.figure(output, &file, &title, &whole, |row| row.label.clone())?;
            if whole.len() < rows.len() {
                let file = format!("probe-encoders-{task}-{step}");
                let name = |row: &Row| format!("{}, {}", row.label, row.encoder);
                self.figure(output, &file, &title, &rows, name)?;
            }
        }
        Ok(())
    }

    /// Draws a panel for each setting, a group of bars for each horizon and a bar for each name, and writes the values
    /// as CSV. Seeds of one name are pooled.
    fn figure(
        &self,
        output: &Output,
        file: &str,
        title: &str,
        rows: &[&Row],
        name: impl Fn(&Row) -> String,
    ) -> anyhow::Result<()> {
        let names = unique(rows.iter().map(|row| name(row)));
        let settings = unique(rows.iter().map(|row| self.setting(row)));
        let horizons = unique(rows.iter().map(|row| row.horizon));
        let groups: Vec<String> = horizons.iter().map(|horizon| format!("t+{horizon}")).collect();
        let pooled = |setting: &str, series: &str, horizon: usize| -> Vec<f64> {
            let of = |row: &&&Row| {
                row.horizon == horizon && self.setting(row) == setting && name(row) == series
            };
            let rows = rows.iter().filter(of);
            rows.flat_map(|row| row.errors.by_episode.iter().copied()).collect()
        };
        let panel = |setting: &String| {
            let of = |series: &String| {
                let bar = |horizon: &usize| moments(&pooled(setting, series, *horizon));
                horizons.iter().map(bar).collect()
            };
            BarPanel { title: setting.clone(), values: names.iter().map(of).collect() }
        };
        let panels: Vec<BarPanel> = settings.iter().map(panel).collect();
        let drawn = bars(title, &error_label(rows), &names, &groups, &panels)?;
        output.text(&format!("{file}.svg"), &drawn)?;
        let series = settings.iter().flat_map(|setting| names.iter().map(move |of| (setting, of)));
        let bars = series.flat_map(|of| horizons.iter().map(move |&horizon| (of, horizon)));
        let cells = bars.filter_map(|((setting, series), horizon)| {
            let episodes = pooled(setting, series, horizon);
            let (mean, std) = moments(&episodes)?;
            Some(vec![
                setting.clone(),
                series.clone(),
                horizon.to_string(),
                mean.to_string(),
                std.to_string(),
                episodes.len().to_string(),
            ])
        });
        let heading =
            ["probed_in", "bar", "horizon_agent_steps", "mse", "mse_std", "test_episodes"];
        output.csv(&format!("{file}.csv"), &heading, cells)
    }

    /// Prints the table of results.
    pub fn print(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        for task in unique(self.rows.iter().map(|row| row.task.clone())) {
            let rows: Vec<&Row> = self.rows.iter().filter(|row| row.task == task).collect();
            let horizons = unique(rows.iter().map(|row| row.horizon));
            let heads: Vec<String> = horizons.iter().map(|h| format!("t+{h}")).collect();
            let mut columns = vec![
                ("RUN", Align::Left),
                ("SEED", Align::Right),
                ("STEP", Align::Right),
                ("PROBED IN", Align::Left),
                ("ENCODER", Align::Left),
            ];
            columns.extend(heads.iter().map(|head| (head.as_str(), Align::Right)));
            let lines = unique(rows.iter().map(|row| {
                (row.run.clone(), self.setting(row), row.environment_step, row.encoder.clone())
            }));
            let mut cells: Vec<Vec<String>> = Vec::new();
            for (index, line) in lines.iter().enumerate() {
                let of: Vec<&&Row> = rows
                    .iter()
                    .filter(|row| {
                        row.run == line.0
                            && self.setting(row) == line.1
                            && row.environment_step == line.2
                            && row.encoder == line.3
                    })
                    .collect();
                let first = of[0];
                let mut cell = vec![
                    first.label.clone(),
                    first.seed.to_string(),
                    grouped(first.environment_step),
                    line.1.clone(),
                    first.encoder.clone(),
                ];
                let at = |horizon: &usize| of.iter().find(|row| row.horizon == *horizon);
                let errors = |of: &&&Row| {
                    format!("{} ± {}", short(of.errors.mean()), short(of.errors.std()))
                };
                let blank = String::new;
                cell.extend(horizons.iter().map(|h| at(h).map_or_else(blank, errors)));
                cells.push(cell);
                // Once for each setting: the error of predicting the mean.
                if lines.get(index + 1).is_none_or(|next| next.1 != line.1) {
                    let mut cell = vec![String::new(), String::new(), String::new()];
                    cell.extend([line.1.clone(), "none: the mean".to_owned()]);
                    let constant = |of: &&&Row| short(of.errors.constant_mean());
                    cell.extend(horizons.iter().map(|h| at(h).map_or_else(blank, constant)));
                    cells.push(cell);
                }
            }
            writeln!(
                out,
                "\n{task}: {} over test episodes, ± one standard deviation",
                error_label(&rows)
            )?;
            table::write(out, &columns, &cells)?;
        }
        writeln!(out)?;
        Ok(())
    }
}

fn to_json(row: &Row) -> Value {
    json!({
        "run": row.run,
        "label": row.label,
        "seed": row.seed,
        "task": row.task,
        "trained_in": row.trained_in,
        "probed_in": row.probed_in,
        "transfer": row.transfer(),
        "data": row.data,
        "environment_step": row.environment_step,
        "encoder": row.encoder,
        "horizon_agent_steps": row.horizon,
        "mse": row.errors.mean(),
        "mse_std": row.errors.std(),
        "constant_mse": row.errors.constant_mean(),
        "mse_by_episode": row.errors.by_episode,
        "mse_by_coordinate": row.errors.by_coordinate,
    })
}

/// Label of the error, with its unit.
fn error_label(rows: &[&Row]) -> String {
    match rows.first().and_then(|row| row.unit.as_ref()) {
        Some(unit) => format!("mean squared error, {unit}²"),
        None => "mean squared error".to_owned(),
    }
}

fn moments(values: &[f64]) -> Option<(f64, f64)> {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
    (!values.is_empty()).then(|| (mean, (squares / count).sqrt()))
}

/// Distinct values in the order of first appearance.
fn unique<T: Clone + Ord>(values: impl Iterator<Item = T>) -> Vec<T> {
    let mut seen = BTreeSet::new();
    values.filter(|value| seen.insert(value.clone())).collect()
}

/// Formats a value with three significant digits.
fn short(value: f64) -> String {
    if value != 0.0 && (value.abs() < 1e-3 || value.abs() >= 1e4) {
        return format!("{value:.2e}");
    }
    let digits =
        if value == 0.0 { 3 } else { (2 - value.abs().log10().floor() as i32).max(0) as usize };
    format!("{value:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_written_with_three_digits() {
        for (value, text) in [
            (0.0, "0.000"),
            (0.012345, "0.0123"),
            (2.0, "2.00"),
            (1.5e-5, "1.50e-5"),
            (314.2, "314"),
        ] {
            assert_eq!(short(value), text);
        }
    }

    #[test]
    fn runs_that_saw_other_episodes_are_told_apart() {
        let row = |label: &str, data: &str| Row {
            run: label.to_owned(),
            label: label.to_owned(),
            seed: 1,
            task: "walker-walk".to_owned(),
            trained_in: "none".to_owned(),
            probed_in: "none".to_owned(),
            data: data.to_owned(),
            environment_step: 0,
            encoder: ALL_ENCODERS.to_owned(),
            horizon: 1,
            unit: Some("m".to_owned()),
            errors: Errors {
                by_episode: vec![1.0],
                by_coordinate: vec![1.0],
                constant_by_episode: vec![2.0],
            },
        };
        let same = Results::new(vec![row("a", "x"), row("b", "x")]);
        assert_eq!((same.divided().count(), same.setting(&same.rows[0])), (0, "none".into()));
        let other = Results::new(vec![row("a", "x"), row("b", "y")]);
        assert_eq!(other.divided().collect::<Vec<_>>(), ["walker-walk"]);
        let mut out = Vec::new();
        other.print(&mut out).unwrap();
        let text = String::from_utf8(out).unwrap();
        assert!(text.contains("none, data x") && text.contains("none, data y"), "{text}");
    }

    #[test]
    fn seeds_are_pooled() {
        assert_eq!(moments(&[1.0, 3.0]), Some((2.0, 1.0)));
        assert_eq!(moments(&[]), None);
    }
}
