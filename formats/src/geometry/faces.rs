//! Conversion of a triangulated surface to the faces of a convex polyhedron: decides whether a POLYR can be computed.
//! cd-solve computes with the result; cd-pre checks it before it writes a shape.

use std::collections::BTreeMap;

use bytemuck::{Pod, Zeroable};
use nalgebra::Vector3;

use super::surface::{MassProperties, Surface, SurfaceFaults};

type Vec3 = Vector3<f64>;

/// Index of a vertex, edge or face.
pub type FeatureIndex = u16;

/// Plane of a face.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct PolyhedronPlane {
    /// Outward unit normal.
    pub normal: Vector3<f64>,
    /// Largest n·x over the body, m.
    pub offset: f64,
}

/// Edge between two faces.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct PolyhedronEdge {
    /// Ends, in the order of the first face: e points along n0 × n1.
    pub ends: [FeatureIndex; 2],
    pub faces: [FeatureIndex; 2],
}

/// Largest ratio of a triangle's distance from a face's plane to the size: vertices are rounded to seven digits.
pub const FLATNESS_OF_FILES: f64 = 1e-6;
/// Smaller values of [`FLATNESS_OF_FILES`], tried in turn for bodies that give no polyhedron with it: needles, whose
/// sides it merges.
const FINER_FLATNESS: [f64; 2] = [1e-8, 1e-10];

/// Twice the area of a plane polygon times its normal, by the right-hand rule, m².
///
/// ```
/// # use {cd_formats::faces::doubled_area, nalgebra::Vector3};
/// let square = [[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [2.0, 2.0, 1.0], [0.0, 2.0, 1.0]].map(Vector3::from);
/// assert_eq!(doubled_area(&square), Vector3::new(0.0, 0.0, 8.0));
/// ```
pub fn doubled_area(corners: &[Vector3<f64>]) -> Vector3<f64> {
    corners.windows(2).map(|pair| (pair[0] - corners[0]).cross(&(pair[1] - corners[0]))).sum()
}

/// Reason why a surface is not a convex polyhedron.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum MeshError {
    /// Faults of the surface.
    Surface(SurfaceFaults),
    /// The triangles do not make a convex polyhedron, for this reason.
    NotConvex(String),
}

impl std::fmt::Display for MeshError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            MeshError::Surface(faults) => write!(f, "{faults}"),
            MeshError::NotConvex(reason) => f.write_str(reason),
        }
    }
}

impl std::error::Error for MeshError {}

impl From<SurfaceFaults> for MeshError {
    fn from(faults: SurfaceFaults) -> Self {
        MeshError::Surface(faults)
    }
}

/// Vertices, faces and edges of a convex polyhedron.
#[derive(Debug, Clone, PartialEq)]
pub struct ConvexMesh {
    pub vertices: Vec<Vec3>,
    pub planes: Vec<PolyhedronPlane>,
    pub edges: Vec<PolyhedronEdge>,
    /// Vertices around each face, counter-clockwise seen from outside, then the edge from each to the next; face f has
    /// `starts[f]..starts[f + 1]`.
    pub loops: Vec<FeatureIndex>,
    /// Position in `loops` at which each face begins, and the end of the last.
    pub starts: Vec<u32>,
    /// Largest distance of a vertex from the centre of mass, m.
    pub circumradius: f64,
}

impl ConvexMesh {
    /// Faces of a POLYR of BODIES.DAT about its own centre of mass, and its mass properties in the frame of the file.
    ///
    /// Errors: a fault of the surface, or the reason why it is not a convex polyhedron.
    ///
    /// ```
    /// # use cd_formats::faces::ConvexMesh;
    /// let vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    /// let (faces, mass) = ConvexMesh::from_contactor(&vertices, &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]).unwrap();
    /// assert_eq!((faces.planes.len(), faces.edges.len(), mass.centre), (4, 6, [0.25; 3]));
    /// ```
    pub fn from_contactor(
        vertices: &[[f64; 3]],
        triangles: &[[u32; 3]],
    ) -> Result<(ConvexMesh, MassProperties), MeshError> {
        let surface = Surface::new(vertices, triangles)?;
        let mass = surface.mass_properties();
        let centre = Vec3::from(mass.centre);
        let local: Vec<Vec3> = surface.vertices().iter().map(|v| Vec3::from(*v) - centre).collect();
        let attempt = |flatness: f64| ConvexMesh::new(&local, surface.triangles(), flatness);
        let finer_mesh = |found| FINER_FLATNESS.iter().find_map(|flatness| attempt(*flatness).ok()).ok_or(found);
        Ok((attempt(FLATNESS_OF_FILES).or_else(finer_mesh)?, mass))
    }

