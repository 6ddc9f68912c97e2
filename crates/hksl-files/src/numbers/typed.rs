//! Numbers as people type them: `100_000`, `1e5`, `100000.0` and `.001`, wherever a number of that kind is meant.

use std::fmt;

use serde::de::{Deserialize, Deserializer, Error, Visitor};

/// Whole numbers up to here are exact as `f64`.
const MOST_EXACT: f64 = 9_007_199_254_740_992.0;

/// A whole number, exactly; none for text that is not one.
///
/// ```
/// use hksl_files::numbers::whole;
///
/// for text in ["100000", "100_000", "1e5", "+1E+5", "100000.0", "100000.", "0.1e6"] {
///     assert_eq!(whole(text), Some(100_000), "{text}");
/// }
/// assert_eq!(whole("-3"), Some(-3));
/// for text in ["1.5", "1e-1", "", ".", "1_", "1__0", "1,000", "100k", "1e", "1e99", "one"] {
///     assert_eq!(whole(text), None, "{text}");
/// }
/// ```
pub fn whole(text: &str) -> Option<i128> {
    let text = without_underscores(text)?;
    let (negative, rest) = match text.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, text.strip_prefix('+').unwrap_or(&text)),
    };
    let (mantissa, exponent) = match rest.split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, exponent.parse::<i64>().ok()?),
        None => (rest, 0),
    };
    let (before, after) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let digits = format!("{before}{after}");
    if digits.is_empty() || !digits.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let significant = digits.trim_end_matches('0');
    if significant.is_empty() {
        return Some(0);
    }
    let zeros = (digits.len() - significant.len()) as i64;
    let shift = exponent.checked_sub(after.len() as i64)?.checked_add(zeros)?;
    let factor = 10_i128.checked_pow(u32::try_from(shift).ok()?)?;
    let number = significant.parse::<i128>().ok()?.checked_mul(factor)?;
    Some(if negative { -number } else { number })
}

/// A finite number; none for text that is not one.
///
/// ```
/// use hksl_files::numbers::number;
///
/// for text in ["0.001", ".001", "1e-3", "+1_0e-4"] {
///     assert_eq!(number(text), Some(0.001), "{text}");
/// }
/// for text in ["", "nan", "inf", "0,001", "1e", "1e999"] {
///     assert_eq!(number(text), None, "{text}");
/// }
/// ```
pub fn number(text: &str) -> Option<f64> {
    let text = without_underscores(text)?;
    let plain = text.bytes().all(|byte| byte.is_ascii_digit() || b"+-.eE".contains(&byte));
    text.parse().ok().filter(|number: &f64| plain && number.is_finite())
}

/// How a number must be written that is meant by other text: with separators, a decimal comma, or a unit.
///
/// ```
/// use hksl_files::numbers::rewritten;
///
/// let written = [("100,000", "100000"), ("1 000", "1000"), ("0,001", "0.001"), ("1,5", "1.5"), ("1.5k", "1500")];
/// for (text, way) in written {
///     assert_eq!(rewritten(text).as_deref(), Some(way), "{text}");
/// }
/// assert_eq!(rewritten("1.000.000").as_deref(), Some("1000000"));
/// assert_eq!((rewritten("1.500"), rewritten("many")), (None, None));
/// ```
pub fn rewritten(text: &str) -> Option<String> {
    let text = text.trim();
    let grouped = |separator: char| {
        let mut groups = text.split(separator);
        let first = groups.next()?;
        let sound = !first.is_empty() && first.len() <= 3 && !first.starts_with('0');
        let rest: Vec<&str> = groups.collect();
        let all =
            rest.iter().chain([&first]).all(|of| of.bytes().all(|byte| byte.is_ascii_digit()));
        // A single point is a decimal one.
        let least = if separator == '.' { 2 } else { 1 };
        let groups = rest.len() >= least && rest.iter().all(|group| group.len() == 3);
        let whole = sound && groups && all;
        whole.then(|| text.replace(separator, ""))
    };
    if let Some(written) = [',', ' ', '\'', '.'].into_iter().find_map(grouped) {
        return Some(written);
    }
    if text.matches(',').count() == 1 {
        let written = text.replace(',', ".");
        return number(&written).map(|_| written);
    }
    let factor = match text.chars().next_back()? {
        'k' | 'K' => 3,
        'm' | 'M' => 6,
        _ => return None,
    };
    whole(&format!("{}e{factor}", &text[..text.len() - 1])).map(|number| number.to_string())
}

/// Each underscore between two digits.
fn without_underscores(text: &str) -> Option<String> {
    let text = text.trim();
    let bytes = text.as_bytes();
    let digit = |index: usize| bytes.get(index).is_some_and(u8::is_ascii_digit);
    let sound = |index: usize| index > 0 && digit(index - 1) && digit(index + 1);
    let mut underscores = text.match_indices('_');
    underscores.all(|(index, _)| sound(index)).then(|| text.replace('_', ""))
}

/// A whole number that was read as a float; none for one that is not whole.
pub fn whole_float(number: f64) -> Option<i64> {
    (number.fract() == 0.0 && number.abs() <= MOST_EXACT).then_some(number as i64)
}

/// A whole number of a file, which may be written `1.0` or `1e5`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Whole(pub u64);

impl<'de> Deserialize<'de> for Whole {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Reader;

        fn checked<E: Error>(number: Option<i64>, said: &dyn fmt::Display) -> Result<Whole, E> {
            let sound = number.and_then(|number| u64::try_from(number).ok());
            sound
                .map(Whole)
                .ok_or_else(|| E::custom(format!("{said} is not a whole number of at least 0")))
        }

        impl Visitor<'_> for Reader {
            type Value = Whole;

            fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str("a whole number of at least 0")
            }

            fn visit_i64<E: Error>(self, number: i64) -> Result<Whole, E> {
                checked(Some(number), &number)
            }

            fn visit_u64<E: Error>(self, number: u64) -> Result<Whole, E> {
                Ok(Whole(number))
            }

            fn visit_f64<E: Error>(self, number: f64) -> Result<Whole, E> {
                checked(whole_float(number), &number)
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<Whole, E> {
                let way = whole(text).map(|number| number.to_string()).or_else(|| rewritten(text));
                let hint =
                    way.map_or_else(String::new, |way| format!("; write {way} without quotes"));
                Err(E::custom(format!("{text:?} is not a whole number of at least 0{hint}")))
            }
        }

        deserializer.deserialize_any(Reader)
    }
}
