//! Kepler orbits of the masses of `fields`: position and velocity at any time, from elements or from a state.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

type Vec3 = Vector3<f64>;

/// Orbit of two bodies about each other, as it is written in options.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum OrbitSpec {
    /// Elements. The size is given by `periapsis` or `semi_major_axis`, the shape by `eccentricity` or `v_infinity`; the
    /// plane by rotations about z, x and z: `node`, `inclination`, `argument`.
    Elements {
        /// Least distance, m.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        periapsis: Option<f64>,
        /// Semi-major axis, m: more than 0 for an ellipse, less than 0 for a hyperbola.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        semi_major_axis: Option<f64>,
        /// Eccentricity: 0 for a circle, 1 for a parabola, more for a hyperbola.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        eccentricity: Option<f64>,
        /// Speed at infinity, m/s.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        v_infinity: Option<f64>,
        /// Angle between the orbit's plane and the xy plane, rad.
        #[serde(default)]
        inclination: f64,
        /// Angle from x to the ascending node, rad.
        #[serde(default)]
        node: f64,
        /// Angle from the ascending node to the periapsis, rad.
        #[serde(default)]
        argument: f64,
        /// Time of the passage through the periapsis, s.
        #[serde(default)]
        periapsis_time: f64,
    },
    /// Relative position (m) and velocity (m/s) at a time (s).
    State {
        position: [f64; 3],
        velocity: [f64; 3],
        #[serde(default)]
        time: f64,
    },
}

/// Kepler orbit about a centre of attraction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeplerOrbit {
    /// G times the attracting mass, m^3/s^2.
    mu: f64,
    /// Least distance q, m.
    periapsis: f64,
    eccentricity: f64,
    /// Unit vectors towards the periapsis, and along the velocity there.
    axes: [Vec3; 2],
    /// Time of the passage through the periapsis, s.
    periapsis_time: f64,
}

/// Largest number of steps of Newton's method: it converges within some forty from its bounds.
const MAX_NEWTON_STEPS: usize = 100;

