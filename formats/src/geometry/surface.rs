//! Closed triangulated surfaces of POLYR contactors: their faults, and the mass properties of their inside.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use crate::error::Fault;
use crate::names::count_text;

type Vec3 = Vector3<f64>;

/// Closed surface in one piece, its triangles counter-clockwise seen from outside.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    vertices: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

/// Mass properties of the space inside a surface, at density 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MassProperties {
    /// Volume, m^3.
    pub volume: f64,
    /// Centre of mass, m.
    pub centre: [f64; 3],
    /// Inertia tensor about the centre of mass, m^5.
    pub inertia: [[f64; 3]; 3],
}

/// Ratio of the height of a triangle to its longest side, below which its normal is undefined.
const FLAT_TRIANGLE: f64 = 1e-14;
/// Ratio of volume to area times extent, below which a surface encloses no volume; rounding leaves about 1e-16.
const FLAT_BODY: f64 = 1e-12;

/// Fault of a triangulated surface.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SurfaceFault {
    /// Element with the fault and the value found: `vertex 3 is not used`.
    pub found: String,
    /// Phrase about the expected value: `expected a corner of triangles`.
    pub expected: String,
}

impl SurfaceFault {
    /// Fault from the text of both members.
    pub fn new(found: impl Into<String>, expected: impl Into<String>) -> Self {
        SurfaceFault { found: found.into(), expected: expected.into() }
    }

    /// Fault of the file that holds the surface.
    pub fn file_fault(&self, file: &Path) -> Fault {
        Fault::new(file, None, "surface", self.found.as_str(), self.expected.as_str())
    }
}

impl std::fmt::Display for SurfaceFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}; {}", self.found, self.expected)
    }
}

/// Faults of a triangulated surface, at least one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SurfaceFaults(pub Vec<SurfaceFault>);

impl std::fmt::Display for SurfaceFaults {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0.iter().map(SurfaceFault::to_string).collect::<Vec<_>>().join("; "))
    }
}

impl std::error::Error for SurfaceFaults {}

