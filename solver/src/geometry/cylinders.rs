//! Two solid cylinders, two capsules, and a capsule and a cylinder: a capsule is a cylinder of radius 0, its core, and all
//! points up to its radius from it.
//!
//! As for a [polyhedron and a cylinder](super::cylinder), s(m) = min_A m·a - max_B m·b for a unit m from B to A is a lower
//! bound of their distance, and -s a translation that separates them if they overlap. With d = x_A - x_B, axes u, half heights
//! H and radii R
//!
//! ```text
//! s(m) = m·d - Σ (R |m x u| + H |m·u|).
//! ```
//!
//! It is the smallest of four functions, one for each pair of ends, that are smooth except at m = ±u. Its maximum is therefore
//! at the normal of an end, at the common perpendicular of the axes, on the circle m·u = 0 of one of the two, where the side
//! meets a rim, or where two rims meet. All of these are tried.

use super::capsule::rounded_manifold;
use super::cylinder::{CYLINDER_END, CYLINDER_OTHER_END, CYLINDER_RIM, CYLINDER_SIDE, MAX_END_DEVIATION, rim_maximum};
use super::manifold::{ContactPoint, ListingRange, Manifold};
use super::pair::PatchCorner;
use super::patch::{ContactPatch, MAX_AREA_TILT};
use crate::math::{Mat3, Quat, Vec3};

/// Contact of solid cylinder A with solid cylinder B at `c` = x_B - x_A (m), both of `[half height, radius]` (m) with their
/// orientations, the axis the third; `None` if they are farther apart than `range` lists.
///
/// An end on an end gives points on the outline of their common part and its area; a side on an end, or sides of parallel
/// cylinders, the ends of their common line; all others one point. Points are relative to A's centre, the normal is from B
/// to A. Features: 0 for a side, 1 for the end along the axis, 2 for the other end, more for points on a rim.
///
/// ```
/// # use cd_solve::geometry::cylinder_cylinder;
/// # use cd_solve::math::{Quat, Vec3};
/// // Two that stand on each other, and two next to each other.
/// let q = Quat::identity();
/// let on_top = cylinder_cylinder(&q, [1.0, 0.5], &Vec3::new(0.0, 0.0, -2.25), &q, [1.0, 0.5], 0.5).unwrap();
/// assert_eq!((on_top.normal, on_top.gap(), on_top.points.len()), (Vec3::z(), 0.25, 4));
/// let contact = cylinder_cylinder(&q, [1.0, 0.5], &Vec3::new(1.25, 0.0, 1.0), &q, [1.0, 0.5], 0.5).unwrap();
/// assert_eq!((contact.normal, contact.gap(), contact.points.len()), (-Vec3::x(), 0.25, 2));
/// ```
pub fn cylinder_cylinder(
    axes_a: &Quat,
    size_a: [f64; 2],
    c: &Vec3,
    axes_b: &Quat,
    size_b: [f64; 2],
    range: impl Into<ListingRange>,
) -> Option<Manifold> {
    let (a, b) = (PosedCylinder::new(axes_a, size_a, Vec3::zeros()), PosedCylinder::new(axes_b, size_b, *c));
    core_contact(a, b, range.into())
}

/// Contact of capsule A of `[half length, radius]` (m) with solid cylinder B, with the other arguments and results of
/// [`cylinder_cylinder`].
///
/// ```
/// # use cd_solve::geometry::capsule_cylinder;
/// # use cd_solve::math::{Quat, Vec3};
/// // A capsule stands on a cylinder.
/// let q = Quat::identity();
/// let found = capsule_cylinder(&q, [1.0, 0.5], &Vec3::new(0.0, 0.0, -2.75), &q, [1.0, 2.0], 0.5).unwrap();
/// assert_eq!((found.normal, found.gap(), found.points[0].position.z), (Vec3::z(), 0.25, -1.625));
/// ```
pub fn capsule_cylinder(
    axes_a: &Quat,
    size_a: [f64; 2],
    c: &Vec3,
    axes_b: &Quat,
    size_b: [f64; 2],
    range: impl Into<ListingRange>,
) -> Option<Manifold> {
    let (a, b) = (PosedCylinder::core_of(axes_a, size_a, Vec3::zeros()), PosedCylinder::new(axes_b, size_b, *c));
    rounded_contact(a, b, range.into())
}

