//! The room that a body of grains is put in, centred on the origin, its axes along the coordinates.

use nalgebra::Vector3;

use crate::scene::Envelope;

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Room {
    /// Radius, m.
    Ball(f64),
    /// Semi-axes, m.
    Ellipsoid([f64; 3]),
    /// Half lengths, m.
    Box([f64; 3]),
}

impl Envelope {
    /// The room and whether its size is given; without one it has the right proportions only.
    pub fn room(&self) -> (Room, bool) {
        let half = |lengths: [f64; 3]| lengths.map(|length| 0.5 * length);
        match *self {
            Envelope::Ball { radius } => (Room::Ball(radius.unwrap_or(1.0)), radius.is_some()),
            Envelope::Ellipsoid { semi_axes, ratios } => {
                (Room::Ellipsoid(semi_axes.or(ratios).unwrap_or([1.0; 3])), semi_axes.is_some())
            }
            Envelope::Box { lengths, ratios } => {
                (Room::Box(half(lengths.or(ratios).unwrap_or([2.0; 3]))), lengths.is_some())
            }
        }
    }
}

impl Room {
    /// m^3
    pub fn volume(&self) -> f64 {
        let product = |[a, b, c]: [f64; 3]| a * b * c;
        match *self {
            Room::Ball(radius) => crate::sizes::volume(radius),
            Room::Ellipsoid(axes) => 4.0 / 3.0 * std::f64::consts::PI * product(axes),
            Room::Box(halves) => 8.0 * product(halves),
        }
    }

    /// The room of the same proportions with `volume`, m^3.
    pub fn scaled_to(&self, volume: f64) -> Room {
        let factor = libm::cbrt(volume / self.volume());
        let scaled = |lengths: [f64; 3]| lengths.map(|length| factor * length);
        match *self {
            Room::Ball(radius) => Room::Ball(factor * radius),
            Room::Ellipsoid(axes) => Room::Ellipsoid(scaled(axes)),
            Room::Box(halves) => Room::Box(scaled(halves)),
        }
    }

    /// Half the lengths of the smallest box around the room, m.
    pub fn halves(&self) -> Vector3<f64> {
        match *self {
            Room::Ball(radius) => Vector3::repeat(radius),
            Room::Ellipsoid(lengths) | Room::Box(lengths) => lengths.into(),
        }
    }

    /// Whether the whole ball of `radius`, m, about `centre` lies in the room.
    pub fn holds(&self, centre: &Vector3<f64>, radius: f64) -> bool {
        match self {
            Room::Ball(room) => centre.norm() + radius <= *room,
            Room::Ellipsoid(axes) => ellipsoid_holds(axes, centre, radius),
            Room::Box(halves) => (0..3).all(|k| centre[k].abs() + radius <= halves[k]),
        }
    }
}

impl std::fmt::Display for Room {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let three = |[a, b, c]: [f64; 3]| format!("({a:.5}, {b:.5}, {c:.5})");
        match *self {
            Room::Ball(radius) => write!(f, "a ball of radius {radius:.5} m"),
            Room::Ellipsoid(axes) => write!(f, "an ellipsoid of semi-axes {} m", three(axes)),
            Room::Box(halves) => write!(f, "a box of lengths {} m", three(halves.map(|half| 2.0 * half))),
        }
    }
}

/// Whether the ball lies in the ellipsoid: its centre inside, and no nearer to the surface than `radius`.
fn ellipsoid_holds(axes: &[f64; 3], centre: &Vector3<f64>, radius: f64) -> bool {
    let level = (0..3).map(|k| (centre[k] / axes[k]).powi(2)).sum::<f64>().sqrt();
    if level > 1.0 {
        return false;
    }
    // The ellipsoid shrunk to the share 1 - level fits about any point of that level: a quick yes.
    let shortest = axes.iter().copied().fold(f64::INFINITY, f64::min);
    (1.0 - level) * shortest >= radius || distance_to_ellipsoid(axes, centre) >= radius
}

