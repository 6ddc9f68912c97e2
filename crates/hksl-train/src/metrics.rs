//! What a run writes down while it learns; `docs/metrics.md` defines every name.

mod eval_csv;
mod jsonl;
mod window;

pub use eval_csv::{EvalCsv, EvaluationRow, read_evaluations};
pub use jsonl::MetricsFile;
pub use window::Window;
