//! Balls that represent a closed surface in contacts: inscribed balls, chosen until they cover the surface.
//!
//! From points spread evenly on the surface, the largest ball that touches the surface there from inside is found by shrinking
//! it until no other point of the surface lies in it (J. Ma, S. W. Bae & S. Choi, Vis. Comput. 28 (2012) 7-19). A ball covers
//! the points that are nearer to it than the permitted error. The next ball is always the one that covers the most points that
//! are not yet covered: the greedy solution of the set cover of the surface (C.-Q. Li, W.-J. Xu & Q.-S. Meng, Powder
//! Technol. 286 (2015) 478-487).

use cd_formats::surface::Surface;
use nalgebra::Vector3;
use parry3d_f64::math::Vector as Point;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::{TriMesh, TriMeshFlags};
use rayon::prelude::*;

use crate::shapes::union::ClumpBall;

/// Balls inscribed in a surface, and how well they represent it.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceBalls {
    /// Balls in the axes of the surface, the one that covers most of it first.
    pub balls: Vec<ClumpBall>,
    /// Share of the area that is nearer to a ball than the permitted error.
    pub covered_share: f64,
    /// Largest distance of a point of the surface from the nearest ball, m.
    pub largest_distance: f64,
}

/// Numbers of points on the surface. The cost is quadratic: 6000 points make 36 million distances.
const POINT_COUNTS: std::ops::RangeInclusive<f64> = 500.0..=6000.0;

/// Number of points on the area of a square whose side is the permitted error.
const POINTS_PER_SQUARE: f64 = 4.0;

/// Relative penetration of the surface at which a ball counts as inscribed.
const PENETRATION_TOLERANCE: f64 = 1e-6;

/// Largest number of times that a ball is shrunk; some five are needed.
const MAX_SHRINKAGES: usize = 100;

/// Fractions by which a sequence of points in a square is spread evenly: 1/p and 1/p² with p³ = p + 1 (M. Roberts, The
/// unreasonable effectiveness of quasirandom sequences, 2018).
const EVEN_STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];

/// Point on a surface, with the normal of its triangle, outward.
struct SurfacePoint {
    position: Vector3<f64>,
    normal: Vector3<f64>,
}

/// Chooses at most `max_balls` balls that touch `surface` from inside, until no point of it is farther from them than
/// `max_error` times the radius of the sphere of equal volume.
///
/// `None` if no mesh can be made of the surface.
pub fn inscribed_balls(surface: &Surface, max_balls: usize, max_error: f64) -> Option<SurfaceBalls> {
    // In a frame in which the sphere of equal volume has the radius 1.
    let properties = surface.mass_properties();
    let centre = Vector3::from(properties.centre);
    let unit = libm::cbrt(0.75 * properties.volume / std::f64::consts::PI);
    let vertices: Vec<Vector3<f64>> = surface.vertices().iter().map(|&v| (Vector3::from(v) - centre) / unit).collect();
    let corners = vertices.iter().map(|v| Point::new(v.x, v.y, v.z)).collect();
    let mesh = TriMesh::with_flags(corners, surface.triangles().to_vec(), TriMeshFlags::ORIENTED).ok()?;
    let points = even_surface_points(&vertices, surface.triangles(), max_error);
    let diameter = 2.0 * vertices.iter().map(|v| v.norm()).fold(0.0, f64::max);
    let candidates: Vec<ClumpBall> =
        points.par_iter().filter_map(|point| inscribed_ball(&mesh, point, diameter)).collect();
    let covers = |ball: &ClumpBall, x: &Vector3<f64>| {
        let reach = ball.radius + max_error;
        (x - ball.centre).norm_squared() <= reach * reach
    };
    let words = points.len().div_ceil(64);
    let covered_points: Vec<Vec<u64>> = candidates
        .par_iter()
        .map(|ball| {
            let mut bits = vec![0; words];
            let numbers = (0..points.len()).filter(|&k| covers(ball, &points[k].position));
            numbers.for_each(|k| bits[k / 64] |= 1u64 << (k % 64));
            bits
        })
        .collect();
    let mut uncovered = vec![0u64; words];
    (0..points.len()).for_each(|k| uncovered[k / 64] |= 1 << (k % 64));
    let mut balls: Vec<ClumpBall> = Vec::new();
    while balls.len() < max_balls {
        let gain = |bits: &Vec<u64>| bits.iter().zip(&uncovered).map(|(a, b)| (a & b).count_ones()).sum::<u32>();
        let gains: Vec<u32> = covered_points.par_iter().map(gain).collect();
        // The first of equal ones is taken.
        let Some((best, _)) =
            gains.iter().enumerate().rev().max_by_key(|(_, gain)| **gain).filter(|(_, gain)| **gain > 0)
        else {
            break;
        };
        uncovered.iter_mut().zip(&covered_points[best]).for_each(|(bits, covered)| *bits &= !covered);
        balls.push(candidates[best]);
    }
    let left: u32 = uncovered.iter().map(|bits| bits.count_ones()).sum();
    let distance = |x: &Vector3<f64>| {
        balls.iter().map(|ball| (x - ball.centre).norm() - ball.radius).fold(f64::INFINITY, f64::min)
    };
    let largest = points.iter().map(|point| &point.position).chain(&vertices).map(distance).fold(0.0, f64::max);
    let rescaled_ball =
        |ball: &ClumpBall| ClumpBall { centre: centre + unit * ball.centre, radius: unit * ball.radius };
    Some(SurfaceBalls {
        balls: balls.iter().map(rescaled_ball).collect(),
        covered_share: 1.0 - f64::from(left) / points.len() as f64,
        largest_distance: unit * largest,
    })
}

