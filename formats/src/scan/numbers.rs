//! Reading and formatting of numbers of LMGC90's text files, in the forms of Fortran.

use std::fmt::{Display, Write};

use arrayvec::ArrayString;

use crate::report::MAX_MAGNITUDE;

/// Number of columns of a real.
pub const REAL_WIDTH: usize = 14;

/// Reason why a text is not read as a number, as a phrase that follows the text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NumberError(pub &'static str);

impl Display for NumberError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.0)
    }
}

impl std::error::Error for NumberError {}

/// Reason why no number can be in a field, if there is one.
pub(super) fn number_fault(field: &str) -> Option<NumberError> {
    match field {
        "" => Some("blank"),
        stars if stars.contains('*') => Some("a number that did not fit its columns when it was written"),
        tabs if tabs.contains('\t') => Some("with a tab, which is one column wide"),
        _ => None,
    }
    .map(NumberError)
}

/// Reads a real like Fortran from its columns: blanks anywhere; D, E, Q or no letter before a signed exponent.
///
/// Errors: the reason for rejection. Rejected are a blank field and a number without point, which Fortran reads as 0 and
/// as 1e-7 of the written value, and NaN, infinities and numbers beyond [`MAX_MAGNITUDE`], which itself is
/// accepted: a smaller number may be rounded up to it when it is written.
///
/// ```
/// use cd_formats::scan::fortran_real;
/// assert_eq!(fortran_real(" 0.1234568D+01"), Ok(1.234568));
/// assert_eq!(fortran_real("1.0-10"), Ok(1e-10));
/// assert!(fortran_real("100").is_err());
/// ```
pub fn fortran_real(field: &str) -> Result<f64, NumberError> {
    wide_fortran_real(field).and_then(within_bound)
}

/// Reads a real like [`fortran_real`], but of any size that the columns hold, below 1e100: for products of numbers of input,
/// such as moments of inertia.
pub fn wide_fortran_real(field: &str) -> Result<f64, NumberError> {
    let value = wide_real(field)?;
    let without_point = NumberError("without a decimal point, which LMGC90 would scale by 1e-7");
    if field.contains('.') { Ok(value) } else { Err(without_point) }
}

/// Reads a real in free format: as [`fortran_real`], and the point may be missing. Errors: a blank field, no number, a
/// number that is not finite or beyond [`MAX_MAGNITUDE`].
pub fn free_real(field: &str) -> Result<f64, NumberError> {
    wide_real(field).and_then(within_bound)
}

/// The number, unless it is beyond [`MAX_MAGNITUDE`].
fn within_bound(value: f64) -> Result<f64, NumberError> {
    if value.abs() > MAX_MAGNITUDE { Err(NumberError("too large a number, more than 1e40")) } else { Ok(value) }
}

/// Smallest number that the columns of a real do not hold.
const TOO_WIDE_REAL: f64 = 1e100;

/// Real in free format below [`TOO_WIDE_REAL`].
fn wide_real(field: &str) -> Result<f64, NumberError> {
    if let Some(value) = plain_real(field) {
        return Ok(value);
    }
    let text: String = field.chars().filter(|&c| c != ' ').map(|c| c.to_ascii_lowercase()).collect();
    if let Some(fault) = number_fault(&text) {
        return Err(fault);
    }
    let unsigned = text.strip_prefix(['+', '-']).unwrap_or(&text);
    if ["nan", "inf"].iter().any(|word| unsigned.starts_with(word)) {
        return Err(NumberError("not a finite number"));
    }
    let mantissa_end = unsigned.find(|c: char| c != '.' && !c.is_ascii_digit()).unwrap_or(unsigned.len());
    let (mantissa, exponent) = unsigned.split_at(mantissa_end);
    let exponent = if exponent.is_empty() { "0" } else { exponent.strip_prefix(['d', 'e', 'q']).unwrap_or(exponent) };
    // `parse` rejects all other errors: the only letter that it accepts is this e.
    let value: f64 = format!("{mantissa}e{exponent}").parse().map_err(|_| NumberError("not a number"))?;
    if value >= TOO_WIDE_REAL {
        return Err(NumberError("too large a number, 1e100 or more"));
    }
    Ok(if text.starts_with('-') { -value } else { value })
}

