//! Gravity of a homogeneous polyhedron.
//!
//! By the divergence theorem the attraction of a homogeneous body is that of layers on its surface. With the outward normal
//! n_f of a face, the height z_f = n_f.(y - x) of its plane above the point x, and I_f = ∫ dS/|y - x| over the face:
//!
//! ```text
//! g(x) = -G rho sum_f n_f I_f        U(x) = G rho/2 sum_f z_f I_f        g = grad U
//! ```
//!
//! Near faces are integrated in closed form. Far ones are combined in a tree and expanded in powers of the ratio of
//! their size to the distance. The sums have a fixed order.
//!
//! Source: R. A. Werner, D. J. Scheeres, Exterior gravitation of a polyhedron derived and compared with harmonic and mascon
//! gravitation representations of asteroid 4769 Castalia (1997), whose sums over edges and faces are these by face.

use nalgebra::{Matrix3, Vector3};

use super::surface::Surface;

type Vec3 = Vector3<f64>;

/// Relative error of the attraction up to which far faces are expanded. It bounds the sum of the magnitudes of the
/// neglected terms; the true error is some hundred times smaller.
const EXPANSION_ERROR: f64 = 1e-3;

/// Cube root of the relative error of the expansion of the whole body: largest ratio of its extent to the distance.
const MAX_FAR_RATIO: f64 = 0.045;

/// Gravity of a homogeneous polyhedron, per G times density.
#[derive(Debug, Clone, PartialEq)]
pub struct PolyhedronGravity {
    /// Nodes of the tree in depth-first order, the whole surface first.
    nodes: Vec<FaceNode>,
    /// Area of the surface, m^2.
    area: f64,
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
    /// Largest distance of a corner from the centre, m.
    radius: f64,
    moments: LayerMoments,
    /// Index of the next node that is not inside of this one.
    next: usize,
    /// Corners of the face of a leaf, m.
    face: Option<[Vec3; 3]>,
}

/// Moments, about a centre, of layers on the faces whose densities are the components of the normal.
#[derive(Debug, Clone, PartialEq)]
struct LayerMoments {
    /// ∫ n dS, m^2.
    zeroth: Vec3,
    /// ∫ n_i y_j dS, m^3.
    first: Matrix3<f64>,
    /// ∫ n_i y y' dS for each i, m^4.
    second: [Matrix3<f64>; 3],
}

/// Integrals of the layers as seen from a point: ∫ n dS/r in m, and ∫ n.(y - x) dS/r in m^2.
#[derive(Debug, Clone, Copy, PartialEq)]
struct LayerIntegrals {
    normal: Vec3,
    height: f64,
}

impl PolyhedronGravity {
    /// Gravity of the space inside a surface.
    pub fn new(surface: &Surface) -> Self {
        let properties = surface.mass_properties();
        let corners = |t: &[u32; 3]| t.map(|k| Vec3::from(surface.vertices()[k as usize]));
        let mut faces: Vec<[Vec3; 3]> = surface.triangles().iter().map(corners).collect();
        let centre = Vec3::from(properties.centre);
        let extent = surface.vertices().iter().map(|v| (Vec3::from(*v) - centre).norm()).fold(0.0, f64::max);
        let area = faces.iter().map(|face| area_vector(face).norm()).sum();
        let inertia = Matrix3::from(properties.inertia);
        let mut nodes = Vec::with_capacity(2 * faces.len());
        add_nodes(&mut faces, &mut nodes);
        PolyhedronGravity {
            nodes,
            area,
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
        let d = x - self.centre;
        let distance = d.norm();
        // The expansion of the whole leaves out the third power of extent / distance.
        if distance * MAX_FAR_RATIO > self.extent {
            return self.far_attraction_and_potential(&d, distance);
        }
        let mut sum = LayerIntegrals { normal: Vec3::zeros(), height: 0.0 };
        let nearest = distance.max(libm::cbrt(self.volume));
        let budget = EXPANSION_ERROR * self.volume / (self.area * nearest * nearest);
        let mut k = 0;
        while let Some(node) = self.nodes.get(k) {
            let from_centre = x - node.centre;
            let r = from_centre.norm();
            let ratio = node.radius / r;
            // The expansion leaves out (radius/r)^3/r per area, and higher powers.
            let term = if ratio < 0.5 && ratio * ratio * ratio < budget * r * (1.0 - ratio) {
                k = node.next;
                node.moments.integrals(&from_centre, r)
            } else {
                k += 1;
                let Some(face) = &node.face else { continue };
                face_integrals(face, x)
            };
            sum.normal += term.normal;
            sum.height += term.height;
        }
        (-sum.normal, -0.5 * sum.height)
    }

    /// [`attraction_and_potential`](Self::attraction_and_potential) at `d` from the centre of mass, by the moments of the
    /// mass. With the second moment J:
    ///
    /// ```text
    /// U = V/r + (3 d.J d/r^2 - tr J)/(2 r^3)
    /// ```
    fn far_attraction_and_potential(&self, d: &Vec3, r: f64) -> (Vec3, f64) {
        let (j_d, trace) = (self.second_moment * d, self.second_moment.trace());
        let (square, cube) = (r * r, r * r * r);
        let along = d.dot(&j_d) / square;
        let potential = -self.volume / r - (3.0 * along - trace) / (2.0 * cube);
        let attraction = d * (-self.volume / cube) + (j_d * 3.0 - d * (7.5 * along - 1.5 * trace)) / (cube * square);
        (attraction, potential)
    }

    /// Solid angle of the body as seen from `x`: 4 pi inside, 0 outside.
    pub fn solid_angle(&self, x: &Vec3) -> f64 {
        self.nodes.iter().filter_map(|node| node.face.as_ref()).map(|face| face_solid_angle(&face.map(|y| y - x))).sum()
    }
}

/// Adds the tree of the faces in depth-first order: each node is cut in halves along the longest side of the
/// box around their centroids.
fn add_nodes(faces: &mut [[Vec3; 3]], nodes: &mut Vec<FaceNode>) {
    let centroid = |face: &[Vec3; 3]| (face[0] + face[1] + face[2]) / 3.0;
    let weight: f64 = faces.iter().map(|face| area_vector(face).norm()).sum();
    let centre = faces.iter().map(|face| centroid(face) * area_vector(face).norm()).sum::<Vec3>() / weight;
    let index = nodes.len();
    nodes.push(FaceNode {
        centre,
        radius: faces.iter().flatten().map(|y| (y - centre).norm()).fold(0.0, f64::max),
        moments: LayerMoments::of_faces(faces, &centre),
        next: 0,
        face: (faces.len() == 1).then(|| faces[0]),
    });
    if faces.len() > 1 {
        let ends = |choose: fn(f64, f64) -> f64, start: f64| {
            faces.iter().map(centroid).fold(Vec3::repeat(start), |end, c| end.zip_map(&c, choose))
        };
        let axis = (ends(f64::max, f64::NEG_INFINITY) - ends(f64::min, f64::INFINITY)).imax();
        faces.sort_by(|a, b| centroid(a)[axis].total_cmp(&centroid(b)[axis]));
        let (low, high) = faces.split_at_mut(faces.len() / 2);
        add_nodes(low, nodes);
        add_nodes(high, nodes);
    }
    nodes[index].next = nodes.len();
}

/// Normal times area of a triangle, m^2.
fn area_vector([a, b, c]: &[Vec3; 3]) -> Vec3 {
    (b - a).cross(&(c - a)) * 0.5
}

impl LayerMoments {
    /// Exact moments about `centre`.
    fn of_faces(faces: &[[Vec3; 3]], centre: &Vec3) -> Self {
        let mut moments =
            LayerMoments { zeroth: Vec3::zeros(), first: Matrix3::zeros(), second: [Matrix3::zeros(); 3] };
        for face in faces {
            let layer = area_vector(face);
            let mean = (face[0] + face[1] + face[2]) / 3.0;
            let offset = mean - centre;
            // ∫ y y' dS about the mean is a twelfth of the area times the sum over the corners.
            let spread: Matrix3<f64> = face.iter().map(|y| (y - mean) * (y - mean).transpose()).sum();
            let square = offset * offset.transpose() + spread / 12.0;
            moments.zeroth += layer;
            moments.first += layer * offset.transpose();
            for i in 0..3 {
                moments.second[i] += square * layer[i];
            }
        }
        moments
    }