/// Points on the triangles of a surface, each for an equal share of its area; a smaller `max_error` needs more.
fn even_surface_points(vertices: &[Vector3<f64>], triangles: &[[u32; 3]], max_error: f64) -> Vec<SurfacePoint> {
    let corners = |t: &[u32; 3]| t.map(|k| vertices[k as usize]);
    let doubled_area = |t: &[u32; 3]| {
        let [a, b, c] = corners(t);
        (b - a).cross(&(c - a)).norm()
    };
    let total: f64 = 0.5 * triangles.iter().map(doubled_area).sum::<f64>();
    let count = (POINTS_PER_SQUARE * total / (max_error * max_error)).clamp(*POINT_COUNTS.start(), *POINT_COUNTS.end());
    let share = total / libm::floor(count);
    let mut points = Vec::new();
    let mut area_before = 0.0;
    for triangle in triangles {
        let [a, b, c] = corners(triangle);
        let cross = (b - a).cross(&(c - a));
        area_before += 0.5 * cross.norm();
        // Point k lies in the triangle in which the area up to there passes (k + 1/2) shares.
        while (points.len() as f64 + 0.5) * share < area_before {
            let fraction = |step: f64| {
                let x = step * (points.len() + 1) as f64;
                x - libm::floor(x)
            };
            let [mut s, mut t] = EVEN_STEPS.map(fraction);
            if s + t > 1.0 {
                (s, t) = (1.0 - s, 1.0 - t);
            }
            points.push(SurfacePoint { position: a + s * (b - a) + t * (c - a), normal: cross.normalize() });
        }
    }
    points
}

/// Largest ball that touches a surface at a point from inside; none if it is lost in rounding. `diameter`: length that no ball
/// exceeds.
fn inscribed_ball(mesh: &TriMesh, point: &SurfacePoint, diameter: f64) -> Option<ClumpBall> {
    let SurfacePoint { position, normal } = point;
    let mut radius = 0.5 * diameter;
    for _ in 0..MAX_SHRINKAGES {
        let centre = position - radius * normal;
        let nearest = mesh.project_local_point(Point::new(centre.x, centre.y, centre.z), false).point;
        let nearest = Vector3::new(nearest.x, nearest.y, nearest.z);
        if (nearest - centre).norm() >= radius * (1.0 - PENETRATION_TOLERANCE) {
            return Some(ClumpBall { centre, radius });
        }
        // Ball through both points that is tangent at the first.
        let chord = position - nearest;
        radius = chord.norm_squared() / (2.0 * normal.dot(&chord));
        if !(radius.is_finite() && radius > f64::EPSILON * diameter) {
            return None;
        }
    }
    None
}
