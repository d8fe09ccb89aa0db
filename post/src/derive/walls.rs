//! Walls that bound grains, and the grains that walls support.

use cd_formats::faces::doubled_area;

use crate::derive::fragments::Fragment;
use crate::frame::{Frame, GrainId, Wall, WallId, WallShape};
use crate::math::{Mat3, Vec3};

/// Grains of all fragments that a wall touches with force.
pub fn supported_grains(frame: &Frame, fragments: &[Fragment]) -> Vec<GrainId> {
    let mut touched = vec![false; frame.grains.len()];
    let walls = frame.active_contacts().filter(|contact| contact.grain_pair().is_none());
    walls.flat_map(|contact| contact.on_grains()).for_each(|(i, _, _)| touched[i.index()] = true);
    let supported = fragments.iter().filter(|fragment| fragment.grains.iter().any(|&i| touched[i.index()]));
    let mut grains: Vec<GrainId> = supported.flat_map(|fragment| fragment.grains.iter().copied()).collect();
    grains.sort_unstable();
    grains
}

/// Face of a wall, finite.
#[derive(Debug, Clone, PartialEq)]
pub struct WallFace {
    pub wall: WallId,
    /// Corners of a convex polygon in turn, m.
    corners: Vec<Vec3>,
}

/// Plane of the faces of one or more walls that lie flush: n.x >= offset for the centres of nearly all grains.
#[derive(Debug, Clone, PartialEq)]
pub struct WallPlane {
    /// Unit vector n towards the grains.
    pub normal: Vec3,
    /// Offset of the plane along n, m.
    pub offset: f64,
    pub faces: Vec<WallFace>,
}

impl WallPlane {
    /// Whether a point (m) is on the inner side of the plane, where the grains are.
    pub fn is_on_inner_side(&self, x: &Vec3) -> bool {
        x.dot(&self.normal) >= self.offset
    }

    /// Whether a point of the plane lies in one of the faces, or within `margin` (m) of it.
    fn covers(&self, x: &Vec3, margin: f64) -> bool {
        self.faces.iter().any(|face| {
            let edges = face.corners.iter().zip(face.corners.iter().cycle().skip(1));
            // Seen against the normal, corners are counter-clockwise; an edge has its outside on the right.
            edges.into_iter().all(|(p, q)| {
                let edge = q - p;
                edge.cross(&self.normal).dot(&(x - p)) <= margin * edge.norm()
            })
        })
    }

    /// Share of a convex polygon in the plane that the faces cover, each with a margin (m) around it; flush faces that
    /// overlap count once. Points of a lattice in the polygon are counted, so the error is some hundredths. 1 for a polygon
    /// without such a point, a sliver.
    pub fn covered_share(&self, polygon: &[Vec3], margin: f64) -> f64 {
        let first = self.normal.cross(&Vec3::ith(self.normal.iamin(), 1.0)).normalize();
        let axes = [first, self.normal.cross(&first)];
        let [(from, to), (left, right)] = axes.map(|axis| {
            let along = polygon.iter().map(|p| p.dot(&axis));
            along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
        });
        // Corners that are one but for rounding make an edge of any direction.
        let mut corners = counter_clockwise(polygon.to_vec(), &self.normal);
        let rounding = 1e-9 * f64::max(to - from, right - left);
        corners.dedup_by(|p, q| (*p - *q).norm() <= rounding);
        let face = WallFace { wall: WallId::new(0), corners };
        let outline = WallPlane { normal: self.normal, offset: self.offset, faces: vec![face] };
        let (mut all, mut covered) = (0.0, 0.0);
        for k in 0..COVER_POINTS * COVER_POINTS {
            let [u, v] = [k % COVER_POINTS, k / COVER_POINTS].map(|i| (i as f64 + 0.5) / COVER_POINTS as f64);
            let x =
                axes[0] * (from + u * (to - from)) + axes[1] * (left + v * (right - left)) + self.normal * self.offset;
            if outline.covers(&x, 0.0) {
                all += 1.0;
                covered += f64::from(u8::from(self.covers(&x, margin)));
            }
        }
        if all > 0.0 { covered / all } else { 1.0 }
    }
}

/// Points along each axis of the lattice of [`WallPlane::covered_share`].
const COVER_POINTS: usize = 24;

/// Largest sine of the angle between faces that lie flush: a few roundings of an orientation from a file.
const FLUSH_ANGLE: f64 = 1e-6;