/// Contact of two capsules of `[half length, radius]` (m), with the other arguments and results of [`cylinder_cylinder`].
///
/// ```
/// # use cd_solve::geometry::capsule_capsule;
/// # use cd_solve::math::{Quat, Vec3};
/// // Side by side they touch along a line.
/// let q = Quat::identity();
/// let found = capsule_capsule(&q, [1.0, 0.5], &Vec3::new(1.25, 0.0, 1.0), &q, [1.0, 0.25], 0.5).unwrap();
/// assert_eq!((found.normal, found.gap(), found.points.len()), (-Vec3::x(), 0.5, 2));
/// assert_eq!(found.points[0].position.x, 0.75);
/// ```
pub fn capsule_capsule(
    axes_a: &Quat,
    size_a: [f64; 2],
    c: &Vec3,
    axes_b: &Quat,
    size_b: [f64; 2],
    range: impl Into<ListingRange>,
) -> Option<Manifold> {
    let (a, b) = (PosedCylinder::core_of(axes_a, size_a, Vec3::zeros()), PosedCylinder::core_of(axes_b, size_b, *c));
    rounded_contact(a, b, range.into())
}

/// Contact of solid cylinder A with the end of solid cylinder B along the given unit normal `n`, from B to A, which is that
/// of the end: points of the common part of the end and the surface of A that faces it. `None` if there is no common part
/// within the range, or if `n` is not along B's axis to 10⁻³ rad. Other arguments as in [`cylinder_cylinder`].
///
/// No search is made: the caller knows that a plane across `n` separates the two.
pub fn cylinder_end_along(
    axes_a: &Quat,
    size_a: [f64; 2],
    c: &Vec3,
    axes_b: &Quat,
    size_b: [f64; 2],
    n: &Vec3,
    range: ListingRange,
) -> Option<Manifold> {
    let (a, b) = (PosedCylinder::new(axes_a, size_a, Vec3::zeros()), PosedCylinder::new(axes_b, size_b, *c));
    end_contact(a, b, n, range)
}

/// Contact of capsule A of `[half length, radius]` (m) with the end of solid cylinder B, with the other arguments and
/// results of [`cylinder_end_along`].
pub fn capsule_end_along(
    axes_a: &Quat,
    size_a: [f64; 2],
    c: &Vec3,
    axes_b: &Quat,
    size_b: [f64; 2],
    n: &Vec3,
    range: ListingRange,
) -> Option<Manifold> {
    let (a, b) = (PosedCylinder::core_of(axes_a, size_a, Vec3::zeros()), PosedCylinder::new(axes_b, size_b, *c));
    let rounding = [a.rounding, b.rounding];
    let found = end_contact(a, b, n, range.widened_by(rounding[0]))?;
    Some(rounded_manifold(&found, rounding))
}

/// Contact of cylinder A, at the origin, with the end of B that faces along `n`, without their rounding; `None` as in
/// [`cylinder_end_along`].
fn end_contact(a: PosedCylinder, b: PosedCylinder, n: &Vec3, range: ListingRange) -> Option<Manifold> {
    let axis = b.axis();
    if axis.cross(n).norm() > MAX_END_DEVIATION {
        return None;
    }
    let pair = TwoCylinders::new(a, b);
    let m = axis * 1f64.copysign(axis.dot(n));
    let end = MeetingAxis { m, s: pair.separation(&m), meeting: CylinderMeeting::EndOfB };
    let mut manifold = Manifold::default();
    pair.common_part(&end, range.area).write_manifold(range, pair.tie, &mut manifold);
    (!manifold.points.is_empty()).then_some(manifold)
}

/// Contact of two cylinders, A at the origin, with their rounding; `None` if they are farther apart than `range` lists.
fn rounded_contact(a: PosedCylinder, b: PosedCylinder, range: ListingRange) -> Option<Manifold> {
    let rounding = [a.rounding, b.rounding];
    let found = core_contact(a, b, range.widened_by(rounding[0] + rounding[1]))?;
    Some(rounded_manifold(&found, rounding))
}

/// Contact of two cylinders, A at the origin, without their rounding; `None` if they are farther apart than `range` lists.
fn core_contact(a: PosedCylinder, b: PosedCylinder, range: ListingRange) -> Option<Manifold> {
    if b.centre.norm() - a.size() - b.size() > range.alert {
        return None;
    }
    let pair = TwoCylinders::new(a, b);
    let axis = pair.best_axis();
    if axis.s > range.alert {
        return None;
    }
    let mut patch = pair.common_part(&axis, range.area);
    if patch.has_axis_gap(axis.s, pair.tie) {
        let mut manifold = Manifold::default();
        patch.write_manifold(range, pair.tie, &mut manifold);
        return (!manifold.points.is_empty()).then_some(manifold);
    }
    Some(Manifold { normal: axis.m, points: [pair.axis_point(&axis)].into_iter().collect(), area: 0.0 })
}

