//! Two-body orbits of the fragments about the largest remnant.

use crate::derive::fragments::Fragment;
use crate::derive::motion::AggregateSums;
use crate::math::Vec3;

/// The orbit of a fragment about the largest remnant, both as points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// Distance from the largest remnant, m.
    pub distance: f64,
    /// Relative speed, m/s.
    pub speed: f64,
    /// Semi-major axis, m; < 0 of a hyperbola.
    pub a: f64,
    /// Eccentricity: below 1 bound, above 1 not.
    pub e: f64,
    /// Angle between the orbit's and the reference's axis, rad, 0 to pi; NaN on a straight line.
    pub inclination: f64,
    /// Least distance, m.
    pub pericentre: f64,
    /// Period, s; NaN if not bound.
    pub period: f64,
    /// Speed at infinity, m/s; NaN if bound.
    pub speed_at_infinity: f64,
}

impl Orbit {
    /// Returns the orbit with the relative position `r` (m) and velocity `v` (m/s); `mu` = G (M + m), m^3/s^2; `axis`:
    /// reference axis of inclinations.
    ///
    /// 1/a = 2/r - v^2/mu; e = |v x h / mu - r/|r||, h = r x v; period 2 pi sqrt(a^3/mu).
    /// Source: Murray & Dermott (1999), chapter 2.
    pub fn new(r: Vec3, v: Vec3, mu: f64, axis: Vec3) -> Orbit {
        let (distance, speed) = (r.norm(), v.norm());
        let h = r.cross(&v);
        let a = 1.0 / (2.0 / distance - speed * speed / mu);
        let e = (v.cross(&h) / mu - r / distance).norm();
        let tilt = h.dot(&axis) / (h.norm() * axis.norm());
        let pericentre = h.norm_squared() / mu / (1.0 + e);
        let bound = a > 0.0;
        Orbit {
            distance,
            speed,
            a,
            e,
            inclination: if tilt.is_finite() { tilt.clamp(-1.0, 1.0).acos() } else { f64::NAN },
            pericentre,
            period: if bound { std::f64::consts::TAU * (a.powi(3) / mu).sqrt() } else { f64::NAN },
            speed_at_infinity: if bound { f64::NAN } else { (speed * speed - 2.0 * mu / distance).max(0.0).sqrt() },
        }
    }

    /// Whether the orbit is an ellipse.
    pub fn is_bound(&self) -> bool {
        self.a > 0.0
    }
}

/// The orbits of all fragments but the first about the first; `gravitational_constant`: G, m^3 kg^-1 s^-2.
///
/// Inclinations are measured from the spin axis of the largest remnant, or from z if it does not rotate.
pub fn fragment_orbits(fragments: &[Fragment], gravitational_constant: f64) -> Vec<Orbit> {
    let Some((largest, others)) = fragments.split_first() else { return Vec::new() };
    let axis = spin_axis(&largest.sums);
    let orbit = |other: &Fragment| {
        let (r, v) = (other.sums.x - largest.sums.x, other.sums.velocity() - largest.sums.velocity());
        Orbit::new(r, v, gravitational_constant * (largest.sums.mass + other.sums.mass), axis)
    };
    others.iter().map(orbit).collect()
}

