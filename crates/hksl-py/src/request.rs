//! Requests for a configuration, from the arguments of Python's functions.

use hksl_train::config::{Flag, Request};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use toml::Value;

use crate::error::Result;
use crate::values::settings;

/// The arguments that configure a run, as a dictionary; what is None may be left out.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Arguments<'py> {
    task: Option<String>,
    method: Option<String>,
    ablation: Option<String>,
    distractor: Option<String>,
    seed: Option<i64>,
    environment_steps: Option<i64>,
    device: Option<String>,
    threads: Option<i64>,
    pub presets: Vec<String>,
    config: Bound<'py, PyDict>,
}

impl Arguments<'_> {
    /// The request that they make.
    pub fn request(&self) -> Result<Request> {
        let text = |value: &Option<String>| value.clone().map(Value::String);
        let whole = |value: Option<i64>| value.map(Value::Integer);
        let flags = [
            ("task", text(&self.task), "task"),
            ("method", text(&self.method), "method"),
            ("ablation", text(&self.ablation), "ablation"),
            ("distractor", text(&self.distractor), "distractor"),
            ("seed", whole(self.seed), "seed"),
            ("environment_steps", whole(self.environment_steps), "environment_steps"),
            ("device", text(&self.device), "device"),
            ("threads", whole(self.threads), "threads"),
        ];
        let flag =
            |(key, value, name): (_, Option<Value>, _)| Some(Flag { key, value: value?, name });
        Ok(Request {
            presets: self.presets.clone(),
            values: settings(&self.config)?,
            flags: flags.into_iter().filter_map(flag).collect(),
            ..Request::default()
        })
    }
}