/// Cylinder in the world's axes, relative to the centre of A.
struct PosedCylinder<'a> {
    centre: Vec3,
    axes: &'a Quat,
    half_height: f64,
    radius: f64,
    /// Distance of the surface from the cylinder, m: the radius of a capsule, whose core has the radius 0.
    rounding: f64,
}

impl<'a> PosedCylinder<'a> {
    /// Cylinder of `[half height, radius]` (m) about `centre`.
    fn new(axes: &'a Quat, [half_height, radius]: [f64; 2], centre: Vec3) -> Self {
        PosedCylinder { centre, axes, half_height, radius, rounding: 0.0 }
    }

    /// Core of a capsule of `[half length, radius]` (m) about `centre`.
    fn core_of(axes: &'a Quat, [half_height, rounding]: [f64; 2], centre: Vec3) -> Self {
        PosedCylinder { centre, axes, half_height, radius: 0.0, rounding }
    }
}

impl PosedCylinder<'_> {
    /// Unit vector along the axis.
    fn axis(&self) -> Vec3 {
        self.axes * Vec3::z()
    }

    /// Radius of the bounding ball, m.
    fn size(&self) -> f64 {
        libm::hypot(self.radius, self.half_height)
    }

    /// Largest m·x of its points x from the centre, m.
    fn reach(&self, m: &Vec3) -> f64 {
        let along = self.axis().dot(m);
        self.radius * (m - self.axis() * along).norm() + self.half_height * along.abs()
    }

    /// Centre of the end along `m`, relative to the centre of A.
    fn end_centre(&self, m: &Vec3) -> Vec3 {
        self.centre + self.axis() * self.half_height.copysign(self.axis().dot(m))
    }

    /// Feature of the end along `m`.
    fn end_feature(&self, m: &Vec3) -> u32 {
        if self.axis().dot(m) >= 0.0 { CYLINDER_END } else { CYLINDER_OTHER_END }
    }

    /// Unit vector from the axis towards `m`; 0 if `m` is along the axis.
    fn radial_direction(&self, m: &Vec3) -> Vec3 {
        let across = m - self.axis() * self.axis().dot(m);
        across.try_normalize(1e-12).unwrap_or(Vec3::zeros())
    }
}

/// Cylinders A and B.
struct TwoCylinders<'a> {
    a: PosedCylinder<'a>,
    b: PosedCylinder<'a>,
    /// Smaller of the circumradii of A and B, m.
    smaller: f64,
    /// Smallest improvement by which a direction replaces an earlier one, m.
    tie: f64,
}

/// Features that meet along a direction.
#[derive(Debug, Clone, Copy, PartialEq)]
enum CylinderMeeting {
    /// An end of A, or of B, with anything.
    EndOfA,
    EndOfB,
    /// Two sides.
    Sides,
    /// The side of A with a rim of B, or the reverse.
    SideOfA,
    SideOfB,
    /// Two rims.
    Rims,
}

/// Cylinder whose end touches the other one.
#[derive(Debug, Clone, Copy)]
enum EndOwner {
    A,
    B,
}

/// Direction with the separation along it.
#[derive(Debug, Clone, Copy)]
struct MeetingAxis {
    /// Unit direction from B to A.
    m: Vec3,
    /// Separation s(m), m, < 0 if the two overlap in this direction.
    s: f64,
    meeting: CylinderMeeting,
}

/// Number of steps of the search between two rims: Newton's method needs less than ten.
const MAX_RIM_STEPS: usize = 50;
/// Number of times that a step between two rims is halved: down to 1e-9 rad, the angle below which a direction is taken as the
/// normal of an end.
const MAX_HALVINGS: i32 = 30;
/// Angle between two axes, rad, up to which radial directions count as perpendicular to both: far above that of rounding, 1e-8,
/// below which their cross product has no better direction, and far below one that moves a contact point.
const MAX_PARALLEL_TILT: f64 = 1e-6;
/// Sideways distance of the ends of two nearly parallel sides, divided by the smaller radius, up to which they touch
/// along a line: the gap at these ends exceeds that of the middle by half the square of this ratio, times the radius.
const MAX_SIDE_SKEW: f64 = 1e-2;

impl<'a> TwoCylinders<'a> {
    fn new(a: PosedCylinder<'a>, b: PosedCylinder<'a>) -> Self {
        let smaller = a.size().min(b.size());
        let tie = 4e-12 * smaller + 32.0 * f64::EPSILON * (a.size() + b.size());
        TwoCylinders { a, b, smaller, tie }
    }