/// Distance, m, of a point inside an ellipsoid to its surface.
///
/// The nearest surface point is x_k = a_k^2 p_k / (a_k^2 + t) with the root t in (-min a^2, 0] of
/// sum (a_k p_k / (a_k^2 + t))^2 = 1, whose left side falls with t (Eberly, "Distance from a point to
/// an ellipse, an ellipsoid, or a hyperellipsoid", 2013). Bisection: exact to round-off.
fn distance_to_ellipsoid(axes: &[f64; 3], point: &Vector3<f64>) -> f64 {
    let squares = axes.map(|a| a * a);
    let short = (0..3).fold(0, |best, k| if axes[k] < axes[best] { k } else { best });
    let sum = |t: f64| (0..3).map(|k| (axes[k] * point[k] / (squares[k] + t)).powi(2)).sum::<f64>();
    let nearest = |t: f64| Vector3::from_fn(|k, _| squares[k] * point[k] / (squares[k] + t));
    // At the lower end the term of the shortest axis alone is 1.
    let (mut low, mut high) = (-squares[short] + axes[short] * point[short].abs(), 0.0);
    if point[short] == 0.0 || sum(low) < 1.0 {
        // In the plane across the shortest axis, so near the centre that the root is the pole t = -min a^2
        // (or, at the same length, another of the shortest axes): the nearest point is off the plane.
        let flat = |k: usize| {
            if squares[k] == squares[short] { 0.0 } else { axes[k] * point[k] / (squares[k] - squares[short]) }
        };
        let rest = 1.0 - (0..3).map(|k| flat(k).powi(2)).sum::<f64>();
        let in_plane = (0..3).all(|k| squares[k] != squares[short] || point[k] == 0.0);
        if rest >= 0.0 && in_plane {
            let off = |k: usize| if k == short { axes[k] * rest.sqrt() } else { axes[k] * flat(k) - point[k] };
            return Vector3::from_fn(|k, _| off(k)).norm();
        }
        low = low.max(-squares[short] * (1.0 - 1e-15));
    }
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if sum(middle) >= 1.0 { low = middle } else { high = middle }
    }
    (nearest(0.5 * (low + high)) - point).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn distances_known_by_hand() {
        let axes = [3.0, 2.0, 1.0];
        let distance = |x, y, z| distance_to_ellipsoid(&axes, &Vector3::new(x, y, z));
        assert_eq!(distance(0.0, 0.0, 0.0), 1.0);
        assert!((distance(0.0, 0.0, 0.75) - 0.25).abs() < 1e-14);
        // On the long axis the tip is nearest only beyond its centre of curvature, a - c^2/a = 8/3 from the centre.
        assert!((distance(2.9, 0.0, 0.0) - 0.1).abs() < 1e-12);
        assert!(distance(2.0, 0.0, 0.0) < 0.99);
        // x = 2: nearest at x/(1 - c^2/a^2) = 2.25, z^2 = 1 - 2.25^2/9.
        assert!((distance(2.0, 0.0, 0.0) - (0.0625f64 + 1.0 - 2.25f64.powi(2) / 9.0).sqrt()).abs() < 1e-14);
        assert!((distance_to_ellipsoid(&[2.0; 3], &Vector3::new(0.3, 0.4, 0.0)) - 1.5).abs() < 1e-14);
    }

    #[test]
    fn scaling_gives_the_volume() {
        for room in [Room::Ball(2.0), Room::Ellipsoid([1.0, 2.0, 3.0]), Room::Box([1.0, 2.0, 3.0])] {
            assert!((room.scaled_to(7.0).volume() - 7.0).abs() < 1e-14 * 7.0); // a cube root and its cube
        }
    }

    proptest! {
        /// Against the surface sampled finely: no sample is nearer, and one is nearly as near.
        #[test]
        fn distance_is_that_of_the_nearest_surface_point(
            axes in prop::array::uniform3(0.5..2.0f64),
            direction in prop::array::uniform3(-1.0..1.0f64),
            level in 0.0..1.0f64,
            flat in 0..4usize,
        ) {
            let mut point: Vector3<f64> = Vector3::from(direction).component_mul(&axes.into());
            if flat < 3 { point[flat] = 0.0 } // the plane across an axis is the special case
            let norm = point.component_div(&axes.into()).norm();
            prop_assume!(norm > 1e-3);
            point *= level / norm;
            let found = distance_to_ellipsoid(&axes, &point);
            let n = 200;
            let mut sampled = f64::INFINITY;
            for i in 0..=n {
                for j in 0..2 * n {
                    let (theta, phi) = (i as f64 / n as f64 * 3.141592653589793, j as f64 / n as f64 * 3.141592653589793);
                    let unit = Vector3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
                    sampled = sampled.min((unit.component_mul(&axes.into()) - point).norm());
                }
            }
            prop_assert!(found <= sampled + 1e-12, "{found} {sampled}");
            // Sample spacing at most pi/200 * 2 = 0.031 in either angle.
            prop_assert!(found >= sampled - 0.04, "{found} {sampled}");
        }
    }
}
