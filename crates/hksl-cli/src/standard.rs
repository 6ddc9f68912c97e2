//! Standard output and standard error. A reader that left or a full disk behind them ends no command, panics nowhere,
//! and turns no exit code into another; output that is lost is reported where that can be.

use std::io::{self, ErrorKind, StdoutLock, Write};

use crate::exit::Code;

/// What a command's standard output is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// It is the command's result: losing some of it is a failure.
    Data,
    /// It reports on work whose results are in files: losing it stops and fails nothing.
    Progress,
}

/// Standard output, which takes everything and remembers its first failure.
pub struct Stdout {
    inner: StdoutLock<'static>,
    purpose: Purpose,
    failure: Option<io::Error>,
}

impl Stdout {
    /// The process's own.
    pub fn new(purpose: Purpose) -> Self {
        Self { inner: io::stdout().lock(), purpose, failure: None }
    }

    /// Flushes what is left, and returns the exit code of a command that ends with `code`.
    pub fn finish(mut self, code: Code) -> Code {
        // Failures are kept in `self`, and never returned.
        let _ = self.flush();
        match self.failure {
            Some(error) if is_lost_data(self.purpose, &error) => {
                error_line(&format!(
                    "error: {}; what was printed is incomplete. Redirect it to a place that can be written",
                    unwritable(&error)
                ));
                if code == Code::Done { Code::Failure } else { code }
            }
            _ => code,
        }
    }

    fn note(&mut self, error: io::Error) {
        if self.failure.is_some() {
            return;
        }
        if self.purpose == Purpose::Progress && error.kind() != ErrorKind::BrokenPipe {
            error_line(&format!(
                "warning: {}; the command goes on, and writes its files as usual",
                unwritable(&error)
            ));
        }
        self.failure = Some(error);
    }
}

impl Write for Stdout {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self.inner.write(bytes) {
            Err(error) if error.kind() != ErrorKind::Interrupted => {
                self.note(error);
                Ok(bytes.len())
            }
            written => written,
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        if let Err(error) = self.inner.flush() {
            self.note(error);
        }
        Ok(())
    }
}

/// Whether data was lost that somebody wanted: a reader that left, as `head` does, has what it wanted.
pub fn is_lost_data(purpose: Purpose, error: &io::Error) -> bool {
    purpose == Purpose::Data && error.kind() != ErrorKind::BrokenPipe
}

fn unwritable(error: &io::Error) -> String {
    format!("standard output cannot be written: {error}")
}

/// Writes a line to standard error; where that cannot be, there is nowhere to say so.
pub fn error_line(text: &str) {
    let _ = writeln!(io::stderr(), "{text}");
}

/// Prints what the argument parser has to say: an error, a help text, the version.
pub fn print_parsers(said: &clap::Error) -> Code {
    let purpose = if said.use_stderr() { Purpose::Progress } else { Purpose::Data };
    let code = if said.exit_code() == 0 { Code::Done } else { Code::Usage };
    match said.print().and_then(|()| io::stdout().flush()) {
        Err(error) if is_lost_data(purpose, &error) => {
            error_line(&format!("error: {}", unwritable(&error)));
            Code::Failure
        }
        _ => code,
    }
}
