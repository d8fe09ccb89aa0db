//! Least-squares planes through the heights of a surface, and the noise of their slopes due to single grains.

use crate::math::{Mat3, Vec3};

/// Default reach of the planes fitted to the heights of an aggregate, in mean radii. The standard error due to single
/// grains is 5 degrees at 6 radii, 1.8 at 10 and 1.3 at 12.
pub const DEFAULT_FIT_REACH: f64 = 10.0;

/// Sums for the least-squares plane through weighted heights about a point.
///
/// A height represents a part of the surface: its solid angle (sr) on an aggregate, where coordinates are angles (rad), or
/// 1, a column, on a bed, where coordinates are in m. The height at the distance d is weighted by w part, with
/// w = (1 - (d / reach)^2)^2. In the matrices, row = (1, x / reach, y / reach).
#[derive(Debug, Clone, Default)]
pub struct PlaneFit {
    /// Distance up to which heights count, in the unit of the coordinates.
    reach: f64,
    /// Matrix of the normal equations: sum of w part row (x) row.
    matrix: Mat3,
    /// Right side of the normal equations: sum of w part height row, m times the unit of the parts.
    sums: Vec3,
    /// Sum of w^2 part row (x) row, from which the variance due to noise follows.
    noise: Mat3,
    /// Sum of w part.
    pub weight_sum: f64,
    /// Sum of w^2 part.
    square_sum: f64,
}

/// A plane through the heights about a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedPlane {
    /// Height of the plane at the point, m.
    pub height: f64,
    /// Gradient of the height along both axes, m per unit of the coordinates.
    pub gradient: [f64; 2],
    /// Var(∂h/∂x) + Var(∂h/∂y) for noise of density 1, see [`NoiseDensity`].
    pub variance: f64,
    /// Fraction by which the fit lowers the expected sum of the products of a residual with those in its patch, per unit
    /// of the patch's area.
    removed_fraction: f64,
    /// Area of equal weights that averages noise as much as the weights of the fit, in the unit of the parts:
    /// (sum of w part)^2 / sum of w^2 part.
    pub effective_area: f64,
}

impl FittedPlane {
    /// The plane through `count` heights of equal weight, each of which represents a part of 1, so that the area is their
    /// number.
    pub fn through_all(height: f64, gradient: [f64; 2], variance: f64, count: f64) -> FittedPlane {
        FittedPlane { height, gradient, variance, removed_fraction: 1.0 / count, effective_area: count }
    }
}

impl PlaneFit {
    /// `reach`: distance up to which heights count, in the unit of the coordinates.
    pub fn new(reach: f64) -> PlaneFit {
        PlaneFit { reach, ..PlaneFit::default() }
    }

    /// The weight w of a height at (x, y) from the point, for a part of 1.
    pub fn weight_at(&self, [x, y]: [f64; 2]) -> f64 {
        (1.0 - (x * x + y * y) / (self.reach * self.reach)).max(0.0).powi(2)
    }

    /// Adds a height (m) at (x, y) from the point, which represents `part` of the surface.
    pub fn add(&mut self, position: [f64; 2], height: f64, part: f64) {
        let weighted_part = self.weight_at(position) * part;
        let row = Vec3::new(1.0, position[0] / self.reach, position[1] / self.reach);
        self.matrix += weighted_part * row * row.transpose();
        self.sums += weighted_part * height * row;
        self.noise += weighted_part * weighted_part / part * row * row.transpose();
        self.weight_sum += weighted_part;
        self.square_sum += weighted_part * weighted_part / part;
    }

    /// The plane; None where the heights lie on a line.
    pub fn fitted_plane(&self) -> Option<FittedPlane> {
        // Coordinates are of order 1: points in a strip narrower than a thousandth of the reach are a line.
        let scaled_inverse = (self.matrix / self.weight_sum).try_inverse().filter(|inverse| inverse.amax() < 1e6)?;
        let inverse = scaled_inverse / self.weight_sum;
        let fit = inverse * self.sums;
        let spread = inverse * self.noise * inverse;
        Some(FittedPlane {
            height: fit.x,
            gradient: [fit.y / self.reach, fit.z / self.reach],
            variance: (spread[(1, 1)] + spread[(2, 2)]) / (self.reach * self.reach),
            removed_fraction: 2.0 * inverse[(0, 0)] - spread[(0, 0)],
            effective_area: self.weight_sum * self.weight_sum / self.square_sum,
        })
    }
}

