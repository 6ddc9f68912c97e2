//! Scores of one method.

use std::ops::Range;
use std::sync::Arc;

use super::{Error, Result};

/// Scores of one method, a finite number for each run of each task: rliable's matrix of runs × tasks, except that tasks
/// may have different numbers of runs.
///
/// Runs at the same position in different tasks are unrelated.
#[derive(Debug, Clone, PartialEq)]
pub struct Scores {
    /// Shared by resamples and the original scores.
    tasks: Arc<[Task]>,
    /// Ordered by task.
    values: Vec<f64>,
}

#[derive(Debug, PartialEq)]
struct Task {
    name: String,
    cells: Range<usize>,
}

impl Scores {
    /// Scores of named tasks.
    ///
    /// ```
    /// use hksl_report::statistics::Scores;
    ///
    /// let scores = Scores::new([("walker_walk", vec![0.5, 0.7]), ("cheetah_run", vec![0.3])])?;
    /// assert_eq!(scores.values(), [0.5, 0.7, 0.3]);
    /// let error = Scores::new([("walker_walk", vec![0.5, f64::NAN])]).unwrap_err();
    /// let message = "walker_walk: the score of run 1 (from 0) is NaN; scores must be finite";
    /// assert_eq!(error.to_string(), message);
    /// # Ok::<(), hksl_report::statistics::Error>(())
    /// ```
    ///
    /// # Errors
    /// No task, a task without runs, a score that is NaN or infinite.
    pub fn new<N: Into<String>>(tasks: impl IntoIterator<Item = (N, Vec<f64>)>) -> Result<Self> {
        let mut named = Vec::new();
        let mut values = Vec::new();
        for (name, runs) in tasks {
            let task = name.into();
            if runs.is_empty() {
                return Err(Error::NoRun { task });
            }
            if let Some(run) = runs.iter().position(|score| !score.is_finite()) {
                return Err(Error::NotFinite { task, run, value: runs[run] });
            }
            named.push(Task { name: task, cells: values.len()..values.len() + runs.len() });
            values.extend(runs);
        }
        if named.is_empty() {
            return Err(Error::NoTask);
        }
        Ok(Self { tasks: named.into(), values })
    }

    /// Scores from rliable's matrix: a row for each run, a column for each task. Tasks are named `task 0`, `task 1` and
    /// so on.
    ///
    /// ```
    /// use hksl_report::statistics::Scores;
    ///
    /// let scores = Scores::from_rows(&[[0.1, 0.9], [0.5, 0.8], [0.3, 1.2]])?;
    /// let tasks: Vec<_> = scores.tasks().collect();
    /// assert_eq!(tasks[1], ("task 1", &[0.9, 0.8, 1.2][..]));
    /// # Ok::<(), hksl_report::statistics::Error>(())
    /// ```
    ///
    /// # Errors
    /// Rows of different lengths, and as [`Scores::new`].
    pub fn from_rows(rows: &[impl AsRef<[f64]>]) -> Result<Self> {
        let expected = rows.first().map_or(0, |row| row.as_ref().len());
        let mut tasks = vec![Vec::with_capacity(rows.len()); expected];
        for (run, row) in rows.iter().enumerate() {
            let row = row.as_ref();
            if row.len() != expected {
                return Err(Error::Row { run, got: row.len(), expected });
            }
            tasks.iter_mut().zip(row).for_each(|(task, &score)| task.push(score));
        }
        Self::new(tasks.into_iter().enumerate().map(|(task, runs)| (format!("task {task}"), runs)))
    }

    /// Each task's name and runs.
    pub fn tasks(&self) -> impl ExactSizeIterator<Item = (&str, &[f64])> {
        self.tasks.iter().map(|task| (task.name.as_str(), &self.values[task.cells.clone()]))
    }

    /// The mean over each task's runs.
    pub fn task_means(&self) -> impl ExactSizeIterator<Item = f64> {
        self.tasks().map(|(_, runs)| runs.iter().sum::<f64>() / runs.len() as f64)
    }

    /// All scores, ordered by task.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Fills `resample` with the scores at `picks`.
    pub(super) fn resample(&self, picks: &[usize], resample: &mut Self) {
        debug_assert_eq!(picks.len(), resample.values.len());
        for (value, &pick) in resample.values.iter_mut().zip(picks) {
            *value = self.values[pick];
        }
    }

    /// # Errors
    /// The tasks or their order differ from `other`'s.
    pub(super) fn check_same_tasks(&self, other: &Self) -> Result<()> {
        let name = |scores: &Self, position: usize| {
            scores.tasks.get(position).map(|task| format!("`{}`", task.name))
        };
        for position in 0..self.tasks.len().max(other.tasks.len()) {
            let (one, two) = (name(self, position), name(other, position));
            if one != two {
                let or_none = |name: Option<String>| name.unwrap_or_else(|| "no task".to_owned());
                let differ = format!("one has {} and the other {}", or_none(one), or_none(two));
                return Err(Error::Tasks { position, differ });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_scores_is_named() {
        let none: [(&str, Vec<f64>); 0] = [];
        assert_eq!(Scores::new(none), Err(Error::NoTask));
        assert_eq!(Scores::from_rows(&[[0.0; 2]; 0]), Err(Error::NoTask));
        assert_eq!(Scores::from_rows(&[[], []]), Err(Error::NoTask));
        let empty = Scores::new([("a", vec![1.0]), ("b", vec![])]);
        assert_eq!(empty, Err(Error::NoRun { task: "b".to_owned() }));
        let infinite = Scores::new([("a", vec![1.0, f64::INFINITY])]);
        let error = Error::NotFinite { task: "a".to_owned(), run: 1, value: f64::INFINITY };
        assert_eq!(infinite, Err(error));
        let rows: [&[f64]; 2] = [&[1.0, 2.0], &[1.0]];
        assert_eq!(Scores::from_rows(&rows), Err(Error::Row { run: 1, got: 1, expected: 2 }));
    }

    #[test]
    fn other_tasks_are_told_apart() {
        let scores =
            |names: &[&str]| Scores::new(names.iter().map(|&name| (name, vec![1.0]))).unwrap();
        let one = scores(&["a", "b"]);
        assert_eq!(one.check_same_tasks(&scores(&["a", "b"])), Ok(()));
        let message = |other: &Scores| one.check_same_tasks(other).unwrap_err().to_string();
        let start = "both must have the same tasks in the same order; at position 1, one has";
        assert_eq!(message(&scores(&["a"])), format!("{start} `b` and the other no task"));
        assert_eq!(message(&scores(&["a", "c"])), format!("{start} `b` and the other `c`"));
    }
}
