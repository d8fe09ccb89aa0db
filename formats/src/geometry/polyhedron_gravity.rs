//! Gravity of a homogeneous polyhedron.
//!
//! By the divergence theorem the attraction of a homogeneous body is that of layers on its surface. With the outward normal
//! n_f of a face, the height z_f = n_f.(y - x) of its plane above the point x, and I_f = ∫ dS/|y - x| over the face:
//!
//! ```text
//! g(x) = -G rho sum_f n_f I_f        U(x) = G rho/2 sum_f z_f I_f        g = grad U
//! ```
//!
//! Near faces are integrated in closed form, those farther away numerically. Far ones are combined in a tree and expanded to the
//! third power of the ratio of their size to the distance. Several points are computed at a time, each with the sum that it
//! has alone, in a fixed order.
//!
//! Source: R. A. Werner, D. J. Scheeres, Exterior gravitation of a polyhedron derived and compared with harmonic and mascon
//! gravitation representations of asteroid 4769 Castalia (1997), whose sums over edges and faces are these by face.

use nalgebra::{Matrix3, Vector3};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::surface::Surface;

type Vec3 = Vector3<f64>;

/// Largest ratio of the radius of a node to its distance up to which it is expanded, for points near the body; the expansion
/// leaves out the fourth power. The attractions of opposite faces cancel the more the farther a point is: from V^(1/3) on the
/// ratio falls with the square root of the distance.
///
/// With 0.2 the largest error found at 180 points from 0.9 to 30 radii of irregular bodies of 512 to 32 768 faces is 2.9e-5 of
/// the attraction. With 0.15 errors are a third, for 1.7 times the terms, with 0.3 five times as large, for half.
const MAX_NODE_RATIO: f64 = 0.2;

/// Largest ratio of the radius of a face to its distance up to which it is integrated numerically, with errors of the sixth
/// power. The largest errors are then those of the expansions.
const MAX_NUMERICAL_RATIO: f64 = 0.35;

/// Squared distance of numerically integrated faces over that of expanded nodes.
const SQUARED_REACH_RATIO: f64 = (MAX_NODE_RATIO / MAX_NUMERICAL_RATIO) * (MAX_NODE_RATIO / MAX_NUMERICAL_RATIO);

/// Points that are computed at a time: two or one vectors of the instruction set.
const LANES: usize = 8;

/// One number for each of `N` points.
type Lanes<const N: usize> = [f64; N];

/// Choice among `N` points: all bits of a number are 1 or 0. Compilers vectorise selection by bits.
type Mask<const N: usize> = [u64; N];

/// Face number of nodes with several faces.
const NO_FACE: u32 = u32::MAX;

/// Largest ratio of the body's extent to the distance at which the whole body is expanded. Its cube, 9e-5, is the size of the
/// first term left out, relative to the potential; in the attraction that term has the factor 4. The errors found are below
/// 3e-5.
const MAX_FAR_RATIO: f64 = 0.045;

/// Gravity of a homogeneous polyhedron, per G times density.
#[derive(Debug, Clone, PartialEq)]
pub struct PolyhedronGravity {
    /// Nodes of the tree in depth-first order, the whole surface first.
    nodes: Vec<FaceNode>,
    /// Moments of the layers on the faces of each node.
    moments: Vec<LayerMoments>,
    /// Corners of the faces in the order of their nodes, m.
    faces: Vec<[Vec3; 3]>,
    volume: f64,
    /// Centre of mass, m.
    centre: Vec3,
    /// Radius of the ball about the centre of mass that contains the body, m.
    extent: f64,
    /// ∫ y y' dV about the centre of mass, m^5.
    second_moment: Matrix3<f64>,
}

/// Faces that are close together.
#[derive(Debug, Clone, PartialEq)]
struct FaceNode {
    /// Centre of the expansion, m.
    centre: Vec3,
    /// Square of the distance from which points near the body see the expansion, m^2.
    squared_reach: f64,
    /// Index of the next node that is not inside of this one.
    next: u32,
    /// Index of the face of a leaf, else [`NO_FACE`].
    face: u32,
}

/// Number of moments of a layer up to the third order: 1 + 3 + 5 + 7 without the traces, which do not attract.
const MOMENT_COUNT: usize = 16;

/// Moments about a centre of four layers: those whose densities are the components of the normal n, and n.y. Row k has the
/// integral of the harmonic polynomial k of [`harmonic_polynomials`] times each density, in m^2 to m^6.
#[derive(Debug, Clone, PartialEq)]
struct LayerMoments([[f64; 4]; MOMENT_COUNT]);

/// Integrals of the layers as seen from `N` points: ∫ n dS/r in m, and ∫ n.(y - x) dS/r in m^2.
#[derive(Debug, Clone, Copy, PartialEq)]
struct LayerIntegrals<const N: usize> {
    normal: [Lanes<N>; 3],
    height: Lanes<N>,
}

