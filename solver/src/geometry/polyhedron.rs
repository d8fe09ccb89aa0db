//! A convex polyhedron in its body's frame, and the same turned as its body is.

use std::collections::BTreeMap;

use nalgebra::Matrix3;

use crate::math::{Quat, Vec3};

/// Columns are as long as the next multiple of this, so that all widths of vectors fit.
pub(super) const PAD: usize = 8;

/// A convex polyhedron; its faces are polygons, not triangles.
///
/// Known pairs ask for what comes first here, which is kept short: of many grains it comes from far memory in every step.
#[derive(Debug, Clone, PartialEq)]
pub struct Polyhedron {
    /// Columns x, y, z of the vertices, padded by the first.
    columns: Vec<f64>,
    pub(super) planes: Vec<Plane>,
    /// Vertices round each face, counter-clockwise seen from outside, then the edge from each to the next; face f has
    /// `starts[f]..starts[f + 1]`.
    loops: Vec<Place>,
    starts: Vec<u32>,
    /// Edges that end at each vertex, likewise.
    spokes: Vec<Spoke>,
    spoke_starts: Vec<u32>,
    pub(super) edges: Vec<Edge>,
    vertices: Vec<Vec3>,
    /// Columns x, y, z of the normals, padded by zeros.
    pub(super) normals: Vec<f64>,
    /// Columns of the edges, each `arc_pad` long: x, y, z of the two normals and of the direction, and the cosine
    /// between the normals.
    pub(super) arcs: Vec<f64>,
    pub(super) arc_pad: usize,
    inradius: f64,
    circumradius: f64,
}

/// Which vertex, edge or face.
pub(super) type Place = u16;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Plane {
    /// Unit, outward.
    pub normal: Vec3,
    /// Largest n·x over the body, m.
    pub offset: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Edge {
    /// Ends, so that the first face has them in this order: e points along n0 × n1.
    pub ends: [Place; 2],
    pub faces: [Place; 2],
}

/// An edge seen from one of its ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Spoke {
    pub edge: Place,
    /// The vertex at its other end.
    pub to: Place,
}

impl Polyhedron {
    /// Distance from a face's plane, over the size, up to which triangles belong to it.
    pub const FLATNESS: f64 = 1e-10;
    /// The same for vertices that were rounded to seven or eight digits.
    pub const FLATNESS_OF_FILES: f64 = 1e-6;

    /// The polyhedron of a closed, outward triangulated surface about the body's centre of mass, m.
    ///
    /// Triangles in one plane become one face, and vertices that are then no corners are left out. Errors: what makes
    /// it no convex polyhedron.
    pub fn new(vertices: &[Vec3], triangles: &[[u32; 3]]) -> Result<Self, String> {
        Self::with_flatness(vertices, triangles, Self::FLATNESS)
    }

    /// The same with another tolerance of planes, over the size: [`Self::FLATNESS_OF_FILES`] where the vertices come
    /// from text.
    pub fn with_flatness(vertices: &[Vec3], triangles: &[[u32; 3]], flatness: f64) -> Result<Self, String> {
        let circumradius = vertices.iter().map(|v| v.norm()).fold(0.0, f64::max);
        if !circumradius.is_finite() || triangles.iter().flatten().any(|&v| v as usize >= vertices.len()) {
            return Err("vertices are missing or not finite".into());
        }
        let regions = Regions::grow(vertices, triangles, flatness * circumradius)?;
        let loops = regions.loops(vertices.len(), triangles)?;
        let edges = loops.iter().map(Vec::len).sum::<usize>() / 2;
        if edges > usize::from(Place::MAX) {
            return Err(format!("it has {edges} edges; {} are the most", Place::MAX));
        }
        // Vertices that are left, renumbered.
        let mut number = vec![Place::MAX; vertices.len()];
        loops.iter().flatten().for_each(|&v| number[v as usize] = 0);
        let mut kept = Vec::new();
        for (v, number) in number.iter_mut().enumerate().filter(|(_, number)| **number == 0) {
            *number = kept.len() as Place;
            kept.push(vertices[v]);
        }
        let mut shape = Polyhedron::bare(kept, circumradius);
        for corners in &loops {
            shape.add_loop(corners.iter().map(|&v| number[v as usize]));
            shape.add_plane(flatness)?;
        }
        shape.finish()?;
        Ok(shape)
    }

