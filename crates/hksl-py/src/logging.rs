//! Warnings of the libraries as records of Python's `logging`.

use std::io::{self, Write};

use pyo3::prelude::*;
use tracing_subscriber::filter::LevelFilter;

/// Sends warnings to the logger `hksl`.
pub fn forward_warnings() {
    // A program that embeds Python may have a subscriber of its own.
    let _ = tracing_subscriber::fmt()
        .with_max_level(LevelFilter::WARN)
        .with_writer(|| Logger)
        .log_internal_errors(false)
        .with_level(false)
        .with_target(false)
        .without_time()
        .with_ansi(false)
        .try_init();
}

/// Writes each event as a record.
struct Logger;

impl Write for Logger {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let text = String::from_utf8_lossy(bytes);
        Python::attach(|py| -> PyResult<()> {
            let logger = py.import("logging")?.call_method1("getLogger", ("hksl",))?;
            logger.call_method1("warning", ("%s", text.trim_end()))?;
            Ok(())
        })
        .map_err(io::Error::other)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
