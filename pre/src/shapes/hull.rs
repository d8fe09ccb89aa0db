//! Convex hulls by parry, each one checked.

use cd_formats::surface::Surface;
use nalgebra::{Rotation3, Vector3};
use parry3d_f64::math::Vector as Point;
use parry3d_f64::transformation::try_convex_hull;
use rustc_hash::FxHashMap;

/// Points may lie outside a face by this share of the extent: roundings, and what the hull leaves of points in a plane.
const OUTSIDE: f64 = 1e-9;

/// Volume over that of the box around the points, below which they lie in a plane.
const FLAT: f64 = 1e-9;

/// How often the points are turned anew where no sound hull is found.
const TURNS: usize = 20;

/// Why points have no hull.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Misfit {
    /// They lie in a plane, or are too few.
    Flat,
    /// None was found that holds them all.
    Unsound(String),
}

impl std::fmt::Display for Misfit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Misfit::Flat => write!(f, "the points lie in a plane"),
            Misfit::Unsound(why) => write!(f, "no convex hull was found that holds all points: {why}"),
        }
    }
}

/// The convex hull of `points`; its vertices are among them, to the last bit.
///
/// The points are brought to size 1 about their middle. parry loses its way now and then where many points lie in one
/// plane: then the same points are turned and it tries again. Points inside faces and edges may become vertices or not.
///
/// Errors: too few points, points in a plane, or no hull that holds them all.
pub fn convex(points: &[[f64; 3]]) -> Result<Surface, Misfit> {
    let bounds = |k: usize| {
        let of = |start: f64, choose: fn(f64, f64) -> f64| points.iter().map(|p| p[k]).fold(start, choose);
        (of(f64::INFINITY, f64::min), of(f64::NEG_INFINITY, f64::max))
    };
    let sides = [0, 1, 2].map(|k| bounds(k).1 - bounds(k).0);
    let middle = Vector3::from([0, 1, 2].map(|k| 0.5 * (bounds(k).0 + bounds(k).1)));
    let size = sides.iter().copied().fold(0.0, f64::max);
    if points.len() < 4 || !(size > 0.0 && size.is_finite()) {
        return Err(Misfit::Flat);
    }
    let unit: Vec<Vector3<f64>> = points.iter().map(|&p| (Vector3::from(p) - middle) / size).collect();
    let mut reason = Misfit::Flat;
    for turn in 0..TURNS {
        match attempt(&unit, turn) {
            Ok(triangles) => return compact(points, &triangles),
            Err(found) => reason = found,
        }
    }
    Err(reason)
}

/// Triangles of the hull by numbers of `points`, which have size 1.
fn attempt(points: &[Vector3<f64>], turn: usize) -> Result<Vec<[u32; 3]>, Misfit> {
    // Any directions that are not round.
    let rotation = Rotation3::from_scaled_axis(Vector3::new(0.31, -0.72, 0.53) * turn as f64);
    let turned: Vec<Vector3<f64>> = points.iter().map(|p| rotation * p).collect();
    let given: Vec<Point> = turned.iter().map(|p| Point::new(p.x, p.y, p.z)).collect();
    let (vertices, triangles) = try_convex_hull(&given).map_err(|error| Misfit::Unsound(error.to_string()))?;
    let place: FxHashMap<[u64; 3], u32> =
        given.iter().enumerate().rev().map(|(k, p)| ([p.x, p.y, p.z].map(f64::to_bits), k as u32)).collect();
    let number = |k: u32| {
        let p = vertices[k as usize];
        let same = || [p.x, p.y, p.z].map(f64::to_bits);
        place.get(&same()).copied().or_else(|| {
            let distance = |k: &usize| (turned[*k] - Vector3::new(p.x, p.y, p.z)).norm_squared();
            (0..turned.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).map(|k| k as u32)
        })
    };
    let mut numbered = Vec::with_capacity(triangles.len());
    for triangle in triangles {
        let [Some(a), Some(b), Some(c)] = triangle.map(number) else {
            return Err(Misfit::Unsound("it has other points".into()));
        };
        numbered.push([a, b, c]);
    }
    sound(points, &numbered)?;
    Ok(numbered)
}

/// Whether the triangles are a closed convex surface around all points.
fn sound(points: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Result<(), Misfit> {
    let mut volume = 0.0;
    for triangle in triangles {
        let [a, b, c] = triangle.map(|k| points[k as usize]);
        volume += a.dot(&b.cross(&c)) / 6.0;
        let cross = (b - a).cross(&(c - a));
        // Of a sliver the direction is not known: its neighbours speak for it.
        let doubt = 1.0 + 1e-6 / cross.norm().max(1e-30);
        let outside = points.iter().map(|p| cross.dot(&(p - a))).fold(0.0, f64::max);
        if outside > OUTSIDE * doubt * cross.norm() {
            return Err(Misfit::Unsound(format!("one is outside by {:e} of the extent", outside / cross.norm())));
        }
    }
    if volume.abs() < FLAT {
        return Err(Misfit::Flat);
    }
    Ok(())
}

/// The surface of those points that are corners of triangles.
fn compact(points: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<Surface, Misfit> {
    let mut used: Vec<u32> = triangles.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let number = |k: u32| used.partition_point(|&u| u < k) as u32;
    let triangles: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(number)).collect();
    let vertices: Vec<[f64; 3]> = used.iter().map(|&k| points[k as usize]).collect();
    Surface::new(&vertices, &triangles).map_err(|faults| Misfit::Unsound(faults.join("; ")))
}