    /// Corners of the common part along a direction.
    fn common_part(&self, axis: &MeetingAxis, area_within: f64) -> ContactPatch {
        let mut patch = ContactPatch { normal: -axis.m, ..ContactPatch::default() };
        self.collect_corners(axis, area_within, &mut patch);
        for corner in &mut patch.corners {
            // The gap of the direction itself, if the two differ by rounding only.
            corner.gap = if corner.gap <= axis.s + self.tie { axis.s } else { corner.gap };
        }
        patch
    }

    /// Separation s(m), m.
    fn separation(&self, m: &Vec3) -> f64 {
        -m.dot(&self.b.centre) - self.a.reach(m) - self.b.reach(m)
    }

    /// Returns the best direction.
    fn best_axis(&self) -> MeetingAxis {
        let (u, w, d) = (self.a.axis(), self.b.axis(), -self.b.centre);
        let mut best = MeetingAxis { m: Vec3::z(), s: f64::NEG_INFINITY, meeting: CylinderMeeting::EndOfB };
        let mut attempt = |m: Vec3, meeting: CylinderMeeting| {
            let s = self.separation(&m);
            if s > best.s + self.tie {
                best = MeetingAxis { m, s, meeting };
            }
        };
        let pointing_to_a = |m: Vec3| m * 1f64.copysign(m.dot(&d));
        attempt(pointing_to_a(w), CylinderMeeting::EndOfB);
        attempt(pointing_to_a(u), CylinderMeeting::EndOfA);
        let across = u.cross(&w);
        if across.norm() < MAX_PARALLEL_TILT {
            // Every radial direction is perpendicular to two parallel axes.
            let radial = [self.a.radial_direction(&d), self.b.radial_direction(&d)];
            radial.into_iter().filter(|m| *m != Vec3::zeros()).for_each(|m| attempt(m, CylinderMeeting::Sides));
        }
        if let Some(m) = across.try_normalize(1e-9) {
            attempt(pointing_to_a(m), CylinderMeeting::Sides);
        }
        for m in rim_to_side(&self.a, &self.b, &d).into_iter().flatten() {
            attempt(m, CylinderMeeting::SideOfA);
        }
        for m in rim_to_side(&self.b, &self.a, &d).into_iter().flatten() {
            attempt(m, CylinderMeeting::SideOfB);
        }
        for signs in [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]] {
            if let Some(m) = self.rim_to_rim(signs, &d) {
                attempt(m, CylinderMeeting::Rims);
            }
        }
        best
    }

    /// Direction of the largest separation of the rim of A at -`signs`[0] along its axis and that of B at `signs`[1], if no
    /// other parts of the cylinders are nearer along it.
    ///
    /// Newton's method on the sphere for f = m·D - Σ R |m x u|, which is homogeneous: at the maximum its gradient is f m.
    fn rim_to_rim(&self, signs: [f64; 2], d: &Vec3) -> Option<Vec3> {
        let [u, w] = [self.a.axis(), self.b.axis()];
        let between = d - u * (signs[0] * self.a.half_height) - w * (signs[1] * self.b.half_height);
        let discs = [(u, self.a.radius), (w, self.b.radius)];
        let value = |m: &Vec3| between.dot(m) - discs.iter().map(|(u, r)| r * u.cross(m).norm()).sum::<f64>();
        // f has a corner at the normals of the ends, and the steps of the search would end in one that lies between it and the
        // maximum. They rise, so they cannot if they begin above all corners.
        let mut m = between.try_normalize(0.0)?;
        let corners = [u, -u, w, -w].map(|n| (value(&n), n)).into_iter().filter(|corner| corner.0 >= value(&m));
        if let Some((at_corner, n)) = corners.max_by(|one, other| one.0.total_cmp(&other.0)) {
            m = off_corner(&n, &between, &discs, |m| value(m) > at_corner)?;
        }
        for _ in 0..MAX_RIM_STEPS {
            let (mut slope, mut bend, mut reach) = (between, -Mat3::identity() * value(&m), 1.0f64);
            for (u, r) in &discs {
                let across = m - u * u.dot(&m);
                let length = across.norm();
                if length < 1e-9 {
                    return None; // the normal of an end
                }
                let out = across / length;
                slope -= out * *r;
                bend -= (Mat3::identity() - u * u.transpose() - out * out.transpose()) * (*r / length);
                reach = reach.min(0.5 * length);
            }
            let slope = slope - m * m.dot(&slope);
            // Along m itself the matrix is -1, so that the step stays tangential.
            let tangent = Mat3::identity() - m * m.transpose();
            let on_sphere = tangent * bend * tangent - m * m.transpose() * self.smaller;
            let newton = on_sphere.try_inverse().map(|inverse| inverse * -slope).filter(|step| step.dot(&slope) > 0.0);
            let mut step = newton.unwrap_or(slope / self.smaller);
            // Not past the normal of an end, where f has a corner.
            step *= (reach / step.norm()).min(1.0);
            let before = value(&m);
            let mut next = (m + step).normalize();
            for _ in 0..MAX_HALVINGS {
                if value(&next) >= before {
                    break;
                }
                step *= 0.5;
                next = (m + step).normalize();
            }
            let moved = (next - m).norm();
            m = next;
            if moved <= 4.0 * f64::EPSILON {
                break;
            }
        }
        (signs[0] * u.dot(&m) > 0.0 && signs[1] * w.dot(&m) > 0.0).then_some(m)
    }

    /// Collects the corners of the common part of the two surfaces that meet; none if they meet in one point.
    fn collect_corners(&self, axis: &MeetingAxis, area_within: f64, patch: &mut ContactPatch) {
        let m = &axis.m;
        match axis.meeting {
            CylinderMeeting::EndOfB => self.collect_on_end(EndOwner::B, m, area_within, patch),
            CylinderMeeting::EndOfA => self.collect_on_end(EndOwner::A, m, area_within, patch),
            CylinderMeeting::Sides => self.collect_along_sides(axis, patch),
            CylinderMeeting::SideOfA | CylinderMeeting::SideOfB | CylinderMeeting::Rims => {}
        }
    }

    /// Collects the corners of the common part of an end of `owner` and the surface of the other cylinder. `m`: direction from
    /// B to A.
    fn collect_on_end(&self, owner: EndOwner, m: &Vec3, area_within: f64, patch: &mut ContactPatch) {
        // The end belongs to the cylinder below, and has the outer normal n.
        let (below, above, n) = match owner {
            EndOwner::A => (&self.a, &self.b, &-m),
            EndOwner::B => (&self.b, &self.a, m),
        };
        let centre = below.end_centre(n);
        let own_end = below.end_feature(n);
        let [e, f] = [below.axes * Vec3::x(), below.axes * Vec3::y()];
        let mut add = |on_above: Vec3, feature_above: u32, feature_below: u32| {
            let gap = n.dot(&(on_above - centre));
            let from = on_above - centre;
            let features = match owner {
                EndOwner::A => (feature_below, feature_above),
                EndOwner::B => (feature_above, feature_below),
            };
            let point = (on_above - n * (0.5 * gap)).into();
            patch.corners.push(PatchCorner { point, flat: [e.dot(&from), f.dot(&from)], gap, features });
        };
        let is_inside = |x: &Vec3, centre_of_disc: &Vec3, radius: f64| {
            let from = x - centre_of_disc;
            (from - n * n.dot(&from)).norm() <= radius + 1e-11 * self.smaller
        };
        let tilt = above.axis().dot(n);
        if tilt.abs() < std::f64::consts::FRAC_1_SQRT_2 {
            // Its side: the lowest line between its ends and the outline of the end below.
            let (along, low) = (above.axis(), above.centre + above.radial_direction(&-n) * above.radius);
            let [x, y] = [e, f].map(|axis| axis.dot(&along));
            let [x0, y0] = [e, f].map(|axis| axis.dot(&(low - centre)));
            let (square, half) = (x * x + y * y, x * x0 + y * y0);
            let root = half * half - square * (x0 * x0 + y0 * y0 - below.radius * below.radius);
            if root <= 0.0 {
                return;
            }
            let ends = [-1.0, 1.0].map(|side| (side * root.sqrt() - half) / square);
            let (from, to) = (ends[0].max(-above.half_height), ends[1].min(above.half_height));
            if from <= to {
                add(low + along * from, CYLINDER_SIDE, CYLINDER_RIM);
                add(low + along * to, CYLINDER_SIDE, CYLINDER_RIM + 1);
            }
            return;
        }
        let (end, feature_above) = (above.end_centre(&-n), above.end_feature(&-n));
        // Points of the end above: the plane of the end above a point of the end below.
        let on_end_above = |x: Vec3| x - n * (above.axis().dot(&(x - end)) / tilt);
        let rim_offset = |cylinder: &PosedCylinder, k: u32| {
            let axis = if k.is_multiple_of(2) { Vec3::x() } else { Vec3::y() };
            cylinder.axes * (axis * if k < 2 { cylinder.radius } else { -cylinder.radius })
        };
        for k in 0..4 {
            let rim = end + rim_offset(above, k);
            if is_inside(&rim, &centre, below.radius) {
                add(rim, CYLINDER_RIM + k, own_end);
            }
        }
        let lowest = above.radial_direction(&-n);
        if lowest != Vec3::zeros() && is_inside(&(end + lowest * above.radius), &centre, below.radius) {
            add(end + lowest * above.radius, CYLINDER_RIM + 4, own_end);
        }
        for k in 0..4 {
            let rim = on_end_above(centre + rim_offset(below, k));
            // On the end above, not on its outline, which is there already.
            let from = rim - end;
            if from.norm() < above.radius - 1e-9 * self.smaller {
                add(rim, feature_above, CYLINDER_RIM + k);
            }
        }
        let angle = (1.0 - tilt * tilt).max(0.0).sqrt();
        // Where outlines cross, seen along n: circles up to half the square of the tilt.
        let between = end - centre - n * n.dot(&(end - centre));
        let distance = between.norm();
        let [r_above, r_below] = [above.radius, below.radius];
        let cross =
            distance > 1e-9 * self.smaller && distance < r_above + r_below && distance > (r_above - r_below).abs();
        if cross && angle < MAX_AREA_TILT {
            let along = (distance * distance + r_below * r_below - r_above * r_above) / (2.0 * distance);
            let across = (r_below * r_below - along * along).max(0.0).sqrt();
            let (out, side) = (between / distance, n.cross(&between) / distance);
            for (k, sign) in [(0, -1.0), (1, 1.0)] {
                let crossing = on_end_above(centre + out * along + side * (sign * across));
                add(crossing, CYLINDER_RIM + 5 + k, CYLINDER_RIM + 5);
            }
        }
        let share = if area_within == f64::INFINITY { 1.0 } else { (1.0 - (angle / MAX_AREA_TILT).powi(2)).max(0.0) };
        patch.area = share * common_disc_area(distance, r_above, r_below);
    }

    /// Corners of two sides that are nearly parallel, seen along the direction: the ends of their common line.
    fn collect_along_sides(&self, axis: &MeetingAxis, patch: &mut ContactPatch) {
        let (m, u, w) = (&axis.m, self.a.axis(), self.b.axis());
        let along = (u - m * m.dot(&u)).normalize();
        let opposite = 1f64.copysign(w.dot(&u));
        let skew = along.cross(&w).dot(m).abs();
        // Heights along A's axis.
        let (middle, reach) = (along.dot(&self.b.centre), self.b.half_height * w.dot(&along).abs());
        let smaller_radius = (self.a.radius + self.a.rounding).min(self.b.radius + self.b.rounding);
        let (from, to) = ((middle - reach).max(-self.a.half_height), (middle + reach).min(self.a.half_height));
        if from > to || (to - from).max(self.smaller) * skew > MAX_SIDE_SKEW * smaller_radius {
            return;
        }
        for (k, z) in [from, to].into_iter().enumerate() {
            let on_a = u * z - m * self.a.radius;
            let on_b = self.b.centre + w * (opposite * (z - middle)) + m * self.b.radius;
            let gap = m.dot(&(on_a - on_b));
            let point = (on_a - m * (0.5 * gap)).into();
            let features = (CYLINDER_SIDE, CYLINDER_RIM + k as u32);
            patch.corners.push(PatchCorner { point, flat: [z, 0.0], gap, features });
        }
    }

    /// Contact point of the direction's own features.
    fn axis_point(&self, axis: &MeetingAxis) -> ContactPoint {
        let MeetingAxis { m, s, .. } = axis;
        let rim = |of: &PosedCylinder, m: &Vec3| of.end_centre(m) + of.radial_direction(m) * of.radius;
        let (on_a, on_b) = (rim(&self.a, &-m) - m * (0.5 * s), rim(&self.b, m) + m * (0.5 * s));
        let (position, features) = match axis.meeting {
            CylinderMeeting::EndOfA => (on_b, (self.a.end_feature(&-m), CYLINDER_RIM)),
            CylinderMeeting::EndOfB => (on_a, (CYLINDER_RIM, self.b.end_feature(m))),
            CylinderMeeting::SideOfA => (on_b, (CYLINDER_SIDE, CYLINDER_RIM)),
            CylinderMeeting::SideOfB => (on_a, (CYLINDER_RIM, CYLINDER_SIDE)),
            CylinderMeeting::Rims => ((on_a + on_b) * 0.5, (CYLINDER_RIM, CYLINDER_RIM)),
            CylinderMeeting::Sides => {
                // The point of A's axis nearest to B's axis, seen along m.
                let (u, w) = (self.a.axis(), self.b.axis());
                let across = w.cross(m);
                let z = self.b.centre.dot(&across) / u.dot(&across);
                let z = if z.is_finite() { z.clamp(-self.a.half_height, self.a.half_height) } else { 0.0 };
                (u * z - m * (self.a.radius + 0.5 * s), (CYLINDER_SIDE, CYLINDER_SIDE))
            }
        };
        ContactPoint { position, gap: *s, features }
    }
}

