//! Penetration of convex solids, to reject scenes with overlaps.

use nalgebra::Vector3;
use parry3d_f64::math::{Pose, Vector as Point};
use parry3d_f64::query::{self, PointQuery};
use parry3d_f64::shape::{ConvexPolyhedron, Cylinder};

/// Convex solid in its orientation, at its position.
#[derive(Debug, Clone, PartialEq)]
pub struct ConvexPiece {
    /// Vertices relative to `centre`, along the fixed axes, m.
    vertices: Vec<Vector3<f64>>,
    /// Unit normals of the faces, outward.
    normals: Vec<Vector3<f64>>,
    /// Unit directions of the edges.
    edges: Vec<Vector3<f64>>,
    /// Position to which the vertices are relative, m.
    pub centre: Vector3<f64>,
}

impl ConvexPiece {
    /// Convex piece from its triangles, counter-clockwise seen from outside; vertices relative to `centre`, m.
    pub fn new(centre: Vector3<f64>, vertices: Vec<Vector3<f64>>, triangles: &[[u32; 3]]) -> ConvexPiece {
        let corners = |t: &[u32; 3]| t.map(|k| vertices[k as usize]);
        let normals = triangles.iter().map(|t| {
            let [a, b, c] = corners(t);
            (b - a).cross(&(c - a)).normalize()
        });
        let sides = triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]);
        // Every edge is a side of two triangles, in opposite directions.
        let edges = sides.filter(|[a, b]| a < b).map(|side| {
            let [a, b] = side.map(|k| vertices[k as usize]);
            (b - a).normalize()
        });
        ConvexPiece { normals: distinct_directions(normals), edges: distinct_directions(edges), vertices, centre }
    }

    /// Box about `centre` with half lengths (m) along `axes` (rows).
    pub fn cuboid(centre: Vector3<f64>, axes: &nalgebra::Matrix3<f64>, half_lengths: &Vector3<f64>) -> ConvexPiece {
        let corner = |k: usize| {
            Vector3::from_fn(|axis, _| if k >> axis & 1 == 0 { -half_lengths[axis] } else { half_lengths[axis] })
        };
        let directions: Vec<Vector3<f64>> = (0..3).map(|k| axes.row(k).transpose()).collect();
        let normals = directions.iter().flat_map(|axis| [*axis, -axis]).collect();
        ConvexPiece {
            centre,
            vertices: (0..8).map(|k| axes.transpose() * corner(k)).collect(),
            normals,
            edges: directions,
        }
    }

    /// Penetration of a ball into the solid, m; negative when apart. For a centre within, it is measured to the nearest
    /// face.
    pub fn overlap_of_ball(&self, centre: &Vector3<f64>, radius: f64) -> f64 {
        let local = centre - self.centre;
        let height = |n: &Vector3<f64>| local.dot(n) - self.support_distance(n);
        let height_over_nearest = self.normals.iter().map(height).fold(f64::NEG_INFINITY, f64::max);
        let is_inside = height_over_nearest <= 0.0;
        if is_inside { radius - height_over_nearest } else { radius - self.distance_to_point(&local) }
    }

    /// Penetration of a cylinder at `centre`, with its axis in the last row of `axes`, of `[half height, radius]`, m,
    /// into the solid. It is the largest uniform shrinkage with which the cylinder still touches, to a thousandth of
    /// that, and 0 if it does not exceed `allowed`.
    ///
    /// Computed by parry's GJK in a frame in which the cylinder has size 1.
    pub fn overlap_of_cylinder(
        &self,
        centre: &Vector3<f64>,
        axes: &nalgebra::Matrix3<f64>,
        [half_height, radius]: [f64; 2],
        allowed: f64,
    ) -> f64 {
        let size = libm::hypot(half_height, radius);
        let local = |v: Vector3<f64>| {
            let v = axes * (v - centre) / size;
            // Parry's cylinders are about the second axis.
            Point::new(v.y, v.z, v.x)
        };
        let Some(hull) = ConvexPolyhedron::from_convex_hull(&self.vertices().map(local).collect::<Vec<_>>()) else {
            return 0.0;
        };
        let touches_when_shrunk_by = |length: f64| {
            let cylinder = Cylinder::new((half_height - length) / size, (radius - length) / size);
            query::intersection_test(&Pose::IDENTITY, &hull, &Pose::IDENTITY, &cylinder)
                .is_ok_and(|intersection| intersection.intersecting)
        };
        let mut upper = half_height.min(radius);
        if allowed >= upper || !touches_when_shrunk_by(allowed) {
            return 0.0;
        }
        let mut lower = allowed;
        while upper - lower > 1e-3 * upper {
            let middle = 0.5 * (lower + upper);
            if touches_when_shrunk_by(middle) { lower = middle } else { upper = middle }
        }
        upper
    }

    /// Vertices, m.
    pub fn vertices(&self) -> impl Iterator<Item = Vector3<f64>> {
        self.vertices.iter().map(|v| v + self.centre)
    }

    /// Distance of a point outside, m, by parry's GJK in a frame in which the solid has size 1.
    fn distance_to_point(&self, local: &Vector3<f64>) -> f64 {
        let size = self.vertices.iter().map(|v| v.norm()).fold(local.norm(), f64::max);
        let point = |v: &Vector3<f64>| Point::new(v.x / size, v.y / size, v.z / size);
        let vertices: Vec<Point> = self.vertices.iter().map(point).collect();
        ConvexPolyhedron::from_convex_hull(&vertices)
            .map_or(0.0, |hull| size * hull.distance_to_local_point(point(local), true))
    }

    /// Largest distance along the unit direction `n`, from the centre, m.
    fn support_distance(&self, n: &Vector3<f64>) -> f64 {
        self.vertices.iter().map(|v| v.dot(n)).fold(f64::NEG_INFINITY, f64::max)
    }
}

