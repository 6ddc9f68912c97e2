//! Numbers as people read and type them.

mod typed;

pub use typed::{Whole, number, rewritten, whole, whole_float};

/// `1990518` as `1,990,518`.
///
/// ```
/// assert_eq!(hksl_files::numbers::grouped(1_990_518), "1,990,518");
/// assert_eq!(hksl_files::numbers::grouped(999), "999");
/// ```
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}
