//! Convex polyhedron in its body's frame, and posed by its body's orientation.

use bytemuck::{Pod, Zeroable};
use cd_formats::faces::MeshError;
pub(super) use cd_formats::faces::{ConvexMesh, FeatureIndex, PolyhedronEdge, PolyhedronPlane};
use nalgebra::Matrix3;

use crate::math::simd::SimdWidth;
use crate::math::{Quat, Vec3};

/// Padding of columns: their length is a multiple of this, so that all vector widths fit.
pub(super) const COLUMN_PAD: usize = 8;

/// Convex polyhedron; its faces are polygons, not triangles.
#[derive(Debug, Clone, PartialEq)]
pub struct Polyhedron {
    topology: PackedTopology,
    vertices: Vec<Vec3>,
    /// Columns x, y, z of the normals, padded by zeros.
    pub(super) normals: Vec<f64>,
    /// Edges on the Gauss map, as arcs between the normals of the two faces: columns, each `arc_pad` long, of x, y, z of the two
    /// normals and of the cosine of half the angle between them.
    pub(super) arcs: Vec<f64>,
    pub(super) arc_pad: usize,
    inradius: f64,
    circumradius: f64,
}

/// Data that pairs with a cached feature need, in one compact block: with many grains it comes from main memory in every
/// step.
///
/// Each section is a range of `lines` read as an array of the section's type.
#[derive(Debug, Clone, PartialEq)]
struct PackedTopology {
    lines: Vec<CacheLine>,
    /// Length of each of the columns x, y, z of the vertices, padded by the first vertex; they are at the beginning.
    column_len: usize,
    planes: Section,
    edges: Section,
    /// Start of each vertex in `half_edges`, and the end of the last.
    half_edge_starts: Section,
    half_edges: Section,
    /// Corners and edges of the faces as in [`ConvexMesh`].
    loops: Section,
    /// Start of each face in `loops`, and the end of the last.
    starts: Section,
}

/// Cache line.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
struct CacheLine([u64; 8]);

/// Start and end of a section.
type Section = [u32; 2];

impl PackedTopology {
    fn new(faces: &ConvexMesh) -> Self {
        let column_len = faces.vertices.len().next_multiple_of(COLUMN_PAD);
        let mut bytes = Vec::new();
        for axis in 0..3 {
            let padded = faces.vertices.iter().chain(std::iter::repeat(&faces.vertices[0]));
            padded.take(column_len).for_each(|v| bytes.extend(v[axis].to_ne_bytes()));
        }
        // Sections are sorted by the size of their type, largest first, so that each starts at a multiple of it.
        let planes = append_rows(&mut bytes, &faces.planes);
        let edges = append_rows(&mut bytes, &faces.edges);
        let starts = append_rows(&mut bytes, &faces.starts);
        let mut half_edges = vec![Vec::new(); faces.vertices.len()];
        for (edge, PolyhedronEdge { ends: [from, to], .. }) in (0..).zip(&faces.edges) {
            half_edges[usize::from(*from)].push(HalfEdge { edge, to: *to });
            half_edges[usize::from(*to)].push(HalfEdge { edge, to: *from });
        }
        let mut half_edge_starts = vec![0];
        for at_vertex in &half_edges {
            half_edge_starts.push(half_edge_starts[half_edge_starts.len() - 1] + at_vertex.len() as u32);
        }
        let half_edge_starts = append_rows(&mut bytes, &half_edge_starts);
        let half_edges = append_rows(&mut bytes, &half_edges.concat());
        let loops = append_rows(&mut bytes, &faces.loops);
        let mut lines = vec![CacheLine::zeroed(); bytes.len().div_ceil(size_of::<CacheLine>())];
        bytemuck::cast_slice_mut(&mut lines)[..bytes.len()].copy_from_slice(&bytes);
        PackedTopology { lines, column_len, planes, edges, starts, half_edge_starts, half_edges, loops }
    }

    #[inline(always)]
    fn section_rows<T: Pod>(&self, [start, end]: Section) -> &[T] {
        &bytemuck::cast_slice(&self.lines)[start as usize..end as usize]
    }
}

fn append_rows<T: Pod>(bytes: &mut Vec<u8>, rows: &[T]) -> Section {
    let start = bytes.len() / size_of::<T>();
    bytes.extend_from_slice(bytemuck::cast_slice(rows));
    [start, start + rows.len()].map(|k| k as u32)
}

/// Half-edge: an edge seen from one of its ends.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct HalfEdge {
    pub edge: FeatureIndex,
    /// Vertex at its other end.
    pub to: FeatureIndex,
}

