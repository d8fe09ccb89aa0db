//! Formatting of numbers: unit prefixes and round lengths.

/// Superscript digits, and the minus sign as the eleventh.
const SUPERSCRIPT_DIGITS: [char; 11] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹', '⁻'];

const UNIT_PREFIXES: [&str; 9] = ["p", "n", "µ", "m", "", "k", "M", "G", "T"];

/// Returns the factor and the unit with prefix that bring numbers up to `largest` to between 1 and 1000.
///
/// A number without unit ("1") is unchanged, and so are seconds above 1. Values beyond all prefixes get a power of ten
/// before the unit, and so does a kilogram, which has its prefix.
///
/// ```
/// # use cd_post::write::scale::unit_prefix;
/// assert_eq!(unit_prefix(2.5e4, "Pa"), (1e3, "kPa".to_string()));
/// assert_eq!(unit_prefix(0.0, "m"), (1.0, "m".to_string()));
/// assert_eq!(unit_prefix(3e-20, "J"), (1e-21, "10⁻²¹ J".to_string()));
/// assert_eq!(unit_prefix(2e7, "kg m/s"), (1e6, "10⁶ kg m/s".to_string()));
/// ```
pub fn unit_prefix(largest: f64, unit: &str) -> (f64, String) {
    if !(largest > 0.0 && largest.is_finite()) || ["1", "°"].contains(&unit) || unit == "s" && largest >= 1.0 {
        return (1.0, unit.to_string());
    }
    let triple = (largest.log10() / 3.0).floor() as i32;
    let factor = 10f64.powi(3 * triple);
    let fits_unit = |prefix: &&&str| prefix.is_empty() || !unit.starts_with("kg");
    let label = match UNIT_PREFIXES.get((triple + 4).max(-1) as usize).filter(fits_unit) {
        Some(prefix) => format!("{prefix}{unit}"),
        None => format!("10{} {unit}", to_superscript(3 * triple)),
    };
    (factor, label)
}

/// An integer in superscript digits.
pub fn to_superscript(number: i32) -> String {
    number.to_string().chars().map(|c| SUPERSCRIPT_DIGITS[c.to_digit(10).map_or(10, |d| d as usize)]).collect()
}

/// The largest of 1, 2, 5 times a power of ten that is not above `limit`, which is > 0.
///
/// ```
/// assert_eq!(cd_post::write::scale::round_below(70.0), 50.0);
/// ```
pub fn round_below(limit: f64) -> f64 {
    let power = 10f64.powi(limit.log10().floor() as i32);
    [5.0, 2.0, 1.0].into_iter().map(|m| m * power).find(|length| *length <= limit).unwrap_or(power)
}

/// Number of significant digits that distinguish numbers up to `largest` with the distance `step` (> 0); more than any
/// number has if `step` is 0.
///
/// ```
/// assert_eq!(cd_post::write::scale::digits_needed(200.0, 0.05), 5);
/// ```
pub fn digits_needed(largest: f64, step: f64) -> usize {
    (largest.log10().floor() - step.log10().floor() + 1.0).max(1.0) as usize
}

/// Formats a value with six significant digits, without trailing zeros.
///
/// ```
/// # use cd_post::write::scale::format_six_digits;
/// assert_eq!(format_six_digits(863.8000000000001), "863.8");
/// assert_eq!(format_six_digits(-0.0), "0");
/// assert_eq!(format_six_digits(1.0 / 3e7), "3.33333e-8");
/// ```
pub fn format_six_digits(value: f64) -> String {
    format_digits(value, 6)
}

/// Formats a value with `digits` significant digits (at least 1), without trailing zeros.
pub fn format_digits(value: f64, digits: usize) -> String {
    let decimals = digits.clamp(1, 17) - 1;
    let rounded: f64 = format!("{value:.decimals$e}").parse().unwrap_or(value);
    if rounded == 0.0 {
        "0".into()
    } else if (1e-4..1e9).contains(&rounded.abs()) {
        rounded.to_string()
    } else {
        format!("{rounded:e}")
    }
}
