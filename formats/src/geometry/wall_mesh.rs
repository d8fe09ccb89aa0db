//! Triangulated surfaces of walls, contactors MESHx: their checks, the points where balls touch them, and the directions in
//! which other bodies can.
//!
//! A ball touches a surface where the distance of its centre from the surface has a local minimum: at a point of the surface
//! that is the nearest one of every triangle that contains it. An edge or corner is therefore touched only if the surface is
//! convex there; along edges between triangles in one plane, and in concave ones, the faces are touched. A ball on a plane
//! of triangles has one contact, in a groove it has one for each side.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use nalgebra::Vector3;
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::Vector as TreePoint;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy, BvhNode};
use parry3d_f64::query::PointProjection;
use smallvec::SmallVec;

use super::mesh::{PolygonMesh, ReadError, lines};
use super::obj;
use super::surface::{SurfaceFault, SurfaceFaults, element_faults};
use crate::atomic;
use crate::error::{Fault, Faults};
use crate::names::count_text;

type Vec3 = Vector3<f64>;

/// Sides of a triangulated wall that push bodies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum MeshSides {
    /// The side from which triangles are seen counter-clockwise. A ball whose centre is behind the surface is pushed back
    /// through it, if the centre is not deeper than the radius of the ball.
    One,
    /// Both sides: a ball is pushed to the side where its centre is.
    Both,
}

/// Point where a ball touches a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshContact {
    /// Touched feature, see [`feature_of`].
    pub feature: u32,
    /// Point of the surface that is nearest to the centre of the ball, m.
    pub point: Vec3,
    /// Unit normal from the surface to the ball.
    pub normal: Vec3,
    /// Distance of the centre of the ball from the point along the normal, m; negative behind a surface with one side.
    pub distance: f64,
}

/// Largest number of triangles, so that features fit in 32 bits.
pub const MAX_MESH_TRIANGLES: usize = 1 << 28;

/// Feature numbers of a triangle: a face, three edges and three corners, and one that is not used.
const FEATURES_PER_TRIANGLE: u32 = 8;

/// Largest angle between the normals of two contacts of a ball that are one contact, rad. The gap of the contact that is left
/// out is wrong by at most 5e-9 of the radius.
const SAME_NORMAL: f64 = 1e-4;

/// Units of the last digit by which distances from triangles with a common point may differ by rounding. Chosen with a margin:
/// of random points above an edge of two triangles the largest difference is 2 if heights are at least 0.03 of the longest
/// side, and 16 at 0.001 of it.
const ROUNDINGS: f64 = 64.0;

/// Number of a feature of a surface: 8 times the triangle (from 0), plus 0 for its face, 1 to 3 for the edge from its first,
/// second or third corner to the next, 4 to 6 for the corner. An edge or corner has the number of the lowest triangle that has it.
///
/// ```
/// use cd_formats::wall_mesh::{feature_of, triangle_of};
/// assert_eq!((feature_of(5, 2), triangle_of(42)), (42, 5));
/// ```
pub fn feature_of(triangle: u32, region: u32) -> u32 {
    FEATURES_PER_TRIANGLE * triangle + region
}

/// Triangle of a feature, from 0.
pub fn triangle_of(feature: u32) -> u32 {
    feature / FEATURES_PER_TRIANGLE
}

/// Part of a triangle: its inside, an edge without its ends, or a corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TriangleRegion {
    Face,
    /// Edge from the corner with this index to the next.
    Edge(usize),
    Corner(usize),
}

impl TriangleRegion {
    /// Whether a feature is the face of a triangle.
    pub fn is_face_feature(feature: u32) -> bool {
        feature.is_multiple_of(FEATURES_PER_TRIANGLE)
    }
}

/// Largest angle between two triangles at a flush edge, rad: the edge is no feature of their plane. Bodies whose faces
/// cover such an edge may be wrong by 5e-6 of the triangles' size.
const FLUSH_ANGLE: f64 = 1e-5;

/// Cosine between a direction and an edge up to which the direction is perpendicular to the edge: rounding of unit vectors.
const CONE_TOLERANCE: f64 = 1e-12;

/// Triangles near a ball, kept from step to step: they contain all in its reach until it has moved by more than the skin with
/// which they were searched. They affect only time.
#[derive(Debug, Clone, Default)]
pub struct TriangleList {
    /// Centre of the ball when they were searched, m, and the distance from it up to which all are in the list, m.
    centre: Vec3,
    reach: f64,
    /// Numbers of the triangles, ascending.
    numbers: SmallVec<[u32; 12]>,
}

/// Ratio of the skin of a [`TriangleList`] to the radius of its ball: chosen so that a ball that moves by a hundredth of its
/// radius per step is searched in every sixth, and a ball at rest has few triangles more than without it.
const SKIN_PER_RADIUS: f64 = 0.0625;

/// Triangle near a ball.
#[derive(Debug, Clone, Copy)]
struct NearTriangle {
    triangle: u32,
    region: TriangleRegion,
    /// Nearest point, m.
    point: Vec3,
    /// Distance of the nearest point, m.
    distance: f64,
}

/// Triangulated surface of a wall with the tree of its triangles.
#[derive(Clone)]
pub struct WallMesh {
    vertices: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    sides: MeshSides,
    /// Unit normals of the triangles.
    normals: Vec<Vec3>,
    /// Triangles of each vertex, ascending, and where those of each vertex begin.
    fans: Vec<u32>,
    fan_starts: Vec<u32>,
    /// Whether each vertex is on the rim, where an edge belongs to one triangle.
    rim: Vec<bool>,
    /// Bits 0 to 2 of each triangle: whether its edges are flush, see [`WallMesh::is_flush`].
    flush_edges: Vec<u8>,
    /// Whether all edges of each vertex are flush.
    flush_vertices: Vec<bool>,
    /// Largest distance of a vertex from the origin, m.
    radius: f64,
    tree: Bvh,
}

impl fmt::Debug for WallMesh {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "WallMesh({} triangles, {:?})", self.triangles.len(), self.sides)
    }
}

