//! Bodies inside a hollow cylinder, as in a drum.

use super::cylinder::CYLINDER_RIM;
use super::manifold::{ContactPoint, Manifold, vertex_feature};
use super::polyhedron::PosedPolyhedron;
use crate::math::{Quat, Vec3};

/// Contacts of polyhedron A in a hollow cylinder of `[half height, radius]` (m) at `c` = x_B - x_A (m) with the
/// orientation `q`, its axis the third.
///
/// The cylinder is closed at its ends. Its inside is convex, so that only vertices touch it: each touches the side and
/// the nearer end. Returns one manifold of one point for each contact within `alert` (m). A vertex on the axis has no
/// contact with the side, as it has no direction. The cylinder's feature is 0 for the side, 1 for the end along its axis,
/// 2 for the other end.
///
/// ```
/// # use cd_solve::geometry::{Polyhedron, polyhedron_hollow_cylinder};
/// # use cd_solve::math::{Quat, Vec3};
/// let cube = Polyhedron::cuboid(&Vec3::repeat(3.0));
/// let posed = cube.posed_by(&Quat::identity());
/// // The corners at x = 3 are at 5 from the axis.
/// let c = Vec3::new(-1.0, 0.0, 0.0);
/// let found = polyhedron_hollow_cylinder(&posed, &c, &Quat::identity(), [9.0, 5.5], 1.0);
/// assert_eq!(found.len(), 4);
/// assert!(found.iter().all(|manifold| (manifold.gap() - 0.5).abs() < 1e-15));
/// ```
pub fn polyhedron_hollow_cylinder(
    a: &PosedPolyhedron,
    c: &Vec3,
    q: &Quat,
    [half_height, radius]: [f64; 2],
    alert: f64,
) -> Vec<Manifold> {
    let mut inside = InsideContacts { c, q, half_height, radius, alert, found: Vec::new() };
    for k in 0..a.shape.vertices().len() as u32 {
        let v = a.vertex(k);
        let local = inside.local_point(&v);
        inside.add_at_side(v, &local, vertex_feature(k));
        inside.add_at_end(v, &local, local.z, vertex_feature(k));
    }
    inside.found
}

/// Contacts of points of A with the inside of a hollow cylinder of these lengths (m) at `c` = x_B - x_A (m) with the
/// orientation `q`, up to the gap `alert`, m.
struct InsideContacts<'a> {
    c: &'a Vec3,
    q: &'a Quat,
    half_height: f64,
    radius: f64,
    alert: f64,
    found: Vec<Manifold>,
}

impl InsideContacts<'_> {
    /// Position of a point along the axes of the cylinder, m.
    fn local_point(&self, point: &Vec3) -> Vec3 {
        self.q.inverse_transform_vector(&(point - self.c))
    }

    /// Adds the contact of a point with the side; a point on the axis has none. `local`: its position along the axes.
    fn add_at_side(&mut self, point: Vec3, local: &Vec3, feature: u32) {
        let distance = local.xy().norm();
        if distance > 0.0 {
            let outward = Vec3::new(local.x, local.y, 0.0) / distance;
            self.add(point, outward, self.radius - distance, (feature, 0));
        }
    }

    /// Adds the contact of a point with the end on the side of the height `height`, m.
    fn add_at_end(&mut self, point: Vec3, local: &Vec3, height: f64, feature: u32) {
        let end = if height >= 0.0 { 1 } else { 2 };
        let gap = self.half_height - local.z.abs();
        self.add(point, Vec3::z() * 1f64.copysign(height), gap, (feature, end));
    }

    fn add(&mut self, point: Vec3, outward: Vec3, gap: f64, features: (u32, u32)) {
        if gap <= self.alert {
            self.found.push(point_contact(point, self.q * outward, gap, features));
        }
    }
}

/// Contact of the point `x` of A, m, with a wall at the distance `gap` along the unit vector `outward`, world frame.
fn point_contact(x: Vec3, outward: Vec3, gap: f64, features: (u32, u32)) -> Manifold {
    let points = [ContactPoint { position: x + outward * (0.5 * gap), gap, features }].into_iter().collect();
    Manifold { normal: -outward, points, area: 0.0 }
}

/// Samples of a rim among which the farthest points from the axis are searched: their distance has at most two maxima.
const RIM_SAMPLES: u32 = 16;

/// Ratio of the variation of the squared distance from the axis along a rim to the squared radius, below which the rim is
/// round about the axis.
const ROUND_RIM: f64 = 1e-9;

/// Length of the part of the direction to an end that is in the plane of a rim, below which the rim is flush with the end.
const FLUSH_TILT: f64 = 1e-9;