/// Directions perpendicular to the axis of `side` in which the separation from the rims of `rim` is largest: one for each end
/// of `rim`. `d`: x_A - x_B, m.
fn rim_to_side(side: &PosedCylinder, rim: &PosedCylinder, d: &Vec3) -> [Option<Vec3>; 2] {
    let (u, w) = (side.axis(), rim.axis());
    // On m = x e + y f the rim is a x + b y - R sqrt(x² + k² y²) with k = |u·w|, e across both axes.
    let Some(f) = (w - u * u.dot(&w)).try_normalize(1e-9) else { return [None; 2] };
    let e = f.cross(&u);
    let (a, k) = (d.dot(&e), u.dot(&w).abs().min(1.0));
    [1.0, -1.0].map(|sign| {
        let b = sign * d.dot(&f) - rim.half_height * w.dot(&f);
        let (x, y) = rim_maximum(a.abs(), b, rim.radius, k)?;
        (e * x.copysign(a) + f * (sign * y)).try_normalize(0.0)
    })
}

/// Direction next to the normal `n` of an end in which f = m·`centre_offset` - Σ R |m x u| is larger than along `n`; `None` if f is
/// largest along `n` itself.
///
/// * `discs`: axes u and radii R (m) of the two rims.
/// * `is_higher`: whether f along a direction exceeds f along `n`.
fn off_corner(
    n: &Vec3,
    centre_offset: &Vec3,
    discs: &[(Vec3, f64); 2],
    is_higher: impl Fn(&Vec3) -> bool,
) -> Option<Vec3> {
    // Rims about n lower f by their radius times the angle off n in all directions; the rest of f has a slope.
    let (mut slope, mut radius) = (*centre_offset, 0.0);
    for (u, r) in discs {
        match (n - u * u.dot(n)).try_normalize(1e-9) {
            Some(out) => slope -= out * *r,
            None => radius += r,
        }
    }
    let across = slope - n * n.dot(&slope);
    let rise = across.norm();
    if rise <= radius {
        return None;
    }
    (1..MAX_HALVINGS).map(|k| (n + across * (0.5f64.powi(k) / rise)).normalize()).find(is_higher)
}