impl<const N: usize> LayerIntegrals<N> {
    /// Adds `term` at the points of the mask.
    #[inline(always)]
    fn add(&mut self, term: &LayerIntegrals<N>, mask: &Mask<N>) {
        let sums = self.normal.iter_mut().chain([&mut self.height]);
        for (sum, term) in sums.zip(term.normal.iter().chain([&term.height])) {
            for l in 0..N {
                sum[l] += f64::from_bits(term[l].to_bits() & mask[l]);
            }
        }
    }

    /// Adds `term` at one point.
    fn add_to_lane(&mut self, lane: usize, term: &LayerIntegrals<1>) {
        (0..3).for_each(|axis| self.normal[axis][lane] += term.normal[axis][0]);
        self.height[lane] += term.height[0];
    }
}

/// Bits that are all 1 if `condition` holds, else all 0.
#[inline(always)]
fn mask(condition: bool) -> u64 {
    if condition { u64::MAX } else { 0 }
}

/// Whether any point is chosen.
#[inline(always)]
fn is_any<const N: usize>(mask: &Mask<N>) -> bool {
    mask.iter().fold(0, |any, bits| any | bits) != 0
}

/// Squares of the lengths of `N` vectors.
#[inline(always)]
fn squared_norms<const N: usize>([x, y, z]: &[Lanes<N>; 3]) -> Lanes<N> {
    std::array::from_fn(|l| x[l] * x[l] + y[l] * y[l] + z[l] * z[l])
}

impl PolyhedronGravity {
    /// Gravity of the space inside a surface.
    pub fn new(surface: &Surface) -> Self {
        let properties = surface.mass_properties();
        let corners = |t: &[u32; 3]| t.map(|k| Vec3::from(surface.vertices()[k as usize]));
        let mut faces: Vec<[Vec3; 3]> = surface.triangles().iter().map(corners).collect();
        let centre = Vec3::from(properties.centre);
        let extent = surface.vertices().iter().map(|v| (Vec3::from(*v) - centre).norm()).fold(0.0, f64::max);
        let inertia = Matrix3::from(properties.inertia);
        let (mut nodes, mut moments) = (Vec::with_capacity(2 * faces.len()), Vec::with_capacity(2 * faces.len()));
        add_nodes(&mut faces, 0, &mut nodes, &mut moments);
        PolyhedronGravity {
            nodes,
            moments,
            faces,
            volume: properties.volume,
            centre,
            extent,
            second_moment: Matrix3::identity() * (0.5 * inertia.trace()) - inertia,
        }
    }

    /// Volume, m^3.
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// Centre of mass, m.
    pub fn centre(&self) -> Vec3 {
        self.centre
    }

    /// Attraction, m, and potential -U, m^2, at the point `x`, m, outside or inside, each per G times density.
    pub fn attraction_and_potential(&self, x: &Vec3) -> (Vec3, f64) {
        let [value] = self.attractions_and_potentials_in_lanes([*x]);
        value
    }

    /// [`attraction_and_potential`](Self::attraction_and_potential) at each of the `points`, the same numbers in less time
    /// if neighbours follow each other.
    pub fn attractions_and_potentials(&self, points: &[Vec3]) -> Vec<(Vec3, f64)> {
        let mut values = vec![(Vec3::zeros(), 0.0); points.len()];
        let arch = Arch::new();
        points.par_chunks(LANES).zip(values.par_chunks_mut(LANES)).for_each(|(points, values)| {
            if let [point] = points {
                values[0] = self.attraction_and_potential(point);
                return;
            }
            // Lanes without a point of their own repeat the last one.
            let lanes: [Vec3; LANES] = std::array::from_fn(|lane| points[lane.min(points.len() - 1)]);
            let found = arch.dispatch(EvaluateInLanes { gravity: self, points: lanes });
            values.copy_from_slice(&found[..points.len()]);
        });
        values
    }