    /// Integrals as seen from a point at `d`, of length `r`, from the centre, to the second power of size / r.
    fn integrals(&self, d: &Vec3, r: f64) -> LayerIntegrals {
        let square = r * r;
        let cube = square * r;
        let quadrupole = |m: &Matrix3<f64>| (3.0 * d.dot(&(m * d)) - square * m.trace()) / (2.0 * square * cube);
        let second = Vec3::from_fn(|i, _| quadrupole(&self.second[i]));
        let normal = self.zeroth / r + self.first * d / cube + second;
        // n.(y - x) = -n.d + n.y, y from the centre.
        let along = Vec3::from_fn(|j, _| (0..3).map(|i| self.second[i][(i, j)]).sum());
        LayerIntegrals { normal, height: -d.dot(&normal) + self.first.trace() / r + along.dot(d) / cube }
    }
}

/// Integrals of one face as seen from `x`, in closed form. With the signed distance h_e of the foot of x from each edge, the
/// distances r of its ends, its length l, the height z of the plane and the solid angle w:
///
/// ```text
/// ∫ dS/r = sum_e h_e ln((r_1 + r_2 + l)/(r_1 + r_2 - l)) - z w
/// ```
fn face_integrals(face: &[Vec3; 3], x: &Vec3) -> LayerIntegrals {
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
        let gap = (ends - length).max(f64::MIN_POSITIVE);
        integral += distance * libm::log((ends + length) / gap);
    }
    LayerIntegrals { normal: normal * integral, height: height * integral }
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

    /// Largest relative error of the attraction, from inside of an irregular body to far away; 9e-6 is found.
    const TRUE_ERROR: f64 = 2e-5;

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

    /// Sums over all faces, without expansions.
    fn exact(body: &PolyhedronGravity, x: &Vec3) -> (Vec3, f64) {
        let faces = body.nodes.iter().filter_map(|node| node.face.as_ref());
        faces
            .map(|face| face_integrals(face, x))
            .fold((Vec3::zeros(), 0.0), |(g, phi), term| (g - term.normal, phi - 0.5 * term.height))
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
        let mut largest: f64 = 0.0;
        for x in points_about() {
            let ((g, phi), (g_exact, phi_exact)) = (body.attraction_and_potential(&x), exact(&body, &x));
            // At the centre the attraction itself vanishes.
            let scale = body.volume / x.norm().max(1.0).powi(2);
            largest = largest.max((g - g_exact).norm() / scale);
            assert!((phi - phi_exact).abs() < TRUE_ERROR * phi_exact.abs(), "{x}: {phi} {phi_exact}");
        }
        assert!(largest < TRUE_ERROR, "{largest:e}");
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
