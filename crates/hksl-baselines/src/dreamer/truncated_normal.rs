//! The normal distribution between −1 and 1.

use std::f64::consts::{E, PI};

use candle_core::Tensor;
use hksl_sac::Result;
use statrs::function::erf::{erf, erfc_inv};

/// Samples stay this far from the ends.
const MARGIN: f64 = 1e-6;

/// `φ`.
fn density(x: f64) -> f64 {
    (-0.5 * x * x).exp() / (2.0 * PI).sqrt()
}

/// `Φ`.
fn cdf(x: f64) -> f64 {
    0.5 * (1.0 + erf(x / 2f64.sqrt()))
}

/// `Φ⁻¹`.
fn inverse_cdf(p: f64) -> f64 {
    -(2f64.sqrt()) * erfc_inv(2.0 * p)
}

/// A normal distribution with this location and deviation, cut off at −1 and 1.
#[derive(Debug, Clone, Copy)]
pub struct TruncatedNormal {
    location: f64,
    deviation: f64,
    /// The ends, standardised.
    ends: (f64, f64),
    /// What lies between them.
    mass: f64,
}

/// A number with its slopes along location and deviation.
#[derive(Debug, Clone, Copy)]
pub struct Sloped {
    /// The number.
    pub value: f64,
    /// Along the location.
    pub by_location: f64,
    /// Along the deviation.
    pub by_deviation: f64,
}

impl TruncatedNormal {
    /// The distribution.
    pub fn new(location: f64, deviation: f64) -> Self {
        let ends = ((-1.0 - location) / deviation, (1.0 - location) / deviation);
        let mass = cdf(ends.1) - cdf(ends.0);
        Self { location, deviation, ends, mass }
    }

    /// The number below which `uniform` of the mass lies, kept a little off the ends; its slopes at fixed `uniform`.
    ///
    /// ```
    /// use hksl_baselines::dreamer::truncated_normal::TruncatedNormal;
    ///
    /// let distribution = TruncatedNormal::new(0.4, 0.6);
    /// let drawn = distribution.at(0.3);
    /// assert!((drawn.value - 0.012_649_14).abs() < 1e-7);
    /// assert!((distribution.log_density(drawn.value) + 0.432_014_15).abs() < 1e-7);
    /// // The slopes are those of finite differences.
    /// let off = |location: f64, deviation: f64| TruncatedNormal::new(location, deviation).at(0.3).value;
    /// let by_location = (off(0.4 + 1e-5, 0.6) - off(0.4 - 1e-5, 0.6)) / 2e-5;
    /// let by_deviation = (off(0.4, 0.6 + 1e-5) - off(0.4, 0.6 - 1e-5)) / 2e-5;
    /// assert!((drawn.by_location - by_location).abs() < 1e-6);
    /// assert!((drawn.by_deviation - by_deviation).abs() < 1e-6);
    /// ```
    pub fn at(&self, uniform: f64) -> Sloped {
        let (low, high) = self.ends;
        // Not `clamp`, which panics where an end is NaN: a model that has diverged must reach the caller as numbers.
        let standard = inverse_cdf(cdf(low) + uniform * self.mass).max(low).min(high);
        // ∂Φ⁻¹ of a mix of both ends' masses: what each end contributes, over the density here.
        let below = (1.0 - uniform) * density(low) / density(standard);
        let above = uniform * density(high) / density(standard);
        let moved = self.location + self.deviation * standard;
        Sloped {
            value: moved.clamp(MARGIN - 1.0, 1.0 - MARGIN),
            by_location: 1.0 - below - above,
            by_deviation: standard - below * low - above * high,
        }
    }

    /// `ln` of the density at a number within (−1, 1).
    pub fn log_density(&self, x: f64) -> f64 {
        let standard = (x - self.location) / self.deviation;
        -0.5 * standard * standard - (2.0 * PI).ln() / 2.0 - (self.deviation * self.mass).ln()
    }

    /// The entropy, in nats, with its slopes.
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
    pub fn entropy(&self) -> Sloped {
        let ((low, high), mass, deviation) = (self.ends, self.mass, self.deviation);
        let (at_low, at_high) = (density(low), density(high));
        let edge = low * at_low - high * at_high;
        // Along each end, standardised: of ln(mass) and of edge / (2 mass).
        let by_end = |end: f64, at: f64, sign: f64| {
            let mass_slope = sign * at;
            let edge_slope = -sign * at * (1.0 - end * end);
            mass_slope / mass + edge_slope / (2.0 * mass) - edge * mass_slope / (2.0 * mass * mass)
        };
        let (by_low, by_high) = (by_end(low, at_low, -1.0), by_end(high, at_high, 1.0));
        Sloped {
            value: ((2.0 * PI * E).sqrt() * deviation * mass).ln() + edge / (2.0 * mass),
            by_location: -(by_low + by_high) / deviation,
            by_deviation: (1.0 - by_low * low - by_high * high) / deviation,
        }
    }
}

/// Numbers of `of` elementwise, and to first order their dependence on location and deviation: on every device, with
/// the arithmetic in f64 on the host.
///
/// # Shapes
/// - `location`, `deviation`, output: `(N, A)`
fn sloped(
    location: &Tensor,
    deviation: &Tensor,
    of: impl Fn(usize, TruncatedNormal) -> Sloped,
) -> Result<Tensor> {
    let numbers = |tensor: &Tensor| tensor.detach().flatten_all()?.to_vec1::<f32>();
    let (locations, deviations) = (numbers(location)?, numbers(deviation)?);
    let (mut values, mut by_location, mut by_deviation) = (Vec::new(), Vec::new(), Vec::new());
    for (index, (location, deviation)) in locations.iter().zip(&deviations).enumerate() {
        let distribution = TruncatedNormal::new(f64::from(*location), f64::from(*deviation));
        let sloped = of(index, distribution);
        values.push(sloped.value as f32);
        by_location.push(sloped.by_location as f32);
        by_deviation.push(sloped.by_deviation as f32);
    }
    let tensor = |numbers| Tensor::from_vec(numbers, location.shape(), location.device());
    // x − x is 0 and has the slope of x.
    let along = |x: &Tensor, slopes: Vec<f32>| (x - x.detach())? * tensor(slopes)?;
    let moved = (along(location, by_location)? + along(deviation, by_deviation)?)?;
    Ok((tensor(values)? + moved)?)
}

/// Numbers drawn by `uniform`, reparameterised.
///
/// # Shapes
/// - all: `(N, A)`; `uniform` in [0, 1)
pub fn sample(location: &Tensor, deviation: &Tensor, uniform: &Tensor) -> Result<Tensor> {
    let uniform = uniform.flatten_all()?.to_vec1::<f32>()?;
    sloped(location, deviation, |index, distribution| distribution.at(f64::from(uniform[index])))
}

/// Entropies, `(N, A)`.
pub fn entropy(location: &Tensor, deviation: &Tensor) -> Result<Tensor> {
    sloped(location, deviation, |_, distribution| distribution.entropy())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A model that has diverged says so through its losses, and does not panic.
    #[test]
    fn what_is_no_number_gives_no_number() {
        for (location, deviation) in [(f64::NAN, 1.0), (0.0, f64::NAN), (f64::INFINITY, 1.0)] {
            let distribution = TruncatedNormal::new(location, deviation);
            assert!(!distribution.at(0.3).by_location.is_finite());
            assert!(!distribution.entropy().value.is_finite());
        }
    }
}
