//! The result of one check.

use std::io::{self, Write};

use crate::exit::Code;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mark {
    Ok,
    Warn,
    /// With the exit code of the failure.
    Fail(Code),
}

/// Result of a check: its subject, the finding and advice.
#[derive(Debug)]
pub struct Finding {
    mark: Mark,
    what: &'static str,
    found: String,
    advice: Option<String>,
}

impl Finding {
    /// A check that passed.
    pub fn ok(what: &'static str, found: impl Into<String>) -> Self {
        Self { mark: Mark::Ok, what, found: found.into(), advice: None }
    }

    /// A check that passed with a warning.
    pub fn warn(what: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { mark: Mark::Warn, what, found: found.into(), advice: Some(advice.into()) }
    }

    /// A check that failed.
    pub fn fail(what: &'static str, error: &anyhow::Error, advice: impl Into<String>) -> Self {
        let found = error.chain().map(ToString::to_string).collect::<Vec<_>>().join(": ");
        Self { mark: Mark::Fail(Code::of(error)), what, found, advice: Some(advice.into()) }
    }

    /// Whether the check passed without a warning.
    pub fn is_fine(&self) -> bool {
        self.mark == Mark::Ok
    }

    /// Writes the finding, and below it the advice.
    pub fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        let mark = match self.mark {
            Mark::Ok => "ok",
            Mark::Warn => "warn",
            Mark::Fail(_) => "fail",
        };
        writeln!(out, "{mark:<5} {:<12} {}", self.what, self.found)?;
        match &self.advice {
            Some(advice) => writeln!(out, "{:<18} → {advice}", ""),
            None => Ok(()),
        }
    }
}

/// 3 if a native component is missing, else 1 if any other check failed, else 0.
pub fn exit_code(findings: &[Finding]) -> Code {
    let mut code = Code::Done;
    for finding in findings {
        match finding.mark {
            Mark::Fail(Code::Native) => return Code::Native,
            Mark::Fail(_) => code = Code::Failure,
            Mark::Ok | Mark::Warn => {}
        }
    }
    code
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_natively_outweighs_other_faults() {
        let fine = || Finding::ok("CPU", "one");
        let warned = || Finding::warn("memory", "little", "buy some");
        let failed = || Finding::fail("runs", &anyhow::anyhow!("read-only"), "");
        let native = || {
            let error = hksl_envs::Error::Graphics { reason: "no EGL".into() };
            Finding::fail("graphics", &error.into(), "")
        };
        assert_eq!(exit_code(&[fine(), warned()]), Code::Done);
        assert_eq!(exit_code(&[fine(), failed(), warned()]), Code::Failure);
        assert_eq!(exit_code(&[failed(), native(), failed()]), Code::Native);
    }

    #[test]
    fn advice_stands_below_what_it_is_about() {
        let mut out = Vec::new();
        Finding::warn("memory", "1 GiB free", "close something").write(&mut out).unwrap();
        let expected = "warn  memory       1 GiB free\n                   → close something\n";
        assert_eq!(String::from_utf8(out).unwrap(), expected);
    }
}
