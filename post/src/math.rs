//! Vectors, fitted lines and medians.

use nalgebra::{Matrix3, Vector3};

/// Vector.
pub type Vec3 = Vector3<f64>;
/// 3x3 matrix.
pub type Mat3 = Matrix3<f64>;

/// Straight line fitted by least squares.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedLine {
    pub slope: f64,
    pub intercept: f64,
    /// Square of the correlation.
    pub r2: f64,
}

impl FittedLine {
    /// Returns the least-squares line through points of which at least two have different x.
    pub fn least_squares(points: &[(f64, f64)]) -> Option<FittedLine> {
        let points: Vec<(f64, f64)> = points.iter().copied().filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
        let n = points.len() as f64;
        let (x, y) = points.iter().fold((0.0, 0.0), |(x, y), p| (x + p.0 / n, y + p.1 / n));
        let (xx, xy, yy) = points.iter().fold((0.0, 0.0, 0.0), |(xx, xy, yy), p| {
            (xx + (p.0 - x) * (p.0 - x), xy + (p.0 - x) * (p.1 - y), yy + (p.1 - y) * (p.1 - y))
        });
        // Equal x can differ from their mean by rounding.
        let differ = points.iter().any(|p| p.0 != points[0].0);
        let slope = xy / xx;
        let r2 = if yy > 0.0 { xy * xy / (xx * yy) } else { 1.0 };
        (differ && xx > 0.0).then_some(FittedLine { slope, intercept: y - slope * x, r2 })
    }
}

/// Median; for an even number of values the mean of the middle two. NaN without values or if one is not defined.
pub fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        count if count == 0 || values.iter().any(|value| value.is_nan()) => f64::NAN,
        count if count % 2 == 1 => values[middle],
        _ => 0.5 * (values[middle - 1] + values[middle]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_needs_two_places() {
        assert_eq!(FittedLine::least_squares(&[(1.0, 2.0), (1.0, 3.0)]), None);
        assert_eq!(FittedLine::least_squares(&[(1.0, 2.0), (f64::NAN, 3.0)]), None);
        // The mean of seven equal numbers is another one.
        let x = 250.0_f64.cbrt().recip();
        let equal: Vec<(f64, f64)> = (0..7).map(|k| (x, f64::from(k))).collect();
        assert_eq!(FittedLine::least_squares(&equal), None);
        let line = FittedLine::least_squares(&[(0.0, 1.0), (2.0, 5.0), (1.0, f64::NAN)]);
        assert_eq!(line, Some(FittedLine { slope: 2.0, intercept: 1.0, r2: 1.0 }));
    }

    #[test]
    fn a_median_is_in_the_middle() {
        let of = |values: &[f64]| median(values.iter().copied());
        assert_eq!((of(&[3.0, 1.0, 2.0]), of(&[4.0, 1.0, 3.0, 2.0])), (2.0, 2.5));
        assert!(of(&[]).is_nan() && of(&[1.0, f64::NAN]).is_nan());
    }
}
