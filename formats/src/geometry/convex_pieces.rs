//! Splitting of a closed polyhedron that is not convex into convex pieces, by cuts along the planes of its reflex edges.
//!
//! A convex cell around the solid is halved by the plane of a face that other faces are in front of, and each half again,
//! until no face of a cell is in front of another. Within such a cell the solid is convex: the cell behind all of its
//! faces. Planes of cuts are planes of faces, so the pieces of an L, a U or a T are exact.

use std::collections::BTreeMap;
use std::fmt::{Display, Formatter};

use nalgebra::Vector3;

use super::faces::{ConvexMesh, FLATNESS_OF_FILES, doubled_area};
use super::surface::Surface;
use crate::names::number_text;

type Vec3 = Vector3<f64>;

/// Largest number of pieces of a polyhedron.
pub const MAX_CONVEX_PIECES: usize = 32;
/// Largest number of comparisons of a face with a plane while a polyhedron is split, about a third of a second. A cut of
/// n faces in p planes takes n p of them for each plane that is tried, and n p to choose these planes.
const MAX_SPLIT_COMPARISONS: u64 = 40_000_000;
/// Largest number of planes that are tried for a cut; at least two are tried.
const MAX_TRIED_PLANES: usize = 24;
/// Number of comparisons beyond which fewer planes are tried for a cut: 500 faces in as many planes take this number.
const MAX_CUT_COMPARISONS: usize = MAX_TRIED_PLANES * 500 * 500;
/// Ratio of the depth of dents to the size of a surface, up to which they are attributed to the rounding of its
/// coordinates, and not split.
const MIN_REFLEX_DEPTH: f64 = 1e-4;
/// Largest difference of the volume of all pieces from that of the whole, divided by the latter: flatness of files, per
/// face.
const VOLUME_TOLERANCE: f64 = 1e-5;

/// Vertices (m) and triangles of a piece, counter-clockwise seen from outside.
#[derive(Debug, Clone, PartialEq)]
pub struct ConvexPiece {
    pub vertices: Vec<[f64; 3]>,
    pub triangles: Vec<[u32; 3]>,
}

/// Reason why a surface cannot be split into convex pieces.
#[derive(Debug, Clone, PartialEq)]
pub enum SplitError {
    /// The dents of the surface are no deeper than the rounding of its coordinates.
    ShallowDents,
    /// The comparisons of the surface's faces exceed the largest number.
    ManyDents { triangles: usize },
    /// The pieces exceed [`MAX_CONVEX_PIECES`].
    ManyPieces,
    /// Volume of its pieces and of the surface, m^3, which differ.
    IntersectingFaces { pieces: f64, volume: f64 },
}

impl Display for SplitError {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        match self {
            SplitError::ShallowDents => f.write_str("its dents are no deeper than the rounding of its coordinates"),
            SplitError::ManyDents { triangles } => {
                write!(f, "its {triangles} triangles have more dents than can be examined")
            }
            SplitError::ManyPieces => write!(f, "it has more than {MAX_CONVEX_PIECES} convex pieces"),
            SplitError::IntersectingFaces { pieces, volume } => {
                let [pieces, volume] = [pieces, volume].map(|x| number_text(*x));
                write!(f, "its faces intersect: the volume of its pieces is {pieces} m^3, not {volume} m^3")
            }
        }
    }
}

impl std::error::Error for SplitError {}

