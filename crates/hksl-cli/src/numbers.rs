//! Parsing and formatting of numbers for the command line.

use std::ops::RangeInclusive;

pub use hksl_files::numbers::grouped;
use hksl_files::numbers::{number, rewritten, whole};

/// Parser for an integer option within bounds; accepts `100000`, `100_000` and `1e5`.
pub fn whole_within<T: TryFrom<i128>>(
    bounds: RangeInclusive<i128>,
) -> impl Fn(&str) -> Result<T, String> + Clone {
    move |text| {
        let known = whole(text).filter(|number| bounds.contains(number));
        known.and_then(|number| T::try_from(number).ok()).ok_or_else(|| {
            let (least, most) = (bounds.start(), bounds.end());
            let range = match (*least, *most) {
                (least, most) if least < 0 => format!("a whole number from {least} to {most}"),
                (least, most) if most >= u32::MAX.into() => {
                    format!("a whole number of at least {least}")
                }
                (least, most) => format!("a whole number from {least} to {most}"),
            };
            format!("it must be {range}{}", hint(text))
        })
    }
}

/// Parser for an integer option of at least `least`.
pub fn at_least<T: TryFrom<i128>>(least: i128) -> impl Fn(&str) -> Result<T, String> + Clone {
    whole_within(least..=u64::MAX.into())
}

/// Parser for an integer option whose range the configuration checks.
pub fn any_whole(text: &str) -> Result<i64, String> {
    whole_within(i64::MIN.into()..=i64::MAX.into())(text)
}

/// Parser for a floating-point option.
pub fn any_number(text: &str) -> Result<f64, String> {
    let known = number(text).or_else(|| text.parse().ok());
    known.ok_or_else(|| format!("it must be a number, as in 0.001 or 1e-3{}", hint(text)))
}

fn hint(text: &str) -> String {
    rewritten(text).map_or_else(String::new, |way| format!("; write {way}"))
}

/// Bytes in the largest unit that leaves a whole part: `2.1 GB`.
pub fn bytes(count: u64) -> String {
    let units = ["kB", "MB", "GB", "TB"];
    let mut amount = count as f64 / 1000.0;
    let mut unit = 0;
    while amount >= 999.5 && unit + 1 < units.len() {
        amount /= 1000.0;
        unit += 1;
    }
    if amount < 9.95 {
        format!("{amount:.1} {}", units[unit])
    } else {
        format!("{amount:.0} {}", units[unit])
    }
}

/// Seconds as `3 h 12 min`, `4 min 5 s` or `6.1 s`.
pub fn duration(seconds: f64) -> String {
    if seconds < 59.95 {
        return format!("{seconds:.1} s");
    }
    let whole = seconds.round() as u64;
    if whole < 3600 {
        return format!("{} min {} s", whole / 60, whole % 60);
    }
    let minutes = (seconds / 60.0).round() as u64;
    format!("{} h {} min", minutes / 60, minutes % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn are_written_for_people() {
        assert_eq!(
            (grouped(0), grouped(999), grouped(1_990_518)),
            ("0".into(), "999".into(), "1,990,518".into())
        );
        assert_eq!(
            (bytes(2_116_800_000), bytes(999_700), bytes(52_900_000)),
            ("2.1 GB".into(), "1.0 MB".into(), "53 MB".into())
        );
        assert_eq!(
            (duration(6.12), duration(245.0), duration(11_520.0)),
            ("6.1 s".into(), "4 min 5 s".into(), "3 h 12 min".into())
        );
    }
}
