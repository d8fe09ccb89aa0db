//! Random convex polyhedra: vertices on an ellipsoid, more or less evenly spread.

use nalgebra::Vector3;

use crate::random::RandomStream;
use crate::shapes::hull;
use crate::shapes::principal::PrincipalSolid;

/// Common properties of the polyhedra of one group of grains.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RockGenerator {
    /// Smallest and largest number of vertices.
    pub vertices: (usize, usize),
    /// Semi-axes of the ellipsoid.
    pub ratios: Vector3<f64>,
    /// Angularity: 0 for evenly spread vertices, 1 for arbitrary positions.
    pub angularity: f64,
}

/// Ratio of the spacing of vertices to the widest possible one at angularity 0: about the jamming limit of vertices
/// that are placed one after the other.
const EVEN_SPACING: f64 = 0.75;
/// Ratio of the spacing to the widest possible one at angularity 1: nearer vertices would make negligible edges.
const MIN_SPACING: f64 = 0.1;
/// Smallest ratio of a face's distance from the centre of mass to the circumscribed radius, before the ratios: flatter
/// polyhedra are redrawn.
const MIN_INRADIUS: f64 = 0.1;
/// Largest number of draws of one polyhedron.
const MAX_ATTEMPTS: usize = 1000;

/// Failure to draw a sound polyhedron with this number of vertices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DrawError {
    pub vertices: usize,
}

impl std::fmt::Display for DrawError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "no polyhedron of {} vertices in {MAX_ATTEMPTS} draws", self.vertices)
    }
}

impl std::error::Error for DrawError {}

impl RockGenerator {
    /// Draws the next polyhedron. Its number of vertices is drawn first; all lie on the ellipsoid.
    ///
    /// Errors: no sound polyhedron in `MAX_ATTEMPTS` draws.
    pub fn draw_rock(&self, random: &mut RandomStream) -> Result<PrincipalSolid, DrawError> {
        let (min, max) = self.vertices;
        let count = min + random.uniform_index(max - min + 1);
        let spacing = (EVEN_SPACING + self.angularity * (MIN_SPACING - EVEN_SPACING)) * widest_spacing(count);
        for attempt in 0..MAX_ATTEMPTS {
            // The spacing is reduced slightly with each failed attempt.
            let Some(points) = spread_directions(count, spacing * 0.995f64.powi(attempt as i32), random) else {
                continue;
            };
            let Ok(unit_hull) = hull::convex_hull(&points) else { continue };
            let Ok(unit_solid) = PrincipalSolid::from_convex(&unit_hull) else { continue };
            if unit_hull.vertices().len() != count || inradius(&unit_solid) < MIN_INRADIUS * unit_solid.reach {
                continue;
            }
            let stretched: Vec<[f64; 3]> =
                unit_hull.vertices().iter().map(|&v| Vector3::from(v).component_mul(&self.ratios).into()).collect();
            if let Ok(surface) = hull::convex_hull(&stretched)
                && surface.vertices().len() == count
                && let Ok(solid) = PrincipalSolid::from_convex(&surface)
            {
                return Ok(solid);
            }
        }
        Err(DrawError { vertices: count })
    }
}

/// Largest possible angle, rad, between any two of `count` directions: reached by 3, 4, 6 and 12.
///
/// L. Fejes Toth, Jahresber. Dtsch. Math.-Ver. 53 (1943) 66: cos = (cot^2 w - 1) / 2, w = count pi / (6 (count - 2)).
fn widest_spacing(count: usize) -> f64 {
    let w = count as f64 / (count as f64 - 2.0) * std::f64::consts::FRAC_PI_6;
    let cot = libm::cos(w) / libm::sin(w);
    libm::acos((0.5 * (cot * cot - 1.0)).clamp(-1.0, 1.0))
}

/// Random directions, each at least `spacing`, rad, from those before; none if one cannot be placed.
fn spread_directions(count: usize, spacing: f64, random: &mut RandomStream) -> Option<Vec<[f64; 3]>> {
    let nearest = libm::cos(spacing);
    let mut points: Vec<Vector3<f64>> = Vec::with_capacity(count);
    for _ in 0..100 * count {
        let point = random.uniform_direction();
        if points.iter().all(|other| point.dot(other) <= nearest) {
            points.push(point);
        }
        if points.len() == count {
            return Some(points.into_iter().map(Into::into).collect());
        }
    }
    None
}

/// Distance of the nearest face plane from the centre of mass.
fn inradius(solid: &PrincipalSolid) -> f64 {
    let piece = &solid.pieces[0];
    let distance = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|k| Vector3::from(piece.vertices()[k as usize]));
        (b - a).cross(&(c - a)).normalize().dot(&a)
    };
    piece.triangles().iter().map(distance).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::StreamPurpose;

    fn draw(vertices: (usize, usize), ratios: [f64; 3], angularity: f64, number: usize) -> Vec<PrincipalSolid> {
        let rocks = RockGenerator { vertices, ratios: ratios.into(), angularity };
        let mut random = RandomStream::new(3, 0, StreamPurpose::Shape);
        (0..number).map(|_| rocks.draw_rock(&mut random).unwrap()).collect()
    }

    #[test]
    fn rocks_have_their_vertices_on_the_ellipsoid_and_no_two_are_the_same() {
        let ratios = [3.0, 2.0, 1.0];
        let rocks = draw((8, 12), ratios, 0.5, 200);
        let mut counts = [0; 5];
        for rock in &rocks {
            counts[rock.pieces[0].vertices().len() - 8] += 1;
            for &v in rock.pieces[0].vertices() {
                let given = rock.axes.transpose() * Vector3::from(v) + rock.shift;
                let level: f64 = (0..3).map(|k| (given[k] / ratios[k]).powi(2)).sum();
                assert!((level - 1.0).abs() < 1e-14);
            }
            assert!(rock.pieces[0].is_convex(1e-14));
        }
        assert!(counts.iter().all(|count| *count > 20), "{counts:?}"); // 40 +- 6 expected
        assert!(rocks.windows(2).all(|pair| pair[0] != pair[1]));
    }

    #[test]
    fn angular_rocks_fill_their_ellipsoid_less() {
        let filled = |angularity| draw((14, 14), [1.0; 3], angularity, 100).iter().map(|r| r.volume).sum::<f64>();
        let [even, half, any] = [0.0, 0.5, 1.0].map(filled);
        assert!(even > 1.1 * half && half > 1.05 * any, "{even} {half} {any}");
    }

    #[test]
    fn four_and_many_vertices_can_be_drawn_at_any_angularity() {
        for (count, angularity) in [(4, 0.0), (4, 1.0), (5, 0.0), (12, 0.0), (60, 0.0), (200, 0.5)] {
            draw((count, count), [1.0, 0.5, 0.1], angularity, 10);
        }
    }

    #[test]
    fn the_widest_spacing_is_that_of_the_regular_solids() {
        let tetrahedron = libm::acos(-1.0 / 3.0);
        assert!((widest_spacing(4) - tetrahedron).abs() < 1e-15);
        assert!((widest_spacing(6) - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
        assert!((widest_spacing(12) - libm::acos(1.0 / 5f64.sqrt())).abs() < 1e-15);
    }
}