/// Real in the form in which almost all are written: digits with a point between, behind E or D a signed exponent, blanks
/// only around them. `None` for all others.
fn plain_real(field: &str) -> Option<f64> {
    let field = field.trim_matches(' ');
    let mut copy = [0; 2 * REAL_WIDTH];
    let copy = copy.get_mut(..field.len())?;
    for (to, byte) in copy.iter_mut().zip(field.bytes()) {
        *to = match byte {
            b'0'..=b'9' | b'.' | b'+' | b'-' | b'E' => byte,
            b'D' => b'E',
            _ => return None,
        };
    }
    std::str::from_utf8(copy).ok()?.parse().ok().filter(|value: &f64| value.abs() < TOO_WIDE_REAL)
}

/// Text of a number, without a heap allocation: 14 letters, or up to 32 while it is being made.
pub type RealText = ArrayString<32>;

/// Formats a real in 14 columns as C's `%14.7E`, eight digits: ` 1.2345679E+00`. For input files.
///
/// Numbers below 1e-99 in size are written as zero, since a third digit of the exponent would not fit. Numbers that
/// cannot be written (1e100 and more, NaN, infinities) become 14 stars, as in Fortran, which no reader accepts as a
/// number. Callers check their values beforehand.
pub fn format_e14(x: f64) -> RealText {
    if x == 0.0 {
        return fixed_text(if x.is_sign_negative() { "-0.0000000E+00" } else { " 0.0000000E+00" });
    }
    let Some((minus, mantissa, exponent)) = scientific_parts::<7>(x) else { return fixed_text(STARS) };
    let mut text = fixed_text(minus);
    text.push_str(&mantissa);
    put_exponent(&mut text, 'E', exponent);
    text
}

/// Formats a real in 14 columns as Fortran's `D14.7`, seven digits: ` 0.1234568D+01`. For state files; same bounds as
/// [`format_e14`].
pub fn format_d14(x: f64) -> RealText {
    if x == 0.0 {
        return fixed_text(if x.is_sign_negative() { "-0.0000000D+00" } else { " 0.0000000D+00" });
    }
    let Some((minus, mantissa, exponent)) = scientific_parts::<6>(x) else { return fixed_text(STARS) };
    let mut text = fixed_text(minus);
    text.push_str("0.");
    text.push_str(&mantissa[..1]);
    text.push_str(&mantissa[2..]);
    match exponent + i32::from(x.abs() >= SMALLEST_REAL) {
        100 => text.push_str("+100"), // Fortran drops the letter
        exponent => put_exponent(&mut text, 'D', exponent),
    }
    text
}

/// Formats a real in 14 columns with as many digits as fit: as [`format_e14`] if that is exact or has the most digits,
/// else without exponent, ` 1.23456789012`. Fortran reads both alike.
///
/// Nine digits from 1e-3 on, twelve from 1 to 1e11. Numbers that were read from such a field are reproduced exactly.
///
/// ```
/// use cd_formats::scan::format_long14;
/// assert_eq!(&format_long14(2.0 / 3.0), " 0.66666666667");
/// assert_eq!(&format_long14(-1234.56789012345), "-1234.56789012");
/// assert_eq!(&format_long14(0.25), " 2.5000000E-01");
/// ```
pub fn format_long14(x: f64) -> RealText {
    let short = format_e14(x);
    let size = x.abs();
    // Larger numbers below 1e11 round to it, which leaves no column for the point.
    if !(1e-3..99_999_999_999.95).contains(&size) || fortran_real(&short) == Ok(x) {
        return short;
    }
    let minus = if x.is_sign_negative() { '-' } else { ' ' };
    // Sign, point, and the digits before it; one digit less where rounding gives a power of ten.
    let integer_digits = (size as u64).checked_ilog10().unwrap_or(0) as usize + 1;
    let decimal_text = |decimals: usize| {
        let mut text = RealText::new();
        write!(text, "{minus}{size:.decimals$}").expect("at most 26 letters");
        text
    };
    let long = decimal_text(REAL_WIDTH - 2 - integer_digits);
    if long.len() == REAL_WIDTH { long } else { decimal_text(REAL_WIDTH - 3 - integer_digits) }
}

