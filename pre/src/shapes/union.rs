//! Volume, centre of mass and inertia of a union of balls, in which overlaps count once.
//!
//! The divergence theorem turns the integral of a homogeneous polynomial f of degree k over the union into one over its
//! surface, ∫ f dV = 1/(k + 3) ∮ f (x·n) dA. The surface consists of those parts of each sphere that lie outside of all other
//! balls. On a circle of latitude of a sphere, another ball covers one arc, known in closed form, and f (x·n) is a
//! trigonometric polynomial of degree 3, whose integral over arcs is exact. Across the latitudes the integral is a
//! Gauss-Kronrod rule between the latitudes at which an overlap begins and ends or three spheres meet, where the integrand
//! is not smooth; intervals are halved until it converges.

use std::f64::consts::{PI, TAU};

use cd_formats::surface::MassProperties;
use nalgebra::{Matrix3, Vector3};

/// Ball of a clump.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClumpBall {
    /// m
    pub centre: Vector3<f64>,
    /// m
    pub radius: f64,
}

impl From<&[f64; 4]> for ClumpBall {
    /// Ball of a scene: x, y, z and the radius, m.
    fn from(&[x, y, z, radius]: &[f64; 4]) -> ClumpBall {
        ClumpBall { centre: Vector3::new(x, y, z), radius }
    }
}

/// Largest difference of the two rules on an interval at which it is not halved, divided by the sum of the volumes of the
/// balls. The integral by the better rule is closer by orders: volumes of turned clumps of 30 balls agree to 1e-14.
const MAX_RULE_DIFFERENCE: f64 = 1e-12;

/// Largest number of times that an interval is halved: a kink then lies in 1e-9 of the interval.
const MAX_HALVINGS: u32 = 30;

/// Distance on the unit sphere up to which a point counts as exposed in a cap: a superfluous point costs one more
/// interval.
const EXPOSURE_TOLERANCE: f64 = 1e-9;

/// Node of Kronrod's rule on (-1, 1).
struct KronrodPoint {
    node: f64,
    weight: f64,
    /// Weight in Gauss's rule, 0 if that lacks the node.
    gauss_weight: f64,
}

impl KronrodPoint {
    const fn new(node: f64, weight: f64, gauss_weight: f64) -> KronrodPoint {
        KronrodPoint { node, weight, gauss_weight }
    }
}

/// Nodes of Kronrod's rule of 15 points from 0 up; Gauss's rule of 7 points has every other node.
const KRONROD_POINTS: [KronrodPoint; 8] = [
    KronrodPoint::new(0.0, 0.209_482_141_084_727_82, 0.417_959_183_673_469_4),
    KronrodPoint::new(0.207_784_955_007_898_48, 0.204_432_940_075_298_9, 0.0),
    KronrodPoint::new(0.405_845_151_377_397_2, 0.190_350_578_064_785_42, 0.381_830_050_505_118_9),
    KronrodPoint::new(0.586_087_235_467_691_1, 0.169_004_726_639_267_9, 0.0),
    KronrodPoint::new(0.741_531_185_599_394_3, 0.140_653_259_715_525_92, 0.279_705_391_489_276_64),
    KronrodPoint::new(0.864_864_423_359_769_1, 0.104_790_010_322_250_17, 0.0),
    KronrodPoint::new(0.949_107_912_342_758_5, 0.063_092_092_629_978_54, 0.129_484_966_168_869_7),
    KronrodPoint::new(0.991_455_371_120_812_6, 0.022_935_322_010_529_224, 0.0),
];

/// Points on a circle by which trigonometric polynomials of degree 3 are known.
const CIRCLE_POINTS: usize = 7;

/// Volume, three first and six second moments about the reference point: 1; x, y, z; xx, yy, zz, xy, xz, yz.
type VolumeMoments = [f64; 10];

/// Adds `factor` times the moments `term` to `sum`.
fn add_moments(sum: &mut VolumeMoments, term: &VolumeMoments, factor: f64) {
    sum.iter_mut().zip(term).for_each(|(sum, term)| *sum += factor * term);
}