/// Convex pieces that together fill the inside of a surface, without overlaps.
///
/// Errors: the surface cannot be split into at most [`MAX_CONVEX_PIECES`] such pieces.
///
/// ```
/// # use cd_formats::{convex_pieces::split_into_convex, surface::Surface};
/// // An arrow head: the corner in the middle of its base is pushed in.
/// let corners = [[-1.0, 0.0, 0.0], [0.0, 0.5, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.5, 1.0]];
/// let triangles = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [0, 3, 1], [1, 3, 2]];
/// let pieces = split_into_convex(&Surface::new(&corners, &triangles).unwrap()).unwrap();
/// assert_eq!(pieces.len(), 2);
/// ```
pub fn split_into_convex(surface: &Surface) -> Result<Vec<ConvexPiece>, SplitError> {
    let centre = Vec3::from(surface.mass_properties().centre);
    let vertices: Vec<Vec3> = surface.vertices().iter().map(|&v| Vec3::from(v) - centre).collect();
    let size = vertices.iter().map(|vertex| vertex.norm()).fold(0.0, f64::max);
    let splitter = SolidSplitter {
        vertices: &vertices,
        triangles: surface.triangles(),
        tolerance: FLATNESS_OF_FILES * size,
        comparisons: std::cell::Cell::new(0),
    };
    let face = |triangle: &[u32; 3]| FacePolygon::new(triangle.map(|v| vertices[v as usize]).into());
    let mut faces: Vec<FacePolygon> = surface.triangles().iter().map(face).collect();
    let first_faces = splitter.join_planes(&mut faces)?;
    splitter.count_comparisons(first_faces.len() * faces.len())?;
    let dent_depth = |face: &FacePolygon| faces.iter().map(|other| other.height_over(face)).fold(0.0, f64::max);
    let largest_depth = first_faces.iter().map(|&first| dent_depth(&faces[first])).fold(0.0, f64::max);
    if largest_depth <= MIN_REFLEX_DEPTH * size {
        return Err(SplitError::ShallowDents);
    }
    let mut cells = UncutCells::default();
    splitter.split_cell(ConvexCell::cube(2.0 * size), faces, &mut cells)?;
    let pieces: Vec<ConvexPiece> =
        cells.inner_cells.iter().filter_map(|cell| splitter.convex_piece(cell, &centre)).collect();
    let piece_volume =
        |piece: &ConvexPiece| Surface::new(&piece.vertices, &piece.triangles).map_or(0.0, |surface| surface.volume());
    let sum: f64 = pieces.iter().map(piece_volume).sum();
    let volume = surface.volume();
    if (sum - volume).abs() > VOLUME_TOLERANCE * volume {
        return Err(SplitError::IntersectingFaces { pieces: sum, volume });
    }
    Ok(pieces)
}

