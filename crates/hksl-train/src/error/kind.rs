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
            Self::Environment(error) => matches!(
                error,
                hksl_envs::Error::UnknownTask { .. } | hksl_envs::Error::Setting { .. }
            ),
            Self::Simulation { .. }
            | Self::NotToml(_)
            | Self::NoState { .. }
            | Self::OtherVersion { .. }
            | Self::NotFinite { .. }
            | Self::Memory { .. }
            | Self::OtherWeights { .. }
            | Self::NoCheckpoint { .. }
            | Self::NoCheckpoints { .. }
            | Self::Files(_)
            | Self::Agent(_) => false,
        }
    }
}