/// Area of the common part of two discs whose centres are `distance` apart, m².
fn common_disc_area(distance: f64, r: f64, s: f64) -> f64 {
    if distance >= r + s {
        return 0.0;
    }
    if distance <= (r - s).abs() {
        return std::f64::consts::PI * r.min(s).powi(2);
    }
    let segment = |own: f64, other: f64| {
        let cos = ((distance * distance + own * own - other * other) / (2.0 * distance * own)).clamp(-1.0, 1.0);
        own * own * (libm::acos(cos) - cos * (1.0 - cos * cos).sqrt())
    };
    segment(r, s) + segment(s, r)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Separation along a direction.
    fn separation(a: &Quat, [h, r]: [f64; 2], c: &Vec3, b: &Quat, [k, s]: [f64; 2], m: &Vec3) -> f64 {
        let reach = |q: &Quat, h: f64, r: f64| {
            let local = q.inverse_transform_vector(m);
            h * local.z.abs() + r * local.xy().norm()
        };
        -m.dot(c) - reach(a, h, r) - reach(b, k, s)
    }

    proptest! {
        /// No direction separates the two by more than the one that is found, if they are apart; the contact point is in the
        /// middle between them.
        #[test]
        fn no_direction_is_better(
            turns in prop::array::uniform2(prop::array::uniform3(-3.0..3.0f64)),
            sizes in prop::array::uniform2(prop::array::uniform2(0.2..2.0f64)),
            away in prop::array::uniform3(-5.0..5.0f64),
            tried in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 200),
        ) {
            let [a, b] = turns.map(|turn| Quat::from_scaled_axis(Vec3::from(turn)));
            let c = Vec3::from(away);
            let Some(found) = cylinder_cylinder(&a, sizes[0], &c, &b, sizes[1], 100.0) else { return Ok(()) };
            let m = found.normal;
            let s = separation(&a, sizes[0], &c, &b, sizes[1], &m);
            prop_assert!((m.norm() - 1.0).abs() < 1e-12 && (found.gap() - s).abs() < 1e-9, "{found:?} {s}");
            if s <= 0.0 {
                return Ok(());
            }
            // Steps of all sizes from the direction that was found.
            for (k, step) in tried.iter().enumerate() {
                let other = (m + Vec3::from(*step) * 10f64.powi(-(k as i32 % 8))).normalize();
                let better = separation(&a, sizes[0], &c, &b, sizes[1], &other);
                prop_assert!(better <= s + 1e-9, "{better} {s} {found:?}");
            }
            for point in &found.points {
                let inside = |q: &Quat, from: Vec3, [h, r]: [f64; 2]| {
                    let local = q.inverse_transform_vector(&from);
                    (local.z.abs() - h).max(local.xy().norm() - r)
                };
                // Half of its gap away from each of the two; half the square of the tilt of ends is neglected.
                let most = 0.5 * point.gap + 5e-3 * sizes[0][1].max(sizes[1][1]);
                let (of_a, of_b) = (inside(&a, point.position, sizes[0]), inside(&b, point.position - c, sizes[1]));
                prop_assert!(of_a <= most && of_b <= most, "{point:?} {of_a} {of_b}");
            }
        }
    }

    #[test]
    fn axes_in_one_plane() {
        // Half height and radius 1 and 0.5, tilted by 45 degrees: its rim is nearest to the side at the height of this rim.
        let tilted = Quat::from_scaled_axis(Vec3::y() * std::f64::consts::FRAC_PI_4);
        let c = Vec3::new(2.0, 0.0, 0.25);
        let rim = c + Vec3::new(-1.5, 0.0, -0.5) * std::f64::consts::FRAC_1_SQRT_2;
        let found = cylinder_cylinder(&Quat::identity(), [2.0, 0.5], &c, &tilted, [1.0, 0.5], 1.0).unwrap();
        let gap = rim.x - 0.5;
        assert!((found.normal + Vec3::x()).norm() < 1e-15 && (found.gap() - gap).abs() < 1e-15, "{found:?}");
        assert_eq!(found.points.len(), 1);
        let middle = Vec3::new(0.5 + 0.5 * gap, 0.0, rim.z);
        assert!((Vec3::from(found.points[0].position) - middle).norm() < 1e-15, "{found:?} {middle:?}");
    }

    #[test]
    fn crossed_cylinders_touch_in_one_point() {
        let across = Quat::from_scaled_axis(Vec3::y() * std::f64::consts::FRAC_PI_2);
        let found =
            cylinder_cylinder(&across, [2.0, 0.5], &Vec3::new(0.5, 1.25, 0.25), &Quat::identity(), [2.0, 0.5], 0.5);
        let found = found.unwrap();
        // A few roundings of numbers near 1.
        assert!((found.normal + Vec3::y()).norm() < 1e-15 && (found.gap() - 0.25).abs() < 1e-15, "{found:?}");
        assert_eq!(found.points.len(), 1);
        assert!((found.points[0].position - Vec3::new(0.5, 0.625, 0.0)).norm() < 1e-15, "{found:?}");
    }

    #[test]
    fn ends_meet_in_the_common_part() {
        let q = Quat::identity();
        // Centres 1 apart, radii 1: the lens has the area 2π/3 - √3/2.
        let found = cylinder_cylinder(&q, [1.0, 1.0], &Vec3::new(1.0, 0.0, -2.0), &q, [1.0, 1.0], 0.5).unwrap();
        assert!((found.area - (2.0 * std::f64::consts::PI / 3.0 - 0.75f64.sqrt())).abs() < 1e-14, "{found:?}");
        assert!(found.points.iter().all(|point| point.gap == 0.0 && point.position.z == -1.0), "{found:?}");
        let extent = |k: usize| {
            found
                .points
                .iter()
                .map(|point| point.position[k])
                .fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(x), b.max(x)))
        };
        assert!((extent(0).0 - 0.0).abs() < 1e-12 && (extent(0).1 - 1.0).abs() < 1e-12, "{found:?}");
        assert!((extent(1).1 - 0.75f64.sqrt()).abs() < 1e-12, "{found:?}");
        // One that lies on the end of another touches along a line of the length of the disc.
        let lying = Quat::from_scaled_axis(Vec3::y() * std::f64::consts::FRAC_PI_2);
        let found = cylinder_cylinder(&lying, [4.0, 1.0], &Vec3::new(0.0, 0.0, -2.0), &q, [1.0, 1.0], 0.5).unwrap();
        assert_eq!((found.points.len(), found.normal), (2, Vec3::z()));
        assert!(found.points.iter().all(|point| (point.position.x.abs() - 1.0).abs() < 1e-12), "{found:?}");
    }
}