/// Feature of a rim point: the rim is 0 or 1, the point is 0 to 3 for the fixed ones, more for the others.
const fn rim_feature(rim: u32, point: u32) -> u32 {
    CYLINDER_RIM + 8 * rim + point
}

/// Contacts of a solid cylinder A of `[half height, radius]` (m), with the orientation `axes`, in a hollow cylinder at
/// `c` = x_B - x_A (m) with the orientation `q`, as [`polyhedron_hollow_cylinder`] has those of vertices.
///
/// Only the rims touch. Each touches the side where it is farthest from the axis of B, which may be at two points, and the
/// nearer end at its highest point and at four fixed ones.
///
/// ```
/// # use cd_solve::geometry::cylinder_hollow_cylinder;
/// # use cd_solve::math::{Quat, Vec3};
/// // It lies in a drum, parallel to its axis.
/// let q = Quat::identity();
/// let found = cylinder_hollow_cylinder(&q, [1.0, 0.5], &Vec3::new(-1.25, 0.0, 0.0), &q, [9.0, 2.0], 0.5);
/// assert_eq!(found.len(), 2);
/// assert!(found.iter().all(|contact| (contact.gap() - 0.25).abs() < 1e-15 && (contact.normal + Vec3::x()).norm() < 1e-15));
/// ```
pub fn cylinder_hollow_cylinder(
    axes: &Quat,
    size: [f64; 2],
    c: &Vec3,
    q: &Quat,
    [half_height, radius]: [f64; 2],
    alert: f64,
) -> Vec<Manifold> {
    let mut inside = InsideContacts { c, q, half_height, radius, alert, found: Vec::new() };
    for (rim, PosedRim { centre, radii }) in (0..).zip(posed_rims(axes, size)) {
        let point = |angle: f64| {
            let (sin, cos) = libm::sincos(angle);
            centre + radii[0] * cos + radii[1] * sin
        };
        let local = |v: &Vec3| q.inverse_transform_vector(v);
        let [x, e, f] = [local(&(centre - c)), local(&radii[0]), local(&radii[1])];
        for (angle, number) in farthest_angles(&x, [&e, &f]) {
            let point = point(angle);
            let local = inside.local_point(&point);
            inside.add_at_side(point, &local, rim_feature(rim, number));
        }
        let up = 1f64.copysign(x.z);
        let tilt = libm::hypot(e.z, f.z);
        let highest = (tilt > FLUSH_TILT * size[1]).then(|| (libm::atan2(up * f.z, up * e.z), 4));
        for (angle, number) in fixed_angles().into_iter().chain(highest) {
            let point = point(angle);
            let local = inside.local_point(&point);
            inside.add_at_end(point, &local, x.z, rim_feature(rim, number));
        }
    }
    inside.found
}

/// Rim of a cylinder relative to its centre in the world's axes, m.
struct PosedRim {
    centre: Vec3,
    /// Two perpendicular vectors from the centre to the rim.
    radii: [Vec3; 2],
}

/// Rims of a cylinder of `[half height, radius]`, m.
fn posed_rims(axes: &Quat, [half_height, radius]: [f64; 2]) -> [PosedRim; 2] {
    let radii = [axes * Vec3::x() * radius, axes * Vec3::y() * radius];
    [1.0, -1.0].map(|side| PosedRim { centre: axes * Vec3::z() * (side * half_height), radii })
}

/// Angles of four fixed points of a rim, rad, with their numbers.
fn fixed_angles() -> [(f64, u32); 4] {
    [0, 1, 2, 3].map(|k| (std::f64::consts::FRAC_PI_2 * f64::from(k), k))
}