impl PartialEq for WallMesh {
    fn eq(&self, other: &Self) -> bool {
        self.sides == other.sides && self.vertices == other.vertices && self.triangles == other.triangles
    }
}

impl WallMesh {
    /// Surface of `vertices` (m) and `triangles` of 0-based numbers of vertices, counter-clockwise seen from the side that
    /// pushes; it may be open, and in several pieces.
    ///
    /// Errors: numbers that are not finite, vertices that do not exist or are not used, triangles without area, too many
    /// triangles; with one side also edges of more than two triangles, and of two triangles seen from different sides.
    ///
    /// ```
    /// use cd_formats::wall_mesh::{MeshSides, WallMesh};
    /// use nalgebra::Vector3;
    /// let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    /// let mesh = WallMesh::new(&square, &[[0, 1, 2], [0, 2, 3]], MeshSides::One).unwrap();
    /// // Above the common edge of both triangles.
    /// let found = mesh.ball_contacts(&Vector3::new(0.5, 0.5, 0.75), 0.5, 1.0);
    /// assert_eq!((found.len(), found[0].normal, found[0].distance), (1, Vector3::z(), 0.75));
    /// ```
    pub fn new(vertices: &[[f64; 3]], triangles: &[[u32; 3]], sides: MeshSides) -> Result<WallMesh, SurfaceFaults> {
        let mut faults = element_faults(vertices, triangles);
        if triangles.len() > MAX_MESH_TRIANGLES {
            let found = format!("there are {} triangles", triangles.len());
            faults.push(SurfaceFault::new(found, format!("expected at most {MAX_MESH_TRIANGLES}")));
        }
        if !faults.is_empty() {
            return Err(SurfaceFaults(faults));
        }
        let edges = triangles_of_edges(triangles);
        if sides == MeshSides::One {
            faults = orientation_faults(&edges);
            if !faults.is_empty() {
                return Err(SurfaceFaults(faults));
            }
        }
        let vertices: Vec<Vec3> = vertices.iter().map(|&vertex| Vec3::from(vertex)).collect();
        let corners = |triangle: &[u32; 3]| triangle.map(|k| vertices[k as usize]);
        let normal = |triangle: &[u32; 3]| {
            let [a, b, c] = corners(triangle);
            // The two sides at the corner that is nearest to a right angle have the normal with the smallest error.
            let sides = [(b - a, c - a), (c - b, a - b), (a - c, b - c)];
            let sharpness = |(u, v): &(Vec3, Vec3)| u.dot(v).abs() / (u.norm() * v.norm());
            let (u, v) = sides.into_iter().min_by(|a, b| sharpness(a).total_cmp(&sharpness(b))).unwrap_or_default();
            u.cross(&v).normalize()
        };
        let normals: Vec<Vec3> = triangles.iter().map(normal).collect();
        let boxes: Vec<Aabb> = triangles
            .iter()
            .map(|triangle| {
                let [a, b, c] = corners(triangle);
                Aabb::new(tree_point(&a.inf(&b).inf(&c)), tree_point(&a.sup(&b).sup(&c)))
            })
            .collect();
        let mut fan_starts = vec![0; vertices.len() + 1];
        triangles.iter().flatten().for_each(|&vertex| fan_starts[vertex as usize + 1] += 1);
        (0..vertices.len()).for_each(|k| fan_starts[k + 1] += fan_starts[k]);
        let mut ends = fan_starts.clone();
        let mut fans = vec![0; 3 * triangles.len()];
        for (number, triangle) in (0..).zip(triangles) {
            for &vertex in triangle {
                fans[ends[vertex as usize] as usize] = number;
                ends[vertex as usize] += 1;
            }
        }
        let mut rim = vec![false; vertices.len()];
        for edge in edges.iter().filter(|(_, sides)| sides.len() == 1).flat_map(|(edge, _)| edge) {
            rim[*edge as usize] = true;
        }
        let mut flush_edges = vec![0; triangles.len()];
        let mut flush_vertices = vec![true; vertices.len()];
        for (edge, sides) in &edges {
            if is_flush_edge(&vertices, triangles, &normals, edge, sides) {
                for (number, _) in sides {
                    let t = &triangles[*number as usize];
                    let k = (0..3).find(|&k| edge.contains(&t[k]) && edge.contains(&t[(k + 1) % 3])).unwrap_or(0);
                    flush_edges[*number as usize] |= 1 << k;
                }
            } else {
                edge.iter().for_each(|&vertex| flush_vertices[vertex as usize] = false);
            }
        }
        Ok(WallMesh {
            radius: vertices.iter().map(|vertex| vertex.norm()).fold(0.0, f64::max),
            tree: Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes),
            triangles: triangles.to_vec(),
            vertices,
            sides,
            normals,
            fans,
            fan_starts,
            rim,
            flush_edges,
            flush_vertices,
        })
    }

    /// Reads an OBJ file of triangles, as cd-pre writes it. Errors: all faults of the
    /// file; of the surface the first five, and the number of others.
    pub fn read(path: &Path, sides: MeshSides) -> Result<WallMesh, Faults> {
        let text = atomic::read_text(path)?;
        let mut faults = Faults::default();
        let PolygonMesh { points, polygons, .. } = match obj::read(&lines(&text)) {
            Ok(mesh) => mesh,
            Err(errors) => {
                for ReadError { line, found, expected } in errors {
                    faults.push(Fault::new(path, line, "file", found, format!("expected {expected}")));
                }
                return Err(faults);
            }
        };
        let triangles: Option<Vec<[u32; 3]>> = polygons
            .iter()
            .map(|corners| <[usize; 3]>::try_from(&corners[..]).ok().map(|corners| corners.map(|k| k as u32)))
            .collect();
        let Some(triangles) = triangles else {
            let expected = "expected triangles; cd-pre cuts polygons into triangles";
            return Err(Fault::new(path, None, "file", "polygons of other than three corners", expected).into());
        };
        WallMesh::new(&points, &triangles, sides).map_err(|found| {
            let shown = found.0.iter().take(MAX_PRINTED_FAULTS);
            for fault in shown {
                faults.push(fault.file_fault(path));
            }
            if let Some(others) = found.0.len().checked_sub(MAX_PRINTED_FAULTS).filter(|others| *others > 0) {
                let found = count_text(others, "more fault");
                faults.push(Fault::new(path, None, "surface", found, "expected a surface without them"));
            }
            faults
        })
    }

    /// Text of an OBJ file with the surface, its coordinates with all their digits.
    pub fn to_text(&self) -> String {
        let vertices = self.vertices.iter().map(|v| format!("v {:?} {:?} {:?}\n", v.x, v.y, v.z));
        let triangles = self.triangles.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1));
        vertices.chain(triangles).collect()
    }

    /// Vertices, m.
    pub fn vertices(&self) -> &[Vec3] {
        &self.vertices
    }

    /// Triangles by 0-based numbers of vertices.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Sides that push bodies.
    pub fn sides(&self) -> MeshSides {
        self.sides
    }

    /// Corners of a triangle, m.
    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|k| self.vertices[k as usize])
    }

    /// Unit normal of a triangle, towards the side from which it is seen counter-clockwise.
    pub fn normal(&self, triangle: u32) -> Vec3 {
        self.normals[triangle as usize]
    }

    /// Triangles whose boxes meet the box between two corners, m, ascending.
    pub fn triangles_in_box(&self, lower: &Vec3, upper: &Vec3) -> SmallVec<[u32; 16]> {
        let mut found: SmallVec<[u32; 16]> =
            self.tree.intersect_aabb(&Aabb::new(tree_point(lower), tree_point(upper))).collect();
        found.sort_unstable();
        found
    }

    /// Number of the feature of a region of a triangle, see [`feature_of`].
    pub fn feature(&self, triangle: u32, region: TriangleRegion) -> u32 {
        if region == TriangleRegion::Face {
            return feature_of(triangle, 0);
        }
        let first = self.triangles_at(triangle, region).first().copied().unwrap_or(triangle);
        let corners = &self.triangles[triangle as usize];
        let position =
            |vertex: u32| (self.triangles[first as usize].iter().position(|&k| k == vertex)).unwrap_or_default();
        let region = match region {
            TriangleRegion::Face => 0,
            TriangleRegion::Corner(k) => 4 + position(corners[k]),
            TriangleRegion::Edge(k) => {
                // Edges of the first triangle begin at one of the two ends.
                let [start, end] = [position(corners[k]), position(corners[(k + 1) % 3])];
                1 + if (start + 1) % 3 == end { start } else { end }
            }
        };
        feature_of(first, region as u32)
    }

    /// Whether a region is inside of a plane of triangles: an edge of two triangles in one plane, to 1e-5 rad, a corner all
    /// of whose edges are such, or a face.
    ///
    /// ```
    /// use cd_formats::wall_mesh::{MeshSides, TriangleRegion, WallMesh};
    /// let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    /// let mesh = WallMesh::new(&square, &[[0, 1, 2], [0, 2, 3]], MeshSides::One).unwrap();
    /// let edge = TriangleRegion::Edge;
    /// assert_eq!([edge(0), edge(1), edge(2)].map(|region| mesh.is_flush(0, region)), [false, false, true]);
    /// ```
    pub fn is_flush(&self, triangle: u32, region: TriangleRegion) -> bool {
        match region {
            TriangleRegion::Face => true,
            TriangleRegion::Edge(k) => self.flush_edges[triangle as usize] >> k & 1 == 1,
            TriangleRegion::Corner(k) => self.flush_vertices[self.triangles[triangle as usize][k] as usize],
        }
    }

    /// Whether the surface near a region of a triangle lies, to first order, behind the plane through it across the unit
    /// vector `n`, and `n` points to a side that pushes: a body may touch the surface there along `n`.
    ///
    /// On a face n is its normal; at an edge that is convex it is between the normals of its triangles, at a convex corner in
    /// the cone of those around it. Concave edges have no such direction.
    ///
    /// ```
    /// use cd_formats::wall_mesh::{MeshSides, TriangleRegion, WallMesh};
    /// use nalgebra::Vector3;
    /// let points = |z: f64| [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, z], [0.0, -1.0, z]];
    /// let up = |z: f64| {
    ///     let mesh = WallMesh::new(&points(z), &[[0, 1, 2], [0, 3, 1]], MeshSides::One).unwrap();
    ///     mesh.allows_normal(0, TriangleRegion::Edge(0), &Vector3::z())
    /// };
    /// assert_eq!([-0.5, 0.0, 0.5].map(up), [true, true, false]);
    /// ```
    pub fn allows_normal(&self, triangle: u32, region: TriangleRegion, n: &Vec3) -> bool {
        let vertices = &self.triangles[triangle as usize];
        let position = |vertex: u32| self.vertices[vertex as usize];
        let is_behind = |direction: Vec3| n.dot(&direction) <= CONE_TOLERANCE * direction.norm();
        let at_feature = self.triangles_at(triangle, region);
        let is_local_maximum = match region {
            TriangleRegion::Face => true,
            TriangleRegion::Edge(k) => {
                let [start, end] = [vertices[k], vertices[(k + 1) % 3]];
                let along = (position(end) - position(start)).normalize();
                at_feature.iter().all(|&other| {
                    let opposite =
                        self.triangles[other as usize].iter().find(|&&vertex| vertex != start && vertex != end);
                    let side = opposite.map_or(Vec3::zeros(), |&vertex| position(vertex) - position(start));
                    is_behind(side - along * along.dot(&side))
                })
            }
            TriangleRegion::Corner(k) => {
                let all = at_feature.iter().flat_map(|&other| self.triangles[other as usize]);
                all.into_iter().all(|vertex| is_behind(position(vertex) - position(vertices[k])))
            }
        };
        is_local_maximum
            && self.outward_direction(triangle, region, &at_feature).is_none_or(|outward| outward.dot(n) >= 0.0)
    }

    /// Whether the vector `n` points to a side of the surface that pushes, seen from a region of a triangle: always if both
    /// sides push, and at the rim.
    pub fn is_pushing_side(&self, triangle: u32, region: TriangleRegion, n: &Vec3) -> bool {
        if self.sides == MeshSides::Both {
            return true;
        }
        if region == TriangleRegion::Face {
            return self.normals[triangle as usize].dot(n) >= 0.0;
        }
        let outward = self.outward_direction(triangle, region, &self.triangles_at(triangle, region));
        outward.is_none_or(|outward| outward.dot(n) >= 0.0)
    }

    /// Whether each edge belongs to two triangles or more.
    pub fn has_no_rim(&self) -> bool {
        !self.rim.contains(&true)
    }

    /// Largest distance of a vertex from the origin, m.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Contacts of a ball whose surface is at most `range` from the surface, m; centre and radius in m. They are at local
    /// minima of the distance of the centre, see the module, nearest first. Of contacts with the same normal the nearest is
    /// returned: it is in front of the others.
    ///
    /// Behind a surface with one side the nearest point alone is returned, if it is no farther from the centre than the
    /// radius. The rim of an open surface pushes in all directions.
    pub fn ball_contacts(&self, centre: &Vec3, radius: f64, range: f64) -> SmallVec<[MeshContact; 2]> {
        self.contacts_among(&self.near_triangles(centre, radius + range), centre, radius)
    }

    /// [`Self::ball_contacts`] of a ball whose triangles are searched only if it has left the region of its list.
    pub fn listed_ball_contacts(
        &self,
        list: &mut TriangleList,
        centre: &Vec3,
        radius: f64,
        range: f64,
    ) -> SmallVec<[MeshContact; 2]> {
        let reach = radius + range;
        // Distances of the same triangle from two positions have a rounding error each.
        let moved = (centre - list.centre).norm();
        if moved + reach > list.reach - 2.0 * self.rounding(centre) {
            // A ball that leaves any skin in one step is searched in each, without a skin.
            let skin = SKIN_PER_RADIUS * radius;
            let reach = reach + if moved <= 2.0 * skin { skin } else { 0.0 };
            let numbers = self.near_triangles(centre, reach).iter().map(|found| found.triangle).collect();
            *list = TriangleList { centre: *centre, reach, numbers };
        }
        let listed = list.numbers.iter().map(|&triangle| self.near_triangle(triangle, centre));
        let in_reach: SmallVec<[NearTriangle; 16]> = listed.filter(|triangle| triangle.distance <= reach).collect();
        self.contacts_among(&in_reach, centre, radius)
    }

    /// Contacts of a ball with the surface; `triangles`: all in its reach, by number.
    fn contacts_among(&self, triangles: &[NearTriangle], centre: &Vec3, radius: f64) -> SmallVec<[MeshContact; 2]> {
        let Some(nearest) = triangles.iter().min_by(|a, b| a.distance.total_cmp(&b.distance)) else {
            return SmallVec::new();
        };
        if !self.is_in_front(nearest, centre) {
            let contact = MeshContact { distance: -nearest.distance, ..self.contact_at(nearest, centre, -1.0) };
            return (nearest.distance <= radius).then_some(contact).into_iter().collect();
        }
        let rounding = self.rounding(centre);
        let mut minima: SmallVec<[NearTriangle; 4]> =
            triangles.iter().filter(|found| self.is_minimum(found, triangles, rounding)).copied().collect();
        minima.retain(|found| self.is_in_front(found, centre));
        // Nearest first. Of contacts with the same normal and, up to rounding, the same distance the loop below keeps a face.
        minima.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        let mut contacts: SmallVec<[MeshContact; 2]> = SmallVec::new();
        for found in &minima {
            let contact = self.contact_at(found, centre, 1.0);
            let same = contacts
                .iter_mut()
                .find(|known| (known.normal - contact.normal).norm_squared() <= SAME_NORMAL * SAME_NORMAL);
            match same {
                None => contacts.push(contact),
                Some(known)
                    if contact.distance - known.distance <= rounding
                        && TriangleRegion::is_face_feature(contact.feature) =>
                {
                    // Rounding alone decides between a face and its edge.
                    if !TriangleRegion::is_face_feature(known.feature) {
                        *known = contact;
                    }
                }
                Some(_) => {}
            }
        }
        contacts
    }

    /// Lower bound of the distance of a point from the surface, m, at most `limit`.
    pub fn distance_bound(&self, point: &Vec3, limit: f64) -> f64 {
        self.near_triangles(point, limit).iter().map(|triangle| triangle.distance).fold(limit, f64::min)
    }

    /// Distance of a point behind a surface with one side from its nearest point, m; `None` of a point in front. All points
    /// inside of a closed surface seen from outside are behind it.
    pub fn depth_behind(&self, point: &Vec3) -> Option<f64> {
        let project = |triangle: u32, _: f64| {
            let nearest = self.near_triangle(triangle, point).point;
            Some(PointProjection::new(false, tree_point(&nearest)))
        };
        let (triangle, _) = self.tree.project_point(tree_point(point), f64::MAX, project)?;
        let nearest = self.near_triangle(triangle, point);
        (!self.is_in_front(&nearest, point)).then_some(nearest.distance)
    }

    /// Distance up to which distances of a point from triangles with a common point differ by rounding, m.
    fn rounding(&self, point: &Vec3) -> f64 {
        ROUNDINGS * f64::EPSILON * (self.radius + point.norm())
    }

    /// Triangles up to `reach` from a point, m, in the order of their numbers.
    fn near_triangles(&self, point: &Vec3, reach: f64) -> SmallVec<[NearTriangle; 16]> {
        // Distances of triangles from the point have rounding errors, those of boxes hardly any.
        let limit = reach + self.rounding(point);
        let is_near = |node: &BvhNode| box_distance_squared(node, point) <= limit * limit;
        let in_reach = self.tree.leaves(is_near).map(|triangle| self.near_triangle(triangle, point));
        let mut found: SmallVec<[NearTriangle; 16]> = in_reach.filter(|triangle| triangle.distance <= reach).collect();
        found.sort_unstable_by_key(|triangle| triangle.triangle);
        found
    }

    fn near_triangle(&self, triangle: u32, point: &Vec3) -> NearTriangle {
        let corners = self.triangles[triangle as usize].map(|k| self.vertices[k as usize]);
        let (region, nearest) = nearest_point(&corners, point);
        if region == TriangleRegion::Face {
            let normal = &self.normals[triangle as usize];
            let height = normal.dot(&(point - corners[0]));
            return NearTriangle { triangle, region, point: point - normal * height, distance: height.abs() };
        }
        NearTriangle { triangle, region, point: nearest, distance: (point - nearest).norm() }
    }

    /// Triangles of a vertex, ascending.
    fn fan(&self, vertex: u32) -> &[u32] {
        let [start, end] = [vertex, vertex + 1].map(|k| self.fan_starts[k as usize] as usize);
        &self.fans[start..end]
    }

    /// Whether a triangle has a vertex.
    fn has_vertex(&self, triangle: u32, vertex: u32) -> bool {
        self.triangles[triangle as usize].contains(&vertex)
    }

    /// Triangles that have the edge or corner of a region of a triangle, ascending.
    fn triangles_at(&self, triangle: u32, region: TriangleRegion) -> SmallVec<[u32; 8]> {
        let vertices = &self.triangles[triangle as usize];
        match region {
            TriangleRegion::Face => [triangle].into_iter().collect(),
            TriangleRegion::Corner(k) => self.fan(vertices[k]).iter().copied().collect(),
            TriangleRegion::Edge(k) => {
                let end = vertices[(k + 1) % 3];
                self.fan(vertices[k]).iter().copied().filter(|&other| self.has_vertex(other, end)).collect()
            }
        }
    }

    /// Direction out of the surface at a region of a triangle, of any length; `None` if both sides push, and at the rim.
    /// `at_feature`: the triangles there.
    fn outward_direction(&self, triangle: u32, region: TriangleRegion, at_feature: &[u32]) -> Option<Vec3> {
        if self.sides == MeshSides::Both {
            return None;
        }
        let vertices = &self.triangles[triangle as usize];
        match region {
            TriangleRegion::Face => Some(self.normals[triangle as usize]),
            TriangleRegion::Edge(_) if at_feature.len() == 1 => None,
            TriangleRegion::Edge(_) => Some(at_feature.iter().map(|&k| self.normals[k as usize]).sum()),
            TriangleRegion::Corner(k) if self.rim[vertices[k] as usize] => None,
            // Normals weighted by the angles at the corner: J. A. Baerentzen, H. Aanaes, Signed distance computation using
            // the angle weighted pseudonormal, IEEE Trans. Vis. Comput. Graph. 11 (2005) 243-253.
            TriangleRegion::Corner(k) => {
                let weighted_normal = |&other: &u32| self.normals[other as usize] * self.angle_at(other, vertices[k]);
                Some(at_feature.iter().map(weighted_normal).sum())
            }
        }
    }

    /// Whether no triangle with the feature of `found` is nearer to the centre than `found`; `triangles`: all in reach, by number.
    fn is_minimum(&self, found: &NearTriangle, triangles: &[NearTriangle], rounding: f64) -> bool {
        let is_not_nearer = |other: &u32| {
            let position = triangles.binary_search_by_key(other, |triangle| triangle.triangle);
            position.is_err() || position.is_ok_and(|k| triangles[k].distance >= found.distance - rounding)
        };
        let vertices = &self.triangles[found.triangle as usize];
        match found.region {
            TriangleRegion::Face => true,
            TriangleRegion::Corner(k) => self.fan(vertices[k]).iter().all(is_not_nearer),
            TriangleRegion::Edge(k) => {
                let end = vertices[(k + 1) % 3];
                let mut at_edge = self.fan(vertices[k]).iter().filter(|&&other| self.has_vertex(other, end));
                at_edge.all(is_not_nearer)
            }
        }
    }

    /// Whether a point is in front of the surface at its nearest point: always if both sides push, and at the rim.
    fn is_in_front(&self, found: &NearTriangle, point: &Vec3) -> bool {
        self.is_pushing_side(found.triangle, found.region, &(point - found.point))
    }

    /// Angle of a triangle at one of its vertices, rad.
    fn angle_at(&self, triangle: u32, vertex: u32) -> f64 {
        let corners = self.triangles[triangle as usize];
        let at = corners.iter().position(|&corner| corner == vertex).unwrap_or_default();
        let [a, b, c] = [0, 1, 2].map(|k| self.vertices[corners[(at + k) % 3] as usize]);
        let (u, v) = (b - a, c - a);
        libm::atan2(u.cross(&v).norm(), u.dot(&v))
    }

    /// Contact at the nearest point of a triangle; `side`: 1 in front of a surface with one side, -1 behind it.
    fn contact_at(&self, found: &NearTriangle, centre: &Vec3, side: f64) -> MeshContact {
        let face_normal = self.normals[found.triangle as usize];
        let between = centre - found.point;
        let normal = match found.region {
            TriangleRegion::Face if self.sides == MeshSides::One => face_normal,
            TriangleRegion::Face => {
                let corner = self.vertices[self.triangles[found.triangle as usize][0] as usize];
                face_normal * if face_normal.dot(&(centre - corner)) < 0.0 { -1.0 } else { 1.0 }
            }
            _ if found.distance > self.rounding(centre) => between * (side / found.distance),
            _ => face_normal,
        };
        MeshContact {
            feature: self.feature(found.triangle, found.region),
            point: found.point,
            normal,
            distance: found.distance,
        }
    }
}

