//! What a run writes down while it learns; `docs/metrics.md` defines every name.

mod eval_csv;
mod jsonl;
mod tensorboard;
mod window;

pub use eval_csv::EvalCsv;
pub use hksl_files::{EVENTS_NAME, EvaluationRow, read_evaluations};
pub use jsonl::MetricsFile;
pub use tensorboard::{Colorspace, EventFile, Picture, Value};
pub use window::Window;
