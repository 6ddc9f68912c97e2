//! The `--fit` option and its description.

use clap::ValueEnum;
use hksl_probe::linear_probe::Fit;

/// Method to fit the linear map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FitChoice {
    /// Least squares in closed form, with a small penalty
    Ridge,
    /// Adam, as the paper describes
    GradientDescent,
}

/// Describes a fit for output.
pub fn words(fit: &Fit) -> String {
    match fit {
        Fit::Ridge { penalty } => format!("ridge with penalty {penalty:e}"),
        Fit::GradientDescent(descent) => {
            format!("Adam at {:e}, {} passes", descent.learning_rate, descent.epochs)
        }
    }
}