impl Surface {
    /// Makes the orientation coherent, starting from the first triangle, and turns it outward as LMGC90 does.
    ///
    /// `triangles` contain 0-based vertex numbers. All faults are listed, with 1-based numbers as in the files: numbers
    /// that are not finite, vertices that do not exist or are not used, triangles without area, edges not shared by
    /// exactly two triangles, several pieces, one-sided surfaces, no volume.
    ///
    /// ```
    /// # use cd_formats::surface::Surface;
    /// let vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    /// let corner = Surface::new(&vertices, &[[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]).unwrap();
    /// assert!((corner.volume() - 1.0 / 6.0).abs() < 1e-16);
    /// let open = Surface::new(&vertices, &[[0, 1, 2], [0, 1, 3], [0, 2, 3]]).unwrap_err();
    /// assert_eq!(open.0.len(), 3);
    /// ```
    pub fn new(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<Self, SurfaceFaults> {
        let faults = element_faults(vertices, triangles);
        if !faults.is_empty() {
            return Err(SurfaceFaults(faults));
        }
        let mut surface = Surface { vertices: vertices.to_vec(), triangles: orient_triangles(triangles)? };
        let about = mean_vertex(vertices);
        let (mut volume, mut area) = (0.0, 0.0);
        for [a, b, c] in surface.triangle_corners(&about) {
            volume += a.dot(&b.cross(&c)) / 6.0;
            area += (b - a).cross(&(c - a)).norm() / 2.0;
        }
        // A volume that is NaN, by overflow, is rejected too.
        if volume.is_nan() || volume.abs() <= FLAT_BODY * area * surface.longest_side() {
            let found = format!("the surface encloses a volume of {volume:e}");
            return Err(SurfaceFaults(vec![SurfaceFault::new(found, "expected a body")]));
        }
        if volume < 0.0 {
            surface.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        }
        Ok(surface)
    }

    /// Vertices, m.
    pub fn vertices(&self) -> &[[f64; 3]] {
        &self.vertices
    }

    /// Triangles by 0-based vertex numbers, counter-clockwise seen from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Volume, m^3, > 0.
    pub fn volume(&self) -> f64 {
        self.moments_about(&mean_vertex(&self.vertices)).0
    }

    /// Computes exact integrals over signed tetrahedra with their tips at the centre of mass.
    ///
    /// With a tetrahedron's corners 0, a, b, c, t = a + b + c and d = a·(b × c), the volume is d/6, its centre t/4 and
    /// ∫ x x' = d/120 (a a' + b b' + c c' + t t'). The tips must be near: from an origin a thousand sizes away the
    /// tensor is wrong by percents.
    /// Source: J. Blow, A. J. Binstock, How to find the inertia tensor (or other mass properties) of a 3D solid body
    /// represented by a triangle mesh (2004).
    pub fn mass_properties(&self) -> MassProperties {
        let start = mean_vertex(&self.vertices);
        let centre = start + self.moments_about(&start).1;
        // The offset of the true centre from `centre` is the rounding of the first integration.
        let (volume, offset, second_moment) = self.moments_about(&centre);
        let second_moment = second_moment - offset * offset.transpose() * volume;
        let inertia = Matrix3::identity() * second_moment.trace() - second_moment;
        MassProperties { volume, centre: (centre + offset).into(), inertia: inertia.into() }
    }

    /// Whether every vertex is behind every triangle, if vertices may move by `tolerance` times the extent.
    ///
    /// Files with seven digits need 1e-6: the plane of a sliver is known only as far as its corners are.
    pub fn is_convex(&self, tolerance: f64) -> bool {
        let extent = self.longest_side();
        let about = mean_vertex(&self.vertices);
        let vertices: Vec<Vec3> = self.vertices.iter().map(|&v| Vec3::from(v) - about).collect();
        self.triangle_corners(&about).all(|[a, b, c]| {
            let cross = (b - a).cross(&(c - a));
            let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
            let height = cross.norm() / longest;
            let allowed = tolerance * extent * (1.0 + extent / height);
            vertices.iter().all(|v| cross.dot(&(v - a)) <= allowed * cross.norm())
        })
    }

    /// Whether a point, m, is behind the planes of all triangles, or in front of one by at most `tolerance` times the extent.
    fn is_behind_all(&self, point: &[f64; 3], tolerance: f64) -> bool {
        let allowed = tolerance * self.longest_side();
        self.triangle_corners(&Vec3::from(*point)).all(|[a, b, c]| {
            let cross = (b - a).cross(&(c - a));
            -cross.dot(&a) <= allowed * cross.norm()
        })
    }

    /// Volume (m^3), centre relative to `point` (m), and ∫ x x' about it (m^5); letters as in
    /// [`Surface::mass_properties`].
    fn moments_about(&self, point: &Vec3) -> (f64, Vec3, Matrix3<f64>) {
        let (mut sum_d, mut sum_t_d, mut sum_x_x) = (0.0, Vec3::zeros(), Matrix3::zeros());
        for [a, b, c] in self.triangle_corners(point) {
            let (d, t) = (a.dot(&b.cross(&c)), a + b + c);
            sum_d += d;
            sum_t_d += t * d;
            sum_x_x += (a * a.transpose() + b * b.transpose() + c * c.transpose() + t * t.transpose()) * d;
        }
        (sum_d / 6.0, sum_t_d / (4.0 * sum_d), sum_x_x / 120.0)
    }

    /// Corners of the triangles, relative to `point`.
    fn triangle_corners(&self, point: &Vec3) -> impl Iterator<Item = [Vec3; 3]> {
        self.triangles.iter().map(move |triangle| triangle.map(|k| Vec3::from(self.vertices[k as usize]) - point))
    }

    /// Longest side of the box along the axes, m.
    fn longest_side(&self) -> f64 {
        let side = |k: usize| {
            let (low, high) = (self.vertices.iter())
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (v[k].min(low), v[k].max(high)));
            high - low
        };
        side(0).max(side(1)).max(side(2))
    }
}