/// Angles at which the points x + e cos θ + f sin θ are farthest from the third axis, rad, with the numbers of the points:
/// maxima of g = ρ²; four fixed points if the rim is round about the axis.
fn farthest_angles(x: &Vec3, [e, f]: [&Vec3; 2]) -> smallvec::SmallVec<[(f64, u32); 4]> {
    let [x, e, f] = [x.xy(), e.xy(), f.xy()];
    let squared_distance = |angle: f64| {
        let (sin, cos) = libm::sincos(angle);
        (x + e * cos + f * sin).norm_squared()
    };
    // g' and g''.
    let derivatives = |angle: f64| {
        let (sin, cos) = libm::sincos(angle);
        let (from_axis, slope) = (x + e * cos + f * sin, f * cos - e * sin);
        (2.0 * from_axis.dot(&slope), 2.0 * (slope.norm_squared() - from_axis.dot(&(e * cos + f * sin))))
    };
    let spacing = std::f64::consts::TAU / f64::from(RIM_SAMPLES);
    let samples: [f64; RIM_SAMPLES as usize] = std::array::from_fn(|k| squared_distance(spacing * k as f64));
    let [low, high] = samples.iter().fold([f64::INFINITY, 0.0], |[a, b]: [f64; 2], g| [a.min(*g), b.max(*g)]);
    if high - low <= ROUND_RIM * (e.norm_squared() + f.norm_squared()) {
        return fixed_angles().into_iter().collect();
    }
    let mut maxima = smallvec::SmallVec::new();
    for k in 0..RIM_SAMPLES as usize {
        let [before, after] = [k + samples.len() - 1, k + 1].map(|k| samples[k % samples.len()]);
        if samples[k] < before || samples[k] <= after {
            continue;
        }
        let mut angle = spacing * k as f64;
        let [mut lower, mut upper] = [angle - spacing, angle + spacing];
        for _ in 0..MAX_ANGLE_STEPS {
            let (slope, bend) = derivatives(angle);
            if slope > 0.0 {
                lower = angle
            } else {
                upper = angle
            }
            let newton = angle - slope / bend;
            let next = if newton > lower && newton < upper { newton } else { 0.5 * (lower + upper) };
            if (next - angle).abs() <= f64::EPSILON {
                break;
            }
            angle = next;
        }
        maxima.push((angle, 5 + maxima.len() as u32));
    }
    maxima
}

/// Largest number of steps of the search for a maximum: Newton's method needs less than ten.
const MAX_ANGLE_STEPS: u32 = 60;

/// Tangent planes of the side of [`far_walls`]. The polygon of their faces is at most 2 % wider than the cylinder.
const TANGENT_PLANES: u32 = 16;

/// Ratio of the displacement in a step to the smaller of the cylinder's radius and half height, above which the wall
/// ahead of a body differs from the one nearest to it.
const FAR_DISPLACEMENT: f64 = 0.25;

/// First feature of a hollow cylinder that is a tangent plane of its side or the farther end.
pub const FAR_WALL: u32 = 4;

/// Contacts of a ball of `radius` about `centre` (m, candidate) with all walls of a hollow cylinder at `c` with the
/// orientation `q`, as [`polyhedron_hollow_cylinder`] has them, in steps in which the distance closes by more than a
/// quarter of the cylinder's size: tangent planes of its side all around, and the farther end. Empty in shorter steps.
///
/// `feature`: feature of the candidate.
pub fn far_walls(
    centre: &Vec3,
    radius: f64,
    feature: u32,
    (c, q): (&Vec3, &Quat),
    [half_height, cylinder_radius]: [f64; 2],
    displacement: f64,
) -> Vec<Manifold> {
    if displacement < FAR_DISPLACEMENT * half_height.min(cylinder_radius) {
        return Vec::new();
    }
    let local = q.inverse_transform_vector(&(centre - c));
    let side = |k: u32| {
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * f64::from(k) / f64::from(TANGENT_PLANES));
        (Vec3::new(cos, sin, 0.0), cylinder_radius, FAR_WALL + 1 + k)
    };
    let farther_end = (Vec3::z() * -1f64.copysign(local.z), half_height, FAR_WALL);
    let walls = (0..TANGENT_PLANES).map(side).chain([farther_end]);
    let wall_contact = |(outward, distance, wall): (Vec3, f64, u32)| {
        let gap = distance - outward.dot(&local) - radius;
        let outward = q * outward;
        point_contact(centre + outward * radius, outward, gap, (feature, wall))
    };
    walls.map(wall_contact).filter(|manifold| manifold.gap() <= displacement).collect()
}

/// [`far_walls`] of the vertices of polyhedron A.
pub fn vertices_at_far_walls(
    a: &PosedPolyhedron,
    c: &Vec3,
    q: &Quat,
    size: [f64; 2],
    displacement: f64,
) -> impl Iterator<Item = Manifold> {
    let at_vertex = move |k: u32| far_walls(&a.vertex(k), 0.0, vertex_feature(k), (c, q), size, displacement);
    (0..a.shape.vertices().len() as u32).flat_map(at_vertex)
}

/// [`far_walls`] of four fixed points of each rim of a solid cylinder A of `[half height, radius]`, m.
pub fn rims_at_far_walls(
    axes: &Quat,
    size: [f64; 2],
    (c, q): (&Vec3, &Quat),
    hollow_size: [f64; 2],
    displacement: f64,
) -> Vec<Manifold> {
    let mut found = Vec::new();
    for (rim, PosedRim { centre, radii: [e, f] }) in (0..).zip(posed_rims(axes, size)) {
        for (k, point) in (0..).zip([centre + e, centre + f, centre - e, centre - f]) {
            found.extend(far_walls(&point, 0.0, rim_feature(rim, k), (c, q), hollow_size, displacement));
        }
    }
    found
}