    /// A cuboid of these half lengths, m, along the body's axes.
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
        let mut shape = Polyhedron::bare(vertices, half_lengths.norm());
        corners.chunks(4).for_each(|corners| shape.add_loop(corners.iter().copied()));
        shape.planes = (0..6).map(|f| Plane { normal: normal(f), offset: half_lengths[f / 2] }).collect();
        shape.finish().expect("a cuboid closes");
        shape
    }

    fn bare(vertices: Vec<Vec3>, circumradius: f64) -> Self {
        Polyhedron {
            columns: Vec::new(),
            planes: Vec::new(),
            loops: Vec::new(),
            starts: vec![0],
            spokes: Vec::new(),
            spoke_starts: Vec::new(),
            edges: Vec::new(),
            vertices,
            normals: Vec::new(),
            arcs: Vec::new(),
            arc_pad: 0,
            inradius: f64::INFINITY,
            circumradius,
        }
    }

    /// Edges, columns and radii, when vertices and faces are there.
    fn finish(&mut self) -> Result<(), String> {
        self.add_edges()?;
        self.add_columns();
        self.add_arcs();
        self.inradius = self.planes.iter().map(|plane| plane.offset).fold(f64::INFINITY, f64::min);
        Ok(())
    }

    /// A face with these corners; its edges come later.
    fn add_loop(&mut self, corners: impl ExactSizeIterator<Item = Place>) {
        let end = self.loops.len() + 2 * corners.len();
        self.loops.extend(corners);
        self.loops.resize(end, Place::MAX);
        self.starts.push(end as u32);
    }

    /// The plane of the last face.
    fn add_plane(&mut self, flatness: f64) -> Result<(), String> {
        let face = self.starts.len() - 2;
        let corners = self.corners(face);
        let at = |k: usize| self.vertices[corners[k] as usize];
        let base = at(0);
        let (mut area, mut longest) = (Vec3::zeros(), 0.0f64);
        for k in 1..corners.len() {
            longest = longest.max((at(k) - base).norm());
            if k + 1 < corners.len() {
                area += (at(k) - base).cross(&(at(k + 1) - base));
            }
        }
        let normal = area / area.norm();
        let heights = |corners: &[Vec3]| corners.iter().map(|v| normal.dot(v)).fold(f64::NEG_INFINITY, f64::max);
        let offset = heights(&self.vertices);
        // A sliver's plane is known as far as its corners are over its width.
        let width = area.norm() / longest;
        let allowed = 4.0 * flatness * self.circumradius * (1.0 + self.circumradius / width);
        let outside = (0..corners.len()).map(|k| offset - normal.dot(&at(k))).fold(0.0, f64::max);
        if !offset.is_finite() || outside > allowed {
            let about: Vec<String> = base.iter().map(|x| format!("{x:.4}")).collect();
            return Err(format!("not convex: {outside:.3e} m stand out of the face at ({})", about.join(", ")));
        }
        self.planes.push(Plane { normal, offset });
        Ok(())
    }

    fn add_edges(&mut self) -> Result<(), String> {
        let mut known: BTreeMap<[Place; 2], usize> = BTreeMap::new();
        for face in 0..self.starts.len() - 1 {
            let corners = self.corners(face).to_vec();
            for (k, &a) in corners.iter().enumerate() {
                let b = corners[(k + 1) % corners.len()];
                let edge = *known.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                    self.edges.push(Edge { ends: [a, b], faces: [face as Place, Place::MAX] });
                    self.edges.len() - 1
                });
                if self.edges[edge].faces[0] != face as Place {
                    if self.edges[edge].faces[1] != Place::MAX || self.edges[edge].ends != [b, a] {
                        return Err("its faces do not close".into());
                    }
                    self.edges[edge].faces[1] = face as Place;
                }
                let side = self.starts[face] as usize + corners.len() + k;
                self.loops[side] = edge as Place;
            }
        }
        let euler = self.vertices.len() + self.planes.len() == self.edges.len() + 2;
        if !euler || self.edges.iter().any(|edge| edge.faces[1] == Place::MAX) {
            return Err("its faces do not close".into());
        }
        let mut spokes = vec![Vec::new(); self.vertices.len()];
        for (e, edge) in self.edges.iter().enumerate() {
            let [from, to] = edge.ends;
            let edge = e as Place;
            spokes[from as usize].push(Spoke { edge, to });
            spokes[to as usize].push(Spoke { edge, to: from });
        }
        self.spoke_starts.push(0);
        for of_one in spokes {
            self.spokes.extend(of_one);
            self.spoke_starts.push(self.spokes.len() as u32);
        }
        Ok(())
    }

    fn add_columns(&mut self) {
        let (vertices, normals) = (self.vertices.len().next_multiple_of(PAD), self.planes.len().next_multiple_of(PAD));
        for axis in 0..3 {
            let padded = self.vertices.iter().chain(std::iter::repeat(&self.vertices[0]));
            self.columns.extend(padded.take(vertices).map(|v| v[axis]));
        }
        for axis in 0..3 {
            let of_normals = self.planes.iter().map(|plane| plane.normal[axis]).chain(std::iter::repeat(0.0));
            self.normals.extend(of_normals.take(normals));
        }
    }

    fn add_arcs(&mut self) {
        self.arc_pad = self.edges.len().next_multiple_of(PAD);
        self.arcs = vec![0.0; 10 * self.arc_pad];
        for (e, edge) in self.edges.iter().enumerate() {
            let [n0, n1] = edge.faces.map(|f| self.planes[f as usize].normal);
            let [from, to] = edge.ends.map(|v| self.vertices[v as usize]);
            let along = (to - from).normalize();
            let row = [n0.x, n0.y, n0.z, n1.x, n1.y, n1.z, along.x, along.y, along.z, n0.dot(&n1)];
            row.iter().enumerate().for_each(|(column, x)| self.arcs[column * self.arc_pad + e] = *x);
        }
    }

    /// The same turned by `q`, body to world.
    pub fn posed(&self, q: &Quat) -> Posed<'_> {
        Posed { shape: self, turn: q.to_rotation_matrix().into_inner() }
    }

    /// Corners in the body's frame, m.
    pub fn vertices(&self) -> &[Vec3] {
        &self.vertices
    }

    /// The corners of each face, counter-clockwise seen from outside.
    pub fn faces(&self) -> impl Iterator<Item = &[u16]> {
        (0..self.planes.len()).map(|face| self.corners(face))
    }

    /// Distance from the body's centre to the nearest face's plane, m.
    pub fn inradius(&self) -> f64 {
        self.inradius
    }

    /// Distance from the body's centre to the farthest vertex, m.
    pub fn circumradius(&self) -> f64 {
        self.circumradius
    }

    /// x, y and z of the vertices, each as long as a multiple of [`PAD`]: the first comes again.
    #[inline(always)]
    pub(super) fn columns(&self) -> [&[f64]; 3] {
        let (x, rest) = self.columns.split_at(self.columns.len() / 3);
        let (y, z) = rest.split_at(x.len());
        [x, y, z]
    }

    #[inline(always)]
    pub(super) fn corners(&self, face: usize) -> &[Place] {
        let of_face = self.of_face(face);
        &of_face[..of_face.len() / 2]
    }

    /// The edges round a face; edge k goes from corner k to the next.
    #[inline(always)]
    pub(super) fn sides(&self, face: usize) -> &[Place] {
        let of_face = self.of_face(face);
        &of_face[of_face.len() / 2..]
    }

    #[inline(always)]
    fn of_face(&self, face: usize) -> &[Place] {
        &self.loops[self.starts[face] as usize..self.starts[face + 1] as usize]
    }

    /// A corner, m.
    #[inline(always)]
    pub(super) fn vertex(&self, k: usize) -> Vec3 {
        let [x, y, z] = self.columns();
        Vec3::new(x[k], y[k], z[k])
    }

    /// The edges at a vertex.
    #[inline(always)]
    pub(super) fn spokes(&self, vertex: usize) -> &[Spoke] {
        &self.spokes[self.spoke_starts[vertex] as usize..self.spoke_starts[vertex + 1] as usize]
    }
}