impl MassProperties {
    /// Principal moments, m^5, ascending, and principal axes, one a row, right-handed.
    ///
    /// The largest component of the first and of the second axis is positive. Axes of equal moments are arbitrary within
    /// their plane or space.
    pub fn principal_axes(&self) -> ([f64; 3], [[f64; 3]; 3]) {
        let eigen = SymmetricEigen::new(Matrix3::from(self.inertia));
        let mut order = [0, 1, 2];
        order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
        let axis = |k: usize| {
            let axis: Vec3 = eigen.eigenvectors.column(order[k]).into();
            axis * axis[axis.iamax()].signum()
        };
        let (first, second) = (axis(0), axis(1));
        (order.map(|k| eigen.eigenvalues[k]), [first, second, first.cross(&second)].map(Into::into))
    }
}

/// Mean of the vertices, m.
fn mean_vertex(vertices: &[[f64; 3]]) -> Vec3 {
    // Coordinates relative to the first vertex, so that no digits are lost far from the origin.
    let first = Vec3::from(vertices[0]);
    first + vertices.iter().map(|&v| Vec3::from(v) - first).sum::<Vec3>() / vertices.len() as f64
}

/// Faults of elements: numbers that are not finite, vertices missing or unused, triangles without area.
pub(super) fn element_faults(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Vec<SurfaceFault> {
    let mut faults = Vec::new();
    for (k, vertex) in vertices.iter().enumerate().filter(|(_, v)| v.iter().any(|x| !x.is_finite())) {
        let [x, y, z] = vertex;
        faults.push(SurfaceFault::new(format!("vertex {} is ({x}, {y}, {z})", k + 1), "expected finite numbers"));
    }
    let mut used = vec![false; vertices.len()];
    for (k, triangle) in triangles.iter().enumerate() {
        let missing: Vec<u32> = triangle.iter().copied().filter(|&v| v as usize >= vertices.len()).collect();
        for v in &missing {
            let found = format!("triangle {} names vertex {}", k + 1, u64::from(*v) + 1);
            faults.push(SurfaceFault::new(found, format!("expected 1 to {}", vertices.len())));
        }
        triangle.iter().filter(|&&v| (v as usize) < vertices.len()).for_each(|&v| used[v as usize] = true);
        if !missing.is_empty() {
            continue;
        }
        let [a, b, c] = triangle.map(|v| Vec3::from(vertices[v as usize]));
        let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
        if (b - a).cross(&(c - a)).norm() <= FLAT_TRIANGLE * longest * longest {
            let corners = triangle.map(|v| (v + 1).to_string()).join(", ");
            let found = format!("triangle {} of vertices {corners} has no area", k + 1);
            faults.push(SurfaceFault::new(found, "expected a triangle"));
        }
    }
    if triangles.is_empty() {
        faults.push(SurfaceFault::new("there are no triangles", "expected a closed surface"));
    } else {
        for (k, _) in used.iter().enumerate().filter(|(_, used)| !**used) {
            faults.push(SurfaceFault::new(format!("vertex {} is not used", k + 1), "expected a corner of triangles"));
        }
    }
    faults
}

/// Triangulated surface of which some vertices have been removed.
#[derive(Debug, Clone, PartialEq)]
pub struct CleanedSurface {
    /// Remaining vertices, m.
    pub vertices: Vec<[f64; 3]>,
    /// Triangles by the numbers of their vertices in `vertices`, from 0.
    pub triangles: Vec<[u32; 3]>,
    /// Number of vertices that were removed.
    pub removed: usize,
}

/// Surface without the vertices that no triangle has as a corner.
///
/// Such a vertex must be behind the planes of all triangles, up to `tolerance` times the extent: it is then inside of the
/// body. Another may be meant as a corner. Returns `None` if there is such a vertex, if all vertices are used, or if the
/// surface has other faults.
pub fn without_unused_vertices(
    vertices: &[[f64; 3]],
    triangles: &[[u32; 3]],
    tolerance: f64,
) -> Option<CleanedSurface> {
    // New number of each vertex; `None` for an unused one.
    let mut numbers: Vec<Option<u32>> = vec![None; vertices.len()];
    for &corner in triangles.iter().flatten() {
        *numbers.get_mut(corner as usize)? = Some(0);
    }
    let unused: Vec<[f64; 3]> = numbers.iter().zip(vertices).filter(|(n, _)| n.is_none()).map(|(_, v)| *v).collect();
    if unused.is_empty() {
        return None;
    }
    numbers.iter_mut().flatten().zip(0..).for_each(|(number, k)| *number = k);
    let used: Vec<[f64; 3]> = numbers.iter().zip(vertices).filter(|(n, _)| n.is_some()).map(|(_, v)| *v).collect();
    let renumbered: Vec<[u32; 3]> =
        triangles.iter().map(|triangle| triangle.map(|k| numbers[k as usize].unwrap_or(k))).collect();
    let surface = Surface::new(&used, &renumbered).ok()?;
    if !unused.iter().all(|vertex| surface.is_behind_all(vertex, tolerance)) {
        return None;
    }
    Some(CleanedSurface { vertices: used, triangles: renumbered, removed: unused.len() })
}

/// Surface with vertices that coincide made one, if it is closed only then: triangles that share no vertices in the file.
///
/// Vertices coincide if their coordinates differ by at most `tolerance` times the extent; each is joined to the first at its
/// position. `None` if the surface is closed as it is, or has other faults.
pub fn with_joined_vertices(vertices: &[[f64; 3]], triangles: &[[u32; 3]], tolerance: f64) -> Option<CleanedSurface> {
    // A closed surface without holes, by Euler's formula, needs no further check.
    if triangles.len() + 4 == 2 * vertices.len() || Surface::new(vertices, triangles).is_ok() {
        return None;
    }
    let extent = |k: usize| {
        let coordinates = || vertices.iter().map(|vertex| vertex[k]);
        coordinates().fold(f64::NEG_INFINITY, f64::max) - coordinates().fold(f64::INFINITY, f64::min)
    };
    let distance = tolerance * (0..3).map(extent).fold(0.0, f64::max);
    let mut by_x: Vec<usize> = (0..vertices.len()).collect();
    by_x.sort_by(|&a, &b| vertices[a][0].total_cmp(&vertices[b][0]).then(a.cmp(&b)));
    // One vertex of each position in the order of x, and for each vertex the one of its position.
    let (mut positions, mut position_of_vertex) = (Vec::new(), vec![0; vertices.len()]);
    for k in by_x {
        let is_at_vertex = |other: usize| (0..3).all(|c| (vertices[k][c] - vertices[other][c]).abs() <= distance);
        let mut near_in_x =
            positions.iter().rev().take_while(|&&other: &&usize| vertices[k][0] - vertices[other][0] <= distance);
        let known = near_in_x.find(|&&other| is_at_vertex(other)).copied();
        position_of_vertex[k] = known.unwrap_or(k);
        positions.extend(known.is_none().then_some(k));
    }
    // New numbers of the positions, in the order of the file.
    let mut numbers: Vec<Option<u32>> = vec![None; vertices.len()];
    let mut joined = Vec::with_capacity(positions.len());
    for (vertex, &position) in vertices.iter().zip(&position_of_vertex) {
        numbers[position].get_or_insert_with(|| {
            joined.push(*vertex);
            joined.len() as u32 - 1
        });
    }
    let number = |vertex: u32| position_of_vertex.get(vertex as usize).and_then(|&position| numbers[position]);
    let renumbered: Vec<[u32; 3]> =
        triangles.iter().map(|&[a, b, c]| Some([number(a)?, number(b)?, number(c)?])).collect::<Option<_>>()?;
    Surface::new(&joined, &renumbered).ok()?;
    let removed = vertices.len() - joined.len();
    Some(CleanedSurface { vertices: joined, triangles: renumbered, removed })
}

/// Triangles with the orientation of the first. Errors: they do not form one closed surface.
fn orient_triangles(triangles: &[[u32; 3]]) -> Result<Vec<[u32; 3]>, SurfaceFaults> {
    // Triangles of each edge, and whether they traverse it from the lower number to the higher.
    let mut edges: BTreeMap<[u32; 2], Vec<(usize, bool)>> = BTreeMap::new();
    for (k, t) in triangles.iter().enumerate() {
        for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
            edges.entry([a.min(b), a.max(b)]).or_default().push((k, a < b));
        }
    }
    let mut faults = Vec::new();
    // Neighbours of each triangle, and whether their common edge is traversed alike by both, so that one is reversed.
    let mut neighbours = vec![Vec::new(); triangles.len()];
    for ([a, b], sides) in &edges {
        match sides[..] {
            [(i, along_i), (j, along_j)] => {
                neighbours[i].push((j, along_i == along_j));
                neighbours[j].push((i, along_i == along_j));
            }
            _ => {
                let count = count_text(sides.len(), "triangle");
                let found = format!("the edge of vertices {} and {} belongs to {count}", a + 1, b + 1);
                faults.push(SurfaceFault::new(found, "expected 2"));
            }
        }
    }
    // Whether each triangle is oriented against the first; `None` before it is reached from there.
    let mut is_reversed = vec![None; triangles.len()];
    is_reversed[0] = Some(false);
    let mut pending = vec![0];
    let mut one_sided = false;
    while let Some(i) = pending.pop() {
        for &(j, are_opposite) in &neighbours[i] {
            let reversed = is_reversed[i].map(|is_reversed| is_reversed ^ are_opposite);
            one_sided |= is_reversed[j].is_some() && is_reversed[j] != reversed;
            if is_reversed[j].is_none() {
                is_reversed[j] = reversed;
                pending.push(j);
            }
        }
    }
    if one_sided {
        faults.push(SurfaceFault::new("the surface is one-sided", "expected a surface that encloses a volume"));
    }
    if let (true, Some(unconnected)) = (faults.is_empty(), is_reversed.iter().position(Option::is_none)) {
        let found = format!("triangle {} is not connected with triangle 1", unconnected + 1);
        faults.push(SurfaceFault::new(found, "expected one piece"));
    }
    if !faults.is_empty() {
        return Err(SurfaceFaults(faults));
    }
    let oriented_triangle = |(&[a, b, c], is_reversed): (&[u32; 3], Option<bool>)| {
        if is_reversed == Some(true) { [a, c, b] } else { [a, b, c] }
    };
    Ok(triangles.iter().zip(is_reversed).map(oriented_triangle).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, UnitQuaternion};
    use parry3d_f64::mass_properties::MassProperties as Parry;
    use parry3d_f64::math::Vector as ParryVector;
    use parry3d_f64::transformation::convex_hull;
    use proptest::prelude::*;

    const BOX: [[u32; 3]; 12] = [
        [0, 2, 1],
        [1, 2, 3],
        [4, 5, 6],
        [5, 7, 6],
        [0, 1, 4],
        [1, 5, 4],
        [2, 6, 3],
        [3, 6, 7],
        [0, 4, 2],
        [2, 4, 6],
        [1, 3, 5],
        [3, 7, 5],
    ];

    /// Corners of a box of the half sides `h`, turned and moved.
    fn corners(h: [f64; 3], turn: &UnitQuaternion<f64>, to: Vec3) -> Vec<[f64; 3]> {
        (0..8usize)
            .map(|k| {
                let side = |axis: usize| if k >> axis & 1 == 1 { h[axis] } else { -h[axis] };
                (turn * Vec3::new(side(0), side(1), side(2)) + to).into()
            })
            .collect()
    }

    fn error(got: &MassProperties, volume: f64, centre: Vec3, inertia: Matrix3<f64>, size: f64) -> [f64; 3] {
        [
            (got.volume / volume - 1.0).abs(),
            (Vec3::from(got.centre) - centre).norm() / size,
            (Matrix3::from(got.inertia) - inertia).norm() / inertia.norm(),
        ]
    }

    #[test]
    fn boxes_needles_and_plates_of_all_sizes_follow_the_closed_form() {
        let turn = UnitQuaternion::from_scaled_axis(Vec3::new(0.3, -1.1, 0.7));
        // Allowed: rounding of the turned corners, which moves a face of a thin body by eps sizes.
        for (shape, allowed) in
            [([1.0, 1.0, 1.0], 1e-14), ([1.0, 2.0, 3.0], 1e-14), ([1.0, 1.0, 1e-3], 1e-12), ([1e-3, 1e-3, 1.0], 1e-11)]
        {
            for size in [1e-3, 1.0, 1e4] {
                let h = shape.map(|h| h * size);
                let volume = 8.0 * h[0] * h[1] * h[2];
                let moment = |a: usize, b: usize| volume * (h[a] * h[a] + h[b] * h[b]) / 3.0;
                let moments = Vec3::new(moment(1, 2), moment(0, 2), moment(0, 1));
                let r = Rotation3::from(turn).into_inner();
                let inertia = r * Matrix3::from_diagonal(&moments) * r.transpose();
                let got = Surface::new(&corners(h, &turn, Vec3::zeros()), &BOX).unwrap();
                assert!((got.volume() / volume - 1.0).abs() < allowed);
                let properties = got.mass_properties();
                let e = error(&properties, volume, Vec3::zeros(), inertia, size);
                assert!(e.iter().all(|e| *e < allowed), "{shape:?} {size}: {e:?}");
                let (principal, axes) = properties.principal_axes();
                let mut sorted: Vec<f64> = moments.iter().copied().collect();
                sorted.sort_by(f64::total_cmp);
                let axes = Matrix3::from_rows(&axes.map(|a| Vec3::from(a).transpose()));
                assert!(
                    (0..3).all(|k| (principal[k] - sorted[k]).abs() < allowed * sorted[2]),
                    "{principal:?} {sorted:?}"
                );
                assert!((axes * axes.transpose() - Matrix3::identity()).norm() < 1e-14 && axes.determinant() > 0.0);
                let rebuilt = axes.transpose() * Matrix3::from_diagonal(&principal.into()) * axes;
                assert!((rebuilt - Matrix3::from(properties.inertia)).norm() < 1e-14 * moments.norm());
            }
        }
    }

    #[test]
    fn a_corner_tetrahedron_has_its_textbook_tensor() {
        let vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let got = Surface::new(&vertices, &[[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]).unwrap().mass_properties();
        // About the centre: V (3/40) on the diagonal, V/80 off the diagonal.
        let v = 1.0 / 6.0;
        let inertia = Matrix3::from_fn(|i, j| if i == j { v * 0.075 } else { v * 0.0125 });
        let e = error(&got, v, Vec3::repeat(0.25), inertia, 1.0);
        assert!(e.iter().all(|e| *e < 1e-15), "{e:?}");
        let (moments, axes) = got.principal_axes();
        // The double moment is the smaller one; the single axis is the diagonal.
        assert!(
            (moments[1] - moments[0]).abs() < 1e-16 && (Vec3::from(axes[2]).sum().abs() - 3f64.sqrt()).abs() < 1e-15
        );
    }

    #[test]
    fn far_from_the_origin_only_the_digits_of_the_corners_are_lost() {
        let h = [1.0, 2.0, 3.0];
        let near =
            Surface::new(&corners(h, &UnitQuaternion::identity(), Vec3::zeros()), &BOX).unwrap().mass_properties();
        for far in [1e3, 1e6, 1e9] {
            let to = Vec3::new(far, -far, 0.3 * far);
            let got = Surface::new(&corners(h, &UnitQuaternion::identity(), to), &BOX).unwrap().mass_properties();
            let e = error(&got, near.volume, to, near.inertia.into(), 1.0);
            // A corner is off by eps far; a few of them add up.
            assert!(e.iter().all(|e| *e < 1e-15 + 4.0 * f64::EPSILON * far), "{far}: {e:?}");
        }
    }

    fn hull(points: &[(f64, f64, f64)], size: f64) -> Surface {
        let points: Vec<ParryVector> = points.iter().map(|p| ParryVector::new(p.0, p.1, p.2) * size).collect();
        let (vertices, triangles) = convex_hull(&points);
        let vertices: Vec<[f64; 3]> = vertices.iter().map(|v| [v.x, v.y, v.z]).collect();
        Surface::new(&vertices, &triangles).unwrap()
    }

    proptest! {
        #[test]
        fn random_hulls_agree_with_another_library(
            points in prop::collection::vec((-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64), 12..30),
            size in prop::sample::select(vec![1e-3, 1.0, 1e4]),
        ) {
            let surface = hull(&points, size);
            let got = surface.mass_properties();
            let vertices: Vec<ParryVector> = surface.vertices().iter().map(|&[x, y, z]| ParryVector::new(x, y, z)).collect();
            let other = Parry::from_convex_polyhedron(1.0, &vertices, surface.triangles());
            let centre = other.local_com;
            let far = (Vec3::from(got.centre) - Vec3::new(centre.x, centre.y, centre.z)).norm();
            // Sums of some hundred terms on either side.
            prop_assert!((got.volume / other.mass() - 1.0).abs() < 1e-12 && far < 1e-12 * size);
            // Its principal axes are lost below about 0.05 m.
            if size >= 1.0 {
                let m = other.reconstruct_inertia_matrix();
                let m = Matrix3::from_columns(&[m.x_axis, m.y_axis, m.z_axis].map(|c| Vec3::new(c.x, c.y, c.z)));
                let mine = Matrix3::from(got.inertia);
                prop_assert!((mine - m).norm() < 1e-9 * mine.norm(), "{mine} {m}");
            }
            prop_assert!(surface.is_convex(1e-12));
        }

        #[test]
        fn orientation_and_order_in_the_file_do_not_matter(
            points in prop::collection::vec((-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64), 6..20),
            swaps in prop::collection::vec((any::<bool>(), 0..3usize), 40),
        ) {
            let surface = hull(&points, 1.0);
            let mut triangles = surface.triangles().to_vec();
            for (t, &(flip, turn)) in triangles.iter_mut().zip(swaps.iter().cycle()) {
                t.rotate_left(turn);
                if flip {
                    t.swap(0, 1);
                }
            }
            let again = Surface::new(surface.vertices(), &triangles).unwrap();
            // The same triangles in the same order, so the same sums but for the turn within a triangle.
            prop_assert!((again.volume() / surface.volume() - 1.0).abs() < 1e-13);
            let normalised = |s: &Surface| -> Vec<[u32; 3]> {
                let first = |t: &[u32; 3]| (0..3).min_by_key(|&k| t[k]).unwrap();
                s.triangles().iter().map(|t| std::array::from_fn(|k| t[(first(t) + k) % 3])).collect()
            };
            prop_assert_eq!(normalised(&again), normalised(&surface));
        }
    }

    #[test]
    fn a_dent_is_not_convex_and_rounded_files_are() {
        let turn = UnitQuaternion::from_scaled_axis(Vec3::new(0.3, -1.1, 0.7));
        let mut vertices = corners([1.0, 1.0, 1e-3], &turn, Vec3::zeros());
        assert!(Surface::new(&vertices, &BOX).unwrap().is_convex(1e-14));
        vertices.iter_mut().flatten().for_each(|x| *x = (*x * 1e7).round() / 1e7);
        let rounded = Surface::new(&vertices, &BOX).unwrap();
        assert!(rounded.is_convex(1e-7) && !rounded.is_convex(1e-12));
        // With a corner pulled out the sides bend inward along their diagonals.
        vertices[7] = (turn * Vec3::new(1.5, 1.5, 1e-3)).into();
        assert!(!Surface::new(&vertices, &BOX).unwrap().is_convex(1e-6));
    }

    #[test]
    fn every_fault_is_reported() {
        let cube = corners([1.0; 3], &UnitQuaternion::identity(), Vec3::zeros());
        let faults = |vertices: &[[f64; 3]], triangles: &[[u32; 3]]| {
            let faults = Surface::new(vertices, triangles).unwrap_err();
            faults.0.iter().map(SurfaceFault::to_string).collect::<Vec<_>>().join("\n")
        };
        let mut wrong = BOX.to_vec();
        wrong[3] = [5, 7, 9];
        wrong[4] = [0, 1, 1];
        let mut more = cube.clone();
        more.push([f64::NAN, 0.0, 0.0]);
        assert_eq!(
            faults(&more, &wrong),
            "vertex 9 is (NaN, 0, 0); expected finite numbers\n\
             triangle 4 names vertex 10; expected 1 to 9\n\
             triangle 5 of vertices 1, 2, 2 has no area; expected a triangle\n\
             vertex 9 is not used; expected a corner of triangles"
        );
        let mut fin = BOX.to_vec();
        fin.push([0, 1, 7]);
        let text = faults(&cube, &fin);
        assert!(text.contains("the edge of vertices 1 and 2 belongs to 3 triangles; expected 2"), "{text}");
        assert!(text.contains("the edge of vertices 1 and 8 belongs to 1 triangle; expected 2"), "{text}");
        assert_eq!(faults(&cube, &BOX[1..]).lines().count(), 3, "the edges of a missing triangle");
        assert!(faults(&cube, &[]).contains("no triangles"));
        let flat: Vec<[f64; 3]> =
            [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.3, 0.3]].map(|[x, y]| [x, y, 0.7 * x + 0.1 * y]).into();
        assert!(faults(&flat, &[[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]).contains("encloses a volume of"));
        let two: Vec<[f64; 3]> =
            cube.iter().copied().chain(corners([1.0; 3], &UnitQuaternion::identity(), Vec3::x() * 5.0)).collect();
        let both: Vec<[u32; 3]> = BOX.into_iter().chain(BOX.map(|t| t.map(|v| v + 8))).collect();
        assert_eq!(faults(&two, &both), "triangle 13 is not connected with triangle 1; expected one piece");
        // The projective plane on six vertices: every edge twice, but one side.
        let plane = [
            [0, 1, 2],
            [0, 2, 3],
            [0, 3, 4],
            [0, 4, 5],
            [0, 5, 1],
            [1, 2, 4],
            [2, 3, 5],
            [3, 4, 1],
            [4, 5, 2],
            [5, 1, 3],
        ];
        let six: Vec<[f64; 3]> = (0..6).map(|k| [(k * k) as f64, k as f64, (k * k * k) as f64]).collect();
        assert!(faults(&six, &plane).contains("one-sided"));
    }

    #[test]
    fn triangles_without_common_vertices_are_joined() {
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let faces = [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]];
        let mut soup: Vec<[f64; 3]> = faces.iter().flatten().map(|&k: &u32| corners[k as usize]).collect();
        let own: Vec<[u32; 3]> = (0..4).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        soup[7] = [-1e-7, 1.0, 1e-7]; // up to the digits of files
        let joined = CleanedSurface { vertices: corners.to_vec(), triangles: faces.to_vec(), removed: 8 };
        assert_eq!(with_joined_vertices(&soup, &own, 1e-6), Some(joined));
        // Closed as it is, apart by more than the digits, or faulty in another way.
        assert_eq!(with_joined_vertices(&corners, &faces, 1e-6), None);
        soup[7] = [-1e-5, 1.0, 0.0];
        assert_eq!(with_joined_vertices(&soup, &own, 1e-6), None);
        soup[7] = [f64::NAN; 3];
        assert_eq!(with_joined_vertices(&soup, &own, 1e-6), None);
        assert_eq!(with_joined_vertices(&corners, &[[0, 1, 9]], 1e-6), None);
        assert_eq!(with_joined_vertices(&[], &[], 1e-6), None);
    }

    #[test]
    fn unused_vertices_inside_are_dropped() {
        let corners = [[0.0, 0.0, 0.0], [0.1, 0.1, 0.1], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let faces = [[0, 2, 3], [0, 2, 4], [0, 3, 4], [2, 3, 4]];
        let used = without_unused_vertices(&corners, &faces, 1e-6).unwrap();
        assert_eq!((&used.vertices, used.removed), (&[&corners[..1], &corners[2..]].concat(), 1));
        assert_eq!(used.triangles, [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]);

        let with = |second: [f64; 3]| [&corners[..1], &[second], &corners[2..]].concat();
        // A copy of a corner, up to the digits of files; then points outside, points that are not finite, and other faults.
        assert!(without_unused_vertices(&with([1.0, -1e-7, 0.0]), &faces, 1e-6).is_some());
        for outside in [[0.5, 0.5, 0.5], [0.1, 0.1, -0.01], [f64::NAN, 0.0, 0.0], [f64::INFINITY, 0.0, 0.0]] {
            assert_eq!(without_unused_vertices(&with(outside), &faces, 1e-6), None, "{outside:?}");
        }
        assert_eq!(without_unused_vertices(&corners, &faces[..3], 1e-6), None);
        assert_eq!(without_unused_vertices(&corners, &[[0, 2, 9]], 1e-6), None);
        assert_eq!(without_unused_vertices(&used.vertices, &used.triangles, 1e-6), None);
    }
}