    /// [`attraction_and_potential`](Self::attraction_and_potential) at `N` points. Points descend the tree together: a node
    /// is computed for all if one of them needs it.
    #[inline(always)]
    fn attractions_and_potentials_in_lanes<const N: usize>(&self, points: [Vec3; N]) -> [(Vec3, f64); N] {
        let x = [0, 1, 2].map(|k| points.map(|point| point[k]));
        let mut sum = LayerIntegrals { normal: [[0.0; N]; 3], height: [0.0; N] };
        let distances = points.map(|point| (point - self.centre).norm());
        // The expansion of the whole leaves out the third power of extent / distance.
        let is_far = distances.map(|distance| distance * MAX_FAR_RATIO > self.extent);
        let size = libm::cbrt(self.volume);
        let reach_factors = distances.map(|distance| distance.max(size) / size);
        // Index of the node at which each point continues.
        let mut resume_nodes: [u64; N] = is_far.map(|far| if far { u64::MAX } else { 0 });
        let mut k = 0;
        while let Some(node) = self.nodes.get(k) {
            let from_centre: [Lanes<N>; 3] = std::array::from_fn(|axis| x[axis].map(|x| x - node.centre[axis]));
            let squares = squared_norms(&from_centre);
            let is_here: Mask<N> = std::array::from_fn(|l| mask(resume_nodes[l] <= k as u64));
            let is_beyond = |reach: f64, l: usize| is_here[l] & mask(squares[l] > reach * reach_factors[l]);
            let is_expanded: Mask<N> = std::array::from_fn(|l| is_beyond(node.squared_reach, l));
            if is_any(&is_expanded) {
                sum.add(&self.moments[k].integrals(&from_centre, &squares), &is_expanded);
                for l in 0..N {
                    resume_nodes[l] = (resume_nodes[l] & !is_expanded[l]) | (u64::from(node.next) & is_expanded[l]);
                }
            }
            if let Some(face) = self.faces.get(node.face as usize) {
                let rest: Mask<N> = std::array::from_fn(|l| is_here[l] & !is_expanded[l]);
                let is_distant: Mask<N> =
                    std::array::from_fn(|l| rest[l] & is_beyond(node.squared_reach * SQUARED_REACH_RATIO, l));
                if is_any(&is_distant) {
                    sum.add(&numerical_face_integrals(face, &x), &is_distant);
                }
                for lane in (0..N).filter(|&l| rest[l] & !is_distant[l] != 0) {
                    sum.add_to_lane(lane, &face_integrals(face, &points[lane]));
                }
            }
            let next = resume_nodes.iter().fold(u64::MAX, |next, resume| next.min(*resume));
            k = if next > k as u64 { next as usize } else { k + 1 };
        }
        std::array::from_fn(|l| {
            if is_far[l] {
                return self.far_attraction_and_potential(&(points[l] - self.centre), distances[l]);
            }
            (-Vec3::from(sum.normal.map(|normal| normal[l])), -0.5 * sum.height[l])
        })
    }

    /// [`attraction_and_potential`](Self::attraction_and_potential) at `d` from the centre of mass, by the moments of the
    /// mass. With the second moment J:
    ///
    /// ```text
    /// U = V/r + (3 d.J d/r^2 - tr J)/(2 r^3)
    /// ```
    fn far_attraction_and_potential(&self, d: &Vec3, r: f64) -> (Vec3, f64) {
        let (square, cube) = (r * r, r * r * r);
        let along = d.dot(&(self.second_moment * d)) / square;
        let potential = -self.volume / r - (3.0 * along - self.second_moment.trace()) / (2.0 * cube);
        (d * (-self.volume / cube) + self.quadrupole_attraction(d, r), potential)
    }

    /// Attraction of the second moment of the mass at `d` from its centre, m; `r` = |d|.
    fn quadrupole_attraction(&self, d: &Vec3, r: f64) -> Vec3 {
        let (j_d, trace) = (self.second_moment * d, self.second_moment.trace());
        let (square, cube) = (r * r, r * r * r);
        let along = d.dot(&j_d) / square;
        (j_d * 3.0 - d * (7.5 * along - 1.5 * trace)) / (cube * square)
    }

    /// Part of an [`attraction`](Self::attraction_and_potential) at the point `x` less that of a point mass in the
    /// centre of mass, m per G times density; far from the body it keeps its digits.
    pub fn attraction_of_shape(&self, x: &Vec3, attraction: &Vec3) -> Vec3 {
        let d = x - self.centre;
        let r = d.norm();
        if r * MAX_FAR_RATIO > self.extent {
            self.quadrupole_attraction(&d, r)
        } else if r == 0.0 {
            *attraction
        } else {
            attraction + d * (self.volume / (r * r * r))
        }
    }

    /// Solid angle of the body as seen from `x`: 4 pi inside, 0 outside.
    pub fn solid_angle(&self, x: &Vec3) -> f64 {
        self.faces.iter().map(|face| face_solid_angle(&face.map(|y| y - x))).sum()
    }
}

/// [`PolyhedronGravity::attractions_and_potentials_in_lanes`], compiled for each instruction set.
struct EvaluateInLanes<'a, const N: usize> {
    gravity: &'a PolyhedronGravity,
    points: [Vec3; N],
}

impl<const N: usize> NullaryFnOnce for EvaluateInLanes<'_, N> {
    type Output = [(Vec3, f64); N];
    #[inline(always)]
    fn call(self) -> [(Vec3, f64); N] {
        self.gravity.attractions_and_potentials_in_lanes(self.points)
    }
}

