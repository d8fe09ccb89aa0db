//! Volume of the convex hull of balls.

use std::collections::{HashMap, HashSet};

use crate::math::Vec3;

/// Directions in which the hull of unequal balls is sampled: a ball loses 1.2 10^-3 of its volume, many balls less.
const DIRECTION_COUNT: usize = 4000;

/// Coordinates are integers of this many bits, so that a determinant of three differences fits 128 bits exactly.
const COORDINATE_BITS: i32 = 38;

/// Bound of the rounding errors of a distance and of a product of vectors, divided by their size: a few 10^-16.
const BOUND_ROUNDING: f64 = 1e-14;

/// Points are displaced by up to this many units, 10^-8 of the extent, so that no four lie in one plane.
const MAX_JOGGLE: i64 = 1 << 11;

/// Volume (m^3) of the convex hull of balls of given centres and radii (m); NaN without balls.
///
/// With the smallest radius r, the hull is that of the balls less r, grown by r: V + S r + M r^2 + (4/3) pi r^3, with V, S
/// and M the volume, the surface and the integral of the mean curvature of the former. For equal balls this is exact to
/// 10^-7; for unequal ones the former is the hull of the outermost points in `DIRECTION_COUNT` directions. A single ball has its
/// own volume, and two equal ones at the distance d have pi r^2 d more. Source: J. Steiner (1840), the volume of parallel
/// bodies.
pub fn hull_volume(balls: &[(Vec3, f64)]) -> f64 {
    if balls.is_empty() {
        return f64::NAN;
    }
    let r = balls.iter().map(|ball| ball.1).fold(f64::INFINITY, f64::min);
    let largest = balls.iter().map(|ball| ball.1).fold(0.0, f64::max);
    let reduced_balls = || balls.iter().map(|(x, radius)| (x, radius - r));
    // Radii from a file may differ by rounding.
    let is_rounding = |excess: f64| excess <= 1e-12 * largest;
    let mut points: Vec<Vec3> = reduced_balls().filter(|(_, excess)| is_rounding(*excess)).map(|(x, _)| *x).collect();
    if points.len() < balls.len() {
        // From the outermost ball inwards, so that a search ends at the first that cannot reach beyond the farthest.
        let centre = balls.iter().map(|ball| ball.0).sum::<Vec3>() / balls.len() as f64;
        let bound = |(x, excess): (&Vec3, f64)| ((x - centre).norm() + excess) * (1.0 + BOUND_ROUNDING);
        let mut bounds: Vec<(f64, usize)> = reduced_balls().map(bound).zip(0..).collect();
        bounds.sort_unstable_by(|(a, i), (b, j)| b.total_cmp(a).then(i.cmp(j)));
        let size = balls.iter().map(|(x, _)| x.norm()).fold(largest, f64::max);
        let farthest_ball = |u: Vec3| {
            let (mut largest, mut index) = (f64::NEG_INFINITY, 0);
            let start = centre.dot(&u) + BOUND_ROUNDING * size;
            for &(bound, k) in &bounds {
                if start + bound < largest {
                    break;
                }
                let reach = balls[k].0.dot(&u) + (balls[k].1 - r);
                // The first of equal ones, in the order of the balls.
                if reach > largest || (reach == largest && k < index) {
                    (largest, index) = (reach, k);
                }
            }
            balls[index].0 + (balls[index].1 - r) * u
        };
        points.extend(spiral_directions(DIRECTION_COUNT).map(farthest_ball));
    }
    let ConvexMeasures { volume, surface, curvature } = hull_measures(&points);
    volume + r * (surface + r * (curvature + r * 4.0 / 3.0 * std::f64::consts::PI))
}

/// Unit vectors spread evenly over the sphere, on a golden spiral.
pub fn spiral_directions(count: usize) -> impl Iterator<Item = Vec3> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |k| {
        let z = 1.0 - (2 * k + 1) as f64 / count as f64;
        let (sin, cos) = (golden * k as f64).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        Vec3::new(radius * cos, radius * sin, z)
    })
}

