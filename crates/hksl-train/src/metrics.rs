//! What a run writes down while it learns; `docs/metrics.md` defines every name.

mod eval_csv;
mod jsonl;
mod tensorboard;
mod window;

#[cfg(test)]
pub(crate) use eval_csv::EVALUATION_COLUMNS;
pub use eval_csv::{EvalCsv, EvaluationRow, read_evaluations};
pub(crate) use eval_csv::{Point, read_points};
pub use jsonl::MetricsFile;
pub use tensorboard::{Colorspace, EVENTS_NAME, EventFile, Picture, Value};
pub use window::Window;
