//! Division of a solid into convex fragments without gaps, the placement `Fragments`: the cells of points at random (Voronoi
//! 1908).

use cd_formats::surface::{Surface, SurfaceFaults};
use nalgebra::Vector3;
use rustc_hash::FxHashMap;

use super::region::GrainRegion;
use crate::random::RandomStream;
use crate::shapes::hull::{self, HullError};
use crate::sphere::sphere_spiral;

/// Ratio of a distance to the solid's extent, below which vertices count as one.
const SAME_VERTEX_TOLERANCE: f64 = 1e-12;

/// Number of nearest seeds that nearly always suffice to cut out a cell.
const NEAREST_SEEDS: usize = 64;

/// Number of trial points for one seed in the solid.
const MAX_ATTEMPTS: usize = 100_000;

/// Reason why a solid is not divided into fragments.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FragmentError {
    /// No random point lies in the solid: it is too thin.
    NoSeed,
    /// A fragment is degenerate.
    DegenerateFragment(SurfaceFaults),
}

impl std::fmt::Display for FragmentError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            FragmentError::NoSeed => write!(f, "no point inside the solid in {MAX_ATTEMPTS} random trials"),
            FragmentError::DegenerateFragment(faults) => write!(f, "an invalid fragment: {faults}"),
        }
    }
}

impl std::error::Error for FragmentError {}

/// Solid to be broken, about its centre of mass, in the axes of the region. A round region becomes a polyhedron of equal
/// volume with enough faces for `number` fragments, a surface its convex hull. Errors: a hull in a plane or not sound.
pub fn region_polyhedron(region: &GrainRegion, number: usize) -> Result<Surface, HullError> {
    let solid = match region {
        GrainRegion::Ball(radius) => ellipsoid_surface([*radius; 3], number)?,
        GrainRegion::Ellipsoid(axes) => ellipsoid_surface(*axes, number)?,
        GrainRegion::Box(halves) => {
            let corner = |k: usize| [0, 1, 2].map(|axis| if k >> axis & 1 == 0 { -halves[axis] } else { halves[axis] });
            hull::convex_hull(&(0..8).map(corner).collect::<Vec<_>>())?
        }
        GrainRegion::Cylinder { half_height, radius } => prism_surface(*half_height, *radius, number)?,
        GrainRegion::Inside(inside) => hull::convex_hull(&inside.vertices())?,
    };
    let centre = Vector3::from(solid.mass_properties().centre);
    let centred: Vec<[f64; 3]> = solid.vertices().iter().map(|&v| (Vector3::from(v) - centre).into()).collect();
    to_surface(&centred, solid.triangles())
}

