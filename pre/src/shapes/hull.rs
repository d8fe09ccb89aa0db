//! Convex hulls of points by the library parry, each one checked to be closed, convex and around all points.

use cd_formats::surface::Surface;
use nalgebra::{Matrix3, Rotation3, SymmetricEigen, Vector3};
use parry3d_f64::math::Vector as Point;
use parry3d_f64::transformation::try_convex_hull;
use rustc_hash::FxHashMap;

/// Largest distance of a point outside a face, divided by the extent: rounding, and the error of the hull for coplanar
/// points.
const OUTSIDE_TOLERANCE: f64 = 1e-9;

/// Ratio of the volume to that of the cube around the points, or of thickness to length, below which points count as
/// coplanar.
const FLATNESS_LIMIT: f64 = 1e-9;

/// Largest number of rotations of the points that are tried until a hull is found that contains all of them.
const MAX_ROTATIONS: usize = 20;

/// Relative outward shift of a point, divided by the square of its distance from the middle of points that have size 1.
/// The shift puts points in faces and edges behind the corners.
const BULGE_FACTOR: f64 = 1e-10;

/// Reason why points have no hull, or a hull or surface makes no body.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum HullError {
    /// Points in a plane, or too few.
    Flat,
    /// No hull was found that contains all points.
    Unsound(String),
    /// Surface that is no longer sound when translated to its centre of mass: parts of it are too small relative to the
    /// rest.
    Moved(String),
}

impl std::fmt::Display for HullError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            HullError::Flat => write!(f, "the points lie in a plane"),
            HullError::Unsound(why) => write!(f, "no convex hull was found that contains all points: {why}"),
            HullError::Moved(why) => write!(f, "about its centre of mass, in the digits of a number, {why}"),
        }
    }
}

impl std::error::Error for HullError {}

/// Convex hull of `points`; its vertices are among them, to the last bit.
///
/// The points are scaled to size 1 about their middle. parry sometimes fails where many points lie in one plane. The
/// points are then rotated and tried again, at last with the points in faces and edges shifted behind the corners. Points
/// inside faces and edges may become vertices or not.
///
/// Errors: too few points, points in a plane, or no hull that contains them all.
pub fn convex_hull(points: &[[f64; 3]]) -> Result<Surface, HullError> {
    let low = Vector3::from_fn(|k, _| points.iter().map(|p| p[k]).fold(f64::INFINITY, f64::min));
    let high = Vector3::from_fn(|k, _| points.iter().map(|p| p[k]).fold(f64::NEG_INFINITY, f64::max));
    let middle = (low + high).map(|sum| 0.5 * sum);
    let size = (high - low).iter().copied().fold(0.0, f64::max);
    if points.len() < 4 || !(size > 0.0 && size.is_finite()) {
        return Err(HullError::Flat);
    }
    let unit: Vec<Vector3<f64>> = points.iter().map(|&p| (Vector3::from(p) - middle) / size).collect();
    find_sound_hull(points, &unit, 0.0).or_else(|_| find_sound_hull(points, &isotropic_points(&unit)?, BULGE_FACTOR))
}

/// Hull in the first rotation in which it is sound; `unit` are the points in a frame in which they have size 1.
fn find_sound_hull(points: &[[f64; 3]], unit: &[Vector3<f64>], bulge: f64) -> Result<Surface, HullError> {
    let mut reason = HullError::Flat;
    for attempt in 0..MAX_ROTATIONS {
        match try_hull(unit, bulge, attempt).and_then(|triangles| compact_surface(points, &triangles)) {
            Ok(surface) => return Ok(surface),
            Err(found) => reason = found,
        }
    }
    Err(reason)
}

/// Points along their principal axes, stretched to the same reach along each.
///
/// Errors: points in a plane.
fn isotropic_points(points: &[Vector3<f64>]) -> Result<Vec<Vector3<f64>>, HullError> {
    let mean = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let spread: Matrix3<f64> = points.iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
    let axes = SymmetricEigen::new(spread).eigenvectors.transpose();
    let principal_points: Vec<Vector3<f64>> = points.iter().map(|p| axes * (p - mean)).collect();
    let reach = principal_points.iter().fold(Vector3::zeros(), |reach, p| p.abs().sup(&reach));
    if reach.min() < FLATNESS_LIMIT * reach.max() {
        return Err(HullError::Flat);
    }
    Ok(principal_points.iter().map(|p| p.component_div(&reach)).collect())
}