impl OrbitSpec {
    /// Values that are expected in place of those of the orbit about a mass with G M = `mu` (m^3/s^2), if these cannot be
    /// used.
    pub fn invalid_value(&self, mu: f64) -> Option<&'static str> {
        if mu <= 0.0 {
            return Some("gravity_constant > 0 for an orbit");
        }
        match *self {
            OrbitSpec::Elements {
                periapsis,
                semi_major_axis,
                eccentricity,
                v_infinity,
                inclination,
                node,
                argument,
                periapsis_time,
            } => {
                if ![inclination, node, argument, periapsis_time].iter().all(|x| x.is_finite()) {
                    return Some("finite angles and a finite periapsis_time");
                }
                match (periapsis, semi_major_axis, eccentricity, v_infinity) {
                    (Some(q), None, Some(e), None) if !(q > 0.0 && q.is_finite() && e >= 0.0 && e.is_finite()) => {
                        Some("periapsis > 0 and eccentricity >= 0")
                    }
                    (Some(q), None, None, Some(v)) if !(q > 0.0 && q.is_finite() && v >= 0.0 && v.is_finite()) => {
                        Some("periapsis > 0 and v_infinity >= 0")
                    }
                    (None, Some(a), Some(e), None)
                        if !(a.is_finite()
                            && ((a > 0.0 && (0.0..1.0).contains(&e)) || (a < 0.0 && e > 1.0 && e.is_finite()))) =>
                    {
                        Some("semi_major_axis > 0 with eccentricity < 1, or semi_major_axis < 0 with eccentricity > 1")
                    }
                    (Some(_), None, Some(_), None)
                    | (Some(_), None, None, Some(_))
                    | (None, Some(_), Some(_), None) => None,
                    _ => Some("periapsis with eccentricity or v_infinity, or semi_major_axis with eccentricity"),
                }
            }
            OrbitSpec::State { position, velocity, time } => {
                let finite = position.iter().chain(&velocity).all(|x| x.is_finite()) && time.is_finite();
                let (r, v) = (Vec3::from(position), Vec3::from(velocity));
                let has_plane = r.cross(&v).norm_squared() > 0.0;
                let sound = finite && has_plane && KeplerOrbit::from_state(mu, &r, &v, time).is_finite();
                (!sound).then_some("finite position, velocity and time, and a velocity that is not along the position")
            }
        }
    }

    /// The orbit about a mass with G M = `mu`, m^3/s^2. The values must be [valid](Self::invalid_value).
    pub fn to_orbit(&self, mu: f64) -> KeplerOrbit {
        match *self {
            OrbitSpec::Elements {
                periapsis,
                semi_major_axis,
                eccentricity,
                v_infinity,
                inclination,
                node,
                argument,
                periapsis_time,
            } => {
                let (q, e) = match (periapsis, semi_major_axis, eccentricity, v_infinity) {
                    (Some(q), _, _, Some(v)) => (q, 1.0 + q * v * v / mu),
                    (_, Some(a), Some(e), _) => (a * (1.0 - e), e),
                    (q, _, e, _) => (q.unwrap_or(f64::NAN), e.unwrap_or(f64::NAN)),
                };
                // Two orthogonal unit vectors, rotated in their plane from the first towards the second.
                let rotated_axes = |angle: f64, [a, b]: [Vec3; 2]| {
                    let (sine, cosine) = (libm::sin(angle), libm::cos(angle));
                    [a * cosine + b * sine, b * cosine - a * sine]
                };
                let [to_node, in_xy_plane] = rotated_axes(node, [Vec3::x(), Vec3::y()]);
                let [in_orbit_plane, _] = rotated_axes(inclination, [in_xy_plane, Vec3::z()]);
                let axes = rotated_axes(argument, [to_node, in_orbit_plane]);
                KeplerOrbit { mu, periapsis: q, eccentricity: e, axes, periapsis_time }
            }
            OrbitSpec::State { position, velocity, time } => {
                KeplerOrbit::from_state(mu, &position.into(), &velocity.into(), time)
            }
        }
    }
}

impl KeplerOrbit {
    /// Orbit through the relative position `r` (m) with the relative velocity `v` (m/s) at `time` (s); `mu`: G times the
    /// attracting mass, m^3/s^2.
    ///
    /// e = v x (r x v)/mu - r/|r|, q = |r x v|^2/(mu (1 + |e|)). Source: Murray & Dermott (1999), chapter 2.
    pub fn from_state(mu: f64, r: &Vec3, v: &Vec3, time: f64) -> Self {
        // Angular momentum per mass, and the vector e, which points to the periapsis.
        let h = r.cross(v);
        let eccentricity_vector = v.cross(&h) / mu - r / r.norm();
        let eccentricity = eccentricity_vector.norm();
        // On a circle any point may be called the periapsis.
        let (to_periapsis, eccentricity) = if eccentricity > CIRCULAR_ECCENTRICITY {
            (eccentricity_vector / eccentricity, eccentricity)
        } else {
            (r / r.norm(), 0.0)
        };
        let normal = h / h.norm();
        // Rounding has left a component along the normal.
        let to_periapsis = (to_periapsis - normal * normal.dot(&to_periapsis)).normalize();
        let periapsis = h.norm_squared() / (mu * (1.0 + eccentricity));
        let axes = [to_periapsis, normal.cross(&to_periapsis)];
        let elapsed = time_since_periapsis(mu, periapsis, eccentricity, axes.map(|axis| axis.dot(r)));
        KeplerOrbit { mu, periapsis, eccentricity, axes, periapsis_time: time - elapsed }
    }

    /// Whether all numbers of the orbit are finite.
    pub fn is_finite(&self) -> bool {
        let vectors = self.axes.iter().all(|axis| axis.iter().all(|x| x.is_finite()));
        vectors && [self.mu, self.periapsis, self.eccentricity, self.periapsis_time].iter().all(|x| x.is_finite())
    }