/// Triangles by the plane in which they lie.
struct Regions {
    of: Vec<u32>,
    /// The triangle with each directed edge.
    with_edge: BTreeMap<[u32; 2], usize>,
    count: usize,
}

impl Regions {
    /// From the largest triangle on, each takes its neighbours that lie within `tolerance` (m) of its plane, and those
    /// of these.
    fn grow(vertices: &[Vec3], triangles: &[[u32; 3]], tolerance: f64) -> Result<Self, String> {
        let mut with_edge = BTreeMap::new();
        for (k, t) in triangles.iter().enumerate() {
            for edge in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
                if with_edge.insert(edge, k).is_some() {
                    return Err("its triangles are not oriented alike".into());
                }
            }
        }
        let corners = |k: usize| triangles[k].map(|v| vertices[v as usize]);
        let doubled: Vec<Vec3> = (0..triangles.len())
            .map(|k| {
                let [a, b, c] = corners(k);
                (b - a).cross(&(c - a))
            })
            .collect();
        let mut seeds: Vec<usize> = (0..triangles.len()).collect();
        seeds.sort_by(|&i, &j| doubled[j].norm().total_cmp(&doubled[i].norm()).then(i.cmp(&j)));
        let mut of = vec![u32::MAX; triangles.len()];
        let mut count = 0;
        for seed in seeds {
            if of[seed] != u32::MAX {
                continue;
            }
            let normal = doubled[seed] / doubled[seed].norm();
            let base = corners(seed)[0];
            let mut open = vec![seed];
            of[seed] = count;
            while let Some(k) = open.pop() {
                let t = triangles[k];
                for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
                    let Some(&next) = with_edge.get(&[b, a]) else { return Err("its triangles do not close".into()) };
                    let near = corners(next).iter().all(|v| normal.dot(&(v - base)).abs() <= tolerance);
                    // Of a triangle as thin as that the direction says nothing.
                    let longest = triangle_sides(&corners(next)).fold(0.0, f64::max);
                    let alike = normal.dot(&doubled[next]) > 0.0 || doubled[next].norm() <= tolerance * longest;
                    if of[next] == u32::MAX && near && alike {
                        of[next] = count;
                        open.push(next);
                    }
                }
            }
            count += 1;
        }
        Ok(Regions { of, with_edge, count: count as usize })
    }

    /// The corners round each region, without vertices where only two regions meet.
    fn loops(&self, vertices: usize, triangles: &[[u32; 3]]) -> Result<Vec<Vec<u32>>, String> {
        let mut meeting = vec![Vec::new(); vertices];
        let mut next: Vec<BTreeMap<u32, u32>> = vec![BTreeMap::new(); self.count];
        for (t, &region) in triangles.iter().zip(&self.of) {
            for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
                if !meeting[a as usize].contains(&region) {
                    meeting[a as usize].push(region);
                }
                let border = self.of[self.with_edge[&[b, a]]] != region;
                if border && next[region as usize].insert(a, b).is_some() {
                    return Err("not convex: a face touches itself".into());
                }
            }
        }
        let mut loops = Vec::with_capacity(self.count);
        for border in &next {
            // Never empty: a closed surface has more than one plane, or its Euler number is found wrong.
            let first = border.keys().min().copied().ok_or("it has one face alone")?;
            let (mut corners, mut at, mut walked) = (Vec::new(), first, 0);
            loop {
                if meeting[at as usize].len() > 2 {
                    corners.push(at);
                }
                walked += 1;
                at = *border.get(&at).ok_or("its faces do not close")?;
                if at == first || walked > border.len() {
                    break;
                }
            }
            if walked != border.len() || corners.len() < 3 {
                return Err("not convex: a face is no polygon".into());
            }
            loops.push(corners);
        }
        Ok(loops)
    }
}