/// Triangles of the hull by numbers of `points`, which have size 1 and are shifted outward by `bulge`, see
/// [`BULGE_FACTOR`]. Each `attempt` has its own rotation of the points, the first one none.
fn try_hull(points: &[Vector3<f64>], bulge: f64, attempt: usize) -> Result<Vec<[u32; 3]>, HullError> {
    // Arbitrary directions without simple ratios.
    let rotation = Rotation3::from_scaled_axis(Vector3::new(0.31, -0.72, 0.53) * attempt as f64);
    let rotated: Vec<Vector3<f64>> = points.iter().map(|p| rotation * (p * (1.0 + bulge * p.norm_squared()))).collect();
    let hull_input: Vec<Point> = rotated.iter().map(|p| Point::new(p.x, p.y, p.z)).collect();
    let (vertices, triangles) = try_convex_hull(&hull_input).map_err(|error| HullError::Unsound(error.to_string()))?;
    let indices: FxHashMap<[u64; 3], u32> =
        hull_input.iter().enumerate().rev().map(|(k, p)| ([p.x, p.y, p.z].map(f64::to_bits), k as u32)).collect();
    let number = |k: u32| {
        let p = vertices[k as usize];
        // parry may return a vertex that is not one of the points to the last bit: it is the nearest point then.
        indices.get(&[p.x, p.y, p.z].map(f64::to_bits)).copied().or_else(|| {
            let distance = |k: &usize| (rotated[*k] - Vector3::new(p.x, p.y, p.z)).norm_squared();
            (0..rotated.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).map(|k| k as u32)
        })
    };
    let mut numbered = Vec::with_capacity(triangles.len());
    for triangle in triangles {
        let [Some(a), Some(b), Some(c)] = triangle.map(number) else {
            return Err(HullError::Unsound("it has other points".into()));
        };
        numbered.push([a, b, c]);
    }
    validate_hull(points, &numbered)?;
    Ok(numbered)
}

/// Checks that the triangles are a convex surface around all points.
fn validate_hull(points: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Result<(), HullError> {
    let mut volume = 0.0;
    for triangle in triangles {
        let [a, b, c] = triangle.map(|k| points[k as usize]);
        volume += a.dot(&b.cross(&c)) / 6.0;
        let cross = (b - a).cross(&(c - a));
        // The tolerance grows for slivers, whose direction is not known: their neighbours decide.
        let sliver_factor = 1.0 + 1e-6 / cross.norm().max(1e-30);
        let excess = points.iter().map(|p| cross.dot(&(p - a))).fold(0.0, f64::max);
        if excess > OUTSIDE_TOLERANCE * sliver_factor * cross.norm() {
            return Err(HullError::Unsound(format!("one is outside by {:e} of the extent", excess / cross.norm())));
        }
    }
    if volume.abs() < FLATNESS_LIMIT {
        return Err(HullError::Flat);
    }
    Ok(())
}

/// Surface of the points that are corners of triangles.
fn compact_surface(points: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<Surface, HullError> {
    let mut used: Vec<u32> = triangles.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let number = |k: u32| used.partition_point(|&u| u < k) as u32;
    let triangles: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(number)).collect();
    let vertices: Vec<[f64; 3]> = used.iter().map(|&k| points[k as usize]).collect();
    Surface::new(&vertices, &triangles).map_err(|faults| HullError::Unsound(faults.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::GrainShape;
    use crate::shapes::regular;

    /// Checks that the hull has the volume, m^3, in several rotations.
    fn expect(points: &[[f64; 3]], volume: f64) {
        for k in 0..10 {
            let turn = Rotation3::from_scaled_axis(Vector3::new(0.4, 0.9, -0.2) * k as f64);
            let turned: Vec<[f64; 3]> = points.iter().map(|&p| (turn * Vector3::from(p)).into()).collect();
            let found = convex_hull(&turned).unwrap_or_else(|misfit| panic!("{misfit}")).volume();
            // Rounding of the turned points, which moves a face of a body by eps divided by its thinness.
            assert!((found / volume - 1.0).abs() < 1e-9, "{found} {volume}");
        }
    }

    #[test]
    fn cuboids_full_of_points_have_hulls_whatever_their_size_and_thinness() {
        for n in [2usize, 5, 9] {
            let count = n + 1;
            let all = (0..count.pow(3)).map(|k| [k % count, k / count % count, k / count / count]);
            let grid: Vec<[usize; 3]> = all.filter(|c| c.contains(&0) || c.contains(&n)).collect();
            for lengths in [[1.0; 3], [3.0; 3], [1e-3, 2e-3, 1e-3], [1.0, 2.0, 1e-3], [1e-4, 1e-4, 1.0]] {
                let point = |c: &[usize; 3]| [0, 1, 2].map(|k| lengths[k] * c[k] as f64 / n as f64);
                expect(&grid.iter().map(point).collect::<Vec<_>>(), lengths.iter().product());
            }
        }
    }

    #[test]
    fn plates_and_needles_have_hulls() {
        for lengths in [[1.0, 2.0, 1e-3], [5e-4, 5e-4, 1.0], [1.0, 1.0, 1e-6]] {
            expect(&regular::shape_vertices(&GrainShape::Box { lengths }), lengths.iter().product());
        }
        let slenderness = 2e4;
        let prism = regular::shape_vertices(&GrainShape::Prism { sides: 6, slenderness });
        expect(&prism, 1.5 * 3f64.sqrt() * 2.0 * slenderness);
        let flat: Vec<[f64; 3]> = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 0.7]].map(|[x, y]| [x, y, 0.3 * x]).into();
        assert_eq!(convex_hull(&flat), Err(HullError::Flat));
    }
}
