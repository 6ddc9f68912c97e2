//! The normal distribution truncated to [−1, 1].

use std::f64::consts::{E, PI};

use candle_core::Tensor;
use hksl_sac::Result;
use statrs::function::erf::{erf, erfc_inv};

/// Minimal distance of samples from the bounds −1 and 1.
const MARGIN: f64 = 1e-6;

/// Standard normal density `φ`.
fn density(x: f64) -> f64 {
    (-0.5 * x * x).exp() / (2.0 * PI).sqrt()
}

/// Standard normal distribution function `Φ`.
fn cdf(x: f64) -> f64 {
    0.5 * (1.0 + erf(x / 2f64.sqrt()))
}

/// Standard normal quantile function `Φ⁻¹`.
fn inverse_cdf(p: f64) -> f64 {
    -(2f64.sqrt()) * erfc_inv(2.0 * p)
}

/// A normal distribution truncated to [−1, 1]. Location and deviation are those of the normal distribution.
#[derive(Debug, Clone, Copy)]
pub struct TruncatedNormal {
    location: f64,
    deviation: f64,
    /// The standardised bounds.
    bounds: (f64, f64),
    /// Probability of the normal distribution between the bounds.
    mass: f64,
}

/// A value with its derivatives with respect to location and deviation.
#[derive(Debug, Clone, Copy)]
pub struct ValueWithDerivatives {
    /// The value.
    pub value: f64,
    /// Derivative with respect to the location.
    pub by_location: f64,
    /// Derivative with respect to the deviation.
    pub by_deviation: f64,
}

impl TruncatedNormal {
    /// Creates the distribution.
    pub fn new(location: f64, deviation: f64) -> Self {
        let bounds = ((-1.0 - location) / deviation, (1.0 - location) / deviation);
        let mass = cdf(bounds.1) - cdf(bounds.0);
        Self { location, deviation, bounds, mass }
    }

    /// The quantile at probability `uniform`, at least 1e-6 from −1 and 1, with its derivatives at fixed `uniform`.
    ///
    /// ```
    /// use hksl_baselines::dreamer::truncated_normal::TruncatedNormal;
    ///
    /// let distribution = TruncatedNormal::new(0.4, 0.6);
    /// let drawn = distribution.quantile(0.3);
    /// assert!((drawn.value - 0.012_649_14).abs() < 1e-7);
    /// assert!((distribution.log_density(drawn.value) + 0.432_014_15).abs() < 1e-7);
    /// // The derivatives agree with finite differences.
    /// let off = |location: f64, deviation: f64| TruncatedNormal::new(location, deviation).quantile(0.3).value;
    /// let by_location = (off(0.4 + 1e-5, 0.6) - off(0.4 - 1e-5, 0.6)) / 2e-5;
    /// let by_deviation = (off(0.4, 0.6 + 1e-5) - off(0.4, 0.6 - 1e-5)) / 2e-5;
    /// assert!((drawn.by_location - by_location).abs() < 1e-6);
    /// assert!((drawn.by_deviation - by_deviation).abs() < 1e-6);
    /// ```
    pub fn quantile(&self, uniform: f64) -> ValueWithDerivatives {
        let (low, high) = self.bounds;
        // Not `clamp`, which panics if a bound is NaN. A diverged model must return NaN to the caller, not panic.
        let standard = inverse_cdf(cdf(low) + uniform * self.mass).max(low).min(high);
        // The derivative of Φ⁻¹(Φ(low) + uniform · mass) with respect to each bound.
        let below = (1.0 - uniform) * density(low) / density(standard);
        let above = uniform * density(high) / density(standard);
        let moved = self.location + self.deviation * standard;
        ValueWithDerivatives {
            value: moved.clamp(MARGIN - 1.0, 1.0 - MARGIN),
            by_location: 1.0 - below - above,
            by_deviation: standard - below * low - above * high,
        }
    }

    /// The log-density at `x` in (−1, 1).
    pub fn log_density(&self, x: f64) -> f64 {
        let standard = (x - self.location) / self.deviation;
        -0.5 * standard * standard - (2.0 * PI).ln() / 2.0 - (self.deviation * self.mass).ln()
    }

