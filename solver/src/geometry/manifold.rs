//! Contacts of two bodies, and the gaps up to which they are listed.

use smallvec::SmallVec;

use crate::math::Vec3;

/// Contact point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactPoint {
    /// Middle of the gap, relative to the centre of body A, m.
    pub position: Vec3,
    /// Gap along the normal, m, < 0 overlapping.
    pub gap: f64,
    /// Touching features of A and of B, see [`vertex_feature`], [`edge_feature`], [`face_feature`]; unique within a pair.
    pub features: (u32, u32),
}

/// Kind and number of a vertex as one number.
pub const fn vertex_feature(k: u32) -> u32 {
    k
}

/// Kind and number of an edge as one number.
pub const fn edge_feature(k: u32) -> u32 {
    1 << 30 | k
}

/// Kind and number of a face as one number.
pub const fn face_feature(k: u32) -> u32 {
    2 << 30 | k
}

/// Contact points, at least one.
pub type ContactPoints = SmallVec<[ContactPoint; 6]>;

/// Contact of two bodies: one normal, and points.
///
/// One point where a vertex or crossed edges touch, two where an edge lies on a face, more where faces touch: the corners
/// of their common part.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Manifold {
    /// Unit normal from B (antagonist) to A (candidate).
    pub normal: Vec3,
    /// Points with gaps up to the alert distance, ordered by their features.
    pub points: ContactPoints,
    /// Area of the two faces' overlap seen along the normal, where its gap is within [`ListingRange::area`], m^2; 0 if
    /// the nearest features are vertices or edges.
    pub area: f64,
}

impl Manifold {
    /// Returns the smallest gap, m.
    pub fn gap(&self) -> f64 {
        self.points.iter().map(|point| point.gap).fold(f64::INFINITY, f64::min)
    }
}

/// Manifold of body A and body B with the sides exchanged, so that B is the candidate; `c` = x_A - x_B, m.
pub fn swapped_manifold(found: &Manifold, c: &Vec3) -> Manifold {
    let swapped_point = |point: &ContactPoint| ContactPoint {
        position: point.position + c,
        gap: point.gap,
        features: (point.features.1, point.features.0),
    };
    Manifold { normal: -found.normal, points: found.points.iter().map(swapped_point).collect(), area: found.area }
}

/// Gaps up to which points and areas are listed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ListingRange {
    /// Largest gap of a listed contact point, m.
    pub alert: f64,
    /// Largest gap of a pair for which all points are listed, m; of a pair farther apart only the nearest point is.
    pub patch: f64,
    /// Largest gap of edges and vertices for which all points of the faces are listed, m: > 0 for laws that act on bodies
    /// that are apart, since the joint between such bodies may be a wedge.
    pub joint: f64,
    /// Largest gap of the part of a patch that counts for its area, m: the range of a cohesion that is a stress.
    pub area: f64,
}

impl ListingRange {
    /// Range of the cores of bodies whose surfaces are at the distance `rounding`, m, in sum, from these cores.
    pub fn widened_by(self, rounding: f64) -> Self {
        let ListingRange { alert, patch, joint, area } = self;
        ListingRange {
            alert: alert + rounding,
            patch: patch + rounding,
            joint: joint + rounding,
            area: area + rounding,
        }
    }
}

impl From<f64> for ListingRange {
    /// Range that lists all points up to `alert` and the area of the whole patch.
    fn from(alert: f64) -> Self {
        ListingRange { alert, patch: f64::INFINITY, joint: 0.0, area: f64::INFINITY }
    }
}

/// Search method for the direction of a contact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NarrowPhaseMode {
    /// Follows the cached feature to its best neighbour, without a proof that no better direction exists elsewhere.
    Fast,
    /// Proves that the direction is the best of all, or searches all.
    Accurate,
}

/// Contacts of a body with a triangulated wall, or a lower bound of their gap.
#[derive(Debug, Clone, PartialEq)]
pub enum WallContacts<C> {
    /// Contacts up to the range; a body behind a surface with one side may be near without any.
    Listed(SmallVec<[C; 2]>),
    /// Lower bound of the gap, m, more than the range.
    Apart { min_gap: f64 },
}

impl<C> WallContacts<C> {
    /// Result for a body without contacts; `min_gap`: a lower bound of the gap, m.
    pub fn without_contacts(min_gap: f64, range: f64) -> Self {
        if min_gap > range { WallContacts::Apart { min_gap } } else { WallContacts::Listed(SmallVec::new()) }
    }

    /// Returns the contacts up to the range.
    pub fn into_contacts(self) -> SmallVec<[C; 2]> {
        match self {
            WallContacts::Listed(contacts) => contacts,
            WallContacts::Apart { .. } => SmallVec::new(),
        }
    }
}

/// Direction along which two bodies are farther apart than the requested range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Separated {
    /// Unit direction from A to B.
    pub n: Vec3,
    /// Lower bound of their distance, m.
    pub s: f64,
}