/// Surface of vertices and triangles. Errors: faults of the surface.
fn to_surface(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<Surface, HullError> {
    Surface::new(vertices, triangles).map_err(|faults| HullError::Unsound(faults.to_string()))
}

/// Ellipsoid through the points of a spiral on the sphere: about two for each fragment at the surface and at least 100.
fn ellipsoid_surface(axes: [f64; 3], number: usize) -> Result<Surface, HullError> {
    // About 4.8 n^(2/3) of n cells in a ball lie at the surface.
    let count = (2.0 * 4.8 * libm::pow(number as f64, 2.0 / 3.0)).clamp(100.0, 20_000.0) as usize;
    let unit = hull::convex_hull(&sphere_spiral(count))?;
    let factor = libm::cbrt(4.0 / 3.0 * std::f64::consts::PI / unit.volume());
    let stretched: Vec<[f64; 3]> = unit.vertices().iter().map(|v| [0, 1, 2].map(|k| factor * axes[k] * v[k])).collect();
    to_surface(&stretched, unit.triangles())
}

/// Prism about the third axis, with about two sides for each fragment along a rim and at least 32.
fn prism_surface(half_height: f64, radius: f64, number: usize) -> Result<Surface, HullError> {
    let fragment_size = libm::cbrt(std::f64::consts::PI * radius * radius * 2.0 * half_height / number as f64);
    let rim_length = std::f64::consts::TAU * radius;
    let sides = (2.0 * rim_length / fragment_size).clamp(32.0, 2000.0) as usize;
    let angle = std::f64::consts::TAU / sides as f64;
    // Radius of the corners with which the polygon has the area of the circle.
    let corner_radius = radius * (angle / libm::sin(angle)).sqrt();
    let corner = |k: usize| {
        let (sin, cos) = libm::sincos(angle * (k / 2) as f64);
        [corner_radius * cos, corner_radius * sin, if k.is_multiple_of(2) { -half_height } else { half_height }]
    };
    hull::convex_hull(&(0..2 * sides).map(corner).collect::<Vec<_>>())
}

/// Divides the convex `solid` into `number` convex fragments: every point belongs to the nearest seed.
///
/// Seeds are drawn uniformly in the solid and then moved `relaxation` times to the centres of their cells (Lloyd 1982).
///
/// Errors: no point found in a thin solid; a degenerate cell.
pub fn voronoi_fragments(
    solid: &Surface,
    number: usize,
    relaxation: usize,
    random: &mut RandomStream,
) -> Result<Vec<Surface>, FragmentError> {
    let extent = solid.vertices().iter().map(|&v| Vector3::from(v).norm()).fold(0.0, f64::max);
    let half_extents = solid.vertices().iter().fold(Vector3::zeros(), |halves, &v| Vector3::from(v).abs().sup(&halves));
    let planes: Vec<CutPlane> = solid
        .triangles()
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|k| Vector3::from(solid.vertices()[k as usize]));
            let normal = (b - a).cross(&(c - a)).normalize();
            CutPlane { normal, offset: normal.dot(&a) }
        })
        .collect();
    let is_inside = |p: &Vector3<f64>| planes.iter().all(|plane| plane.signed_distance(p) < 0.0);
    let mut seeds = Vec::with_capacity(number);
    for _ in 0..number {
        // For thin bodies hardly any point of the cube lies inside.
        let seed = (0..MAX_ATTEMPTS).map(|_| extent * random.point_in_cube()).find(is_inside);
        let seed = seed
            .or_else(|| (0..MAX_ATTEMPTS).map(|_| half_extents.component_mul(&random.point_in_cube())).find(is_inside));
        seeds.push(seed.ok_or(FragmentError::NoSeed)?);
    }
    for _ in 0..relaxation {
        let cells = voronoi_cells(&planes, extent, &seeds)?;
        seeds = cells.iter().map(|cell| cell.mass_properties().centre.into()).collect();
    }
    voronoi_cells(&planes, extent, &seeds)
}

/// Cells of all seeds in the solid with these planes; `extent`: radius of a ball about the origin that contains it, m.
fn voronoi_cells(planes: &[CutPlane], extent: f64, seeds: &[Vector3<f64>]) -> Result<Vec<Surface>, FragmentError> {
    (0..seeds.len()).map(|k| voronoi_cell(planes, extent, seeds, k)).collect()
}

/// Part of the solid that is nearer to seed `k` than to all others.
fn voronoi_cell(planes: &[CutPlane], extent: f64, seeds: &[Vector3<f64>], k: usize) -> Result<Surface, FragmentError> {
    let seed = seeds[k];
    // Squared distance and index of each other seed.
    let mut others: Vec<(f64, usize)> =
        (0..seeds.len()).filter(|&j| j != k).map(|j| ((seeds[j] - seed).norm_squared(), j)).collect();
    let by_distance = |a: &(f64, usize), b: &(f64, usize)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    // With many seeds only the nearest matter: the others are rarely sorted.
    let near_count = NEAREST_SEEDS.min(others.len());
    if near_count < others.len() {
        others.select_nth_unstable_by(near_count, by_distance);
    }
    let (near, far) = others.split_at_mut(near_count);
    near.sort_by(by_distance);
    // Coordinates relative to the seed, so that small cells keep their digits.
    let mut cell = VoronoiCell::cube(2.0 * extent);
    let is_complete = cell.cut_between(&seed, seeds, near, SAME_VERTEX_TOLERANCE * extent);
    // Cells at the surface are unbounded until the planes of the solid cut them.
    let reach = cell.bounding_radius();
    for plane in planes {
        let offset = -plane.signed_distance(&seed);
        if offset <= reach {
            cell.cut_above(&CutPlane { normal: plane.normal, offset }, SAME_VERTEX_TOLERANCE * extent);
        }
    }
    if !is_complete {
        let reach = cell.bounding_radius();
        let mut far: Vec<(f64, usize)> = far.iter().copied().filter(|other| 0.5 * other.0.sqrt() <= reach).collect();
        far.sort_by(by_distance);
        cell.cut_between(&seed, seeds, &far, SAME_VERTEX_TOLERANCE * extent);
    }
    cell.to_surface(&seed)
}

/// Cutting plane; keeps the points x with normal.x < offset.
struct CutPlane {
    /// Unit normal.
    normal: Vector3<f64>,
    /// Distance from the origin along the normal, m.
    offset: f64,
}