    /// The entropy in nats, with its derivatives.
    ///
    /// ```
    /// use hksl_baselines::dreamer::truncated_normal::TruncatedNormal;
    ///
    /// let entropy = TruncatedNormal::new(0.4, 0.6).entropy();
    /// assert!((entropy.value - 0.541_336_63).abs() < 1e-7);
    /// let off = |location: f64, deviation: f64| TruncatedNormal::new(location, deviation).entropy().value;
    /// let by_location = (off(0.4 + 1e-5, 0.6) - off(0.4 - 1e-5, 0.6)) / 2e-5;
    /// let by_deviation = (off(0.4, 0.6 + 1e-5) - off(0.4, 0.6 - 1e-5)) / 2e-5;
    /// assert!((entropy.by_location - by_location).abs() < 1e-6);
    /// assert!((entropy.by_deviation - by_deviation).abs() < 1e-6);
    /// ```
    pub fn entropy(&self) -> ValueWithDerivatives {
        let ((low, high), mass, deviation) = (self.bounds, self.mass, self.deviation);
        let (at_low, at_high) = (density(low), density(high));
        let edge = low * at_low - high * at_high;
        // Derivatives of ln(mass) and of edge / (2 mass) with respect to each standardised bound.
        let by_end = |end: f64, at: f64, sign: f64| {
            let mass_slope = sign * at;
            let edge_slope = -sign * at * (1.0 - end * end);
            mass_slope / mass + edge_slope / (2.0 * mass) - edge * mass_slope / (2.0 * mass * mass)
        };
        let (by_low, by_high) = (by_end(low, at_low, -1.0), by_end(high, at_high, 1.0));
        ValueWithDerivatives {
            value: ((2.0 * PI * E).sqrt() * deviation * mass).ln() + edge / (2.0 * mass),
            by_location: -(by_low + by_high) / deviation,
            by_deviation: (1.0 - by_low * low - by_high * high) / deviation,
        }
    }
}

/// Applies `of` elementwise, in f64 on the host, and attaches its derivatives as the gradient of the output.
///
/// # Shapes
/// - `location`, `deviation`, output: `(N, A)`
fn with_derivatives(
    location: &Tensor,
    deviation: &Tensor,
    of: impl Fn(usize, TruncatedNormal) -> ValueWithDerivatives,
) -> Result<Tensor> {
    let numbers = |tensor: &Tensor| tensor.detach().flatten_all()?.to_vec1::<f32>();
    let (locations, deviations) = (numbers(location)?, numbers(deviation)?);
    let (mut values, mut by_location, mut by_deviation) = (Vec::new(), Vec::new(), Vec::new());
    for (index, (location, deviation)) in locations.iter().zip(&deviations).enumerate() {
        let distribution = TruncatedNormal::new(f64::from(*location), f64::from(*deviation));
        let result = of(index, distribution);
        values.push(result.value as f32);
        by_location.push(result.by_location as f32);
        by_deviation.push(result.by_deviation as f32);
    }
    let tensor = |numbers| Tensor::from_vec(numbers, location.shape(), location.device());
    // x − x.detach() is 0 and has the gradient of x.
    let along = |x: &Tensor, derivatives: Vec<f32>| (x - x.detach())? * tensor(derivatives)?;
    let moved = (along(location, by_location)? + along(deviation, by_deviation)?)?;
    Ok((tensor(values)? + moved)?)
}

/// Draws samples by inverse transform sampling. The samples are differentiable in location and deviation
/// (reparameterised).
///
/// # Shapes
/// - all: `(N, A)`; `uniform` in [0, 1)
pub fn sample(location: &Tensor, deviation: &Tensor, uniform: &Tensor) -> Result<Tensor> {
    let uniform = uniform.flatten_all()?.to_vec1::<f32>()?;
    with_derivatives(location, deviation, |index, distribution| {
        distribution.quantile(f64::from(uniform[index]))
    })
}

/// Entropies in nats, `(N, A)`.
pub fn entropy(location: &Tensor, deviation: &Tensor) -> Result<Tensor> {
    with_derivatives(location, deviation, |_, distribution| distribution.entropy())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A diverged model gives losses of NaN or infinity and does not panic.
    #[test]
    fn parameters_of_nan_or_infinity_do_not_panic() {
        for (location, deviation) in [(f64::NAN, 1.0), (0.0, f64::NAN), (f64::INFINITY, 1.0)] {
            let distribution = TruncatedNormal::new(location, deviation);
            assert!(!distribution.quantile(0.3).by_location.is_finite());
            assert!(!distribution.entropy().value.is_finite());
        }
    }
}
