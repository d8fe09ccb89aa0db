//! Rounding of numbers to the digits that the files of DATBOX can hold, so that checks see the bodies that cd-solve reads.

use cd_formats::scan::{format_long14, wide_fortran_real};
use nalgebra::{Matrix3, Vector3};

/// Nearest number that the files can hold: 8 digits, no negative zero.
///
/// ```
/// assert_eq!(cd_pre::rounding::round_8_digits(2.0 / 3.0), 0.66666667);
/// assert_eq!(cd_pre::rounding::round_8_digits(-123456789.0), -123456790.0);
/// ```
pub fn round_8_digits(x: f64) -> f64 {
    format!("{x:.7e}").parse().unwrap_or(x) + 0.0
}

/// [`round_8_digits`] of each component.
pub fn round_point(point: &Vector3<f64>) -> Vector3<f64> {
    point.map(round_8_digits)
}

/// Nearest number that the files can hold for a polyhedron: up to 12 digits, no negative zero.
pub fn round_14_columns(x: f64) -> f64 {
    wide_fortran_real(&format_long14(x)).unwrap_or(x) + 0.0
}

/// [`round_14_columns`] of each component of axes.
pub fn round_axes(axes: &Matrix3<f64>) -> Matrix3<f64> {
    axes.map(round_14_columns)
}