/// Volume (m^3), surface (m^2) and integral of the mean curvature (m) of a convex body.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct ConvexMeasures {
    volume: f64,
    surface: f64,
    curvature: f64,
}

/// Measures of the convex hull of points; of points in a plane or on a line the limits of thin bodies.
fn hull_measures(points: &[Vec3]) -> ConvexMeasures {
    let Some(first) = points.first() else { return ConvexMeasures::default() };
    let size = points.iter().map(|p| (p - first).amax()).fold(0.0, f64::max);
    if size == 0.0 {
        return ConvexMeasures::default();
    }
    let unit = size / 2f64.powi(COORDINATE_BITS);
    // At least four points; copies of a point have different displacements.
    let copies = points.iter().cycle().take(points.len().max(4));
    let grid: Vec<[i64; 3]> = copies
        .enumerate()
        .map(|(k, p)| {
            [0, 1, 2].map(|axis| ((p[axis] - first[axis]) / unit).round() as i64 + joggle_offset(3 * k + axis))
        })
        .collect();
    let hull = ExactHull::new(&grid);
    let mut measures = ConvexMeasures::default();
    let float = |k: usize| Vec3::from(grid[k].map(|x| x as f64)) * unit;
    let normal = |face: &[usize; 3]| {
        let [a, b, c] = face.map(float);
        (b - a).cross(&(c - a))
    };
    let mut sides = HashMap::new();
    for (number, face) in hull.faces.iter().enumerate() {
        let (n, a) = (normal(&face.corners), float(face.corners[0]));
        measures.volume += a.dot(&n) / 6.0;
        measures.surface += 0.5 * n.norm();
        sides.extend(triangle_edges(&face.corners).map(|edge| (edge, number)));
    }
    let mut rising: Vec<_> = sides.iter().filter(|([a, b], _)| a < b).collect();
    rising.sort_unstable(); // sums in one order
    for ([a, b], number) in rising {
        let [n, m] = [*number, sides[&[*b, *a]]].map(|face| normal(&hull.faces[face].corners));
        measures.curvature += 0.5 * (float(*a) - float(*b)).norm() * n.cross(&m).norm().atan2(n.dot(&m));
    }
    measures
}

/// A number from -[`MAX_JOGGLE`] to [`MAX_JOGGLE`] that looks random: Steele, Lea & Flood (2014), SplitMix64.
fn joggle_offset(k: usize) -> i64 {
    let mut z = (k as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) % (2 * MAX_JOGGLE as u64 + 1)) as i64 - MAX_JOGGLE
}

fn triangle_edges([a, b, c]: &[usize; 3]) -> [[usize; 2]; 3] {
    [[*a, *b], [*b, *c], [*c, *a]]
}

/// A triangle, counter-clockwise seen from outside.
struct HullFace {
    /// Indices of the corners in the list of points.
    corners: [usize; 3],
    /// Plane of the triangle, normal . x = offset, in floating point with rounding errors: an outward vector of twice the
    /// triangle's area, in units of the integer coordinates, and its product with a corner.
    normal: Vec3,
    offset: f64,
}

/// Values of a plane above this have the right sign: coordinates of 2^40 make products of 2^122, 2^72 of it rounding.
const SIGN_CERTAINTY: f64 = 4.7e21;

/// The convex hull of points with integer coordinates, exact.
struct ExactHull<'a> {
    points: &'a [[i64; 3]],
    faces: Vec<HullFace>,
}