impl CutPlane {
    /// Distance of a point above the plane, m; negative below.
    fn signed_distance(&self, point: &Vector3<f64>) -> f64 {
        self.normal.dot(point) - self.offset
    }
}

/// Convex polyhedron that is cut plane by plane.
struct VoronoiCell {
    /// Vertices relative to the seed, m.
    vertices: Vec<Vector3<f64>>,
    /// Vertices of each face, counter-clockwise seen from outside.
    faces: Vec<Vec<usize>>,
}

impl VoronoiCell {
    /// Cube with half sides `half` about the origin.
    fn cube(half: f64) -> VoronoiCell {
        let corner = |k: usize| Vector3::from_fn(|axis, _| if k >> axis & 1 == 0 { -half } else { half });
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        VoronoiCell { vertices: (0..8).map(corner).collect(), faces: faces.map(|face| face.to_vec()).into() }
    }

    /// Largest distance of a vertex from the seed, m.
    fn bounding_radius(&self) -> f64 {
        self.faces.iter().flatten().map(|&k| self.vertices[k].norm()).fold(0.0, f64::max)
    }

    /// Removes the part nearer to the `others`, by increasing squared distance, than to the cell's seed. `tolerance` as in
    /// [`VoronoiCell::cut_above`]. Returns whether seeds farther away cannot cut the cell.
    fn cut_between(
        &mut self,
        seed: &Vector3<f64>,
        seeds: &[Vector3<f64>],
        others: &[(f64, usize)],
        tolerance: f64,
    ) -> bool {
        for &(square, other) in others {
            let distance = square.sqrt();
            if 0.5 * distance > self.bounding_radius() {
                return true;
            }
            let normal = (seeds[other] - seed) / distance;
            self.cut_above(&CutPlane { normal, offset: 0.5 * distance }, tolerance);
        }
        false
    }

    /// Removes the part above the plane; vertices within `tolerance` (m) of it stay.
    fn cut_above(&mut self, plane: &CutPlane, tolerance: f64) {
        let heights: Vec<f64> = self.vertices.iter().map(|v| plane.signed_distance(v)).collect();
        if self.faces.iter().flatten().all(|&k| heights[k] <= tolerance) {
            return;
        }
        // Vertex where an edge crosses the plane, by the ends of the edge, so that both of its faces share it.
        let mut crossings: FxHashMap<[usize; 2], usize> = FxHashMap::default();
        let vertices = &mut self.vertices;
        let mut crossing_vertex = |low: usize, high: usize| {
            *crossings.entry([low, high]).or_insert_with(|| {
                if heights[low].abs() <= tolerance {
                    return low;
                }
                let share = heights[low] / (heights[low] - heights[high]);
                vertices.push(vertices[low] + (vertices[high] - vertices[low]) * share);
                vertices.len() - 1
            })
        };
        // Edges of the new face in the plane, from vertex to vertex.
        let mut cap: FxHashMap<usize, usize> = FxHashMap::default();
        let mut faces = Vec::with_capacity(self.faces.len() + 1);
        for face in &self.faces {
            let mut corners = Vec::with_capacity(face.len() + 1);
            let (mut exit, mut entry) = (None, None);
            for (i, &start) in face.iter().enumerate() {
                let end = face[(i + 1) % face.len()];
                match (heights[start] <= tolerance, heights[end] <= tolerance) {
                    (true, true) => corners.push(start),
                    (true, false) => {
                        corners.push(start);
                        let vertex = crossing_vertex(start, end);
                        corners.push(vertex);
                        exit = Some(vertex);
                    }
                    (false, true) => {
                        let vertex = crossing_vertex(end, start);
                        corners.push(vertex);
                        entry = Some(vertex);
                    }
                    (false, false) => {}
                }
            }
            corners.dedup();
            if corners.len() > 1 && corners.first() == corners.last() {
                corners.pop();
            }
            // The face runs from `exit` to `entry` along the plane, the cap in the opposite direction.
            if let (Some(exit), Some(entry)) = (exit, entry)
                && exit != entry
            {
                cap.insert(entry, exit);
            }
            if corners.len() > 2 {
                faces.push(corners);
            }
        }
        if let Some(&first) = cap.keys().min() {
            let mut face = vec![first];
            while let Some(&next) = cap.get(&face[face.len() - 1])
                && next != first
                && face.len() <= cap.len()
            {
                face.push(next);
            }
            if face.len() > 2 {
                faces.push(face);
            }
        }
        self.faces = faces;
    }