/// Whether an edge is in the middle of two triangles in one plane, to [`FLUSH_ANGLE`].
fn is_flush_edge(
    vertices: &[Vec3],
    triangles: &[[u32; 3]],
    normals: &[Vec3],
    [start, end]: &[u32; 2],
    sides: &[(u32, bool)],
) -> bool {
    let [(one, forward), (other, other_forward)] = sides else { return false };
    let along = vertices[*end as usize] - vertices[*start as usize];
    let sideways = |number: &u32| {
        let opposite = triangles[*number as usize].iter().find(|&vertex| vertex != start && vertex != end);
        let side = opposite.map_or(Vec3::zeros(), |&vertex| vertices[vertex as usize] - vertices[*start as usize]);
        side - along * (along.dot(&side) / along.norm_squared())
    };
    let sign = if forward == other_forward { -1.0 } else { 1.0 };
    let [n, m] = [one, other].map(|&number| normals[number as usize]);
    (n - m * sign).norm_squared() <= FLUSH_ANGLE * FLUSH_ANGLE && sideways(one).dot(&sideways(other)) < 0.0
}

/// Number of faults of one surface that are printed one by one; a broken surface has thousands of the same kind.
const MAX_PRINTED_FAULTS: usize = 5;

/// Square of the distance of a point from the box of a node, m².
#[inline]
fn box_distance_squared(node: &BvhNode, point: &Vec3) -> f64 {
    let (low, high) = (node.mins(), node.maxs());
    let excess = |low: f64, x: f64, high: f64| (low - x).max(x - high).max(0.0);
    let [dx, dy, dz] = [excess(low.x, point.x, high.x), excess(low.y, point.y, high.y), excess(low.z, point.z, high.z)];
    dx * dx + dy * dy + dz * dz
}