/// Volume, centre and inertia at density 1 of the union of `balls`, of which no two are equal.
///
/// Relative errors are below 1e-10; without overlaps they are rounding.
pub fn union_properties(balls: &[ClumpBall]) -> MassProperties {
    // In a frame in which the union has size 1.
    let origin = balls.iter().map(|ball| ball.centre).sum::<Vector3<f64>>() / balls.len() as f64;
    let size = balls.iter().map(|ball| (ball.centre - origin).norm() + ball.radius).fold(0.0, f64::max);
    let unit: Vec<ClumpBall> = balls
        .iter()
        .map(|ball| ClumpBall { centre: (ball.centre - origin) / size, radius: ball.radius / size })
        .collect();
    let total: f64 = unit.iter().map(|ball| 4.0 / 3.0 * PI * ball.radius.powi(3)).sum();
    let mut moments = VolumeMoments::default();
    for (k, ball) in unit.iter().enumerate() {
        let others = unit.iter().enumerate().filter(|(other, _)| *other != k).map(|(_, other)| other);
        add_moments(&mut moments, &ExposedSphere::new(ball, others).moments(MAX_RULE_DIFFERENCE * total), 1.0);
    }
    let [volume, x, y, z, xx, yy, zz, xy, xz, yz] = moments;
    let centre = Vector3::new(x, y, z) / volume;
    let about_origin = Matrix3::new(yy + zz, -xy, -xz, -xy, xx + zz, -yz, -xz, -yz, xx + yy);
    // Huygens' theorem.
    let shift = Matrix3::from_diagonal_element(centre.norm_squared()) - centre * centre.transpose();
    let inertia = (about_origin - volume * shift) * size.powi(5);
    MassProperties { volume: volume * size.powi(3), centre: (origin + centre * size).into(), inertia: inertia.into() }
}

/// Part of a sphere that another ball covers: the unit vectors n with n·`direction` > `cosine`.
struct CoveredCap {
    direction: Vector3<f64>,
    /// At most -1 if the whole sphere is covered.
    cosine: f64,
}

/// Sphere of which caps are covered by other balls.
struct ExposedSphere {
    ball: ClumpBall,
    caps: Vec<CoveredCap>,
}

