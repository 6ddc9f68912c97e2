//! How the linear map is fitted, as an option and in words.

use clap::ValueEnum;
use hksl_probe::linear_probe::Fit;

/// How a linear map can be fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FitChoice {
    /// Least squares in closed form, with a small penalty
    Ridge,
    /// Adam, as in the paper's text
    GradientDescent,
}

/// How a linear map is fitted, for people.
pub fn words(fit: &Fit) -> String {
    match fit {
        Fit::Ridge { penalty } => format!("ridge with penalty {penalty:e}"),
        Fit::GradientDescent(descent) => {
            format!("Adam at {:e}, {} passes", descent.learning_rate, descent.epochs)
        }
    }
}