    /// Surface of the cell, translated by `seed`.
    fn to_surface(&self, seed: &Vector3<f64>) -> Result<Surface, FragmentError> {
        let mut numbers: FxHashMap<usize, u32> = FxHashMap::default();
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        for face in &self.faces {
            let face: Vec<u32> = face
                .iter()
                .map(|&k| {
                    *numbers.entry(k).or_insert_with(|| {
                        vertices.push((self.vertices[k] + seed).into());
                        vertices.len() as u32 - 1
                    })
                })
                .collect();
            triangles.extend(face[1..].windows(2).map(|pair| [face[0], pair[0], pair[1]]));
        }
        Surface::new(&vertices, &triangles).map_err(FragmentError::DegenerateFragment)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::StreamPurpose;

    fn broken_solid(region: &GrainRegion, number: usize, relaxation: usize, seed: u64) -> (Surface, Vec<Surface>) {
        let solid = region_polyhedron(region, number).unwrap();
        let fragments =
            voronoi_fragments(&solid, number, relaxation, &mut RandomStream::new(seed, 0, StreamPurpose::Positions))
                .unwrap();
        (solid, fragments)
    }

    #[test]
    fn fragments_fill_the_solid_and_are_convex() {
        let regions = [
            GrainRegion::Ball(100.0),
            GrainRegion::Ellipsoid([3.0, 2.0, 1.0]),
            GrainRegion::Box([0.5, 1.0, 0.01]),
            GrainRegion::Cylinder { half_height: 2.0, radius: 1.0 },
        ];
        for (k, region) in regions.iter().enumerate() {
            for (number, relaxation) in [(1, 0), (2, 0), (50, 0), (300, 0), (60, 5)] {
                let (solid, fragments) = broken_solid(region, number, relaxation, k as u64);
                assert_eq!(fragments.len(), number);
                let sum: f64 = fragments.iter().map(Surface::volume).sum();
                // Round-off of a few hundred sums of some hundred terms.
                assert!((sum / solid.volume() - 1.0).abs() < 1e-12, "{region}, {number}: {sum} {}", solid.volume());
                assert!((solid.volume() / region.volume() - 1.0).abs() < 1e-12, "{region}");
                assert!(fragments.iter().all(|fragment| fragment.is_convex(1e-11)), "{region}, {number}");
            }
        }
    }

    #[test]
    fn every_point_lies_in_the_fragment_of_its_nearest_seed() {
        // Two seeds: a box cut in two by the plane half-way between them.
        let solid = region_polyhedron(&GrainRegion::Box([1.0, 1.0, 1.0]), 2).unwrap();
        let planes: Vec<CutPlane> = (0..6)
            .map(|k| CutPlane {
                normal: Vector3::from_fn(
                    |axis, _| if axis == k / 2 { if k % 2 == 0 { 1.0 } else { -1.0 } } else { 0.0 },
                ),
                offset: 1.0,
            })
            .collect();
        let seeds = [Vector3::new(-0.5, 0.0, 0.0), Vector3::new(0.9, 0.0, 0.0)];
        let cells = voronoi_cells(&planes, 3f64.sqrt(), &seeds).unwrap();
        // The plane x = 0.2.
        assert!((cells[0].volume() - 4.8).abs() < 1e-14 && (cells[1].volume() - 3.2).abs() < 1e-14);
        assert!((cells[0].mass_properties().centre[0] + 0.4).abs() < 1e-15);
        assert!((solid.volume() - 8.0).abs() < 1e-14);
    }

    #[test]
    fn a_needle_breaks_too() {
        let (solid, fragments) = broken_solid(&GrainRegion::Ellipsoid([1000.0, 1.0, 1.0]), 5, 0, 1);
        let sum: f64 = fragments.iter().map(Surface::volume).sum();
        assert!((sum / solid.volume() - 1.0).abs() < 1e-9, "{sum} {}", solid.volume());
    }

    #[test]
    fn relaxed_fragments_are_more_alike() {
        let spread = |relaxation| {
            let (solid, fragments) = broken_solid(&GrainRegion::Ball(1.0), 100, relaxation, 4);
            let mean = solid.volume() / 100.0;
            (fragments.iter().map(|f| (f.volume() / mean - 1.0).powi(2)).sum::<f64>() / 100.0).sqrt()
        };
        // Cells of points at random: 0.42 (E. N. Gilbert, Ann. Math. Stat. 33, 1962); after a few moves far less.
        assert!(spread(0) > 0.3 && spread(5) < 0.5 * spread(0), "{} {}", spread(0), spread(5));
    }
}