/// Smallest magnitude of a number in 14 columns, whose exponent has two digits.
const SMALLEST_REAL: f64 = 1e-99;

/// Text of a number that does not fit its columns.
const STARS: &str = "**************";

fn fixed_text(text: &str) -> RealText {
    RealText::from(text).expect("at most 14 letters")
}

/// Sign (or blank), mantissa with `AFTER` digits behind its point, exponent of ten; `None` if it does not fit its columns.
fn scientific_parts<const AFTER: usize>(x: f64) -> Option<(&'static str, RealText, i32)> {
    let size = if x.abs() < SMALLEST_REAL { 0.0 } else { x.abs() };
    let mut text = RealText::new();
    write!(text, "{size:.AFTER$e}").ok()?;
    let exponent: i32 = text.get(AFTER + 3..)?.parse().ok()?; // NaN and infinities have none
    text.truncate(AFTER + 2);
    (exponent <= 99).then(|| (if x.is_sign_negative() { "-" } else { " " }, text, exponent))
}

/// Appends the letter of an exponent of at most two digits, its sign and its digits.
fn put_exponent(text: &mut RealText, letter: char, exponent: i32) {
    let digits = exponent.unsigned_abs() as u8;
    for letter in
        [letter, if exponent < 0 { '-' } else { '+' }, (b'0' + digits / 10).into(), (b'0' + digits % 10).into()]
    {
        text.push(letter);
    }
}