    /// Period, s; `None` of a parabola or hyperbola.
    pub fn period(&self) -> Option<f64> {
        let a = self.periapsis / (1.0 - self.eccentricity);
        (self.eccentricity < 1.0).then(|| TAU * (a * a * a / self.mu).sqrt())
    }

    /// Relative position (m) and velocity (m/s) at a time, s.
    ///
    /// With q the periapsis, e the eccentricity, v_q the speed there, α = μ (1 - e)/q and Stumpff's functions c_n of α s², the
    /// universal anomaly s since the periapsis solves t = q s + μ e s³ c_3. The position is then q - μ s² c_2 along the first
    /// axis and q s c_1 v_q along the second, at the distance q + μ e s² c_2: for ellipses, parabolas and hyperbolas alike.
    /// Source: Danby (1992), Fundamentals of Celestial Mechanics, section 6.9.
    pub fn position_and_velocity(&self, time: f64) -> (Vec3, Vec3) {
        let KeplerOrbit { mu, periapsis: q, eccentricity: e, axes: [to_periapsis, along_motion], periapsis_time } =
            *self;
        let mut t = time - periapsis_time;
        if let Some(period) = self.period() {
            t -= period * (t / period).round_ties_even();
        }
        let (s, [_, c1, c2, _]) = self.universal_anomaly(t);
        let (s_c1, s2_c2) = (s * c1, s * s * c2);
        let r = q + mu * e * s2_c2;
        let speed = (mu * (1.0 + e) / q).sqrt();
        let position = to_periapsis * (q - mu * s2_c2) + along_motion * (q * s_c1 * speed);
        let velocity = to_periapsis * (-mu * s_c1 / r) + along_motion * ((1.0 - mu * s2_c2 / r) * speed);
        (position, velocity)
    }

    /// Solves t = q s + μ e s³ c_3(α s²) for s by Newton's method; returns s and Stumpff's functions of α s².
    fn universal_anomaly(&self, t: f64) -> (f64, [f64; 4]) {
        let KeplerOrbit { mu, periapsis: q, eccentricity: e, .. } = *self;
        let alpha = mu * (1.0 - e) / q;
        let (duration, root) = (t.abs(), alpha.abs().sqrt());
        // The iteration starts at an upper bound of s, from which Newton's method descends, since t is convex in s for s >= 0.
        // Bounds are the solutions with the term q s alone, with the other term alone and the least c_3, and half an
        // orbit of an ellipse, or on a hyperbola that of e sinh x - x >= (e - 1) sinh x.
        let least_c3 = if alpha > 0.0 { 1.0 / (PI * PI) } else { 1.0 / 6.0 };
        let conic_bound = if alpha > 0.0 {
            PI / root
        } else if alpha < 0.0 {
            libm::asinh(duration * root / q) / root
        } else {
            f64::INFINITY
        };
        let mut s = (duration / q).min(libm::cbrt(duration / (mu * e * least_c3))).min(conic_bound);
        for _ in 0..MAX_NEWTON_STEPS {
            let [_, _, c2, c3] = stumpff(alpha * s * s);
            let change = (q * s + mu * e * s * s * s * c3 - duration) / (q + mu * e * s * s * c2);
            s -= change;
            if change.abs() <= f64::EPSILON * s {
                break;
            }
        }
        (s.copysign(t), stumpff(alpha * s * s))
    }
}

/// Eccentricity below which a state is taken as on a circle: rounding causes as much.
const CIRCULAR_ECCENTRICITY: f64 = 1e-14;