/// Adds the tree of the faces in depth-first order: each node is cut in halves along the longest side of the
/// box around their centroids. `first`: index of the first of these faces among all.
fn add_nodes(faces: &mut [[Vec3; 3]], first: usize, nodes: &mut Vec<FaceNode>, moments: &mut Vec<LayerMoments>) {
    let centroid = |face: &[Vec3; 3]| (face[0] + face[1] + face[2]) / 3.0;
    let weight: f64 = faces.iter().map(|face| area_vector(face).norm()).sum();
    let centre = faces.iter().map(|face| centroid(face) * area_vector(face).norm()).sum::<Vec3>() / weight;
    let radius = faces.iter().flatten().map(|y| (y - centre).norm()).fold(0.0, f64::max);
    let index = nodes.len();
    nodes.push(FaceNode {
        centre,
        squared_reach: (radius / MAX_NODE_RATIO).powi(2),
        next: 0,
        face: if faces.len() == 1 { first as u32 } else { NO_FACE },
    });
    moments.push(LayerMoments::of_faces(faces, &centre));
    if faces.len() > 1 {
        let ends = |choose: fn(f64, f64) -> f64, start: f64| {
            faces.iter().map(centroid).fold(Vec3::repeat(start), |end, c| end.zip_map(&c, choose))
        };
        let axis = (ends(f64::max, f64::NEG_INFINITY) - ends(f64::min, f64::INFINITY)).imax();
        faces.sort_by(|a, b| centroid(a)[axis].total_cmp(&centroid(b)[axis]));
        let middle = faces.len() / 2;
        let (low, high) = faces.split_at_mut(middle);
        add_nodes(low, first, nodes, moments);
        add_nodes(high, first + middle, nodes, moments);
    }
    nodes[index].next = nodes.len() as u32;
}

/// Normal times area of a triangle, m^2.
fn area_vector([a, b, c]: &[Vec3; 3]) -> Vec3 {
    (b - a).cross(&(c - a)) * 0.5
}

/// Harmonic polynomials of y up to the third order whose integrals are the moments of a layer: y_i y_j y_k and lower powers
/// less their traces, those of the third order as (5 y_i y_j y_k - y^2 (y_i d_jk + y_j d_ik + y_k d_ij))/2. The others follow from
/// these, as the traces are 0: that of z^2 from those of x^2 and y^2.
fn harmonic_polynomials(y: &Vec3) -> [f64; MOMENT_COUNT] {
    let [x, y, z] = [y.x, y.y, y.z];
    let [xx, yy] = [x * x, y * y];
    let square = xx + yy + z * z;
    let second = |product: f64, trace: f64| 1.5 * product - 0.5 * trace;
    let third = |product: f64, trace: f64| 2.5 * product - 0.5 * square * trace;
    [
        1.0,
        x,
        y,
        z,
        second(xx, square),
        second(yy, square),
        second(x * y, 0.0),
        second(x * z, 0.0),
        second(y * z, 0.0),
        third(xx * x, 3.0 * x),
        third(xx * y, y),
        third(xx * z, z),
        third(x * yy, x),
        third(x * y * z, 0.0),
        third(yy * y, 3.0 * y),
        third(yy * z, z),
    ]
}

/// Factors of the moments of [`harmonic_polynomials`] in the expansion of ∫ dS/|y - d|, `square` = |d|^2.
#[inline(always)]
fn moment_factors([x, y, z]: [f64; 3], square: f64) -> [f64; MOMENT_COUNT] {
    let [xx, yy, zz] = [x * x, y * y, z * z];
    let first = 1.0 / square.sqrt();
    let inverse_square = first * first;
    let third = first * inverse_square;
    let fifth = third * inverse_square;
    let seventh = fifth * inverse_square;
    [
        first,
        x * third,
        y * third,
        z * third,
        (xx - zz) * fifth,
        (yy - zz) * fifth,
        2.0 * x * y * fifth,
        2.0 * x * z * fifth,
        2.0 * y * z * fifth,
        x * (xx - 3.0 * zz) * seventh,
        3.0 * y * (xx - zz) * seventh,
        z * (3.0 * xx - zz) * seventh,
        3.0 * x * (yy - zz) * seventh,
        6.0 * x * y * z * seventh,
        y * (yy - 3.0 * zz) * seventh,
        z * (3.0 * yy - zz) * seventh,
    ]
}

