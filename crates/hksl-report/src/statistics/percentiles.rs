//! Percentiles.

use super::{Error, Result};

/// Percentile of `values` in any order, at `percent` from 0 to 100: the sorted value at position
/// `percent/100 · (n − 1)`, linearly interpolated. This is NumPy's default, method 7 of Hyndman and Fan, "Sample
/// quantiles in statistical packages", The American Statistician 50(4), 1996.
///
/// ```
/// use hksl_report::statistics::percentile;
///
/// let values = [7.0, 1.0, 10.0, 4.0, 3.0, 8.0, 2.0, 9.0, 6.0, 5.0];
/// assert!((percentile(&values, 2.5)? - 1.225).abs() < 1e-12);
/// assert!((percentile(&values, 97.5)? - 9.775).abs() < 1e-12);
/// # Ok::<(), hksl_report::statistics::Error>(())
/// ```
///
/// # Errors
/// An empty list, a NaN or infinite value, a percentage outside 0 to 100.
pub fn percentile(values: &[f64], percent: f64) -> Result<f64> {
    if !(0.0..=100.0).contains(&percent) {
        return Err(Error::Percent { got: percent });
    }
    if values.is_empty() {
        return Err(Error::NoValue);
    }
    if let Some(position) = values.iter().position(|value| !value.is_finite()) {
        return Err(Error::Value { position, value: values[position] });
    }
    Ok(select(&mut values.to_vec(), percent))
}

/// Percentile of a non-empty list, which is reordered: selecting two percentiles of 50,000 values is much faster than
/// sorting them.
pub(super) fn select(values: &mut [f64], percent: f64) -> f64 {
    let last = values.len() - 1;
    let place = percent / 100.0 * last as f64;
    let before = (place.floor() as usize).min(last);
    let share = place - before as f64;
    let (_, &mut low, higher) = values.select_nth_unstable_by(before, f64::total_cmp);
    let high = higher.iter().copied().reduce(f64::min).unwrap_or(low);
    // Interpolates from the nearer value, as NumPy does, so the result is never outside the two values.
    if share < 0.5 { low + (high - low) * share } else { high - (high - low) * (1.0 - share) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_and_single_values() {
        assert_eq!(percentile(&[3.0, 1.0, 2.0], 0.0), Ok(1.0));
        assert_eq!(percentile(&[3.0, 1.0, 2.0], 100.0), Ok(3.0));
        assert_eq!(percentile(&[3.0, 1.0, 2.0], 50.0), Ok(2.0));
        assert_eq!(percentile(&[3.0, 1.0], 75.0), Ok(2.5));
        assert_eq!(percentile(&[7.0], 33.0), Ok(7.0));
    }

    #[test]
    fn what_has_none() {
        assert_eq!(percentile(&[], 50.0), Err(Error::NoValue));
        assert_eq!(percentile(&[1.0], 100.1), Err(Error::Percent { got: 100.1 }));
        assert!(percentile(&[1.0], f64::NAN).is_err());
        let error = percentile(&[1.0, f64::NEG_INFINITY], 50.0);
        assert_eq!(error, Err(Error::Value { position: 1, value: f64::NEG_INFINITY }));
    }
}