    /// Builds the mesh of a closed, outward triangulated surface about the body's centre of mass, m. Triangles whose
    /// vertices lie within `flatness` times the size of a plane are merged to one face. Vertices that are then not
    /// corners are left out.
    ///
    /// Errors: the reason why it is not a convex polyhedron.
    pub fn new(vertices: &[Vec3], triangles: &[[u32; 3]], flatness: f64) -> Result<Self, MeshError> {
        let circumradius = vertices.iter().map(|v| v.norm()).fold(0.0, f64::max);
        if !circumradius.is_finite() || triangles.iter().flatten().any(|&v| v as usize >= vertices.len()) {
            return Err(MeshError::NotConvex("vertices are missing or not finite".into()));
        }
        let regions = CoplanarRegions::grow_regions(vertices, triangles, flatness * circumradius)?;
        let loops = regions.boundary_loops(vertices.len(), triangles)?;
        let edges = loops.iter().map(Vec::len).sum::<usize>() / 2;
        if edges > usize::from(FeatureIndex::MAX) {
            let reason = format!("it has {edges} edges; {} are the most", FeatureIndex::MAX);
            return Err(MeshError::NotConvex(reason));
        }
        // Remaining vertices, renumbered.
        let mut new_numbers = vec![FeatureIndex::MAX; vertices.len()];
        loops.iter().flatten().for_each(|&v| new_numbers[v as usize] = 0);
        let mut corners = Vec::new();
        for (v, number) in new_numbers.iter_mut().enumerate().filter(|(_, number)| **number == 0) {
            *number = corners.len() as FeatureIndex;
            corners.push(vertices[v]);
        }
        let mut mesh = ConvexMesh::from_vertices(corners, circumradius);
        for face_corners in &loops {
            mesh.add_loop(face_corners.iter().map(|&v| new_numbers[v as usize]));
            mesh.add_plane(flatness)?;
        }
        mesh.add_edges()?;
        Ok(mesh)
    }

    /// Vertices, m, without faces yet; `circumradius`: largest distance of one from the origin, m.
    pub fn from_vertices(vertices: Vec<Vec3>, circumradius: f64) -> Self {
        ConvexMesh { vertices, planes: Vec::new(), edges: Vec::new(), loops: Vec::new(), starts: vec![0], circumradius }
    }

    /// Adds a face with these corners; its edges are added later.
    pub fn add_loop(&mut self, corners: impl ExactSizeIterator<Item = FeatureIndex>) {
        let end = self.loops.len() + 2 * corners.len();
        self.loops.extend(corners);
        self.loops.resize(end, FeatureIndex::MAX);
        self.starts.push(end as u32);
    }

    /// Adds the plane of the last face. Errors: vertices lie farther outside of the face than `flatness` allows.
    fn add_plane(&mut self, flatness: f64) -> Result<(), MeshError> {
        let face = self.starts.len() - 2;
        let corners = self.face_corners(face);
        let corner_position = |k: usize| self.vertices[corners[k] as usize];
        let base = corner_position(0);
        let (mut area, mut longest) = (Vec3::zeros(), 0.0f64);
        for k in 1..corners.len() {
            longest = longest.max((corner_position(k) - base).norm());
            if k + 1 < corners.len() {
                area += (corner_position(k) - base).cross(&(corner_position(k + 1) - base));
            }
        }
        let normal = area / area.norm();
        let offset = self.vertices.iter().map(|v| normal.dot(v)).fold(f64::NEG_INFINITY, f64::max);
        // Accuracy of a sliver's plane: that of its corners divided by its width.
        let width = area.norm() / longest;
        let allowed = 4.0 * flatness * self.circumradius * (1.0 + self.circumradius / width);
        let excess = (0..corners.len()).map(|k| offset - normal.dot(&corner_position(k))).fold(0.0, f64::max);
        if !offset.is_finite() || excess > allowed {
            let coordinates: Vec<String> = base.iter().map(|x| format!("{x:.4}")).collect();
            let reason = format!("not convex: {excess:.3e} m outside the face at ({})", coordinates.join(", "));
            return Err(MeshError::NotConvex(reason));
        }
        self.planes.push(PolyhedronPlane { normal, offset });
        Ok(())
    }