/// Formats an integer right-aligned in `width` columns; stars, as in Fortran, if it does not fit.
pub fn format_integer(value: impl Display, width: usize) -> String {
    let text = format!("{value:>width$}");
    if text.len() > width { "*".repeat(width) } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reals_in_the_forms_of_fortran() {
        for (field, value) in [
            (" 0.1234568D+01", 1.234568),
            ("-0.1234568d-04", -0.1234568e-4),
            (" 1.2345679E+00", 1.2345679),
            ("1.0Q2", 100.0),
            ("1.0-10", 1e-10),
            (" 0.1234568-122", 0.1234568e-122),
            ("   1. 5   D 0 1", 15.0),
            (".5", 0.5),
            ("+5.", 5.0),
            ("-0.0000000D+00", 0.0),
        ] {
            assert_eq!(fortran_real(field), Ok(value), "{field}");
        }
    }

    #[test]
    fn reals_that_are_rejected() {
        for field in [
            "",
            "   ",
            "100",
            "1e3",
            "NaN",
            "-nan",
            "Infinity",
            "inf",
            "1.0E400",
            "**************",
            ".",
            "1.0.0",
            "1.0E",
            "1.0EE5",
            "E5",
            "--1.0",
            "1.0+-5",
            "0x1.0",
            "1,0",
            "1.0e5.0",
            "\u{1a}1.0",
        ] {
            assert!(fortran_real(field).is_err(), "{field} was read as {:?}", fortran_real(field));
        }
        assert!(fortran_real("100").unwrap_err().0.contains("1e-7"));
        assert_eq!(free_real("100"), Ok(100.0));
    }

    #[test]
    fn numbers_of_input_have_a_bound_that_moments_may_exceed() {
        let (largest, larger) = ("-1.0000000E+40", "-1.0000001E+40");
        for parse in [fortran_real, free_real] {
            assert_eq!((parse(largest), parse(larger).is_err()), (Ok(-MAX_MAGNITUDE), true));
        }
        assert_eq!(wide_fortran_real(larger), Ok(-1.0000001e40));
        assert!(wide_fortran_real("1.0000000+100").is_err());
    }

    #[test]
    fn long_reals_fill_their_columns_and_stay_when_given_again() {
        for x in
            [1.0 / 3.0, 9.999_999_999_999_9, 99_999.999_999_99, 1.0 / 998.0, 99_999_999_999.9, 1e99 / 7.0, 1e-9 / 3.0]
        {
            for x in [x, -x] {
                let text = format_long14(x);
                assert_eq!(text.len(), 14, "{text}");
                let read = wide_fortran_real(&text).unwrap();
                // Without exponent there are at least nine digits, otherwise eight.
                let error = (read / x - 1.0).abs();
                assert!(error < if (1e-3..1e11).contains(&x.abs()) { 5e-9 } else { 5e-8 }, "{text} {x:e}");
                assert_eq!(wide_fortran_real(&format_long14(read)), Ok(read));
            }
        }
        let texts = [0.0, -2.5, 1e100].map(|x| format_long14(x).to_string());
        assert_eq!(texts, [" 0.0000000E+00", "-2.5000000E+00", STARS]);
    }

    #[test]
    fn long_reals_have_fourteen_columns_next_to_powers_of_ten() {
        for power in -3..11 {
            for mantissa in [1.0, 1.0 + 1e-15, 1.234_567_890_123_45, 9.999_999_999_999_99, 9.999_999_49] {
                let x = mantissa * 10f64.powi(power);
                let text = format_long14(x);
                assert_eq!(text.len(), REAL_WIDTH, "{text} of {x:e}");
                assert!((fortran_real(&text).unwrap() / x - 1.0).abs() <= 5e-9, "{text} of {x:e}");
            }
        }
    }

    #[test]
    fn reals_as_c_writes_them() {
        for (x, text) in [
            (0.0, " 0.0000000E+00"),
            (-0.0, "-0.0000000E+00"),
            (1.23456789, " 1.2345679E+00"),
            (9.99999996, " 1.0000000E+01"),
            (9.99999994, " 9.9999999E+00"),
            (-0.000123456785, "-1.2345679E-04"), // the double lies just above the tie
            (1.00000005, " 1.0000000E+00"),      // and this one just below
            (-2.5e99, "-2.5000000E+99"),
            (9.9999999e99, " 9.9999999E+99"),
            (1e-99, " 1.0000000E-99"),
            (9.9e-100, " 0.0000000E+00"),
            (-1e-300, "-0.0000000E+00"),
            (1e100, "**************"),
            (-9.99999999e99, "**************"),
            (f64::NAN, "**************"),
            (f64::NEG_INFINITY, "**************"),
        ] {
            assert_eq!(format_e14(x).as_str(), text, "{x:e}");
        }
    }

    #[test]
    fn reals_as_fortran_writes_them() {
        for (x, text) in [
            (0.0, " 0.0000000D+00"),
            (-0.0, "-0.0000000D+00"),
            (1.234567891, " 0.1234568D+01"),
            (0.99999996, " 0.1000000D+01"),
            (-0.05, "-0.5000000D-01"),
            (1.0, " 0.1000000D+01"),
            (2.5e98, " 0.2500000D+99"),
            (-2.5e99, "-0.2500000+100"),
            (1e-99, " 0.1000000D-98"),
            (9e-100, " 0.0000000D+00"),
            (1e100, "**************"),
            (f64::INFINITY, "**************"),
        ] {
            assert_eq!(format_d14(x).as_str(), text, "{x:e}");
        }
    }

    #[test]
    fn what_is_written_fits_its_columns_and_is_read_again() {
        let mut x = 1.2345678912345e-98;
        while x < 1e99 {
            for y in [x, -x] {
                let (e, d) = (format_e14(y), format_d14(y));
                assert_eq!((e.len(), d.len()), (14, 14), "{e} {d}");
                assert!((wide_fortran_real(&e).unwrap() / y - 1.0).abs() < 5.1e-8);
                assert!((wide_fortran_real(&d).unwrap() / y - 1.0).abs() < 5.1e-7);
            }
            x *= 7.3;
        }
    }

    #[test]
    fn integers_that_do_not_fit_become_stars() {
        assert_eq!(format_integer(42, 5), "   42");
        assert_eq!(format_integer(100_000, 5), "*****");
    }
}