/// Convex pieces of a POLYR: one that is convex, or cannot be split, is its own piece.
pub fn convex_surfaces(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Vec<ConvexPiece> {
    let whole_piece = || vec![ConvexPiece { vertices: vertices.to_vec(), triangles: triangles.to_vec() }];
    if ConvexMesh::from_contactor(vertices, triangles).is_ok() {
        return whole_piece();
    }
    let pieces = Surface::new(vertices, triangles).ok().and_then(|surface| split_into_convex(&surface).ok());
    pieces.unwrap_or_else(whole_piece)
}

/// Half space n·x <= offset.
#[derive(Debug, Clone, Copy)]
struct HalfSpace {
    normal: Vec3,
    offset: f64,
}

impl HalfSpace {
    /// Signed distance of a point in front of the plane, m.
    fn height(&self, point: &Vec3) -> f64 {
        self.normal.dot(point) - self.offset
    }
}

/// Convex part of a face, counter-clockwise seen from outside of the solid.
#[derive(Debug, Clone)]
struct FacePolygon {
    corners: Vec<Vec3>,
    plane: HalfSpace,
    /// Number of the plane, which faces of the whole that are coplanar share.
    plane_number: usize,
    /// Twice its area, m².
    doubled_area: f64,
}

impl FacePolygon {
    /// Face with these corners, m, which are not in a line.
    fn new(corners: Vec<Vec3>) -> FacePolygon {
        let area = doubled_area(&corners);
        let normal = area / area.norm();
        let plane = HalfSpace { normal, offset: normal.dot(&corners[0]) };
        FacePolygon { plane, plane_number: 0, doubled_area: area.norm(), corners }
    }

    /// Largest height of its corners above the plane of another, m.
    fn height_over(&self, other: &FacePolygon) -> f64 {
        self.corners.iter().map(|corner| other.plane.height(corner)).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Parts behind and in front of a plane, as far as they are wider than the tolerance.
    fn split(&self, plane: &HalfSpace, tolerance: f64) -> [Option<FacePolygon>; 2] {
        [1.0, -1.0].map(|side| {
            let heights: Vec<f64> = self.corners.iter().map(|corner| side * plane.height(corner)).collect();
            if heights.iter().all(|height| *height >= -tolerance) {
                return None;
            }
            if heights.iter().all(|height| *height <= tolerance) {
                return Some(self.clone());
            }
            let mut corners = Vec::new();
            for (k, corner) in self.corners.iter().enumerate() {
                let next = (k + 1) % heights.len();
                if heights[k] <= tolerance {
                    corners.push(*corner);
                }
                if heights[k].min(heights[next]) < -tolerance && heights[k].max(heights[next]) > tolerance {
                    // The edge to the next corner crosses the plane.
                    corners.push(corner + (self.corners[next] - corner) * (heights[k] / (heights[k] - heights[next])));
                }
            }
            let area = doubled_area(&corners).norm();
            (area > 0.0).then_some(FacePolygon { corners, doubled_area: area, ..*self })
        })
    }
}

/// Convex polyhedron; corners of its faces are counter-clockwise seen from outside.
#[derive(Debug, Clone)]
struct ConvexCell {
    vertices: Vec<Vec3>,
    faces: Vec<Vec<usize>>,
}

impl ConvexCell {
    /// Cube about the origin with this half side.
    fn cube(half: f64) -> ConvexCell {
        let vertices = (0..8).map(|k| Vec3::from_fn(|i, _| if k >> i & 1 == 1 { half } else { -half })).collect();
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        ConvexCell { vertices, faces: faces.map(Vec::from).into() }
    }

    /// Part behind a plane; vertices up to `tolerance` in front of it stay. `None` if nothing is behind it.
    fn clip(mut self, plane: &HalfSpace, tolerance: f64) -> Option<ConvexCell> {
        let mut heights: Vec<f64> = self.vertices.iter().map(|vertex| plane.height(vertex)).collect();
        let mut corners = self.faces.iter().flatten();
        if !corners.clone().any(|&v| heights[v] < -tolerance) {
            return None;
        }
        if !corners.any(|&v| heights[v] > tolerance) {
            return Some(self);
        }
        // Vertices where edges cross the plane, by the ends of the edge.
        let mut crossings: BTreeMap<[usize; 2], usize> = BTreeMap::new();
        let mut faces = Vec::new();
        for face in &self.faces {
            let mut corners = Vec::new();
            for (k, &a) in face.iter().enumerate() {
                let b = face[(k + 1) % face.len()];
                if heights[a] <= tolerance {
                    corners.push(a);
                }
                if heights[a].min(heights[b]) < -tolerance && heights[a].max(heights[b]) > tolerance {
                    // The same order of the ends for both faces of the edge.
                    let ends @ [first, second] = [a.min(b), a.max(b)];
                    corners.push(*crossings.entry(ends).or_insert_with(|| {
                        let share = heights[first] / (heights[first] - heights[second]);
                        let edge = self.vertices[second] - self.vertices[first];
                        self.vertices.push(self.vertices[first] + edge * share);
                        heights.push(0.0);
                        self.vertices.len() - 1
                    }));
                }
            }
            if corners.len() >= 3 && corners.iter().any(|&v| heights[v] < -tolerance) {
                faces.push(corners);
            }
        }
        // The vertices in the plane are the corners of the face that the cut makes.
        let mut rim: Vec<usize> = faces.iter().flatten().copied().filter(|&v| heights[v] >= -tolerance).collect();
        rim.sort_unstable();
        rim.dedup();
        self.faces = faces;
        if rim.len() >= 3 {
            self.order_around(&plane.normal, &mut rim);
            self.faces.push(rim);
        }
        Some(self)
    }

    /// Orders vertices of a convex polygon counter-clockwise about a normal.
    fn order_around(&self, normal: &Vec3, rim: &mut [usize]) {
        let middle = rim.iter().map(|&v| self.vertices[v]).sum::<Vec3>() / rim.len() as f64;
        let first = self.vertices[rim[0]] - middle;
        let second = normal.cross(&first);
        let angle = |v: usize| {
            let arm = self.vertices[v] - middle;
            libm::atan2(arm.dot(&second), arm.dot(&first))
        };
        rim.sort_by(|&a, &b| angle(a).total_cmp(&angle(b)).then(a.cmp(&b)));
    }

    /// Mean of its vertices.
    fn middle(&self) -> Vec3 {
        let mut used: Vec<usize> = self.faces.iter().flatten().copied().collect();
        used.sort_unstable();
        used.dedup();
        used.iter().map(|&v| self.vertices[v]).sum::<Vec3>() / used.len().max(1) as f64
    }
}

/// Cells that need no cut: those that the solid fills in part or wholly, and the number of those outside of it.
#[derive(Default)]
struct UncutCells {
    inner_cells: Vec<ConvexCell>,
    outside: usize,
}

/// Plane of some faces.
struct PlaneCounts<'f> {
    /// First of the faces in the plane.
    first: &'f FacePolygon,
    /// Number of faces in the plane.
    face_count: usize,
    /// Number of faces in front of the plane.
    in_front: usize,
}

/// Solid whose cells are cut.
struct SolidSplitter<'a> {
    /// Vertices of the whole, m.
    vertices: &'a [Vec3],
    triangles: &'a [[u32; 3]],
    /// Distance from a plane that counts as none, m.
    tolerance: f64,
    /// Comparisons of a face with a plane so far.
    comparisons: std::cell::Cell<u64>,
}