impl ExposedSphere {
    /// Sphere of `ball` with the caps that lie in the `others`.
    fn new<'a>(ball: &ClumpBall, others: impl Iterator<Item = &'a ClumpBall>) -> ExposedSphere {
        let cap = |other: &ClumpBall| {
            let separation = other.centre - ball.centre;
            let distance = separation.norm();
            let excess = ball.radius * ball.radius + distance * distance - other.radius * other.radius;
            if distance == 0.0 {
                return (excess < 0.0).then_some(CoveredCap { direction: Vector3::z(), cosine: -1.0 });
            }
            let cosine = excess / (2.0 * ball.radius * distance);
            (cosine < 1.0).then_some(CoveredCap { direction: separation / distance, cosine })
        };
        ExposedSphere { ball: *ball, caps: others.filter_map(cap).collect() }
    }

    /// Contribution of the exposed part to the moments of the union, by rules that differ by at most `max_difference` on each
    /// interval.
    fn moments(&self, max_difference: f64) -> VolumeMoments {
        let mut sum = VolumeMoments::default();
        if self.caps.iter().any(|cap| cap.cosine <= -1.0) {
            return sum;
        }
        // Sines of the latitudes at which a cap begins or ends, or the integrand has a kink.
        let mut ends = vec![-1.0, 1.0];
        ends.extend(self.triple_points().into_iter().map(|point| point.z.clamp(-1.0, 1.0)));
        for CoveredCap { direction, cosine } in &self.caps {
            let (middle, half_width) = (direction.z * cosine, libm::hypot(direction.x, direction.y) * sine_of(*cosine));
            ends.extend([middle - half_width, middle + half_width]);
        }
        ends.sort_by(f64::total_cmp);
        for pair in ends.windows(2).filter(|pair| pair[0] < pair[1]) {
            self.add_interval(&mut sum, [pair[0], pair[1]], [0.0, 1.0], max_difference, MAX_HALVINGS);
        }
        sum
    }

    /// Unit vectors to the exposed points at which the circles of two caps cross, from
    /// n = α a + β b ± γ a × b with n·a = c_a and n·b = c_b, the cosines of the caps.
    fn triple_points(&self) -> Vec<Vector3<f64>> {
        let is_exposed = |normal: &Vector3<f64>| {
            self.caps.iter().all(|cap| normal.dot(&cap.direction) <= cap.cosine + EXPOSURE_TOLERANCE)
        };
        let mut points = Vec::new();
        for (k, a) in self.caps.iter().enumerate() {
            for b in &self.caps[..k] {
                let product = a.direction.dot(&b.direction);
                let rest = 1.0 - product * product;
                let [alpha, beta] = [(a.cosine - b.cosine * product) / rest, (b.cosine - a.cosine * product) / rest];
                let square = (1.0 - alpha * alpha - beta * beta - 2.0 * alpha * beta * product) / rest;
                // Circles about one axis do not cross: the numbers are not finite.
                if !(square.is_finite() && square >= 0.0) {
                    continue;
                }
                let across = square.sqrt() * a.direction.cross(&b.direction);
                let middle = alpha * a.direction + beta * b.direction;
                points.extend([middle + across, middle - across].into_iter().filter(is_exposed));
            }
        }
        points
    }

    /// Adds the integral over the latitudes with the sines z = a + (b - a) (1 - cos πt)/2 of t in `range`, with the `ends` a
    /// and b. As a function of t the integrand is smooth where z ends at a cap.
    fn add_interval(
        &self,
        sum: &mut VolumeMoments,
        ends: [f64; 2],
        range: [f64; 2],
        max_difference: f64,
        halvings_left: u32,
    ) {
        let [low, high] = ends;
        let (middle, half) = (0.5 * (range[0] + range[1]), 0.5 * (range[1] - range[0]));
        let (mut kronrod, mut difference) = (VolumeMoments::default(), VolumeMoments::default());
        for KronrodPoint { node, weight, gauss_weight } in KRONROD_POINTS {
            for sign in if node == 0.0 { &[1.0][..] } else { &[1.0, -1.0] } {
                let (sin, cos) = libm::sincos(PI * (middle + sign * half * node));
                let z = low + 0.5 * (high - low) * (1.0 - cos);
                let step = half * 0.5 * PI * (high - low) * sin;
                let moments = self.latitude_moments(z.clamp(-1.0, 1.0));
                add_moments(&mut kronrod, &moments, weight * step);
                add_moments(&mut difference, &moments, (weight - gauss_weight) * step);
            }
        }
        if halvings_left == 0 || difference.iter().all(|term| term.abs() <= max_difference) {
            return add_moments(sum, &kronrod, 1.0);
        }
        self.add_interval(sum, ends, [range[0], middle], max_difference, halvings_left - 1);
        self.add_interval(sum, ends, [middle, range[1]], max_difference, halvings_left - 1);
    }

    /// Integrand of the moments over the exposed arcs of the latitude with the sine `z`.
    fn latitude_moments(&self, z: f64) -> VolumeMoments {
        let mut sum = VolumeMoments::default();
        let circle_radius = sine_of(z);
        let Some(harmonics) = self.exposed_harmonics(z, circle_radius) else { return sum };
        let ClumpBall { centre, radius } = self.ball;
        for k in 0..CIRCLE_POINTS {
            let angle = TAU * k as f64 / CIRCLE_POINTS as f64;
            let mut weight = harmonics[0][0];
            for (m, [cosines, sines]) in (1..).zip(&harmonics[1..]) {
                let (sin, cos) = libm::sincos(f64::from(m) * angle);
                weight += 2.0 * (cosines * cos + sines * sin);
            }
            let (sin, cos) = libm::sincos(angle);
            let normal = Vector3::new(circle_radius * cos, circle_radius * sin, z);
            let x = centre + radius * normal;
            let flux = weight / CIRCLE_POINTS as f64 * radius * radius * x.dot(&normal);
            let (first, second) = (flux / 4.0, flux / 5.0);
            let term = [
                flux / 3.0,
                first * x.x,
                first * x.y,
                first * x.z,
                second * x.x * x.x,
                second * x.y * x.y,
                second * x.z * x.z,
                second * x.x * x.y,
                second * x.x * x.z,
                second * x.y * x.z,
            ];
            add_moments(&mut sum, &term, 1.0);
        }
        sum
    }

    /// Integrals of cos mφ and sin mφ, m from 0 to 3, over the exposed arcs of the latitude with the sine `z`; none if all of
    /// it is covered.
    fn exposed_harmonics(&self, z: f64, circle_radius: f64) -> Option<[[f64; 2]; 4]> {
        // Covered arcs within a turn, from their start.
        let mut arcs: Vec<[f64; 2]> = Vec::with_capacity(2 * self.caps.len());
        for CoveredCap { direction, cosine } in &self.caps {
            let amplitude = circle_radius * libm::hypot(direction.x, direction.y);
            let threshold = cosine - z * direction.z;
            if threshold >= amplitude {
                continue;
            }
            if threshold <= -amplitude {
                return None;
            }
            let half_angle = libm::acos(threshold / amplitude);
            let start = libm::atan2(direction.y, direction.x) - half_angle;
            let start = if start < 0.0 { start + TAU } else { start };
            let end = start + 2.0 * half_angle;
            arcs.push([start, end.min(TAU)]);
            if end > TAU {
                arcs.push([0.0, end - TAU]);
            }
        }
        arcs.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut harmonics = [[0.0; 2]; 4];
        let mut add_arc = |from: f64, to: f64| {
            harmonics[0][0] += to - from;
            for (m, [cosines, sines]) in (1..).map(f64::from).zip(&mut harmonics[1..]) {
                let ((sin_from, cos_from), (sin_to, cos_to)) = (libm::sincos(m * from), libm::sincos(m * to));
                *cosines += (sin_to - sin_from) / m;
                *sines += (cos_from - cos_to) / m;
            }
        };
        let mut covered_to = 0.0;
        for [start, end] in arcs {
            if start > covered_to {
                add_arc(covered_to, start);
            }
            covered_to = end.max(covered_to);
        }
        if covered_to < TAU {
            add_arc(covered_to, TAU);
        }
        Some(harmonics)
    }
}