fn tree_point(point: &Vec3) -> TreePoint {
    TreePoint::new(point.x, point.y, point.z)
}

/// Region and position of the point of a triangle that is nearest to `p`.
/// Source: C. Ericson, Real-Time Collision Detection (2005), section 5.1.5.
fn nearest_point([a, b, c]: &[Vec3; 3], p: &Vec3) -> (TriangleRegion, Vec3) {
    let (ab, ac) = (b - a, c - a);
    let (ap, bp, cp) = (p - a, p - b, p - c);
    let [d1, d2] = [ab.dot(&ap), ac.dot(&ap)];
    if d1 <= 0.0 && d2 <= 0.0 {
        return (TriangleRegion::Corner(0), *a);
    }
    let [d3, d4] = [ab.dot(&bp), ac.dot(&bp)];
    if d3 >= 0.0 && d4 <= d3 {
        return (TriangleRegion::Corner(1), *b);
    }
    if d1 * d4 - d3 * d2 <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (TriangleRegion::Edge(0), a + ab * (d1 / (d1 - d3)));
    }
    let [d5, d6] = [ab.dot(&cp), ac.dot(&cp)];
    if d6 >= 0.0 && d5 <= d6 {
        return (TriangleRegion::Corner(2), *c);
    }
    if d5 * d2 - d1 * d6 <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (TriangleRegion::Edge(2), a + ac * (d2 / (d2 - d6)));
    }
    let [from_b, from_c] = [d4 - d3, d5 - d6];
    if d3 * d6 - d5 * d4 <= 0.0 && from_b >= 0.0 && from_c >= 0.0 {
        return (TriangleRegion::Edge(1), b + (c - b) * (from_b / (from_b + from_c)));
    }
    (TriangleRegion::Face, *p)
}