impl From<ConvexMesh> for Polyhedron {
    fn from(faces: ConvexMesh) -> Self {
        let topology = PackedTopology::new(&faces);
        let ConvexMesh { vertices, planes, edges, circumradius, .. } = faces;
        let mut normals = Vec::new();
        for axis in 0..3 {
            let padded = planes.iter().map(|plane| plane.normal[axis]).chain(std::iter::repeat(0.0));
            normals.extend(padded.take(planes.len().next_multiple_of(COLUMN_PAD)));
        }
        let arc_pad = edges.len().next_multiple_of(COLUMN_PAD);
        let mut arcs = vec![0.0; 7 * arc_pad];
        for (e, edge) in edges.iter().enumerate() {
            let [n0, n1] = edge.faces.map(|f| planes[f as usize].normal);
            let half_angle_cosine = (0.5 * (1.0 + n0.dot(&n1))).max(0.0).sqrt();
            let row = [n0.x, n0.y, n0.z, n1.x, n1.y, n1.z, half_angle_cosine];
            row.iter().enumerate().for_each(|(column, x)| arcs[column * arc_pad + e] = *x);
        }
        let inradius = planes.iter().map(|plane| plane.offset).fold(f64::INFINITY, f64::min);
        Polyhedron { topology, vertices, normals, arcs, arc_pad, inradius, circumradius }
    }
}

impl Polyhedron {
    /// Distance from a face's plane, divided by the size, up to which triangles belong to it.
    pub const FLATNESS: f64 = 1e-10;

    /// Builds the polyhedron of a closed, outward triangulated surface about the body's centre of mass, m.
    ///
    /// Coplanar triangles become one face, and vertices that are then no corners are left out. Errors: the reason why the
    /// surface is not a convex polyhedron.
    pub fn new(vertices: &[Vec3], triangles: &[[u32; 3]]) -> Result<Self, MeshError> {
        Ok(Self::from(ConvexMesh::new(vertices, triangles, Self::FLATNESS)?))
    }

    /// Builds a cuboid of these half lengths, m, along the body's axes.
    ///
    /// ```
    /// # use cd_solve::{geometry::Polyhedron, math::Vec3};
    /// let plate = Polyhedron::cuboid(&Vec3::new(3.0, 2.0, 0.5));
    /// assert_eq!((plate.vertices().len(), plate.faces().count(), plate.inradius()), (8, 6, 0.5));
    /// ```
    pub fn cuboid(half_lengths: &Vec3) -> Self {
        let corner = |k: usize| {
            let side = |axis: usize| if k >> axis & 1 == 1 { half_lengths[axis] } else { -half_lengths[axis] };
            Vec3::new(side(0), side(1), side(2))
        };
        // Bit k of a corner's number is its side along axis k. Faces are -x, +x, -y, +y, -z, +z.
        let corners = [0, 4, 6, 2, 1, 3, 7, 5, 0, 1, 5, 4, 2, 6, 7, 3, 0, 2, 3, 1, 4, 5, 7, 6];
        let normal = |f: usize| {
            let mut n = Vec3::zeros();
            n[f / 2] = if f % 2 == 1 { 1.0 } else { -1.0 };
            n
        };
        let vertices = (0..8).map(corner).collect();
        let mut faces = ConvexMesh::from_vertices(vertices, half_lengths.norm());
        corners.chunks(4).for_each(|corners| faces.add_loop(corners.iter().copied()));
        faces.planes = (0..6).map(|f| PolyhedronPlane { normal: normal(f), offset: half_lengths[f / 2] }).collect();
        faces.add_edges().expect("a cuboid closes");
        Self::from(faces)
    }