/// Largest distance between faces that lie flush, in mean radii of the grains: positions in a file have eight digits, and a
/// step of this height changes no mean noticeably.
const FLUSH_STEP: f64 = 0.01;

/// Returns the corners of a polygon in the order that is counter-clockwise if seen against `normal`.
fn counter_clockwise(mut corners: Vec<Vec3>, normal: &Vec3) -> Vec<Vec3> {
    if doubled_area(&corners).dot(normal) < 0.0 {
        corners.reverse();
    }
    corners
}

/// Share of the grains that may be beyond a wall that bounds the others: a few grains that have left a box do not open it.
const MAX_ESCAPED_SHARE: f64 = 0.02;

/// Whether all grains but [`MAX_ESCAPED_SHARE`] of them have their centres inside.
fn nearly_all(frame: &Frame, grains: &[GrainId], is_inside: impl Fn(&Vec3) -> bool) -> bool {
    let beyond = grains.iter().filter(|&&i| !is_inside(&frame.grains[i].x)).count();
    beyond as f64 <= MAX_ESCAPED_SHARE * grains.len() as f64
}

/// Planes of the wall faces with nearly all centres of `grains` on one side, the inner side: faces of plates, faces of
/// polyhedra beyond which the wall does not extend, with normals out of the wall, and the two ends of hollow cylinders
/// around the grains.
///
/// Faces that lie flush make one plane, so it does not matter in how many parts a wall is given. Planes whose faces
/// together are smaller than half of the grains' section are left out, as they cannot bound the grains. Whether a plane bounds
/// a space depends on where its faces are, see [`WallPlane::covered_share`].
pub fn bounding_planes(frame: &Frame, grains: &[GrainId]) -> Vec<WallPlane> {
    let count = grains.len() as f64;
    let centre = grains.iter().map(|&i| frame.grains[i].x).sum::<Vec3>() / count;
    let mean_radius = grains.iter().map(|&i| frame.grains[i].radius).sum::<f64>() / count;
    let mut faces: Vec<(Vec3, f64, WallFace)> = Vec::new();
    for wall in frame.wall_ids() {
        faces.extend(wall_faces(frame, wall, grains).into_iter().filter_map(|(normal, corners)| {
            // Positions are relative to the middle of the grains, whose distance from the origin may be large.
            let offset = corners.iter().map(|p| (p - centre).dot(&normal)).fold(f64::NEG_INFINITY, f64::max);
            let corners = counter_clockwise(corners, &normal);
            nearly_all(frame, grains, |x| (x - centre).dot(&normal) >= offset).then_some((
                normal,
                offset,
                WallFace { wall, corners },
            ))
        }));
    }
    faces.sort_by(|a, b| a.0.x.total_cmp(&b.0.x));
    let mut planes: Vec<WallPlane> = Vec::new();
    for (normal, offset, face) in faces {
        let near = planes.iter_mut().rev().take_while(|plane| normal.x - plane.normal.x <= FLUSH_ANGLE);
        let is_flush = |plane: &&mut WallPlane| {
            (plane.normal - normal).norm() <= FLUSH_ANGLE && (plane.offset - offset).abs() <= FLUSH_STEP * mean_radius
        };
        match near.into_iter().find(is_flush) {
            Some(plane) => {
                plane.offset = plane.offset.max(offset);
                plane.faces.push(face);
            }
            None => planes.push(WallPlane { normal, offset, faces: vec![face] }),
        }
    }
    let section = GrainSection::new(frame, grains, &centre);
    let area = |plane: &WallPlane| plane.faces.iter().map(|face| 0.5 * doubled_area(&face.corners).norm()).sum::<f64>();
    planes.retain(|plane| area(plane) >= 0.5 * section.area_across(&plane.normal));
    planes.iter_mut().for_each(|plane| plane.offset += plane.normal.dot(&centre));
    planes.sort_by(|a, b| a.faces[0].wall.cmp(&b.faces[0].wall).then(a.offset.total_cmp(&b.offset)));
    planes
}

