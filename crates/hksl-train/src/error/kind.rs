//! Whose fault an error is: what decides the exit code.

use super::Error;

impl Error {
    /// Whether the fault lies in arguments, configuration files or keys (exit code 2).
    pub fn is_usage(&self) -> bool {
        match self {
            Self::UnknownKey { .. }
            | Self::WrongType { .. }
            | Self::OutOfRange { .. }
            | Self::UnknownName { .. }
            | Self::ForeignKey { .. }
            | Self::ForeignPreset { .. }
            | Self::Ablation { .. }
            | Self::SetSyntax { .. }
            | Self::Syntax { .. }
            | Self::MissingKeys { .. }
            | Self::ReadConfig { .. } => true,
            Self::Device { .. }
            | Self::Threads { .. }
            | Self::OtherConfig { .. }
            | Self::SmallerBudget { .. }
            | Self::RunExists { .. } => true,
            Self::Sweep(error) => error.is_usage(),
            Self::Report(error) => !matches!(**error, crate::report::Error::Page { .. }),
            Self::Environment(error) => matches!(
                error,
                hksl_envs::Error::UnknownTask { .. } | hksl_envs::Error::Setting { .. }
            ),
            Self::Simulation { .. }
            | Self::NotToml(_)
            | Self::Plot { .. }
            | Self::NoState { .. }
            | Self::Locked { .. }
            | Self::NoLocks { .. }
            | Self::OtherVersion { .. }
            | Self::NotFinite { .. }
            | Self::Memory { .. }
            | Self::NoRun { .. }
            | Self::OtherWeights { .. }
            | Self::Statistics(_)
            | Self::NoCheckpoint { .. }
            | Self::NoCheckpoints { .. }
            | Self::Damaged { .. }
            | Self::Read { .. }
            | Self::Write { .. }
            | Self::Agent(_) => false,
        }
    }
}
