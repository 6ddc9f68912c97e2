//! Settings as Python's values.

use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};
use toml::Value;

use crate::error::{Error, Result};

/// The items of `config={"sac.batch_size": 64}` as TOML's values.
pub fn settings(config: &Bound<'_, PyDict>) -> Result<Vec<(String, Value)>> {
    config
        .iter()
        .map(|(key, value)| {
            let key: String = key.extract()?;
            let value = setting(&key, &value)?;
            Ok((key, value))
        })
        .collect()
}

fn setting(key: &str, value: &Bound<'_, PyAny>) -> Result<Value> {
    // A NumPy scalar counts as the number that it holds.
    let value = match value.getattr("item") {
        Ok(item) if !value.is_instance_of::<PyDict>() => item.call0()?,
        _ => value.clone(),
    };
    if value.is_instance_of::<PyBool>() {
        return Ok(Value::Boolean(value.extract()?));
    }
    if value.is_instance_of::<PyInt>() {
        return Ok(Value::Integer(value.extract()?));
    }
    if value.is_instance_of::<PyFloat>() {
        return Ok(Value::Float(value.extract()?));
    }
    if value.is_instance_of::<PyString>() {
        return Ok(Value::String(value.extract()?));
    }
    if value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>() {
        let items = value.try_iter()?.map(|item| setting(key, &item?));
        return Ok(Value::Array(items.collect::<Result<_>>()?));
    }
    Err(Error::Setting {
        key: key.to_owned(),
        value: value.repr()?.to_string(),
        kind: value.get_type().qualname()?.to_string(),
    })
}