/// Normals and corners of the faces of a wall that face outwards, or inwards at the ends of a hollow cylinder around nearly
/// all centres of `grains`.
fn wall_faces(frame: &Frame, wall: WallId, grains: &[GrainId]) -> Vec<(Vec3, Vec<Vec3>)> {
    let (x, rotation) = (frame.walls[wall].x, frame.walls[wall].rotation);
    match &frame.walls[wall].shape {
        WallShape::Plate(half) => {
            let face = |(axis, sign): (usize, f64)| {
                let corner = |[u, v]: [f64; 2]| {
                    let mut corner = Vec3::zeros();
                    let (second, third) = ((axis + 1) % 3, (axis + 2) % 3);
                    (corner[axis], corner[second], corner[third]) =
                        (sign * half[axis], u * half[second], v * half[third]);
                    x + rotation * corner
                };
                let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(corner);
                (rotation * Vec3::ith(axis, sign), corners.to_vec())
            };
            (0..3).flat_map(|axis| [(axis, 1.0), (axis, -1.0)]).map(face).collect()
        }
        // A triangulated wall need not be convex.
        WallShape::Polyhedron(solid) if solid.is_mesh => Vec::new(),
        WallShape::Polyhedron(solid) if solid.hollow.is_none() => {
            let reach = solid.bounding_radius();
            let face = |corners: &Vec<u32>| {
                let corners: Vec<Vec3> = corners.iter().map(|&k| solid.vertices[k as usize]).collect();
                let normal = doubled_area(&corners).try_normalize(0.0)?;
                // A face beyond which the body extends bounds nothing.
                let supports = solid.vertices.iter().all(|v| (v - corners[0]).dot(&normal) <= 1e-9 * reach);
                let corners = corners.iter().map(|v| x + rotation * v).collect();
                supports.then_some((rotation * normal, corners))
            };
            solid.faces.iter().filter_map(face).collect()
        }
        _ => bounding_bore(frame, wall, grains).map_or(Vec::new(), |bore| bore.end_faces().into()),
    }
}

/// Area of the section of some grains across a direction: area of an even filling with the same variances.
struct GrainSection(Mat3);

impl GrainSection {
    fn new(frame: &Frame, grains: &[GrainId], centre: &Vec3) -> GrainSection {
        let grain_section = |i: &GrainId| {
            let (offset, radius) = (frame.grains[*i].x - centre, frame.grains[*i].radius);
            // A ball of radius R has the variance R^2 / 5.
            offset * offset.transpose() + Mat3::identity() * (0.2 * radius * radius)
        };
        GrainSection(grains.iter().map(grain_section).sum::<Mat3>() / grains.len() as f64)
    }

    /// Area of the section across a direction of length 1, m^2. The variances of an even section of sides a and b are
    /// a^2 / 12 and b^2 / 12.
    fn area_across(&self, normal: &Vec3) -> f64 {
        let inverse = self.0.try_inverse();
        let cofactor = self.0.determinant() * inverse.map_or(0.0, |inverse| normal.dot(&(inverse * normal)));
        12.0 * cofactor.max(0.0).sqrt()
    }
}

/// Inside of a hollow cylinder around nearly all centres of grains; its ends are faces of walls.
pub struct CylinderBore {
    /// Centre, m.
    pub x: Vec3,
    /// Direction of the axis, length 1.
    pub axis: Vec3,
    /// Radius, m.
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

    /// Normals of the flat ends seen from inside, and corners of squares around them: what lies beyond the radius is
    /// outside anyway.
    fn end_faces(&self) -> [(Vec3, Vec<Vec3>); 2] {
        let first = self.axis.cross(&Vec3::ith(self.axis.iamin(), 1.0)).normalize() * self.radius;
        let second = self.axis.cross(&first);
        [self.axis, -self.axis].map(|normal| {
            let middle = self.x - normal * self.half_height;
            let corners = [-first - second, first - second, first + second, second - first];
            (normal, corners.map(|corner| middle + corner).to_vec())
        })
    }

    fn contains_between_ends(&self, x: &Vec3) -> bool {
        self.contains_point(x) && (x - self.x).dot(&self.axis).abs() <= self.half_height
    }
}

/// Returns the inside of a hollow cylinder that has nearly all centres between its ends and within its radius.
pub fn bounding_bore(frame: &Frame, wall: WallId, grains: &[GrainId]) -> Option<CylinderBore> {
    let WallShape::Polyhedron(solid) = &frame.walls[wall].shape else { return None };
    let hollow = solid.hollow?;
    let Wall { x, rotation, .. } = frame.walls[wall];
    let bore = CylinderBore { x, axis: rotation * Vec3::z(), radius: hollow.radius, half_height: hollow.half_height };
    nearly_all(frame, grains, |x| bore.contains_between_ends(x)).then_some(bore)
}
