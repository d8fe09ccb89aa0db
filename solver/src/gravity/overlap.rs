//! Attraction of two homogeneous balls that overlap.

use crate::math::Vec3;

/// Attraction of two balls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BallAttraction {
    /// Force on the first ball, N; the second gets the opposite.
    pub force: Vec3,
    /// Potential energy of the two, J, negative.
    pub energy: f64,
}

/// Attraction of two homogeneous balls of these `masses` (kg) and `radii` (m), the second at `r` (m) from the first, |r| less
/// than the sum of the radii; `constant` is G, m³/(kg s²).
///
/// With a the larger and b the smaller radius, the masses m and M, r = |r|, and W' = dW/dd,
///
/// ```text
/// r <= a - b:  U = -G m M (3 a² - r² - 3 b²/5)/(2 a³),  F = G m M r/a³
/// else, d = a + b - r:  U = -G m M (1 - W)/r,  F = G m M ((1 - W)/r² - W'/r),  W = d⁴ (30 a b - 6 (a + b) d + d²)/(160 a³ b³).
/// ```
///
/// U is the integral of the potential of the larger ball over the smaller one. For r < a it is evaluated as its value for
/// r <= a - b and a polynomial in c = r - (a - b), which is exact where the difference of large numbers above would not be.
/// The force goes to 0 with the distance; U and F are continuous.
pub fn ball_attraction(r: &Vec3, masses: [f64; 2], radii: [f64; 2], constant: f64) -> BallAttraction {
    let [a, b] = [radii[0].max(radii[1]), radii[0].min(radii[1])];
    let distance = r.norm();
    let volumes = a.powi(3) * b.powi(3);
    // Potential and F/r for G m M = 1.
    let (potential, strength) = if distance < a {
        let inside = (-(3.0 * a * a - distance * distance - 0.6 * b * b) / (2.0 * a.powi(3)), 1.0 / a.powi(3));
        let c = distance - (a - b);
        if c <= 0.0 {
            inside
        } else {
            let potential_polynomial =
                30.0 * b * b - 30.0 * b * c + 30.0 * b * distance + 5.0 * c * c - 6.0 * c * distance;
            let force_polynomial = 24.0 * b * b * distance - 6.0 * b * b * c + 24.0 * b * distance * distance
                - 30.0 * b * c * distance
                + 6.0 * b * c * c
                - c * c * c
                + 6.0 * c * c * distance
                - 6.0 * c * distance * distance;
            // c <= r, so that the quotients are small.
            let ratio = c / distance;
            (
                inside.0 - ratio * c.powi(3) * potential_polynomial / (160.0 * volumes),
                inside.1 - ratio.powi(3) * force_polynomial / (32.0 * volumes),
            )
        }
    } else {
        let d = a + b - distance;
        let w = d.powi(4) * (30.0 * a * b - 6.0 * (a + b) * d + d * d) / (160.0 * volumes);
        let slope = d.powi(3) * (120.0 * a * b - 30.0 * (a + b) * d + 6.0 * d * d) / (160.0 * volumes);
        (-(1.0 - w) / distance, ((1.0 - w) / distance - slope) / (distance * distance))
    };
    let product = constant * masses[0] * masses[1];
    BallAttraction { force: r * (product * strength), energy: product * potential }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Energy and force of a ball of radius b, cut into discs, in the field of one of radius a; G m M = 1.
    fn summed(r: f64, [a, b]: [f64; 2]) -> (f64, f64) {
        let potential = |s: f64| if s < a { -(3.0 * a * a - s * s) / (2.0 * a.powi(3)) } else { -1.0 / s };
        let field = |s: f64| if s < a { 1.0 / a.powi(3) } else { s.powi(-3) };
        let count = 600;
        let (mut energy, mut force, mut volume) = (0.0, 0.0, 0.0);
        for i in 0..count {
            for k in 0..count {
                // Midpoints of rings about the line of the centres.
                let (x, y) = (b * (2.0 * (i as f64 + 0.5) / count as f64 - 1.0), b * (k as f64 + 0.5) / count as f64);
                if x * x + y * y < b * b {
                    let s = (r + x).hypot(y);
                    (energy, force, volume) = (energy + y * potential(s), force + y * field(s) * (r + x), volume + y);
                }
            }
        }
        (energy / volume, force / volume)
    }

    #[test]
    fn energy_and_force_are_those_of_the_volumes() {
        for (r, radii) in
            [(0.0, [1.0, 1.0]), (0.3, [1.0, 1.0]), (1.2, [1.0, 1.0]), (0.4, [2.0, 0.5]), (1.7, [2.0, 0.5])]
                .into_iter()
                .chain([(2.2, [2.0, 0.5]), (1.0, [1.0, 0.2]), (0.05, [1.0, 0.99])])
        {
            let found = ball_attraction(&(Vec3::x() * r), [1.0; 2], radii, 1.0);
            let (energy, force) = summed(r, radii);
            // Rings at the edge of the ball: 1/600 of the radius, with signs that alternate.
            assert!((found.energy - energy).abs() < 1e-4 * energy.abs(), "{r} {radii:?}: {} {energy}", found.energy);
            assert!((found.force.x - force).abs() < 1e-4, "{r} {radii:?}: {} {force}", found.force.x);
        }
    }

    #[test]
    fn pieces_join_and_points_follow() {
        let at = |r: f64, radii| ball_attraction(&(Vec3::x() * r), [2.0, 3.0], radii, 0.5);
        for radii in [[1.0, 1.0], [1.0, 0.6], [0.3, 2.0], [1e-3, 1.0]] {
            let [a, b] = [f64::max(radii[0], radii[1]), f64::min(radii[0], radii[1])];
            for r in [a - b, a].into_iter().filter(|&r| r > 0.0) {
                let (before, after) = (at(r * (1.0 - 1e-15), radii), at(r * (1.0 + 1e-15), radii));
                assert!((before.energy / after.energy - 1.0).abs() < 1e-13, "{radii:?} {r}");
                assert!((before.force.x - after.force.x).abs() <= 1e-13 * after.force.x, "{radii:?} {r}");
            }
            let touch = at((a + b) * (1.0 - 1e-14), radii);
            assert!(
                (touch.energy * (a + b) + 3.0).abs() < 1e-12 && (touch.force.x * (a + b).powi(2) - 3.0).abs() < 1e-12
            );
        }
    }

    #[test]
    fn the_force_is_the_slope_of_the_energy_and_vanishes_at_the_centre() {
        for radii in [[1.0, 1.0], [1.0, 0.6], [0.3, 2.0]] {
            for r in [0.01, 0.2, 0.39, 0.41, 0.9, 1.3] {
                let at = |r: f64| ball_attraction(&(Vec3::x() * r), [1.0; 2], radii, 1.0);
                let slope = (at(r + 1e-5).energy - at(r - 1e-5).energy) / 2e-5;
                assert!((slope - at(r).force.x).abs() < 1e-9, "{radii:?} {r}"); // second differences, rounding / 1e-5
            }
        }
        let deep = ball_attraction(&(Vec3::x() * 1e-12), [1.0; 2], [1.0; 2], 1.0).force.x;
        assert!((deep / 1e-12 - 1.0).abs() < 1e-10); // F = r/a³ next to the centre
        assert_eq!(ball_attraction(&Vec3::zeros(), [1.0; 2], [1.0, 0.5], 1.0).force, Vec3::zeros());
        assert_eq!(ball_attraction(&Vec3::zeros(), [1.0; 2], [1.0; 2], 1.0).energy, -1.2);
    }
}