impl LayerMoments {
    /// Exact moments about `centre`: the corners, the middles of the edges and the centroid integrate polynomials of the third
    /// order over a triangle with the weights 1/20, 2/15 and 9/20.
    fn of_faces(faces: &[[Vec3; 3]], centre: &Vec3) -> Self {
        let mut moments = [[0.0; 4]; MOMENT_COUNT];
        for face in faces {
            let layer = area_vector(face);
            let [a, b, c] = face.map(|y| y - centre);
            let densities = [layer.x, layer.y, layer.z, layer.dot(&a)];
            let corners = [a, b, c].map(|y| (y, 1.0 / 20.0));
            let middles = [a + b, b + c, c + a].map(|y| (y * 0.5, 2.0 / 15.0));
            let centroid = ((a + b + c) / 3.0, 9.0 / 20.0);
            for (y, weight) in corners.into_iter().chain(middles).chain([centroid]) {
                for (moment, polynomial) in moments.iter_mut().zip(harmonic_polynomials(&y)) {
                    (0..4).for_each(|layer| moment[layer] += weight * polynomial * densities[layer]);
                }
            }
        }
        LayerMoments(moments)
    }

    /// Integrals as seen from points at `d` from the centre, `squares` = |d|^2, to the third power of size / distance.
    #[inline(always)]
    fn integrals<const N: usize>(&self, d: &[Lanes<N>; 3], squares: &Lanes<N>) -> LayerIntegrals<N> {
        let mut factors = [[0.0; N]; MOMENT_COUNT];
        for l in 0..N {
            for (factor, value) in factors.iter_mut().zip(moment_factors([d[0][l], d[1][l], d[2][l]], squares[l])) {
                factor[l] = value;
            }
        }
        let mut layers = [[0.0; N]; 4];
        for (moment, factor) in self.0.iter().zip(&factors) {
            for (layer, moment) in layers.iter_mut().zip(moment) {
                (0..N).for_each(|l| layer[l] += factor[l] * moment);
            }
        }
        let [x, y, z, height] = layers;
        // n.(y - x) = n.y - n.d, y from the centre.
        let along: Lanes<N> = std::array::from_fn(|l| d[0][l] * x[l] + d[1][l] * y[l] + d[2][l] * z[l]);
        LayerIntegrals { normal: [x, y, z], height: std::array::from_fn(|l| height[l] - along[l]) }
    }
}

/// Points of a triangle as parts of its second and third side from the first corner, with weights, that integrate polynomials of
/// the fifth order.
/// Source: J. Radon, Zur mechanischen Kubatur (1948).
const CUBATURE: [[f64; 3]; 7] = {
    let (near, far) = (0.101_286_507_323_456_34, 0.470_142_064_105_115_1);
    let (near_weight, far_weight) = (0.125_939_180_544_827_15, 0.132_394_152_788_506_2);
    let third = 1.0 / 3.0;
    [
        [third, third, 0.225],
        [near, near, near_weight],
        [1.0 - 2.0 * near, near, near_weight],
        [near, 1.0 - 2.0 * near, near_weight],
        [far, far, far_weight],
        [1.0 - 2.0 * far, far, far_weight],
        [far, 1.0 - 2.0 * far, far_weight],
    ]
};

/// Integrals of one face as seen from the points `x`, by [`CUBATURE`].
#[inline(always)]
fn numerical_face_integrals<const N: usize>(face: &[Vec3; 3], x: &[Lanes<N>; 3]) -> LayerIntegrals<N> {
    let layer = area_vector(face);
    let [a, b, c] = face;
    let mut inverse_distances = [0.0; N];
    for [second, third, weight] in CUBATURE {
        let y = a + (b - a) * second + (c - a) * third;
        let from_point: [Lanes<N>; 3] = std::array::from_fn(|axis| x[axis].map(|x| y[axis] - x));
        let squares = squared_norms(&from_point);
        (0..N).for_each(|l| inverse_distances[l] += weight / squares[l].sqrt());
    }
    let heights: Lanes<N> =
        std::array::from_fn(|l| (0..3).map(|axis| layer[axis] * (a[axis] - x[axis][l])).sum::<f64>());
    LayerIntegrals {
        normal: std::array::from_fn(|axis| inverse_distances.map(|sum| layer[axis] * sum)),
        height: std::array::from_fn(|l| heights[l] * inverse_distances[l]),
    }
}

/// Smallest excess of the distances from the ends of an edge over its length, over the length: any number below that of
/// rounding, 1e-16, whose inverse is finite.
const MIN_EDGE_EXCESS: f64 = 1e-300;

/// Integrals of one face as seen from `x`, in closed form. With the signed distance h_e of the foot of x from each edge, the
/// distances r of its ends, its length l, the height z of the plane and the solid angle w:
///
/// ```text
/// ∫ dS/r = sum_e h_e ln((r_1 + r_2 + l)/(r_1 + r_2 - l)) - z w
/// ```
fn face_integrals(face: &[Vec3; 3], x: &Vec3) -> LayerIntegrals<1> {
    let corners = face.map(|y| y - x);
    let normal = area_vector(face).normalize();
    let height = normal.dot(&corners[0]);
    let mut integral = -height * face_solid_angle(&corners);
    for (k, start) in corners.iter().enumerate() {
        let end = corners[(k + 1) % 3];
        let edge = end - start;
        let (length, ends) = (edge.norm(), start.norm() + end.norm());
        let distance = edge.cross(&normal).dot(start) / length;
        // On the edge itself the distance is 0 and the logarithm infinite; their product is 0.
        let gap = (ends - length).max(MIN_EDGE_EXCESS * length);
        integral += distance * libm::log((ends + length) / gap);
    }
    LayerIntegrals { normal: <[f64; 3]>::from(normal * integral).map(|n| [n]), height: [height * integral] }
}

