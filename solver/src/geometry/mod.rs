//! Bench: contact geometry of convex polyhedra - with each other, with spheres, plates and cylinders.
//!
//! All lengths are relative to the centre of body A, so that precision does not depend on the distance from the origin:
//! `c` is x_B - x_A. Normals point from B, the antagonist, to A, the candidate.
//!
//! | file | what |
//! |---|---|
//! | [`polyhedron`] | the shape: polygon faces, edges, neighbours; turned as its body is |
//! | [`search`] | the direction in which two polyhedra are farthest apart, or least overlap |
//! | [`gjk`] | distance and direction where vertices or edges are nearest to each other |
//! | [`patch`] | the common part of two faces seen along the normal: points of contact and area |

mod gjk;
mod patch;
mod polyhedron;
mod search;

pub use polyhedron::{Polyhedron, Posed};

use crate::math::Vec3;
use search::{Axis, Pair};

/// A point of contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Middle of the gap, relative to the centre of body A, m.
    pub position: Vec3,
    /// Along the normal, m, < 0 overlapping.
    pub gap: f64,
    /// What of A and of B is there, see [`vertex`], [`edge`], [`face`]; unique within a pair.
    pub features: (u32, u32),
}

/// Kind and number of a vertex as one number.
pub const fn vertex(k: u32) -> u32 {
    k
}

/// Kind and number of an edge as one number.
pub const fn edge(k: u32) -> u32 {
    1 << 30 | k
}

/// Kind and number of a face as one number.
pub const fn face(k: u32) -> u32 {
    2 << 30 | k
}

/// One to four points; reads as a slice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Points {
    count: usize,
    points: [Point; 4],
}

impl std::ops::Deref for Points {
    type Target = [Point];

    fn deref(&self) -> &[Point] {
        &self.points[..self.count]
    }
}

impl FromIterator<Point> for Points {
    /// The first four.
    fn from_iter<I: IntoIterator<Item = Point>>(from: I) -> Self {
        let none = Point { position: Vec3::zeros(), gap: 0.0, features: (0, 0) };
        let mut points = Points { count: 0, points: [none; 4] };
        for point in from.into_iter().take(4) {
            points.points[points.count] = point;
            points.count += 1;
        }
        points
    }
}

/// The contact of two bodies: one normal, one to four points.
///
/// One point where a vertex or crossed edges meet, two where an edge lies on a face, more where faces meet; of more
/// than four, those that keep the deepest and most of the area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Manifold {
    /// Unit, from B (antagonist) to A (candidate).
    pub normal: Vec3,
    /// With gaps up to the alert distance, in the order of their features.
    pub points: Points,
    /// Of the two faces' overlap seen along the normal, m^2; 0 where vertices or edges are nearest.
    pub area: f64,
}

impl Manifold {
    /// The least gap, m.
    pub fn gap(&self) -> f64 {
        self.points.iter().map(|point| point.gap).fold(f64::INFINITY, f64::min)
    }
}

/// What is kept of a pair from one step to the next.
///
/// In [`Narrow::Accurate`] it saves time, and decides between directions that are equal to 1e-11 of the size; in
/// [`Narrow::Fast`] the search begins and mostly ends there. A restart that is to go on bit for bit needs it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Memory {
    kind: u32,
    data: [u32; 3],
}

impl Memory {
    /// For a snapshot.
    pub fn words(&self) -> [u64; 2] {
        let [a, b, c] = self.data.map(u64::from);
        [u64::from(self.kind) << 32 | a, b << 32 | c]
    }

    /// From a snapshot; any words are safe.
    pub fn from_words([first, second]: [u64; 2]) -> Self {
        Memory { kind: (first >> 32) as u32, data: [first as u32, (second >> 32) as u32, second as u32] }
    }
}

/// How the direction of a contact is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Narrow {
    /// The remembered feature, followed to its best neighbour: no proof that there is no better one elsewhere.
    Fast,
    /// With a proof that it is the best of all, or a search of all.
    Accurate,
}

/// Polyhedron A against polyhedron B at `c` = x_B - x_A, m; `None` where they are more than `alert` (m) apart.
///
/// The normal is the direction of least distance, or of the least translation that parts what overlaps. Where vertices
/// or edges meet in a point and overlap by nothing, or where several directions are equal to 1e-11 of the size, it is a
/// definite one of those. Source: see the section on polyhedra in docs/method.md.
pub fn polyhedron_polyhedron(
    a: (&Polyhedron, &Posed),
    b: (&Polyhedron, &Posed),
    c: &Vec3,
    alert: f64,
    narrow: Narrow,
    memory: &mut Memory,
) -> Option<Manifold> {
    let pair = Pair::new(a, b, *c);
    let _ = (narrow, &memory);
    let axis = search::all(&pair, alert);
    if axis.s > alert {
        return None;
    }
    manifold(&pair, &axis, alert)
}

/// Points of contact along an axis; by the nearest points where the patch of the axis's faces has none at the gap.
fn manifold(pair: &Pair, axis: &Axis, alert: f64) -> Option<Manifold> {
    let (face_a, face_b) = search::support_faces(pair, axis);
    let patch = patch::Patch::new(pair, &axis.n, face_a, face_b);
    if patch.holds(axis.s, pair) {
        return patch.manifold(pair, alert);
    }
    if axis.s > 0.0 {
        return gjk::nearest(pair, axis.n, alert);
    }
    // Not at a proven least overlap: the axis's own features are one point of it.
    let points = search::own_point(pair, axis).into_iter().collect();
    Some(Manifold { normal: -axis.n, points, area: patch.area })
}
