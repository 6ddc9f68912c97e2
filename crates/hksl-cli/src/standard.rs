//! Standard output and standard error. A closed pipe or a full disk neither ends a command nor causes a panic; lost
//! output is reported on standard error where possible.

use std::io::{self, ErrorKind, StdoutLock, Write};

use crate::exit::Code;

/// Purpose of a command's standard output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// The command's result: losing any of it is a failure.
    Data,
    /// Progress of work whose results are in files: losing it is not a failure.
    Progress,
}

/// Standard output that never fails and remembers its first error.
pub struct Stdout {
    inner: StdoutLock<'static>,
    purpose: Purpose,
    failure: Option<io::Error>,
}

impl Stdout {
    /// Standard output of this process.
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
                    "error: {}; the output is incomplete. Redirect it to a writable file",
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
                "warning: {}; the command continues and writes its files as usual",
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

/// Whether a write error lost data. A closed pipe does not: its reader, such as `head`, has read all it needs.
pub fn is_lost_data(purpose: Purpose, error: &io::Error) -> bool {
    purpose == Purpose::Data && error.kind() != ErrorKind::BrokenPipe
}

fn unwritable(error: &io::Error) -> String {
    format!("cannot write to standard output: {error}")
}

/// Writes a line to standard error and ignores failures, which could not be reported anywhere.
pub fn error_line(text: &str) {
    let _ = writeln!(io::stderr(), "{text}");
}

/// Prints an error, a help text or the version from the argument parser.
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