/// Triangles of an edge, and whether each runs from its lower to its higher vertex.
type EdgeTriangles = SmallVec<[(u32, bool); 2]>;

/// Triangles of each edge, by the lower and the higher of its vertices.
type EdgeTable = BTreeMap<[u32; 2], EdgeTriangles>;

fn triangles_of_edges(triangles: &[[u32; 3]]) -> EdgeTable {
    let mut edges = EdgeTable::new();
    for (number, t) in (0..).zip(triangles) {
        for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
            edges.entry([a.min(b), a.max(b)]).or_default().push((number, a < b));
        }
    }
    edges
}

/// Faults of a surface with one side: edges of more than two triangles, or of two that are seen from different sides.
fn orientation_faults(edges: &EdgeTable) -> Vec<SurfaceFault> {
    let fault = |([a, b], triangles): (&[u32; 2], &EdgeTriangles)| {
        let edge = format!("the edge of vertices {} and {}", a + 1, b + 1);
        match triangles[..] {
            [_] => None,
            [(i, forward), (j, other)] => (forward == other).then(|| {
                let [i, j] = [i, j].map(|k| k + 1);
                let found = format!("triangles {i} and {j} at {edge} are seen from different sides");
                SurfaceFault::new(found, "expected the same side, or a wall of which both sides push (`side: Both`)")
            }),
            _ => Some(SurfaceFault::new(
                format!("{edge} belongs to {}", count_text(triangles.len(), "triangle")),
                "expected at most 2, or a wall of which both sides push (`side: Both`)",
            )),
        }
    };
    edges.iter().filter_map(fault).collect()
}