fn triangle_sides(&[a, b, c]: &[Vec3; 3]) -> impl Iterator<Item = f64> {
    [b - a, c - b, a - c].into_iter().map(|side| side.norm())
}

/// A polyhedron turned as its body is but not moved: so precision does not depend on how far from the origin the body is.
///
/// Of a shape only what a contact asks for is turned, then and there: most of the work of a pair is reading memory, and
/// directions are turned into the shape's frame for less than vertices out of it.
#[derive(Debug, Clone, Copy)]
pub struct Posed<'a> {
    pub(super) shape: &'a Polyhedron,
    /// Body to world.
    pub(super) turn: Matrix3<f64>,
}

impl Posed<'_> {
    #[inline(always)]
    pub(super) fn vertex(&self, k: impl Into<u32>) -> Vec3 {
        self.turned(&self.shape.vertex(k.into() as usize))
    }

    #[inline(always)]
    pub(super) fn normal(&self, face: impl Into<u32>) -> Vec3 {
        self.turned(&self.shape.planes[face.into() as usize].normal)
    }

    /// A number of each cache line of what every pair asks for, added up.
    pub(super) fn read_ahead(&self) -> f64 {
        self.shape.columns.iter().step_by(PAD).sum::<f64>() + self.turn.m11 + self.turn.m33
    }

    /// A vector of the shape's frame in the world's. Written out, so that it is the same to the bit wherever it is inlined.
    #[inline(always)]
    pub(super) fn turned(&self, v: &Vec3) -> Vec3 {
        let m = &self.turn;
        Vec3::new(
            m.m11 * v.x + m.m12 * v.y + m.m13 * v.z,
            m.m21 * v.x + m.m22 * v.y + m.m23 * v.z,
            m.m31 * v.x + m.m32 * v.y + m.m33 * v.z,
        )
    }

    /// The reverse.
    #[inline(always)]
    pub(super) fn local(&self, v: &Vec3) -> Vec3 {
        let m = &self.turn;
        Vec3::new(
            m.m11 * v.x + m.m21 * v.y + m.m31 * v.z,
            m.m12 * v.x + m.m22 * v.y + m.m32 * v.z,
            m.m13 * v.x + m.m23 * v.y + m.m33 * v.z,
        )
    }
}