impl ExactHull<'_> {
    /// Four points or more, not all in one plane; points in the plane of a face are taken for inside.
    fn new(points: &[[i64; 3]]) -> ExactHull<'_> {
        let mut hull = ExactHull { points, faces: Vec::new() };
        let float = |k: usize| Vec3::from(points[k].map(|x| x as f64));
        let farthest_point =
            |of: &dyn Fn(usize) -> f64| (0..points.len()).max_by(|a, b| of(*a).total_cmp(&of(*b))).unwrap_or_default();
        let a = 0;
        let b = farthest_point(&|k| (float(k) - float(a)).norm());
        let c = farthest_point(&|k| (float(k) - float(a)).cross(&(float(b) - float(a))).norm());
        let d = farthest_point(&|k| hull.determinant(&[a, b, c], k).unsigned_abs() as f64);
        let start = if hull.determinant(&[a, b, c], d) > 0 { [a, c, b, d] } else { [a, b, c, d] };
        let [a, b, c, d] = start;
        for corners in [[a, b, c], [a, d, b], [b, d, c], [c, d, a]] {
            hull.add_face(corners);
        }
        for k in (0..points.len()).filter(|k| !start.contains(k)) {
            hull.add_point(k);
        }
        hull
    }

    /// Six times the volume of the tetrahedron of a triangle and a point, > 0 where the point is outside.
    fn determinant(&self, corners: &[usize; 3], k: usize) -> i128 {
        let [a, b, c] = corners.map(|corner| self.points[corner]);
        let offset_from_a = |p: [i64; 3]| [0, 1, 2].map(|axis| i128::from(p[axis] - a[axis]));
        let (b, c, p) = (offset_from_a(b), offset_from_a(c), offset_from_a(self.points[k]));
        p[0] * (b[1] * c[2] - b[2] * c[1]) + p[1] * (b[2] * c[0] - b[0] * c[2]) + p[2] * (b[0] * c[1] - b[1] * c[0])
    }

    fn add_face(&mut self, corners: [usize; 3]) {
        let [a, b, c] = corners.map(|k| Vec3::from(self.points[k].map(|x| x as f64)));
        let normal = (b - a).cross(&(c - a));
        self.faces.push(HullFace { corners, normal, offset: normal.dot(&a) });
    }

    fn is_visible_from(&self, k: usize, face: &HullFace) -> bool {
        let value = face.normal.dot(&Vec3::from(self.points[k].map(|x| x as f64))) - face.offset;
        if value.abs() > SIGN_CERTAINTY { value > 0.0 } else { self.determinant(&face.corners, k) > 0 }
    }

    /// Replaces the faces that a point sees by those from their rim to it.
    fn add_point(&mut self, k: usize) {
        let visible: Vec<usize> = (0..self.faces.len()).filter(|&f| self.is_visible_from(k, &self.faces[f])).collect();
        let sides: HashSet<[usize; 2]> = visible.iter().flat_map(|&f| triangle_edges(&self.faces[f].corners)).collect();
        let inner = |[a, b]: &[usize; 2]| sides.contains(&[*b, *a]);
        let rim: Vec<[usize; 2]> =
            visible.iter().flat_map(|&f| triangle_edges(&self.faces[f].corners)).filter(|side| !inner(side)).collect();
        for &face in visible.iter().rev() {
            self.faces.swap_remove(face);
        }
        rim.into_iter().for_each(|[a, b]| self.add_face([a, b, k]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[track_caller]
    fn assert_close(found: f64, expected: f64, tolerance: f64) {
        assert!((found / expected - 1.0).abs() <= tolerance, "{found} is not {expected}");
    }

    fn hull_at(points: &[[f64; 3]], radius: f64) -> Vec<(Vec3, f64)> {
        points.iter().map(|p| (Vec3::from(*p), radius)).collect()
    }

    #[test]
    fn degenerate_hulls_of_equal_balls_are_exact() {
        let ball = 4.0 / 3.0 * PI * 8.0;
        let tiny = 1e-7; // the ratio of the displacement of points to the radius, some times
        assert!(hull_volume(&[]).is_nan());
        assert_close(hull_volume(&hull_at(&[[1e3, -2.0, 0.5]], 2.0)), ball, tiny);
        // A capsule; the same of a row with others between.
        assert_close(hull_volume(&hull_at(&[[0.0; 3], [4.0, 0.0, 0.0]], 2.0)), ball + 4.0 * PI * 4.0, tiny);
        let row: Vec<[f64; 3]> = (0..9).map(|k| [k as f64, 2.0 * k as f64, -2.0 * k as f64]).collect();
        assert_close(hull_volume(&hull_at(&row, 2.0)), ball + 4.0 * PI * 24.0, tiny);
        // A plane: two faces 2 r apart, half a cylinder along the rim.
        let square: Vec<[f64; 3]> = (0..25).map(|k| [f64::from(k % 5), f64::from(k / 5), 0.0]).collect();
        assert_close(hull_volume(&hull_at(&square, 2.0)), ball + 16.0 * 4.0 + 0.5 * PI * 4.0 * 16.0, tiny);
        let triangle = [[0.0; 3], [3.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
        assert_close(hull_volume(&hull_at(&triangle, 2.0)), ball + 6.0 * 4.0 + 0.5 * PI * 4.0 * 12.0, tiny);
        // All points at the same position.
        assert_close(hull_volume(&hull_at(&[[1.0; 3]; 5], 2.0)), ball, tiny);
    }

    #[test]
    fn a_lattice_of_balls_has_the_volume_of_a_rounded_cube() {
        for scale in [1e-3, 1.0, 1e3] {
            let lattice: Vec<[f64; 3]> =
                (0..216).map(|k| [k % 6, k / 6 % 6, k / 36].map(|x| scale * f64::from(x))).collect();
            let (a, r) = (5.0 * scale, 0.5 * scale);
            let expected = a.powi(3) + 6.0 * a * a * r + 3.0 * PI * a * r * r + 4.0 / 3.0 * PI * r.powi(3);
            assert_close(hull_volume(&hull_at(&lattice, r)), expected, 1e-7);
        }
        // Points alone, as vertices of polyhedra are.
        assert_close(
            hull_volume(&hull_at(&[[0.0; 3], [3.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 5.0]], 0.0)),
            5.0,
            1e-7,
        );
    }

    #[test]
    fn unequal_balls_are_within_the_stated_share() {
        // The hull of two balls is a cone's frustum with two caps: sin a = (R - r) / d.
        let (big, small, d) = (3.0f64, 1.0f64, 7.0f64);
        let sine = (big - small) / d;
        let cosine = (1.0 - sine * sine).sqrt();
        let (wide, narrow, long) = (big * cosine, small * cosine, (d - (big - small) * sine));
        let frustum = PI * long / 3.0 * (wide * wide + wide * narrow + narrow * narrow);
        let cap = |r: f64, h: f64| PI * h * h * (3.0 * r - h) / 3.0;
        let expected = frustum + cap(big, big * (1.0 + sine)) + cap(small, small * (1.0 - sine));
        let found = hull_volume(&[(Vec3::zeros(), big), (Vec3::new(0.0, d, 0.0), small)]);
        assert!(found <= expected * (1.0 + 1e-9));
        assert_close(found, expected, 1.2e-3);
        // One within another.
        assert_close(hull_volume(&[(Vec3::zeros(), 3.0), (Vec3::x(), 0.5)]), 4.0 / 3.0 * PI * 27.0, 1.2e-3);
    }

    #[test]
    fn many_points_on_a_sphere_and_within() {
        let sphere: Vec<Vec3> = spiral_directions(1000).collect();
        let balls: Vec<(Vec3, f64)> =
            sphere.iter().flat_map(|u| [(*u, 0.1), (0.5 * u, 0.1), (-0.3 * u, 0.1)]).collect();
        // Inscribed in the ball of radius 1: less by some 4 pi / (1000 sqrt(3)), grown by 0.1.
        assert_close(hull_volume(&balls), 4.0 / 3.0 * PI * 1.1f64.powi(3), 0.01);
    }
}