/// Time since the periapsis at the point with these coordinates along the axes of the orbit, s.
///
/// s c_1 = y/(q v_q) and c_0 = e + (1 - e) x/q are the sine and cosine, circular or hyperbolic, of the anomaly.
fn time_since_periapsis(mu: f64, q: f64, e: f64, [x, y]: [f64; 2]) -> f64 {
    let speed = (mu * (1.0 + e) / q).sqrt();
    let alpha = mu * (1.0 - e) / q;
    let (root, sine) = (alpha.abs().sqrt(), y / (q * speed));
    let s = if alpha > 0.0 {
        libm::atan2(root * sine, e + (1.0 - e) * x / q) / root
    } else if alpha < 0.0 {
        libm::asinh(root * sine) / root
    } else {
        sine
    };
    let [_, _, _, c3] = stumpff(alpha * s * s);
    q * s + mu * e * s * s * s * c3
}

/// Stumpff's functions c_0 to c_3 of `x`: c_n = Σ (-x)^k/(n + 2k)!.
fn stumpff(x: f64) -> [f64; 4] {
    if x.abs() < 1.0 {
        // Twelve terms are exact to rounding.
        let series =
            |n: u32| (1..12).rev().fold(1.0, |sum, k| 1.0 - sum * x / f64::from((n + 2 * k - 1) * (n + 2 * k)));
        let (c2, c3) = (series(2) / 2.0, series(3) / 6.0);
        return [1.0 - x * c2, 1.0 - x * c3, c2, c3];
    }
    let root = x.abs().sqrt();
    let (cosine, sine) =
        if x > 0.0 { (libm::cos(root), libm::sin(root)) } else { (libm::cosh(root), libm::sinh(root)) };
    let c1 = sine / root;
    [cosine, c1, (1.0 - cosine) / x, (1.0 - c1) / x]
}

#[cfg(test)]
mod tests {
    use super::*;

    const MU: f64 = 3.986e14;

    fn elements(periapsis: f64, eccentricity: f64) -> OrbitSpec {
        OrbitSpec::Elements {
            periapsis: Some(periapsis),
            semi_major_axis: None,
            eccentricity: Some(eccentricity),
            v_infinity: None,
            inclination: 0.4,
            node: -1.1,
            argument: 2.3,
            periapsis_time: 500.0,
        }
    }

    /// Eccentricities of circles to hyperbolas, and next to the parabola.
    const SHAPES: [f64; 12] = [0.0, 1e-9, 0.3, 0.97, 1.0 - 1e-9, 1.0, 1.0 + 1e-12, 1.0 + 1e-7, 1.02, 2.0, 30.0, 1e4];

    #[test]
    fn energy_and_angular_momentum_are_those_of_the_elements() {
        let q = 4e7;
        for e in SHAPES {
            let orbit = elements(q, e).to_orbit(MU);
            let (energy, momentum) = (-MU * (1.0 - e) / (2.0 * q), (MU * q * (1.0 + e)).sqrt());
            for time in [-1e7, -3e5, -2e3, 499.0, 500.0, 501.0, 7e4, 1e6, 1e8] {
                let (r, v) = orbit.position_and_velocity(time);
                let scale = MU / r.norm() + v.norm_squared();
                // Rounding of sums of a few terms.
                let error = 0.5 * v.norm_squared() - MU / r.norm() - energy;
                assert!(error.abs() < 2e-14 * scale, "{e} {time}: {}", error / scale);
                let error = r.cross(&v).norm() - momentum;
                assert!(error.abs() < 2e-14 * r.norm() * v.norm(), "{e} {time}: {error:e}");
            }
        }
    }

    #[test]
    fn velocity_is_the_slope_of_the_position_and_the_acceleration_that_of_attraction() {
        for e in SHAPES {
            let orbit = elements(4e7, e).to_orbit(MU);
            for time in [-2e5, 0.0, 700.0, 3e4] {
                let h = 1.0;
                let [before, now, after] = [-h, 0.0, h].map(|d| orbit.position_and_velocity(time + d));
                let scale = now.1.norm();
                // Central differences: the square of the angle in the time h, and the rounding of 1e9 m divided by h.
                let turn = (h * scale / now.0.norm()).powi(2) + 1e-6;
                assert!(((after.0 - before.0) / (2.0 * h) - now.1).norm() < turn * scale, "{e} {time}");
                let pull = -now.0 * (MU / now.0.norm().powi(3));
                let slope = (after.1 - before.1) / (2.0 * h);
                assert!((slope - pull).norm() < turn * pull.norm() + 1e-12 * scale, "{e} {time}: {slope} {pull}");
            }
        }
    }

