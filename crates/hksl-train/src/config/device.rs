//! Parsing of `device`.

use super::error::{Error, Result};

use super::Origin;

/// The most CPU threads that may be asked for.
pub const MOST_THREADS: usize = 4096;

/// The requested training device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeviceChoice {
    /// The first CUDA device where this build and machine have one, else the CPU.
    Auto,
    /// The CPU.
    Cpu,
    /// The CUDA device of that index.
    Cuda(usize),
}

impl DeviceChoice {
    /// Reads `auto`, `cpu`, `cuda` (device 0) or `cuda:N`.
    pub(super) fn parse(text: &str, origin: Option<&Origin>) -> Result<Self> {
        let index = text.strip_prefix("cuda:").map(str::parse);
        match (text, index) {
            ("auto", _) => Ok(Self::Auto),
            ("cpu", _) => Ok(Self::Cpu),
            ("cuda", _) => Ok(Self::Cuda(0)),
            (_, Some(Ok(index))) => Ok(Self::Cuda(index)),
            _ => Err(refused(text, origin, "it must be auto, cpu, cuda or cuda:N, as in cuda:1")),
        }
    }

    /// Reads a device that an option such as `--device` gives outside a configuration.
    ///
    /// # Errors
    /// [`super::Error::OutOfRange`] where it does not follow the grammar, or this build lacks it.
    pub fn from_option(text: &str, option: &'static str) -> Result<Self> {
        let origin = Origin::Flag(option);
        let choice = Self::parse(text, Some(&origin))?;
        choice.require_compiled(text, Some(&origin))?;
        Ok(choice)
    }

    /// Refuses a device that this build has no code for.
    pub(super) fn require_compiled(self, text: &str, origin: Option<&Origin>) -> Result<()> {
        if matches!(self, Self::Cuda(_)) && !cfg!(feature = "cuda") {
            let expected =
                "this build does not support CUDA; build with --features cuda, or use auto or cpu";
            return Err(refused(text, origin, expected));
        }
        Ok(())
    }
}

fn refused(text: &str, origin: Option<&Origin>, expected: &str) -> Error {
    Error::OutOfRange {
        key: "device".to_owned(),
        value: format!("{text:?}"),
        origin: origin.cloned(),
        expected: expected.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn knows_four_forms() {
        for (text, choice) in [
            ("auto", DeviceChoice::Auto),
            ("cpu", DeviceChoice::Cpu),
            ("cuda", DeviceChoice::Cuda(0)),
            ("cuda:3", DeviceChoice::Cuda(3)),
        ] {
            assert_eq!(DeviceChoice::parse(text, None).unwrap(), choice);
        }
        for text in ["gpu", "cuda:", "cuda:x", "cuda:-1", "CPU", ""] {
            let message = DeviceChoice::parse(text, None).unwrap_err().to_string();
            assert!(message.contains("auto, cpu, cuda or cuda:N"), "{message}");
        }
    }

    #[cfg(not(feature = "cuda"))]
    #[test]
    fn names_the_feature_that_cuda_needs() {
        let message = DeviceChoice::Cuda(0).require_compiled("cuda", None).unwrap_err().to_string();
        assert!(message.contains("--features cuda"), "{message}");
    }
}