/// Orientation of the triangles of a surface, made coherent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OrientedTriangles {
    /// Triangles, each piece seen from the side of its first one; all turned over if they are closed and enclose a negative
    /// volume, so that they are seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Whether each edge belongs to two triangles.
    pub is_closed: bool,
    /// Whether there is a coherent orientation: no edge of more than two triangles, and no Moebius strip.
    pub is_orientable: bool,
}

/// Makes the orientation of `triangles` coherent across edges of two triangles; `vertices` in m.
///
/// ```
/// use cd_formats::wall_mesh::oriented_triangles;
/// let vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// let found = oriented_triangles(&vertices, &[[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]);
/// assert_eq!(found.triangles, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]);
/// assert!(found.is_closed && found.is_orientable);
/// ```
pub fn oriented_triangles(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> OrientedTriangles {
    let edges = triangles_of_edges(triangles);
    let is_closed = edges.values().all(|sides| sides.len() == 2);
    let mut is_orientable = edges.values().all(|sides| sides.len() <= 2);
    // Neighbours of each triangle, and whether one of the two has to be turned over.
    let mut neighbours: Vec<SmallVec<[(usize, bool); 3]>> = vec![SmallVec::new(); triangles.len()];
    for sides in edges.values() {
        if let [(i, forward), (j, other)] = sides[..] {
            neighbours[i as usize].push((j as usize, forward == other));
            neighbours[j as usize].push((i as usize, forward == other));
        }
    }
    let mut turned: Vec<Option<bool>> = vec![None; triangles.len()];
    for start in 0..triangles.len() {
        if turned[start].is_some() {
            continue;
        }
        turned[start] = Some(false);
        let mut pending = vec![start];
        while let Some(i) = pending.pop() {
            for &(j, are_opposite) in &neighbours[i] {
                let is_turned = turned[i].map(|is_turned| is_turned ^ are_opposite);
                is_orientable &= turned[j].is_none() || turned[j] == is_turned;
                if turned[j].is_none() {
                    turned[j] = is_turned;
                    pending.push(j);
                }
            }
        }
    }
    let coherent_triangle =
        |(&[a, b, c], turned): (&[u32; 3], Option<bool>)| if turned == Some(true) { [a, c, b] } else { [a, b, c] };
    let mut triangles: Vec<[u32; 3]> = triangles.iter().zip(turned).map(coherent_triangle).collect();
    let about = vertices.first().map_or(Vec3::zeros(), |&vertex| vertex.into());
    let volume = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|k| Vec3::from(vertices[k as usize]) - about);
        a.dot(&b.cross(&c))
    };
    if is_closed && is_orientable && triangles.iter().map(volume).sum::<f64>() < 0.0 {
        triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    }
    OrientedTriangles { triangles, is_closed, is_orientable }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane of squares of side 1 along x and y, each cut along another diagonal than its neighbours.
    fn plane(count: u32) -> WallMesh {
        let vertices: Vec<[f64; 3]> =
            (0..=count).flat_map(|j| (0..=count).map(move |i| [f64::from(i), f64::from(j), 0.0])).collect();
        let square = |k: u32| {
            let (i, j) = (k % count, k / count);
            let corner = |di: u32, dj: u32| (j + dj) * (count + 1) + i + di;
            let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
            if (i + j) % 2 == 0 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] }
        };
        let triangles: Vec<[u32; 3]> = (0..count * count).flat_map(square).collect();
        WallMesh::new(&vertices, &triangles, MeshSides::One).unwrap()
    }

    /// Closed cube of side 2 about the origin.
    fn cube(sides: MeshSides) -> WallMesh {
        let corner = |k: usize| [0, 1, 2].map(|axis| if k >> axis & 1 == 0 { -1.0 } else { 1.0 });
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let triangles: Vec<[u32; 3]> = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let vertices: Vec<[f64; 3]> = (0..8).map(corner).collect();
        let found = oriented_triangles(&vertices, &triangles);
        assert!(found.is_closed && found.is_orientable);
        WallMesh::new(&vertices, &found.triangles, sides).unwrap()
    }

    #[test]
    fn a_ball_on_a_plane_has_one_contact_wherever_it_is() {
        let mesh = plane(4);
        // Over faces, edges, corners, and points that rounding may put on either side of an edge.
        for x in [0.5, 1.0, 1.25, 2.0, 2.0 + 1e-16, 1.0 / 3.0, 0.1 + 0.2, 3.0 - 0.7] {
            for y in [0.5, 1.0, 1.0 / 3.0, x, 2.0 - x, 1.0 - 1e-16, 3.0 * 0.1, 2.0 * x - 1.0] {
                if !(0.0..=4.0).contains(&y) {
                    continue;
                }
                let found = mesh.ball_contacts(&Vec3::new(x, y, 0.625), 0.5, 0.5);
                assert_eq!(found.len(), 1, "{x} {y} {found:?}");
                // Rounding of coordinates up to 4.
                assert!((found[0].normal - Vec3::z()).norm() < 1e-14 && (found[0].distance - 0.625).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn convex_edges_and_corners_are_touched_once() {
        for sides in [MeshSides::One, MeshSides::Both] {
            let mesh = cube(sides);
            let ball = |x: f64, y: f64, z: f64| mesh.ball_contacts(&Vec3::new(x, y, z), 1.0, 0.5);
            let corner = ball(1.5, 1.5, 1.5);
            assert_eq!(corner.len(), 1);
            assert!((corner[0].distance - 0.75f64.sqrt()).abs() < 1e-15 && corner[0].feature % 8 >= 4);
            let edge = ball(1.3, 0.2, 1.4);
            assert_eq!(edge.len(), 1);
            assert!((edge[0].distance - 0.5).abs() < 1e-15 && (1..4).contains(&(edge[0].feature % 8)));
            assert!((edge[0].normal - Vec3::new(0.6, 0.0, 0.8)).norm() < 1e-15);
            let face = ball(0.3, 0.2, 1.5);
            assert_eq!((face.len(), face[0].normal, face[0].distance, face[0].feature % 8), (1, Vec3::z(), 0.5, 0));
        }
    }

    /// A ball in a corner of a box touches its three faces; one of which the centre has passed the wall is pushed out.
    #[test]
    fn sides_decide_what_pushes() {
        let centre = Vec3::new(0.75, 0.5, 0.25);
        let distances = |mesh: &WallMesh, radius: f64| -> Vec<f64> {
            mesh.ball_contacts(&centre, radius, 0.0).iter().map(|contact| contact.distance).collect()
        };
        assert_eq!(distances(&cube(MeshSides::Both), 0.75), [0.25, 0.5, 0.75]);
        assert_eq!(distances(&cube(MeshSides::One), 0.75), [-0.25]);
        assert!(distances(&cube(MeshSides::One), 0.125).is_empty());
        let found = cube(MeshSides::One).ball_contacts(&centre, 0.75, 0.0);
        assert_eq!(found[0].normal, Vec3::x());
        let [inside, outside] = [Vec3::new(0.1, 0.2, 0.1), Vec3::new(3.0, 4.0, -2.0)];
        // The cube has the half length 1.
        let depth = |point: &Vec3| cube(MeshSides::One).depth_behind(point);
        assert_eq!([depth(&inside), depth(&outside)], [Some(1.0 - inside.amax()), None]);
    }

    /// Two planes at the angle of a groove or of a ridge along y.
    fn folded(slope: f64) -> WallMesh {
        let vertices = [
            [-1.0, -1.0, slope],
            [-1.0, 1.0, slope],
            [0.0, -1.0, 0.0],
            [0.0, 1.0, 0.0],
            [1.0, -1.0, slope],
            [1.0, 1.0, slope],
        ];
        WallMesh::new(&vertices, &[[0, 2, 1], [2, 3, 1], [2, 4, 3], [4, 5, 3]], MeshSides::One).unwrap()
    }

    #[test]
    fn grooves_are_touched_on_both_sides_and_ridges_at_the_edge() {
        let ball = |slope: f64, z: f64| folded(slope).ball_contacts(&Vec3::new(0.0, 0.25, z), 0.25, 0.25);
        let groove = ball(0.75, 0.5);
        assert_eq!(groove.len(), 2);
        // 3-4-5: the sides are 0.4 m from the centre. A few roundings of numbers near 1.
        for contact in groove {
            assert!((contact.distance - 0.4).abs() < 1e-15 && (contact.normal.z - 0.8).abs() < 1e-15);
        }
        let ridge = ball(-0.75, 0.5);
        assert_eq!((ridge.len(), ridge[0].normal, ridge[0].distance), (1, Vec3::z(), 0.5));
        assert!((1..4).contains(&(ridge[0].feature % 8)));
    }

    /// The number of contacts does not depend on the side from which an edge that is all but flat is bent.
    #[test]
    fn edges_that_are_flat_up_to_rounding_are_flat() {
        for slope in [1e-6, -1e-6, 1e-9, -1e-9, 1e-15, -1e-15] {
            for x in [-1e-7, -1e-10, 0.0, 1e-16, 1e-10, 1e-7] {
                let found = folded(slope).ball_contacts(&Vec3::new(x, 0.1, 0.5), 0.5, 0.25);
                assert_eq!(found.len(), 1, "{slope} {x} {found:?}");
            }
        }
    }

    #[test]
    fn the_rim_of_an_open_surface_pushes_in_all_directions() {
        let mesh = plane(2);
        for (z, radius) in [(0.3, 0.75), (-0.3, 0.75)] {
            let found = mesh.ball_contacts(&Vec3::new(-0.4, 1.25, z), radius, 0.0);
            assert_eq!(found.len(), 1);
            assert!((found[0].distance - 0.5).abs() < 1e-15);
            assert!((found[0].normal - Vec3::new(-0.8, 0.0, z / 0.5)).norm() < 1e-14);
        }
    }

    #[test]
    fn faults_name_edges_and_triangles() {
        let vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 1.0], [0.0, 0.0, 1.0]];
        let fault = |count: usize, triangles: &[[u32; 3]]| {
            WallMesh::new(&vertices[..count], triangles, MeshSides::One).unwrap_err().to_string()
        };
        let turned = fault(4, &[[0, 1, 2], [1, 2, 3]]);
        assert!(turned.contains("triangles 1 and 2") && turned.contains("vertices 2 and 3"), "{turned}");
        let fin = fault(5, &[[0, 1, 2], [1, 3, 2], [1, 2, 4]]);
        assert!(fin.contains("belongs to 3 triangles"), "{fin}");
        assert!(WallMesh::new(&vertices, &[[0, 1, 2], [1, 3, 2], [1, 2, 4]], MeshSides::Both).is_ok());
        assert!(fault(3, &[[0, 1, 1]]).contains("no area"));
        assert!(fault(4, &[[0, 1, 2]]).contains("vertex 4 is not used"));
        let strip = oriented_triangles(&vertices[..4], &[[0, 1, 2], [1, 2, 3]]);
        assert_eq!((strip.triangles, strip.is_closed), (vec![[0, 1, 2], [1, 3, 2]], false));
    }

    #[test]
    fn a_surface_is_read_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("wall.obj");
        std::fs::write(&path, plane(3).to_text()).unwrap();
        assert_eq!(WallMesh::read(&path, MeshSides::One).unwrap(), plane(3));
        std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 1 x 0\nf 1 2 3\n").unwrap();
        assert!(WallMesh::read(&path, MeshSides::One).unwrap_err().to_string().contains(":3: "));
    }

    /// A ball that moves slowly, then fast, has the contacts that it has without a list, to the last bit.
    #[test]
    fn lists_of_triangles_change_no_contacts() {
        for mesh in [cube(MeshSides::Both), cube(MeshSides::One), plane(8)] {
            let (mut list, mut count) = (TriangleList::default(), 0);
            for k in 0..500 {
                let t = 1e-7 * f64::from(k).powi(3);
                let centre = Vec3::new(1.4 * libm::cos(t), 1.3 * libm::sin(2.0 * t), 1.35 * libm::sin(t));
                let found = mesh.listed_ball_contacts(&mut list, &centre, 0.5, 0.2);
                assert_eq!(found, mesh.ball_contacts(&centre, 0.5, 0.2));
                count += found.len();
            }
            assert!(count > 100, "{count}");
        }
    }

    /// The tree leaves out no triangle: contacts are those of all triangles.
    #[test]
    fn the_tree_finds_the_nearest_triangle() {
        let mesh = cube(MeshSides::Both);
        for k in 0..200 {
            let angle = f64::from(k) * 0.7;
            let point = Vec3::new(2.0 * libm::cos(angle), 1.5 * libm::sin(2.0 * angle), 1.8 * libm::sin(angle));
            let all =
                (0..12).map(|triangle| mesh.near_triangle(triangle, &point).distance).fold(f64::INFINITY, f64::min);
            assert_eq!(mesh.ball_contacts(&point, 3.0, 0.0)[0].distance, all);
            assert_eq!(mesh.distance_bound(&point, 0.1), all.min(0.1));
        }
    }
}