    /// Returns the polyhedron turned by `q`, body to world.
    pub fn posed_by(&self, q: &Quat) -> PosedPolyhedron<'_> {
        PosedPolyhedron { shape: self, lines: &self.topology.lines, turn: q.to_rotation_matrix().into_inner() }
    }

    /// Corners in the body's frame, m.
    pub fn vertices(&self) -> &[Vec3] {
        &self.vertices
    }

    /// The corners of each face, counter-clockwise seen from outside.
    pub fn faces(&self) -> impl Iterator<Item = &[u16]> {
        (0..self.face_planes().len()).map(|face| self.face_corners(face))
    }

    /// Distance from the body's centre to the nearest face's plane, m.
    pub fn inradius(&self) -> f64 {
        self.inradius
    }

    /// Distance from the body's centre to the farthest vertex, m.
    pub fn circumradius(&self) -> f64 {
        self.circumradius
    }

    /// Columns x, y and z of the vertices, padded to a multiple of [`COLUMN_PAD`] by the first vertex.
    #[inline(always)]
    pub(super) fn vertex_columns(&self) -> [&[f64]; 3] {
        let (all, len) = (bytemuck::cast_slice(&self.topology.lines), self.topology.column_len);
        [&all[..len], &all[len..2 * len], &all[2 * len..3 * len]]
    }

    /// Planes of the faces.
    #[inline(always)]
    pub(super) fn face_planes(&self) -> &[PolyhedronPlane] {
        self.topology.section_rows(self.topology.planes)
    }

    /// Edges, each once.
    #[inline(always)]
    pub(super) fn edges(&self) -> &[PolyhedronEdge] {
        self.topology.section_rows(self.topology.edges)
    }

    /// Vertices of a face, counter-clockwise seen from outside.
    #[inline(always)]
    pub(super) fn face_corners(&self, face: usize) -> &[FeatureIndex] {
        let corners_and_edges = self.face_loop(face);
        &corners_and_edges[..corners_and_edges.len() / 2]
    }

    /// The edges round a face; edge k goes from corner k to the next.
    #[inline(always)]
    pub(super) fn face_edges(&self, face: usize) -> &[FeatureIndex] {
        let corners_and_edges = self.face_loop(face);
        &corners_and_edges[corners_and_edges.len() / 2..]
    }

    /// Corners of a face, then its edges.
    #[inline(always)]
    fn face_loop(&self, face: usize) -> &[FeatureIndex] {
        let starts: &[u32] = self.topology.section_rows(self.topology.starts);
        &self.topology.section_rows(self.topology.loops)[starts[face] as usize..starts[face + 1] as usize]
    }

    /// A corner, m.
    #[inline(always)]
    pub(super) fn vertex(&self, k: usize) -> Vec3 {
        let [x, y, z] = self.vertex_columns();
        Vec3::new(x[k], y[k], z[k])
    }

    /// The edges at a vertex.
    #[inline(always)]
    pub(super) fn half_edges(&self, vertex: usize) -> &[HalfEdge] {
        let starts: &[u32] = self.topology.section_rows(self.topology.half_edge_starts);
        &self.topology.section_rows(self.topology.half_edges)[starts[vertex] as usize..starts[vertex + 1] as usize]
    }
}

/// Polyhedron turned by its body's orientation but not moved, so that precision does not depend on the distance from the
/// origin.
///
/// Only the parts of a shape that a contact needs are turned, on use: most of the work of a pair is reading memory, and
/// turning directions into the shape's frame is cheaper than turning vertices out of it.
#[derive(Debug, Clone, Copy)]
pub struct PosedPolyhedron<'a> {
    pub(super) shape: &'a Polyhedron,
    /// [`PackedTopology`] of the shape, which can be prefetched without reading the shape.
    lines: &'a [CacheLine],
    /// Body to world.
    pub(super) turn: Matrix3<f64>,
}

impl PosedPolyhedron<'_> {
    /// Position of vertex `k`, m.
    #[inline(always)]
    pub(super) fn vertex(&self, k: impl Into<u32>) -> Vec3 {
        self.world_vector(&self.shape.vertex(k.into() as usize))
    }

    /// Outer unit normal of a face.
    #[inline(always)]
    pub(super) fn face_normal(&self, face: impl Into<u32>) -> Vec3 {
        self.world_vector(&self.shape.face_planes()[face.into() as usize].normal)
    }

    /// Prefetches the data that [`super::polyhedron_polyhedron`] reads.
    #[inline(always)]
    pub fn prefetch(&self, width: SimdWidth) {
        width.prefetch(self.shape);
        width.prefetch(self.lines);
    }

    /// Converts a vector from the shape's frame to the world's. Written out, so that it is bitwise the same wherever it
    /// is inlined.
    #[inline(always)]
    pub(super) fn world_vector(&self, v: &Vec3) -> Vec3 {
        let m = &self.turn;
        Vec3::new(
            m.m11 * v.x + m.m12 * v.y + m.m13 * v.z,
            m.m21 * v.x + m.m22 * v.y + m.m23 * v.z,
            m.m31 * v.x + m.m32 * v.y + m.m33 * v.z,
        )
    }

    /// Converts a vector from the world's frame to the shape's.
    #[inline(always)]
    pub(super) fn local_vector(&self, v: &Vec3) -> Vec3 {
        let m = &self.turn;
        Vec3::new(
            m.m11 * v.x + m.m21 * v.y + m.m31 * v.z,
            m.m12 * v.x + m.m22 * v.y + m.m32 * v.z,
            m.m13 * v.x + m.m23 * v.y + m.m33 * v.z,
        )
    }
}