    #[test]
    fn a_state_gives_back_the_orbit() {
        for e in SHAPES {
            let orbit = elements(4e7, e).to_orbit(MU);
            for time in [-6e3, 500.0, 9e3] {
                let (r, v) = orbit.position_and_velocity(time);
                let again = OrbitSpec::State { position: r.into(), velocity: v.into(), time };
                assert_eq!(again.invalid_value(MU), None);
                let again = again.to_orbit(MU);
                for later in [0.0, 2e4] {
                    let (x, y) = (orbit.position_and_velocity(later).0, again.position_and_velocity(later).0);
                    // Rounding of the state, which grows with the time.
                    assert!((x - y).norm() < 1e-11 * x.norm(), "{e} {time} {later}: {:e}", (x - y).norm() / x.norm());
                }
            }
        }
    }

    #[test]
    fn an_ellipse_closes_after_its_period_and_a_hyperbola_turns_by_the_angle_of_rutherford() {
        let orbit = elements(4e7, 0.7).to_orbit(MU);
        let (a, period) = (4e7 / 0.3, orbit.period().unwrap());
        assert!((period - TAU * (a * a * a / MU).sqrt()).abs() < 1e-9 * period);
        let at = |time: f64| orbit.position_and_velocity(time).0;
        assert!((at(123.0) - at(123.0 + period)).norm() < 1e-7 * a); // rounding of the time: 1e-16 of 1e6 s
        let v_infinity = 5.9e3;
        let spec = OrbitSpec::Elements {
            periapsis: Some(4e7),
            semi_major_axis: None,
            eccentricity: None,
            v_infinity: Some(v_infinity),
            inclination: 0.1,
            node: 0.2,
            argument: 0.3,
            periapsis_time: 0.0,
        };
        let orbit = spec.to_orbit(MU);
        let far = 1e13;
        let [came, leaves] = [-far, far].map(|time| orbit.position_and_velocity(time).1);
        assert!((leaves.norm() - v_infinity).abs() < 1e-6 * v_infinity);
        let deflection = came.angle(&leaves);
        let e = 1.0 + 4e7 * v_infinity * v_infinity / MU;
        // At a distance of 6e16 m the direction has 1e-6 of the angle left to go, mu/(v^2 r).
        assert!((deflection - 2.0 * libm::asin(1.0 / e)).abs() < 1e-6, "{deflection}");
    }

    #[test]
    fn values_that_give_no_orbit_are_named() {
        let with = |periapsis, semi_major_axis, eccentricity, v_infinity| {
            let angles = (0.0, 0.0, 0.0, 0.0);
            let (inclination, node, argument, periapsis_time) = angles;
            OrbitSpec::Elements {
                periapsis,
                semi_major_axis,
                eccentricity,
                v_infinity,
                inclination,
                node,
                argument,
                periapsis_time,
            }
            .invalid_value(MU)
        };
        assert_eq!(with(Some(1.0), None, Some(0.5), None), None);
        assert_eq!(with(Some(1.0), None, None, Some(2.0)), None);
        assert_eq!(with(None, Some(-1.0), Some(1.5), None), None);
        assert!(with(None, Some(1.0), Some(1.5), None).is_some());
        assert!(with(None, Some(1.0), None, Some(1.5)).is_some());
        assert!(with(Some(-1.0), None, Some(0.5), None).is_some());
        assert!(with(Some(1.0), Some(1.0), Some(0.5), None).is_some());
        assert!(with(Some(1.0), None, Some(f64::NAN), None).is_some());
        let radial = OrbitSpec::State { position: [1.0, 2.0, 3.0], velocity: [-2.0, -4.0, -6.0], time: 0.0 };
        assert!(radial.invalid_value(MU).is_some());
    }
}