    /// Adds the edges after all faces are there. Errors: the faces do not close.
    pub fn add_edges(&mut self) -> Result<(), MeshError> {
        let mut edges_by_ends: BTreeMap<[FeatureIndex; 2], usize> = BTreeMap::new();
        for face in 0..self.starts.len() - 1 {
            let corners = self.face_corners(face).to_vec();
            for (k, &a) in corners.iter().enumerate() {
                let b = corners[(k + 1) % corners.len()];
                let edge = *edges_by_ends.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                    self.edges.push(PolyhedronEdge { ends: [a, b], faces: [face as FeatureIndex, FeatureIndex::MAX] });
                    self.edges.len() - 1
                });
                if self.edges[edge].faces[0] != face as FeatureIndex {
                    if self.edges[edge].faces[1] != FeatureIndex::MAX || self.edges[edge].ends != [b, a] {
                        return Err(MeshError::NotConvex("its faces do not close".into()));
                    }
                    self.edges[edge].faces[1] = face as FeatureIndex;
                }
                let side = self.starts[face] as usize + corners.len() + k;
                self.loops[side] = edge as FeatureIndex;
            }
        }
        let satisfies_euler = self.vertices.len() + self.planes.len() == self.edges.len() + 2;
        if !satisfies_euler || self.edges.iter().any(|edge| edge.faces[1] == FeatureIndex::MAX) {
            return Err(MeshError::NotConvex("its faces do not close".into()));
        }
        Ok(())
    }

    /// Vertices around a face, in their order.
    fn face_corners(&self, face: usize) -> &[FeatureIndex] {
        let [start, end] = [self.starts[face], self.starts[face + 1]].map(|k| k as usize);
        &self.loops[start..start + (end - start) / 2]
    }
}

/// Regions of coplanar triangles.
struct CoplanarRegions {
    region_of_triangle: Vec<u32>,
    /// Triangle of each directed edge, by the numbers of its vertices.
    triangle_of_edge: BTreeMap<[u32; 2], usize>,
    /// Number of regions.
    count: usize,
}