/// Squared length of the difference of two unit vectors that differ by rounding only, as the normals of triangles of one face.
const SAME_DIRECTION_SQUARE: f64 = 1e-24;

/// Sine of the angle of two edges below which rounding dominates their cross product.
const MIN_EDGE_SINE: f64 = 1e-9;

/// Directions without repetitions.
fn distinct_directions(directions: impl Iterator<Item = Vector3<f64>>) -> Vec<Vector3<f64>> {
    let mut distinct: Vec<Vector3<f64>> = Vec::new();
    for direction in directions {
        if !distinct.iter().any(|other| (other - direction).norm_squared() < SAME_DIRECTION_SQUARE) {
            distinct.push(direction);
        }
    }
    distinct
}

/// Largest penetration of two bodies, m, over their convex pieces; `allowed` as in [`overlap_depth`].
pub fn deepest_overlap(a: &[ConvexPiece], b: &[ConvexPiece], allowed: f64) -> f64 {
    let pairs = a.iter().flat_map(|a| b.iter().map(move |b| (a, b)));
    pairs.map(|(a, b)| overlap_depth(a, b, allowed)).fold(0.0, f64::max)
}

/// Penetration of two solids, m: the shortest translation that separates them; any value up to `allowed` as soon as the
/// depth is known not to exceed it.
///
/// The candidate separating axes are the normals of the faces of both solids and the cross products of an edge of each
/// (S. Gottschalk, OBBTree, 1996).
pub fn overlap_depth(a: &ConvexPiece, b: &ConvexPiece, allowed: f64) -> f64 {
    let separation = b.centre - a.centre;
    // Length of the translation of b along n that separates the two.
    let overlap_along = |n: &Vector3<f64>| a.support_distance(n) + b.support_distance(&-n) - separation.dot(n);
    let mut depth = f64::INFINITY;
    let faces = a.normals.iter().copied().chain(b.normals.iter().map(|n| -n));
    for n in faces {
        depth = depth.min(overlap_along(&n));
        if depth <= allowed {
            return depth;
        }
    }
    for e in &a.edges {
        for f in &b.edges {
            let cross = e.cross(f);
            let sine = cross.norm();
            if sine > MIN_EDGE_SINE {
                let n = cross / sine;
                depth = depth.min(overlap_along(&n)).min(overlap_along(&-n));
                if depth <= allowed {
                    return depth;
                }
            }
        }
    }
    depth
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{RandomStream, StreamPurpose};
    use crate::scene::GrainShape;
    use crate::shapes::{hull, regular};
    use nalgebra::Matrix3;

    /// Cubes against a cylinder by hand: at its side, at its end, past its rim.
    #[test]
    fn cubes_in_a_cylinder() {
        let turn = |angle: f64| *nalgebra::Rotation3::from_axis_angle(&Vector3::y_axis(), angle).matrix();
        let (centre, size) = (Vector3::new(1.0, -2.0, 3.0), [2.0, 1.5]);
        for angle in [0.0, 0.7] {
            let axes = turn(angle);
            let overlap = |at: [f64; 3], own: Matrix3<f64>, allowed: f64| {
                let at = centre + axes.transpose() * Vector3::from(at);
                let cube = ConvexPiece::cuboid(at, &(own * axes), &Vector3::repeat(0.5));
                cube.overlap_of_cylinder(&centre, &axes, size, allowed)
            };
            let (straight, half) = (Matrix3::identity(), 0.5f64.sqrt());
            let edge = *nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_4).matrix();
            for (at, own, deep) in [
                ([1.9, 0.0, 0.0], straight, 0.1),
                ([0.0, -2.1, 1.0], edge, 1.5 + half - 2.1),
                ([0.0, 0.3, -2.3], straight, 0.2),
                ([0.0, 0.0, 0.0], straight, 1.5),
            ] {
                let found = overlap(at, own, 1e-6);
                assert!((found - deep).abs() < 2e-3, "{at:?}: {found} {deep}");
            }
            for (at, own) in [
                ([2.0 + 1e-9, 0.0, 0.0], straight),
                ([0.0, 1.5 + half + 1e-9, 0.0], edge),
                ([0.0, 0.0, 2.5 + 1e-9], straight),
                // Its corner is within the radius along either axis, not along both.
                ([1.8, 1.8, 0.0], straight),
            ] {
                // GJK is sure to some 1e-8 of the size.
                assert_eq!(overlap(at, own, 1e-7), 0.0, "{at:?}");
            }
            assert_eq!(overlap([1.9, 0.0, 0.0], straight, 0.11), 0.0);
        }
    }

    fn cube(centre: [f64; 3], turn: Matrix3<f64>) -> ConvexPiece {
        let surface = hull::convex_hull(&regular::shape_vertices(&GrainShape::Cube)).unwrap();
        let vertices = surface.vertices().iter().map(|&v| turn * Vector3::from(v)).collect();
        ConvexPiece::new(centre.into(), vertices, surface.triangles())
    }

    #[test]
    fn cubes_of_half_side_1() {
        let identity = Matrix3::identity();
        assert_eq!(cube([0.0; 3], identity).normals.len(), 6);
        let depth = |centre, turn| super::overlap_depth(&cube([0.0; 3], identity), &cube(centre, turn), -1e9);
        assert!((depth([1.9, 0.3, 0.1], identity) - 0.1).abs() < 1e-15);
        assert!((depth([2.0, 2.0, 2.0], identity)).abs() < 1e-15);
        assert!((depth([0.0; 3], identity) - 2.0).abs() < 1e-15);
        // A cube with an edge down on a face: half the diagonal of a side reaches below the centre.
        let eighth = crate::rotation::rotation_matrix(&crate::scene::Rotation {
            axis: [1.0, 0.0, 0.0],
            angle: std::f64::consts::FRAC_PI_4,
        });
        assert!((depth([0.0, 0.0, 2.3], eighth) - (1.0 + 2f64.sqrt() - 2.3)).abs() < 1e-14);
        // Crossed edges touch where no face separates the cubes: along x, at half diagonals from both centres.
        let z = crate::rotation::rotation_matrix(&crate::scene::Rotation {
            axis: [0.0, 0.0, 1.0],
            angle: std::f64::consts::FRAC_PI_4,
        });
        let y = crate::rotation::rotation_matrix(&crate::scene::Rotation {
            axis: [0.0, 1.0, 0.0],
            angle: std::f64::consts::FRAC_PI_4,
        });
        let crossed = super::overlap_depth(&cube([0.0; 3], z), &cube([2.0 * 2f64.sqrt() - 0.01, 0.0, 0.0], y), -1e9);
        assert!((crossed - 0.01).abs() < 1e-14, "{crossed}");
    }

    #[test]
    fn turned_boxes_are_as_deep_as_their_hulls_and_either_may_come_first() {
        let mut random = RandomStream::new(9, 0, StreamPurpose::Shape);
        for _ in 0..100 {
            let (turn, other) = (random.uniform_rotation(), random.uniform_rotation());
            let centre: [f64; 3] = (2.0 * random.point_in_cube()).into();
            let (a, b) = (cube([0.0; 3], turn), cube(centre, other));
            let box_b = ConvexPiece::cuboid(centre.into(), &other.transpose(), &Vector3::repeat(1.0));
            let found = overlap_depth(&a, &b, -1e9);
            assert!((found - overlap_depth(&b, &a, -1e9)).abs() < 1e-13);
            assert!((found - overlap_depth(&a, &box_b, -1e9)).abs() < 1e-13);
            // Translated along the axis by the penetration, they touch; otherwise they have a common point.
            assert!(overlap_depth(&a, &b, 0.0) <= 0.0 || found > 0.0);
        }
    }
}