impl SolidSplitter<'_> {
    /// Numbers the planes of the faces; coplanar faces get the plane of the first of them. Returns the first faces.
    fn join_planes(&self, faces: &mut [FacePolygon]) -> Result<Vec<usize>, SplitError> {
        let mut first_faces: Vec<usize> = Vec::new();
        for k in 0..faces.len() {
            self.count_comparisons(first_faces.len())?;
            let is_coplanar = |&first: &usize| self.is_in_plane(&faces[k], &faces[first]);
            let known_plane = first_faces.iter().position(is_coplanar);
            let number = known_plane.unwrap_or_else(|| {
                first_faces.push(k);
                first_faces.len() - 1
            });
            (faces[k].plane, faces[k].plane_number) = (faces[first_faces[number]].plane, number);
        }
        Ok(first_faces)
    }

    /// Whether a face lies in the plane of another and faces the same side.
    fn is_in_plane(&self, face: &FacePolygon, other: &FacePolygon) -> bool {
        other.plane.normal.dot(&face.plane.normal) > 0.5
            && face.corners.iter().all(|corner| other.plane.height(corner).abs() <= self.tolerance)
    }

    /// Counts comparisons; errors beyond the largest number.
    fn count_comparisons(&self, count: usize) -> Result<(), SplitError> {
        self.comparisons.set(self.comparisons.get() + count as u64);
        if self.comparisons.get() <= MAX_SPLIT_COMPARISONS {
            return Ok(());
        }
        Err(SplitError::ManyDents { triangles: self.triangles.len() })
    }

    /// Adds the convex parts of the solid in a cell. `faces`: parts of its surface inside of the cell.
    fn split_cell(&self, cell: ConvexCell, faces: Vec<FacePolygon>, cells: &mut UncutCells) -> Result<(), SplitError> {
        let Some(cut) = self.best_cut(&faces)? else {
            if faces.is_empty() && !self.contains(&cell.middle()) {
                cells.outside += 1;
            } else {
                let mut planes: Vec<&FacePolygon> = faces.iter().collect();
                planes.sort_by(|a, b| b.doubled_area.total_cmp(&a.doubled_area));
                cells
                    .inner_cells
                    .extend(planes.iter().try_fold(cell, |cell, face| cell.clip(&face.plane, self.tolerance)));
            }
            if cells.inner_cells.len() > MAX_CONVEX_PIECES || cells.outside > 8 * MAX_CONVEX_PIECES {
                return Err(SplitError::ManyPieces);
            }
            return Ok(());
        };
        let [behind, front] = self.split_faces(&faces, &cut);
        let opposite = HalfSpace { normal: -cut.normal, offset: -cut.offset };
        for (plane, faces) in [(cut, behind), (opposite, front)] {
            if let Some(half) = cell.clone().clip(&plane, self.tolerance) {
                self.split_cell(half, faces, cells)?;
            }
        }
        Ok(())
    }

    /// Faces behind and in front of a plane. Those in the plane bound a half of the cell, as the plane does.
    fn split_faces(&self, faces: &[FacePolygon], cut: &HalfSpace) -> [Vec<FacePolygon>; 2] {
        let (mut behind, mut front) = (Vec::new(), Vec::new());
        for face in faces {
            let [part_behind, part_in_front] = face.split(cut, self.tolerance);
            behind.extend(part_behind);
            front.extend(part_in_front);
        }
        [behind, front]
    }

    /// Planes of faces, with the number of faces in each and in front of it.
    fn plane_counts<'f>(&self, faces: &'f [FacePolygon]) -> Result<Vec<PlaneCounts<'f>>, SplitError> {
        let mut planes: BTreeMap<usize, (&FacePolygon, usize)> = BTreeMap::new();
        for face in faces {
            planes.entry(face.plane_number).or_insert((face, 0)).1 += 1;
        }
        let counts = |(first, face_count): (&'f FacePolygon, usize)| {
            self.count_comparisons(faces.len())?;
            let is_in_front = |other: &&FacePolygon| other.height_over(first) > self.tolerance;
            Ok(PlaneCounts { first, face_count, in_front: faces.iter().filter(is_in_front).count() })
        };
        planes.into_values().map(counts).collect()
    }

    /// Number of pairs of a face and one in front of it.
    fn reflex_pairs(&self, faces: &[FacePolygon]) -> Result<usize, SplitError> {
        Ok(self.plane_counts(faces)?.into_iter().map(|plane| plane.face_count * plane.in_front).sum())
    }

    /// Plane of a face with others in front of it. A cut along it leaves the fewest pairs of a face and one in front of it,
    /// then the fewest faces. `None` if no face is in front of another.
    fn best_cut(&self, faces: &[FacePolygon]) -> Result<Option<HalfSpace>, SplitError> {
        // Number of faces in front of the plane of a face, and this face.
        let mut tried: Vec<(usize, &FacePolygon)> = Vec::new();
        let planes = self.plane_counts(faces)?;
        let max_cuts = MAX_CUT_COMPARISONS / (planes.len() * faces.len()).max(1);
        for PlaneCounts { first: face, in_front, .. } in planes {
            let is_known = |(_, known): &(usize, &FacePolygon)| {
                known.plane.normal.dot(&face.plane.normal).abs() > 0.5
                    && face.corners.iter().all(|corner| known.plane.height(corner).abs() <= self.tolerance)
            };
            if in_front > 0 && !tried.iter().any(is_known) {
                tried.push((in_front, face));
            }
        }
        tried.sort_by_key(|(in_front, _)| std::cmp::Reverse(*in_front));
        tried.truncate(max_cuts.clamp(2, MAX_TRIED_PLANES));
        let mut best: Option<((usize, usize), HalfSpace)> = None;
        for (_, face) in tried {
            let halves = self.split_faces(faces, &face.plane);
            let [behind, front] = [self.reflex_pairs(&halves[0])?, self.reflex_pairs(&halves[1])?];
            let cost = (behind + front, halves.iter().map(Vec::len).sum());
            if best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, face.plane));
            }
        }
        Ok(best.map(|(_, plane)| plane))
    }

    /// Whether a point is inside of the whole: the surface is seen from it under a solid angle of 4 pi, otherwise 0.
    /// Source: A. van Oosterom, J. Strackee, IEEE Trans. Biomed. Eng. 30 (1983) 125-126.
    fn contains(&self, point: &Vec3) -> bool {
        let half_angle: f64 = (self.triangles.iter())
            .map(|triangle| {
                let [a, b, c] = triangle.map(|v| self.vertices[v as usize] - point);
                let [la, lb, lc] = [a.norm(), b.norm(), c.norm()];
                let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
                libm::atan2(a.dot(&b.cross(&c)), below)
            })
            .sum();
        half_angle > std::f64::consts::PI
    }

    /// Surface of a cell in the frame of the file, `centre` away. Vertices closer than the tolerance become one, if
    /// possible that of the whole. `None` for a cell that is flat.
    fn convex_piece(&self, cell: &ConvexCell, centre: &Vec3) -> Option<ConvexPiece> {
        let is_near = |a: &Vec3, b: &Vec3| (a - b).amax() <= 4.0 * self.tolerance;
        let mut kept: Vec<Vec3> = Vec::new();
        let mut number = vec![u32::MAX; cell.vertices.len()];
        for &v in cell.faces.iter().flatten() {
            if number[v] == u32::MAX {
                let vertex = &cell.vertices[v];
                let vertex = *self.vertices.iter().find(|known| is_near(known, vertex)).unwrap_or(vertex);
                number[v] = kept.iter().position(|known| is_near(known, &vertex)).unwrap_or_else(|| {
                    kept.push(vertex);
                    kept.len() - 1
                }) as u32;
            }
        }
        let mut triangles = Vec::new();
        for face in &cell.faces {
            let mut corners: Vec<u32> = face.iter().map(|&v| number[v]).collect();
            corners.dedup();
            if corners.len() > 1 && corners.first() == corners.last() {
                corners.pop();
            }
            triangles.extend((1..corners.len().saturating_sub(1)).map(|k| [corners[0], corners[k], corners[k + 1]]));
        }
        let vertices = kept.iter().map(|vertex| (vertex + centre).into()).collect();
        (triangles.len() >= 4).then_some(ConvexPiece { vertices, triangles })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::MassProperties;
    use nalgebra::{Matrix3, UnitQuaternion};

    /// Surface of a prism from z = 0 to 1: vertices below, then above; `rims` are counter-clockwise, those of holes
    /// clockwise.
    fn prism(corners: &[[f64; 2]], rims: &[&[u32]], caps: &[[u32; 3]]) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
        let count = corners.len() as u32;
        let vertices = [0.0, 1.0].into_iter().flat_map(|z| corners.iter().map(move |[x, y]| [*x, *y, z])).collect();
        let above = caps.iter().map(|t| t.map(|v| v + count));
        let below = caps.iter().map(|[a, b, c]| [*a, *c, *b]);
        let sides = rims.iter().flat_map(|rim| {
            (0..rim.len()).flat_map(move |k| {
                let [a, b] = [rim[k], rim[(k + 1) % rim.len()]];
                [[a, b, b + count], [a, b + count, a + count]]
            })
        });
        (vertices, below.chain(above).chain(sides).collect())
    }

    /// Profiles of masonry: corners, rims, triangles, smallest number of convex pieces.
    type Profile = (Vec<[f64; 2]>, Vec<Vec<u32>>, Vec<[u32; 3]>, usize);

    fn profiles() -> Vec<Profile> {
        let one = |n: u32| vec![(0..n).collect::<Vec<u32>>()];
        let l = vec![[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        let u = vec![[0., 0.], [3., 0.], [3., 2.], [2., 2.], [2., 1.], [1., 1.], [1., 2.], [0., 2.]];
        let t = vec![[1., 0.], [2., 0.], [2., 2.], [3., 2.], [3., 3.], [0., 3.], [0., 2.], [1., 2.]];
        let frame = vec![[0., 0.], [3., 0.], [3., 3.], [0., 3.], [1., 1.], [2., 1.], [2., 2.], [1., 2.]];
        let ring = (0..4).flat_map(|k| [[k, (k + 1) % 4, 4 + (k + 1) % 4], [k, 4 + (k + 1) % 4, 4 + k]]).collect();
        vec![
            (l, one(6), vec![[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]], 2),
            (u, one(8), vec![[0, 1, 4], [1, 2, 3], [1, 3, 4], [0, 4, 5], [0, 5, 6], [0, 6, 7]], 3),
            (t, one(8), vec![[0, 1, 2], [0, 2, 7], [7, 2, 4], [2, 3, 4], [7, 4, 5], [5, 6, 7]], 2),
            (frame, vec![vec![0, 1, 2, 3], vec![7, 6, 5, 4]], ring, 4),
        ]
    }

    /// Pieces of a surface, after checking that they are convex and have together its mass, centre and inertia, with
    /// relative errors up to `allowed`.
    #[track_caller]
    fn checked(vertices: &[[f64; 3]], triangles: &[[u32; 3]], allowed: f64) -> usize {
        let surface = Surface::new(vertices, triangles).unwrap();
        assert!(ConvexMesh::from_contactor(vertices, triangles).is_err());
        let pieces = split_into_convex(&surface).unwrap();
        let parts: Vec<MassProperties> = (pieces.iter())
            .map(|piece| ConvexMesh::from_contactor(&piece.vertices, &piece.triangles).unwrap().1)
            .collect();
        let (sum, whole) = (MassProperties::composite(&parts), surface.mass_properties());
        let size = whole.volume.cbrt();
        assert!((sum.volume / whole.volume - 1.0).abs() < allowed, "{sum:?} {whole:?}");
        assert!((Vec3::from(sum.centre) - Vec3::from(whole.centre)).norm() < allowed * size, "{sum:?} {whole:?}");
        let inertia = Matrix3::from(whole.inertia);
        assert!((Matrix3::from(sum.inertia) - inertia).norm() < allowed * inertia.norm(), "{sum:?} {whole:?}");
        pieces.len()
    }

    #[test]
    fn profiles_of_masonry_are_exact() {
        for (corners, rims, caps, count) in profiles() {
            let rims: Vec<&[u32]> = rims.iter().map(Vec::as_slice).collect();
            let (vertices, triangles) = prism(&corners, &rims, &caps);
            // A few roundings.
            assert_eq!(checked(&vertices, &triangles, 1e-14), count);
            let turn = UnitQuaternion::from_scaled_axis(Vec3::new(0.3, -1.1, 0.7));
            for size in [1e-3, 1e3] {
                let moved = |v: &[f64; 3]| (turn * (Vec3::from(*v) * size) + Vec3::new(5.0, -7.0, 2.0) * size).into();
                let turned: Vec<[f64; 3]> = vertices.iter().map(moved).collect();
                assert_eq!(checked(&turned, &triangles, 1e-13), count, "{size}");
                // In a file: eight digits.
                let written = turned.iter().map(|v| v.map(|x| format!("{x:.7e}").parse().unwrap())).collect::<Vec<_>>();
                assert_eq!(checked(&written, &triangles, 2e-6), count, "{size}");
            }
        }
    }

    #[test]
    fn a_dent_no_deeper_than_rounding_is_not_split() {
        let dented = |depth: f64| {
            let third = 1.0 / 3.0 - depth;
            let vertices = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [third; 3]];
            let triangles = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 4], [2, 3, 4], [3, 1, 4]];
            split_into_convex(&Surface::new(&vertices, &triangles).unwrap())
        };
        assert_eq!(dented(1e-5), Err(SplitError::ShallowDents));
        let pieces = dented(0.1).unwrap();
        // Three tetrahedra would do; cuts along planes of faces make at most one more each.
        assert!((3..=6).contains(&pieces.len()), "{}", pieces.len());
    }

    #[test]
    fn more_pieces_than_allowed_are_rejected() {
        // A comb: each tooth is a piece.
        let teeth = MAX_CONVEX_PIECES + 1;
        let mut corners = vec![[0.0, 0.0], [teeth as f64, 0.0]];
        let mut caps = Vec::new();
        for k in (0..teeth).rev() {
            let x = k as f64;
            corners.extend([[x + 1.0, 1.0], [x + 0.5, 2.0], [x, 1.0]]);
        }
        // The corners between teeth occur once.
        let mut profile: Vec<[f64; 2]> = corners;
        profile.dedup();
        let right = |k: usize| (2 + 2 * k) as u32;
        for k in 0..teeth {
            caps.push([right(k), right(k) + 1, right(k) + 2]);
            caps.push([0, right(k), right(k) + 2]);
        }
        caps.push([0, 1, 2]);
        let rim: Vec<u32> = (0..profile.len() as u32).collect();
        let (vertices, triangles) = prism(&profile, &[&rim], &caps);
        let refused = split_into_convex(&Surface::new(&vertices, &triangles).unwrap()).unwrap_err();
        assert_eq!(refused, SplitError::ManyPieces);
    }
}