impl CoplanarRegions {
    /// Grows regions from the largest triangle on: each takes its neighbours that lie within `tolerance` (m) of its
    /// plane, and their neighbours.
    fn grow_regions(vertices: &[Vec3], triangles: &[[u32; 3]], tolerance: f64) -> Result<Self, MeshError> {
        let mut triangle_of_edge = BTreeMap::new();
        for (k, t) in triangles.iter().enumerate() {
            for edge in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
                if triangle_of_edge.insert(edge, k).is_some() {
                    return Err(MeshError::NotConvex("its triangles are not oriented alike".into()));
                }
            }
        }
        let corners = |k: usize| triangles[k].map(|v| vertices[v as usize]);
        // Twice the area of each triangle times its normal, m².
        let doubled_areas: Vec<Vec3> = (0..triangles.len())
            .map(|k| {
                let [a, b, c] = corners(k);
                (b - a).cross(&(c - a))
            })
            .collect();
        let mut seeds: Vec<usize> = (0..triangles.len()).collect();
        seeds.sort_by(|&i, &j| doubled_areas[j].norm().total_cmp(&doubled_areas[i].norm()).then(i.cmp(&j)));
        let mut region_of_triangle = vec![u32::MAX; triangles.len()];
        let mut count = 0;
        for seed in seeds {
            if region_of_triangle[seed] != u32::MAX {
                continue;
            }
            let normal = doubled_areas[seed] / doubled_areas[seed].norm();
            let base = corners(seed)[0];
            let mut pending = vec![seed];
            region_of_triangle[seed] = count;
            while let Some(k) = pending.pop() {
                let t = triangles[k];
                for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
                    let Some(&next) = triangle_of_edge.get(&[b, a]) else {
                        return Err(MeshError::NotConvex("its triangles do not close".into()));
                    };
                    let is_in_plane = corners(next).iter().all(|v| normal.dot(&(v - base)).abs() <= tolerance);
                    // The normal of a triangle thinner than the tolerance is dominated by rounding.
                    let longest = triangle_sides(&corners(next)).fold(0.0, f64::max);
                    let is_thin = doubled_areas[next].norm() <= tolerance * longest;
                    let faces_alike = normal.dot(&doubled_areas[next]) > 0.0 || is_thin;
                    if region_of_triangle[next] == u32::MAX && is_in_plane && faces_alike {
                        region_of_triangle[next] = count;
                        pending.push(next);
                    }
                }
            }
            count += 1;
        }
        Ok(CoplanarRegions { region_of_triangle, triangle_of_edge, count: count as usize })
    }

    /// Corners around each region, without vertices where only two regions meet.
    fn boundary_loops(&self, vertex_count: usize, triangles: &[[u32; 3]]) -> Result<Vec<Vec<u32>>, MeshError> {
        // Regions that meet at each vertex, and for each region the next vertex behind each on its border.
        let mut regions_at_vertex = vec![Vec::new(); vertex_count];
        let mut borders: Vec<BTreeMap<u32, u32>> = vec![BTreeMap::new(); self.count];
        for (t, &region) in triangles.iter().zip(&self.region_of_triangle) {
            for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
                if !regions_at_vertex[a as usize].contains(&region) {
                    regions_at_vertex[a as usize].push(region);
                }
                let is_border = self.region_of_triangle[self.triangle_of_edge[&[b, a]]] != region;
                if is_border && borders[region as usize].insert(a, b).is_some() {
                    return Err(MeshError::NotConvex("not convex: a face touches itself".into()));
                }
            }
        }
        let mut loops = Vec::with_capacity(self.count);
        for border in &borders {
            // Never empty: a closed surface has more than one plane, or its Euler number is found wrong.
            let first =
                border.keys().min().copied().ok_or_else(|| MeshError::NotConvex("it has only one face".into()))?;
            let (mut corners, mut vertex, mut edge_count) = (Vec::new(), first, 0);
            loop {
                if regions_at_vertex[vertex as usize].len() > 2 {
                    corners.push(vertex);
                }
                edge_count += 1;
                vertex = *border.get(&vertex).ok_or_else(|| MeshError::NotConvex("its faces do not close".into()))?;
                if vertex == first || edge_count > border.len() {
                    break;
                }
            }
            if edge_count != border.len() || corners.len() < 3 {
                return Err(MeshError::NotConvex("not convex: a face is no polygon".into()));
            }
            loops.push(corners);
        }
        Ok(loops)
    }
}

/// Lengths of the sides of a triangle, m.
fn triangle_sides(&[a, b, c]: &[Vec3; 3]) -> impl Iterator<Item = f64> {
    [b - a, c - b, a - c].into_iter().map(|side| side.norm())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_edges_than_have_numbers_are_rejected() {
        // A globe: its quadrangles between two circles of latitude are flat.
        let globe = |circles: u32, meridians: u32| {
            let turn = |k: u32, of: u32| std::f64::consts::TAU * f64::from(k) / f64::from(of);
            let mut vertices = vec![Vec3::z(), -Vec3::z()];
            let mut triangles = Vec::new();
            for i in 1..=circles {
                for j in 0..meridians {
                    let (fall, east) = (0.5 * turn(i, circles + 1), turn(j, meridians));
                    vertices.push(Vec3::new(fall.sin() * east.cos(), fall.sin() * east.sin(), fall.cos()));
                    let at = |i: u32, j: u32| 2 + (i - 1) * meridians + j % meridians;
                    if i < circles {
                        triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                        triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
                    }
                }
            }
            for j in 0..meridians {
                let (next, south) = ((j + 1) % meridians, (circles - 1) * meridians);
                triangles.push([0, 2 + j, 2 + next]);
                triangles.push([1, 2 + south + next, 2 + south + j]);
            }
            ConvexMesh::new(&vertices, &triangles, 1e-10)
        };
        assert_eq!(globe(9, 12).unwrap().edges.len(), 12 * (9 + 10));
        let expected = format!("it has {} edges; 65535 are the most", 182 * (180 + 181));
        assert_eq!(globe(180, 182).err(), Some(MeshError::NotConvex(expected)));
    }
}