/// The direction of a body's spin; z without one.
pub fn spin_axis(sums: &AggregateSums) -> Vec3 {
    let spin = sums.spin();
    if spin.norm() > 0.0 && spin.iter().all(|x| x.is_finite()) { spin.normalize() } else { Vec3::z() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cd_formats::compute::ExternalField;

    use crate::derive::fragments::find_fragments;
    use crate::samples::Scene;

    #[track_caller]
    fn assert_close(found: f64, expected: f64) {
        assert!((found - expected).abs() <= 1e-12 * expected.abs(), "{found:e} is not {expected:e}");
    }

    #[test]
    fn an_ellipse_of_known_elements_is_recovered_anywhere_on_it() {
        // a = 5, e = 0.6, i = 0.7, mu = 2: from the true anomaly f, r = a (1 - e^2) / (1 + e cos f).
        let (a, e, i, mu) = (5.0f64, 0.6f64, 0.7f64, 2.0f64);
        for f in [0.0, 1.0, 3.0, 4.4] {
            let p = a * (1.0 - e * e);
            let r = p / (1.0 + e * f64::cos(f));
            let tilted = |x: f64, y: f64| Vec3::new(x, y * i.cos(), y * i.sin());
            let position = tilted(r * f64::cos(f), r * f64::sin(f));
            let velocity = tilted(-f64::sin(f), e + f64::cos(f)) * (mu / p).sqrt();
            let orbit = Orbit::new(position, velocity, mu, Vec3::z());
            assert_close(orbit.a, a);
            assert_close(orbit.e, e);
            assert_close(orbit.inclination, i);
            assert_close(orbit.pericentre, a * (1.0 - e));
            assert_close(orbit.period, std::f64::consts::TAU * (a.powi(3) / mu).sqrt());
            assert!(orbit.is_bound() && orbit.speed_at_infinity.is_nan());
        }
    }

    #[test]
    fn twice_the_energy_of_escape_leaves_the_speed_of_escape() {
        let mu = 3.0;
        let v = Vec3::new(0.0, 2.0 * (2.0f64 * mu / 10.0).sqrt() / 2f64.sqrt(), 0.0);
        let orbit = Orbit::new(Vec3::new(10.0, 0.0, 0.0), v, mu, Vec3::z());
        assert!(!orbit.is_bound() && orbit.e > 1.0 && orbit.a < 0.0 && orbit.period.is_nan());
        assert_close(orbit.speed_at_infinity, (2.0f64 * mu / 10.0).sqrt());
    }

    #[test]
    fn fragments_go_round_the_largest() {
        let gravitational_constant = 0.5;
        let mut scene = Scene::self_gravitating(gravitational_constant);
        scene.grain([1.0, 2.0, 3.0], 1.0);
        scene.grain([11.0, 2.0, 3.0], 0.5);
        let b = &mut scene.snapshot.bodies;
        let speed = (gravitational_constant * (b.body_mass[0] + b.body_mass[1]) / 10.0).sqrt();
        (b.body_v[0], b.body_v[1]) = ([0.0, 0.0, 7.0], [0.0, speed, 7.0]);
        let found = fragment_orbits(&find_fragments(&scene.frame()), gravitational_constant);
        assert_eq!(found.len(), 1);
        assert!(found[0].e < 1e-14);
        assert_close(found[0].a, 10.0);
        assert_eq!(found[0].inclination, 0.0);
    }

    #[test]
    fn what_rests_in_turning_axes_goes_round() {
        // At k times the speed of the circle, v^2 = k^2 mu / r: e = k^2 - 1, and far away (k^2 - 2) mu / r is left of v^2.
        let (gravitational_constant, distance, k) = (0.5, 10.0, 1.6);
        let mut scene = Scene::self_gravitating(gravitational_constant);
        scene.grain([1.0, 2.0, 3.0], 1.0);
        scene.grain([1.0 + distance, 2.0, 3.0], 1.0);
        let mu = 2.0 * gravitational_constant * scene.snapshot.bodies.body_mass[0];
        let rate = k * (mu / distance.powi(3)).sqrt();
        scene.snapshot.meta.parameters.fields =
            vec![ExternalField::RotatingFrame { rate: [0.0, 0.0, rate], centre: [-3.0, 4.0, 0.0] }];
        let found = fragment_orbits(&find_fragments(&scene.frame()), gravitational_constant)[0];
        assert_close(found.speed, rate * distance);
        assert_close(found.e, k * k - 1.0);
        assert_close(found.speed_at_infinity, ((k * k - 2.0) * mu / distance).sqrt());
        assert!(!found.is_bound());
    }
}
