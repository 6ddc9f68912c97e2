//! dm_control's `tolerance` reward: 1 inside an interval, decreasing smoothly outside.

/// Shape of the decrease outside the interval (dm_control's sigmoid).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Shape {
    /// `exp(-(s·d)² / 2)`, `s = √(-2 ln w)`.
    Gaussian,
    /// `1 - s·d` while positive, `s = 1 - w`.
    Linear,
    /// `1 - (s·d)²` while positive, `s = √(1 - w)`.
    Quadratic,
}

/// Interval of value 1, and the decrease outside.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tolerance {
    /// Lower end of the interval, included.
    pub low: f64,
    /// Upper end of the interval, included.
    pub high: f64,
    /// Distance from the interval at which the value is `value_at_margin`. 0 makes the value 0 outside the interval.
    pub margin: f64,
    /// The value `w` at that distance.
    pub value_at_margin: f64,
    /// The shape of the decrease.
    pub shape: Shape,
}

impl Tolerance {
    /// A value of 0 outside the interval. The caller sets the interval.
    pub(crate) const HARD: Self = Self::around_zero(0.0);

    /// dm_control's defaults around the point 0: Gaussian, 0.1 at `margin`.
    pub(crate) const fn around_zero(margin: f64) -> Self {
        Self { low: 0.0, high: 0.0, margin, value_at_margin: 0.1, shape: Shape::Gaussian }
    }

    /// The value at `x`, in `[0, 1]`.
    pub(crate) fn value(&self, x: f64) -> f64 {
        if (self.low..=self.high).contains(&x) {
            return 1.0;
        }
        if self.margin == 0.0 {
            return 0.0;
        }
        let outside = if x < self.low { self.low - x } else { x - self.high };
        let distance = outside / self.margin;
        match self.shape {
            Shape::Gaussian => {
                let scaled = distance * (-2.0 * self.value_at_margin.ln()).sqrt();
                (-0.5 * scaled.powi(2)).exp()
            }
            Shape::Linear => {
                let scaled = distance * (1.0 - self.value_at_margin);
                if scaled.abs() < 1.0 { 1.0 - scaled } else { 0.0 }
            }
            Shape::Quadratic => {
                let scaled = distance * (1.0 - self.value_at_margin).sqrt();
                if scaled.abs() < 1.0 { 1.0 - scaled.powi(2) } else { 0.0 }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_inside_and_the_named_value_at_the_margin() {
        for shape in [Shape::Gaussian, Shape::Linear, Shape::Quadratic] {
            let tolerance =
                Tolerance { low: -1.0, high: 2.0, margin: 3.0, value_at_margin: 0.3, shape };
            for (x, expected) in [(-1.0, 1.0), (0.5, 1.0), (2.0, 1.0), (5.0, 0.3), (-4.0, 0.3)] {
                assert!((tolerance.value(x) - expected).abs() < 1e-15, "{shape:?} at {x}");
            }
            assert!(tolerance.value(3.0) > tolerance.value(4.0));
        }
    }

    #[test]
    fn quadratic_ends_at_zero_and_no_margin_is_a_hard_edge() {
        let quadratic = Tolerance {
            value_at_margin: 0.0,
            shape: Shape::Quadratic,
            ..Tolerance::around_zero(1.0)
        };
        assert_eq!(quadratic.value(0.5), 0.75);
        assert_eq!(quadratic.value(1.5), 0.0);
        assert_eq!(Tolerance::around_zero(0.0).value(1e-9), 0.0);
        assert_eq!(Tolerance::around_zero(0.0).value(0.0), 1.0);
    }
}