/// Solid angle of a triangle with corners relative to the point, positive if its back is seen.
/// Source: A. van Oosterom, J. Strackee, The solid angle of a plane triangle (1983).
fn face_solid_angle([a, b, c]: &[Vec3; 3]) -> f64 {
    let (r_a, r_b, r_c) = (a.norm(), b.norm(), c.norm());
    let spread = r_a * r_b * r_c + a.dot(b) * r_c + b.dot(c) * r_a + c.dot(a) * r_b;
    2.0 * libm::atan2(a.dot(&b.cross(c)), spread)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest relative error of the attraction, from inside of an irregular body to far away; 1.9e-5 is found.
    const TRUE_ERROR: f64 = 3e-5;

    /// Sides of the cube from 0 to 1.
    fn cube() -> Surface {
        let vertices: Vec<[f64; 3]> = (0..8).map(|k| [0, 1, 2].map(|i| f64::from(k >> i & 1))).collect();
        let squares = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles: Vec<[u32; 3]> = squares.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        Surface::new(&vertices, &triangles).unwrap()
    }

    /// Octahedron whose faces are cut into four `times` times, its corners at `map` of the unit vectors.
    fn ball(times: u32, map: impl Fn(Vec3) -> Vec3) -> Surface {
        let [x, y, z] = [Vec3::x(), Vec3::y(), Vec3::z()];
        let octant = |k: u32| {
            let [a, b, c] = [0, 1, 2].map(|i| 1.0 - 2.0 * f64::from(k >> i & 1));
            if a * b * c > 0.0 { [x * a, y * b, z * c] } else { [x * a, z * c, y * b] }
        };
        let mut faces: Vec<[Vec3; 3]> = (0..8).map(octant).collect();
        for _ in 0..times {
            let cut = |&[a, b, c]: &[Vec3; 3]| {
                let [ab, bc, ca] = [a + b, b + c, c + a].map(|v| v.normalize());
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            };
            faces = faces.iter().flat_map(cut).collect();
        }
        let mut vertices: Vec<[f64; 3]> = Vec::new();
        let mut number = std::collections::BTreeMap::new();
        let mut index = |v: Vec3| {
            *number.entry([v.x, v.y, v.z].map(f64::to_bits)).or_insert_with(|| {
                vertices.push(map(v).into());
                vertices.len() as u32 - 1
            })
        };
        // Adding zero makes -0 equal to 0.
        let triangles: Vec<[u32; 3]> = faces.iter().map(|face| face.map(|v| index(v.add_scalar(0.0)))).collect();
        Surface::new(&vertices, &triangles).unwrap()
    }

    /// Irregular body of 512 faces.
    fn lump() -> Surface {
        ball(3, |v| v.component_mul(&Vec3::new(1.6, 1.0, 0.8)) * (1.0 + 0.2 * (3.0 * v.x).sin() * (5.0 * v.z).cos()))
    }

    /// Points on spiral directions at several distances from the surface of [`lump`], in radii.
    fn points_about() -> impl Iterator<Item = Vec3> {
        let direction = |k: usize| {
            let z = -1.0 + (k as f64 + 0.5) / 10.0;
            let angle = 2.4 * k as f64;
            Vec3::new((1.0 - z * z).sqrt() * angle.cos(), (1.0 - z * z).sqrt() * angle.sin(), z)
        };
        [0.1, 0.5, 1.0, 1.3, 2.0, 4.0, 10.0, 30.0, 100.0]
            .into_iter()
            .flat_map(move |r| (0..20).map(move |k| direction(k) * r))
    }

    fn normal_of(term: &LayerIntegrals<1>) -> Vec3 {
        Vec3::from(term.normal.map(|[normal]| normal))
    }

    /// Expansion at `d` from the centre.
    fn expanded(moments: &LayerMoments, d: &Vec3) -> LayerIntegrals<1> {
        moments.integrals(&[[d.x], [d.y], [d.z]], &[d.norm_squared()])
    }

    /// Sums over all faces, without expansions.
    fn exact(body: &PolyhedronGravity, x: &Vec3) -> (Vec3, f64) {
        body.faces
            .iter()
            .map(|face| face_integrals(face, x))
            .fold((Vec3::zeros(), 0.0), |(g, phi), term| (g - normal_of(&term), phi - 0.5 * term.height[0]))
    }

    #[test]
    fn potential_of_a_cube_at_its_corner_and_centre() {
        let cube = PolyhedronGravity::new(&cube());
        // ∫ dV/r over the unit cube from a corner; from the centre eight cubes of half the side.
        let corner = 1.5 * (2.0 + 3f64.sqrt()).ln() - std::f64::consts::FRAC_PI_4;
        let potential = |x: [f64; 3]| cube.attraction_and_potential(&Vec3::from(x)).1;
        assert!((potential([0.0; 3]) + corner).abs() < 1e-14);
        assert!((potential([1.0, 1.0, 0.0]) + corner).abs() < 1e-14);
        assert!((potential([0.5; 3]) + 2.0 * corner).abs() < 1e-14);
        // The middle of an edge: four cubes of half the side.
        assert!(potential([0.5, 0.0, 0.0]) < -corner && potential([0.5, 0.0, 0.0]) > -2.0 * corner);
        let (g, _) = cube.attraction_and_potential(&Vec3::repeat(0.5));
        assert!(g.norm() < 1e-14, "{g}");
        let (g, _) = cube.attraction_and_potential(&Vec3::zeros());
        assert!((g.x - g.y).abs() + (g.y - g.z).abs() < 1e-14 && g.x > 0.0, "{g}");
    }

    /// Divergence of the attraction by central differences.
    fn divergence(body: &PolyhedronGravity, x: &Vec3, h: f64) -> f64 {
        let slope = |k: usize| {
            let step = Vec3::ith(k, h);
            (exact(body, &(x + step)).0[k] - exact(body, &(x - step)).0[k]) / (2.0 * h)
        };
        (0..3).map(slope).sum()
    }

    #[test]
    fn the_field_obeys_poisson_s_equation() {
        let body = PolyhedronGravity::new(&lump());
        let four_pi = 4.0 * std::f64::consts::PI;
        for x in points_about() {
            let angle = body.solid_angle(&x);
            let inside = angle > 0.5 * four_pi;
            // Rounding of 512 terms.
            assert!((angle - if inside { four_pi } else { 0.0 }).abs() < 1e-11, "{x}: {angle}");
            // Central differences: h^2 and rounding / h.
            assert!((divergence(&body, &x, 1e-4) + angle).abs() < 1e-5, "{x}: {} {angle}", divergence(&body, &x, 1e-4));
        }
    }

    #[test]
    fn the_attraction_is_the_slope_of_the_potential() {
        let body = PolyhedronGravity::new(&lump());
        for x in points_about() {
            let h = 1e-4;
            let slope = Vec3::from_fn(|k, _| {
                let step = Vec3::ith(k, h);
                (exact(&body, &(x + step)).1 - exact(&body, &(x - step)).1) / (2.0 * h)
            });
            // Central differences: h^2 and rounding / h.
            assert!((exact(&body, &x).0 + slope).norm() < 1e-6, "{x}");
        }
    }

    #[test]
    fn expansions_keep_their_error() {
        let body = PolyhedronGravity::new(&lump());
        let (mut largest, mut largest_of_potential) = (0f64, 0f64);
        for x in points_about() {
            let ((g, phi), (g_exact, phi_exact)) = (body.attraction_and_potential(&x), exact(&body, &x));
            // At the centre the attraction itself vanishes.
            let scale = body.volume / x.norm().max(1.0).powi(2);
            largest = largest.max((g - g_exact).norm() / scale);
            largest_of_potential = largest_of_potential.max((phi / phi_exact - 1.0).abs());
        }
        assert!(largest < TRUE_ERROR && largest_of_potential < TRUE_ERROR, "{largest:e} {largest_of_potential:e}");
    }

    /// Two layers of one face, whose expansion leaves out the fourth power of size / distance.
    #[test]
    fn expansions_of_a_face_converge_to_fourth_order() {
        let face = [[0.3, -0.2, 0.1], [-0.4, 0.5, 0.2], [0.1, -0.3, -0.3]].map(Vec3::from);
        let centre = (face[0] + face[1] + face[2]) / 3.0;
        let moments = LayerMoments::of_faces(&[face], &centre);
        for direction in [Vec3::new(1.0, 2.0, -1.5), Vec3::new(-0.5, 0.3, 2.0), Vec3::new(0.7, -1.1, 0.2)] {
            let error = |scale: f64| {
                let d = direction * scale;
                let exact = normal_of(&face_integrals(&face, &(centre + d)));
                (normal_of(&expanded(&moments, &d)) - exact).norm() / exact.norm()
            };
            // Twice the distance: 1/16 and higher powers.
            let ratio = error(4.0) / error(8.0);
            assert!((12.0..24.0).contains(&ratio), "{direction}: {ratio}");
            let d = direction * 4.0;
            let (found, exact) = (expanded(&moments, &d), face_integrals(&face, &(centre + d)));
            let scale = normal_of(&exact).norm() * d.norm();
            assert!((found.height[0] - exact.height[0]).abs() < 1e-4 * scale, "{direction}");
        }
    }

    /// Seven points of a face leave out the sixth power of size / distance.
    #[test]
    fn numerical_integrals_of_a_face_converge_to_sixth_order() {
        let face = [[0.3, -0.2, 0.1], [-0.4, 0.5, 0.2], [0.1, -0.3, -0.3]].map(Vec3::from);
        for direction in [Vec3::new(1.0, 2.0, -1.5), Vec3::new(-0.5, 0.3, 2.0), Vec3::new(0.7, -1.1, 0.2)] {
            let error = |scale: f64| {
                let x = direction * scale;
                let found = numerical_face_integrals(&face, &[[x.x], [x.y], [x.z]]);
                let exact = face_integrals(&face, &x);
                assert!((found.height[0] / found.normal[0][0] - exact.height[0] / exact.normal[0][0]).abs() < 1e-12);
                (normal_of(&found) - normal_of(&exact)).norm() / normal_of(&exact).norm()
            };
            // Twice the distance: 1/64 and higher powers.
            let ratio = error(2.0) / error(4.0);
            assert!((40.0..110.0).contains(&ratio), "{direction}: {ratio}");
        }
    }

    /// On corners and edges of a large body the logarithms are infinite in all but the last digits.
    #[test]
    fn the_attraction_is_finite_on_corners_and_edges() {
        let large = ball(3, |v| v * 250.0);
        let body = PolyhedronGravity::new(&large);
        for triangle in large.triangles().iter().take(40) {
            let [a, b, c] = triangle.map(|k| Vec3::from(large.vertices()[k as usize]));
            for x in [a, (a + b) * 0.5, b * 0.25 + c * 0.75] {
                let (g, phi) = body.attraction_and_potential(&x);
                let expected = body.volume() / x.norm_squared();
                // A ball of 512 faces, whose surface is up to 1.5 % within it.
                assert!((g.norm() / expected - 1.0).abs() < 0.05 && phi.is_finite(), "{g} {expected}");
            }
        }
    }

    #[test]
    fn the_attraction_of_the_shape_is_what_a_point_mass_leaves() {
        let body = PolyhedronGravity::new(&lump());
        for x in points_about() {
            let (g, _) = body.attraction_and_potential(&x);
            let d = x - body.centre;
            let point_mass = -d * (body.volume / d.norm().powi(3));
            // Rounding of the difference.
            assert!((body.attraction_of_shape(&x, &g) + point_mass - g).norm() < 1e-14 * point_mass.norm(), "{x}");
        }
    }

    #[test]
    fn a_point_has_the_same_sum_alone_and_among_others() {
        let body = PolyhedronGravity::new(&lump());
        let points: Vec<Vec3> = points_about().collect();
        let alone: Vec<(Vec3, f64)> = points.iter().map(|x| body.attraction_and_potential(x)).collect();
        assert_eq!(body.attractions_and_potentials(&points), alone);
        assert_eq!(body.attractions_and_potentials(&points[..3]), alone[..3]);
    }

    #[test]
    fn a_ball_attracts_as_a_point_outside_and_linearly_inside() {
        let surface = ball(4, |v| v);
        let body = PolyhedronGravity::new(&surface);
        for x in points_about().filter(|x| (x.norm() - 1.0).abs() > 0.05) {
            let (g, _) = body.attraction_and_potential(&x);
            let r = x.norm();
            let expected =
                -x * (body.volume / if r < 1.0 { body.volume * 0.75 / std::f64::consts::PI } else { r.powi(3) });
            // 2048 faces: corners on the sphere, faces up to 4e-3 below it.
            assert!((g - expected).norm() < 5e-3 * expected.norm().max(0.1), "{x}: {g} {expected}");
        }
    }

    #[test]
    fn far_away_a_body_is_a_point_with_its_quadrupole() {
        let body = PolyhedronGravity::new(&lump());
        for k in 0..3 {
            let x = body.centre + Vec3::ith(k, 1000.0);
            let (g, phi) = body.attraction_and_potential(&x);
            let (g_exact, phi_exact) = exact(&body, &x);
            // The sum over faces cancels: its rounding is multiplied by the square of distance / extent, 4e5, and by
            // the number of terms. The next moment is a part in 1e9.
            assert!((phi / phi_exact - 1.0).abs() < 1e-6, "{phi} {phi_exact}");
            assert!((g - g_exact).norm() < 1e-6 * g.norm());
        }
    }
}