/// Sine of the angle from 0 to π with this cosine, or the reverse.
fn sine_of(cosine: f64) -> f64 {
    ((1.0 - cosine) * (1.0 + cosine)).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{RandomStream, StreamPurpose};

    fn ball(centre: [f64; 3], radius: f64) -> ClumpBall {
        ClumpBall { centre: centre.into(), radius }
    }

    /// Integrals of 1, z and z², and of x², over the part of a ball about (0, 0, c) between heights from its centre.
    fn zone(c: f64, r: f64, [low, high]: [f64; 2]) -> [f64; 4] {
        let integral = |f: &dyn Fn(f64) -> f64| f(high) - f(low);
        let area = |u: f64| r * r * u - u.powi(3) / 3.0;
        let first = |u: f64| r * r * u * u / 2.0 - u.powi(4) / 4.0;
        let second = |u: f64| r * r * u.powi(3) / 3.0 - u.powi(5) / 5.0;
        let across = |u: f64| r.powi(4) * u - 2.0 / 3.0 * r * r * u.powi(3) + u.powi(5) / 5.0;
        let [v, m, s] = [integral(&area), integral(&first), integral(&second)];
        [v, c * v + m, c * c * v + 2.0 * c * m + s, integral(&across) / 4.0].map(|x| PI * x)
    }

    /// Union of balls at (0, 0, c) with the radius r, each of which its neighbours alone cut: volume, height of the centre,
    /// moments across and along the axis.
    fn chain_closed_form(balls: &[(f64, f64)]) -> [f64; 4] {
        // Height of the plane in which two spheres meet.
        let cut = |(a, r): (f64, f64), (b, s): (f64, f64)| 0.5 * (a + b + (r * r - s * s) / (b - a));
        let mut sum = [0.0; 4];
        for (k, &(c, r)) in balls.iter().enumerate() {
            let low = if k == 0 { -r } else { cut(balls[k - 1], balls[k]).max(c - r) - c };
            let high = if k + 1 == balls.len() { r } else { cut(balls[k], balls[k + 1]).min(c + r) - c };
            sum.iter_mut().zip(zone(c, r, [low, high])).for_each(|(sum, part)| *sum += part);
        }
        let [volume, first, second, across] = sum;
        let height = first / volume;
        [volume, height, second - volume * height * height + across, 2.0 * across]
    }

    #[test]
    fn chains_have_their_closed_forms_in_all_directions() {
        let mut random = RandomStream::new(2, 0, StreamPurpose::Shape);
        let chains: [&[(f64, f64)]; 6] = [
            &[(-1.0, 0.8), (1.0, 0.8)],
            &[(0.0, 1.0), (1.5, 1.0)],
            &[(0.0, 1.0), (1.1, 0.4)],
            &[(-0.7, 1.0), (0.9, 0.7)],
            // In this one, up to four balls overlap in a point.
            &[(0.0, 1.0), (0.5, 1.0), (1.0, 1.0), (1.5, 1.0), (2.0, 1.0)],
            &[(0.0, 0.2), (0.3, 0.25), (0.7, 0.3), (1.2, 0.35), (1.9, 0.2)],
        ];
        for chain in chains {
            let [volume, height, across, along] = chain_closed_form(chain);
            for turn in 0..6 {
                // The axis itself, at which arcs degenerate, then at random.
                let axis = if turn == 0 { Vector3::z() } else { random.uniform_direction() };
                let origin = Vector3::new(3.0, -1.0, 2.0) * f64::from(turn);
                let balls: Vec<ClumpBall> =
                    chain.iter().map(|&(c, radius)| ClumpBall { centre: origin + axis * c, radius }).collect();
                let found = union_properties(&balls);
                let inertia = Matrix3::from_diagonal_element(across) + (along - across) * axis * axis.transpose();
                // The stated error.
                assert!((found.volume / volume - 1.0).abs() < 1e-10, "{chain:?}: {} {volume}", found.volume);
                assert!((Vector3::from(found.centre) - origin - axis * height).norm() < 1e-10, "{chain:?}");
                assert!((Matrix3::from(found.inertia) - inertia).amax() < 1e-10 * across, "{chain:?}");
            }
        }
    }

    #[test]
    fn two_unit_balls_at_the_distance_1_have_the_lens_of_the_textbook() {
        // The lens of two unit balls at the distance d has π (4 + d) (2 - d)²/12: 5π/12.
        let found = union_properties(&[ball([0.0; 3], 1.0), ball([1.0, 0.0, 0.0], 1.0)]);
        assert!((found.volume - (8.0 / 3.0 - 5.0 / 12.0) * PI).abs() < 1e-12, "{}", found.volume);
        assert!((Vector3::from(found.centre) - Vector3::new(0.5, 0.0, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn a_ball_within_another_adds_nothing() {
        let lone = union_properties(&[ball([1.0, 2.0, 3.0], 2.0)]);
        let both = union_properties(&[ball([1.0, 2.0, 3.0], 2.0), ball([1.5, 2.0, 3.5], 1.0)]);
        assert!((lone.volume - 32.0 / 3.0 * PI).abs() < 1e-12);
        assert!((both.volume / lone.volume - 1.0).abs() < 1e-13); // roundings
        assert!((Matrix3::from(both.inertia) - Matrix3::from(lone.inertia)).amax() < 1e-12 * lone.inertia[0][0]);
        let moment = 0.4 * lone.volume * 4.0;
        assert!((Matrix3::from(lone.inertia) - Matrix3::from_diagonal_element(moment)).amax() < 1e-12 * moment);
    }

    /// Clumps at random, of which many balls overlap in a point: their volume and inertia turn with them, and are those that
    /// random points find.
    #[test]
    fn clumps_at_random_turn_with_their_inertia() {
        let mut random = RandomStream::new(5, 0, StreamPurpose::Shape);
        for count in [3, 8, 30] {
            let balls: Vec<ClumpBall> = (0..count)
                .map(|_| ClumpBall { centre: random.point_in_ball(), radius: 0.3 + 0.5 * random.uniform() })
                .collect();
            let found = union_properties(&balls);
            for _ in 0..3 {
                let rotation = random.uniform_rotation();
                let turned: Vec<ClumpBall> =
                    balls.iter().map(|ball| ClumpBall { centre: rotation * ball.centre, ..*ball }).collect();
                let turned = union_properties(&turned);
                let centre = rotation * Vector3::from(found.centre);
                let inertia = rotation * Matrix3::from(found.inertia) * rotation.transpose();
                assert!((turned.volume / found.volume - 1.0).abs() < 1e-10, "{count}");
                assert!((Vector3::from(turned.centre) - centre).norm() < 1e-10, "{count}");
                assert!((Matrix3::from(turned.inertia) - inertia).amax() < 1e-10 * inertia.trace(), "{count}");
            }
            let (points, half) = (20_000, 1.8);
            let is_inside = |x: &Vector3<f64>| balls.iter().any(|ball| (x - ball.centre).norm() < ball.radius);
            let share =
                (0..points).filter(|_| is_inside(&(half * random.point_in_cube()))).count() as f64 / f64::from(points);
            let expected = found.volume / (2.0 * half).powi(3);
            // Four standard errors.
            let error = (expected * (1.0 - expected) / f64::from(points)).sqrt();
            assert!((share - expected).abs() < 4.0 * error, "{count}: {share} {expected}");
        }
    }
}