/// Density of the noise of single grains: the covariance of the height at a point with those around it, integrated over the
/// surface; m^2 times the unit of the parts (see [`PlaneFit`]).
///
/// Averages over many grains of white noise of this density have the variances of averages of the surface.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoiseDensity {
    /// Sum over the heights k, and over the heights j in the patch of each, of e_k e_j part_j; e are residuals, m.
    covariances: f64,
    /// Sum of part e^2.
    variances: f64,
    /// Sum of the fractions of the covariances that the fits remove.
    removed_fractions: f64,
    /// Number of heights.
    count: f64,
}

impl NoiseDensity {
    /// Adds a height that represents `part` of the surface: `residual` from the fit `plane`, and `products`, the sum of it
    /// times the residuals within a diameter times their parts; `patch`, the sum of these parts.
    pub fn add(&mut self, part: f64, residual: f64, products: f64, patch: f64, plane: &FittedPlane) {
        self.covariances += products;
        self.variances += part * residual * residual;
        self.removed_fractions += patch * plane.removed_fraction;
        self.count += 1.0;
    }

    /// Returns the mean, corrected for the share that the fits remove, and at least that of independent heights; 0 without
    /// heights.
    pub fn mean_density(&self) -> f64 {
        if self.count == 0.0 {
            return 0.0;
        }
        // In a patch nearly as large as the reach, the fit removes almost all noise.
        let remaining = (1.0 - self.removed_fractions / self.count).max(0.2);
        (self.covariances / self.count / remaining).max(self.variances / self.count)
    }
}

/// Slope, rad, corrected for noise: its squared tangent is reduced by the square of `noise`, the standard deviation of the
/// gradient, by which the mean square of a noisy gradient is too large. Overhanging slopes are unchanged.
pub fn without_noise(slope: f64, noise: f64) -> f64 {
    if slope.cos() <= 0.0 {
        return slope;
    }
    let square = slope.tan().powi(2) - noise * noise;
    if square < 0.0 { 0.0 } else { square.sqrt().atan() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_is_found_whatever_its_samples() {
        let mut fit = PlaneFit::new(3.0);
        assert!(fit.fitted_plane().is_none());
        for (x, y) in (-3..=3).flat_map(|i| (-2..=3).map(move |j| (f64::from(i) * 0.7, f64::from(j) * 0.9))) {
            fit.add([x, y], 5.0 + 0.25 * x - 0.5 * y, 1.0);
        }
        let plane = fit.fitted_plane().unwrap();
        assert!((plane.height - 5.0).abs() < 1e-13 && (plane.gradient[0] - 0.25).abs() < 1e-13);
        assert!((plane.gradient[1] + 0.5).abs() < 1e-13);
        let mut line = PlaneFit::new(3.0);
        (0..9).for_each(|k| line.add([0.3 * f64::from(k) - 1.0, 0.0], 1.0, 1.0));
        assert!(line.fitted_plane().is_none());
    }

    #[test]
    fn white_noise_has_the_variance_that_is_stated() {
        // The gradient of white noise of variance 1 on a lattice of 1 has, with weights w, 2 int w^2 x^2 / (int w x^2)^2.
        let mut fit = PlaneFit::new(20.0);
        for (x, y) in (-20..=20).flat_map(|i| (-20..=20).map(move |j| (f64::from(i), f64::from(j)))) {
            fit.add([x, y], 0.0, 1.0);
        }
        // int (1 - s)^n s^k: pi L^4 (1/12 - ...) by the beta function: w x^2 gives pi L^4 / 24, w^2 x^2 pi L^4 / 60.
        let (pi, l) = (std::f64::consts::PI, 20f64.powi(4));
        let expected = 2.0 * (pi * l / 60.0) / (pi * l / 24.0).powi(2);
        let found = fit.fitted_plane().unwrap();
        assert!((found.variance / expected - 1.0).abs() < 1e-2, "{} {expected}", found.variance);
        assert!((found.effective_area / (5.0 / 9.0 * pi * 400.0) - 1.0).abs() < 1e-2, "{}", found.effective_area);
    }

    #[test]
    fn noise_goes_from_the_square_of_a_slope() {
        assert_eq!(without_noise(0.3f64.atan(), 0.5), 0.0);
        assert!((without_noise(0.5f64.atan(), 0.3) - 0.4f64.atan()).abs() < 1e-15);
        assert_eq!(without_noise(2.0, 0.3), 2.0);
        assert!(without_noise(f64::NAN, 0.1).is_nan());
    }
}
