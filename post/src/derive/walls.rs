//! Walls that bound grains, and the grains that walls support.

use crate::derive::fragments::Fragment;
use crate::frame::{Frame, GrainId, Wall, WallId, WallShape};
use crate::math::{Mat3, Vec3};

/// The grains of all groups that a wall touches with force.
pub fn supported_grains(frame: &Frame, fragments: &[Fragment]) -> Vec<GrainId> {
    let mut touched = vec![false; frame.grains.len()];
    let walls = frame.active_contacts().filter(|contact| contact.grain_pair().is_none());
    walls.flat_map(|contact| contact.on_grains()).for_each(|(i, _, _)| touched[i.index()] = true);
    let borne = fragments.iter().filter(|fragment| fragment.grains.iter().any(|&i| touched[i.index()]));
    let mut grains: Vec<GrainId> = borne.flat_map(|fragment| fragment.grains.iter().copied()).collect();
    grains.sort_unstable();
    grains
}

/// Face of a wall: n.x >= place for the centres of nearly all grains.
pub struct WallFace {
    pub wall: WallId,
    pub normal: Vec3,
    pub place: f64,
}

impl WallFace {
    /// Whether a point (m) is on the side of the grains.
    pub fn is_before(&self, x: &Vec3) -> bool {
        x.dot(&self.normal) >= self.place
    }
}

/// Share of the grains that may be beyond a wall that bounds the others: a few grains that have left a box do not open it.
const MAX_ESCAPED_SHARE: f64 = 0.02;

fn nearly_all(frame: &Frame, grains: &[GrainId], inside: impl Fn(&Vec3) -> bool) -> bool {
    let beyond = grains.iter().filter(|&&i| !inside(&frame.grains[i].x)).count();
    beyond as f64 <= MAX_ESCAPED_SHARE * grains.len() as f64
}

/// Faces of a wall that have the centres of nearly all `grains` before them. A plate has any such face. A convex polyhedron
/// has, of the faces that cover half of the grains' section or more, the one that is farthest from the nearest of these
/// centres. A hollow cylinder around these centres has both ends.
pub fn bounding_faces(frame: &Frame, wall: WallId, grains: &[GrainId]) -> Vec<WallFace> {
    let (x, rotation) = (frame.walls[wall].x, frame.walls[wall].rotation);
    let before = |face: &WallFace| nearly_all(frame, grains, |x| face.is_before(x));
    match &frame.walls[wall].shape {
        WallShape::Plate(half) => {
            let face = |(axis, sign): (usize, f64)| {
                let normal = rotation * Vec3::ith(axis, sign);
                WallFace { wall, normal, place: normal.dot(&x) + half[axis] }
            };
            (0..3).flat_map(|axis| [(axis, 1.0), (axis, -1.0)]).map(face).filter(before).collect()
        }
        WallShape::Polyhedron(solid) if solid.hollow.is_none() => {
            let reach = solid.bounding_radius();
            let centre = grains.iter().map(|&i| frame.grains[i].x).sum::<Vec3>() / grains.len() as f64;
            let offset = |i: &GrainId| frame.grains[*i].x - centre;
            let spread = grains.iter().map(|i| offset(i) * offset(i).transpose()).sum::<Mat3>() / grains.len() as f64;
            let covers = |corners: &[u32], normal: &Vec3| {
                let at = |k: usize| solid.vertices[corners[k] as usize];
                let twice = (2..corners.len()).map(|k| (at(k - 1) - at(0)).cross(&(at(k) - at(0))));
                // The variances of an even section of sides a and b are a^2 / 12 and b^2 / 12; those of grains in a plane
                // are zero.
                let cofactor =
                    spread.determinant() * spread.try_inverse().map_or(f64::NAN, |i| normal.dot(&(i * normal)));
                0.5 * twice.sum::<Vec3>().norm() >= 0.5 * 12.0 * cofactor.max(0.0).sqrt()
            };
            let face = |corners: &Vec<u32>| {
                let [a, b, c] = [0, 1, 2].map(|k| solid.vertices[corners[k] as usize]);
                let normal = (b - a).cross(&(c - b)).try_normalize(0.0)?;
                // Faces of a body that is not convex bound nothing.
                let supports = solid.vertices.iter().all(|v| (v - a).dot(&normal) <= 1e-9 * reach);
                let normal = supports.then(|| rotation * normal).filter(|normal| covers(corners, normal))?;
                Some(WallFace { wall, normal, place: normal.dot(&(x + rotation * a)) })
            };
            let clearance = |face: &WallFace| {
                let distances = grains.iter().map(|&i| frame.grains[i].x.dot(&face.normal) - face.place);
                distances.filter(|d| *d >= 0.0).fold(f64::INFINITY, f64::min)
            };
            let faces = solid.faces.iter().filter_map(face).filter(before);
            faces.max_by(|a, b| clearance(a).total_cmp(&clearance(b))).into_iter().collect()
        }
        _ => bounding_bore(frame, wall, grains).map_or(Vec::new(), |bore| bore.ends(wall).into()),
    }
}

/// Hollow cylinder around nearly all centres; its ends are faces.
pub struct CylinderBore {
    pub x: Vec3,
    pub axis: Vec3,
    pub radius: f64,
    /// Distance of both ends from x along the axis, m.
    half_height: f64,
}

impl CylinderBore {
    /// Whether a point (m) is within the radius, at any height.
    pub fn contains_point(&self, x: &Vec3) -> bool {
        (x - self.x).cross(&self.axis).norm() <= self.radius
    }

    /// Shortest vector from the axis to a point, m.
    pub fn offset_from_axis(&self, x: &Vec3) -> Vec3 {
        let offset = x - self.x;
        offset - self.axis * offset.dot(&self.axis)
    }

    /// Flat ends, seen from inside.
    pub fn ends(&self, wall: WallId) -> [WallFace; 2] {
        [self.axis, -self.axis].map(|normal| WallFace { wall, normal, place: normal.dot(&self.x) - self.half_height })
    }
}

/// Returns the inside of a hollow cylinder that has nearly all centres between its ends and within its radius.
pub fn bounding_bore(frame: &Frame, wall: WallId, grains: &[GrainId]) -> Option<CylinderBore> {
    let WallShape::Polyhedron(solid) = &frame.walls[wall].shape else { return None };
    let hollow = solid.hollow?;
    let Wall { x, rotation, .. } = frame.walls[wall];
    let bore = CylinderBore { x, axis: rotation * Vec3::z(), radius: hollow.radius, half_height: hollow.half_height };
    let ends = bore.ends(wall);
    nearly_all(frame, grains, |x| bore.contains_point(x) && ends.iter().all(|end| end.is_before(x))).then_some(bore)
}
