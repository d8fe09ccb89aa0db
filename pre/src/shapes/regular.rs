//! Vertices of regular solids, boxes and prisms, along their axes of symmetry.

use crate::scene::GrainShape;

/// The golden ratio.
const GOLDEN_RATIO: f64 = 1.618_033_988_749_895;

/// Vertices of a shape that is defined by its vertices, m; regular solids have arbitrary size.
pub fn shape_vertices(shape: &GrainShape) -> Vec<[f64; 3]> {
    match shape {
        GrainShape::Tetrahedron => vec![[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]],
        GrainShape::Cube => cuboid_vertices([1.0; 3]),
        GrainShape::Octahedron => cyclic_permutations(&[[1.0, 0.0, 0.0]]),
        GrainShape::Dodecahedron => {
            [cuboid_vertices([1.0; 3]), cyclic_permutations(&[[0.0, 1.0 / GOLDEN_RATIO, GOLDEN_RATIO]])].concat()
        }
        GrainShape::Icosahedron => cyclic_permutations(&[[0.0, 1.0, GOLDEN_RATIO]]),
        GrainShape::Box { lengths } => cuboid_vertices(lengths.map(|length| 0.5 * length)),
        &GrainShape::Prism { sides, slenderness } => {
            let corner = |k: usize| libm::sincos(std::f64::consts::TAU * k as f64 / sides as f64);
            let ring = |z: f64| (0..sides).map(move |k| [corner(k).1, corner(k).0, z]);
            ring(-slenderness).chain(ring(slenderness)).collect()
        }
        GrainShape::Vertices(vertices) => vertices.clone(),
        GrainShape::Sphere
        | GrainShape::Cylinder { .. }
        | GrainShape::Capsule { .. }
        | GrainShape::Random { .. }
        | GrainShape::Model { .. }
        | GrainShape::Clump(_)
        | GrainShape::ClumpFile { .. } => Vec::new(),
    }
}

fn cuboid_vertices(half: [f64; 3]) -> Vec<[f64; 3]> {
    (0..8).map(|corner| [0, 1, 2].map(|k| if corner >> k & 1 == 0 { -half[k] } else { half[k] })).collect()
}

/// Points with all signs and all cyclic orders of their components, without repetition.
fn cyclic_permutations(points: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let mut all = Vec::new();
    for point in points {
        for (shift, signs) in (0..3).flat_map(|shift| (0..8).map(move |signs| (shift, signs))) {
            let sign = |k: usize| if signs >> k & 1 == 0 { 1.0 } else { -1.0 };
            let candidate = [0, 1, 2].map(|k| point[(k + shift) % 3] * sign(k));
            if !all.contains(&candidate) {
                all.push(candidate);
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::{PrincipalSolid, hull};
    use nalgebra::{Matrix3, Vector3};

    /// Ratio of the volume to the cube of the circumscribed radius, from Coxeter, Regular Polytopes (1973), table I.
    #[test]
    fn regular_solids_have_their_volumes_and_keep_their_vertices() {
        let (r3, r5) = (3f64.sqrt(), 5f64.sqrt());
        for (shape, volume, count) in [
            (GrainShape::Tetrahedron, 8.0 * r3 / 27.0, 4),
            (GrainShape::Cube, 8.0 * r3 / 9.0, 8),
            (GrainShape::Octahedron, 4.0 / 3.0, 6),
            (GrainShape::Dodecahedron, (15.0 + 7.0 * r5) / 4.0 / (r3 * (1.0 + r5) / 4.0).powi(3), 20),
            (GrainShape::Icosahedron, 5.0 * (3.0 + r5) / 12.0 / ((10.0 + 2.0 * r5).sqrt() / 4.0).powi(3), 12),
        ] {
            let solid = PrincipalSolid::from_convex(&hull::convex_hull(&shape_vertices(&shape)).unwrap()).unwrap();
            let piece = &solid.pieces[0];
            assert_eq!((piece.vertices().len(), piece.triangles().len()), (count, 2 * count - 4), "{shape:?}");
            // Some tens of roundings.
            assert!((solid.volume / solid.reach.powi(3) / volume - 1.0).abs() < 1e-14, "{shape:?}");
            let [a, b, c] = solid.moments;
            assert!((a - b).abs() < 1e-14 * a && (b - c).abs() < 1e-14 * a, "{shape:?}: {:?}", solid.moments);
            assert_eq!((solid.axes, solid.shift), (Matrix3::identity(), Vector3::zeros()));
            assert_eq!(piece.vertices(), shape_vertices(&shape), "to the last bit");
        }
    }

    #[test]
    fn boxes_and_prisms_have_the_moments_of_the_textbook() {
        let solid = |shape| PrincipalSolid::from_convex(&hull::convex_hull(&shape_vertices(&shape)).unwrap()).unwrap();
        let (a, b, c) = (1.0, 2.0, 4.0);
        let cuboid = solid(GrainShape::Box { lengths: [a, b, c] });
        let moments = [b * b + c * c, a * a + c * c, a * a + b * b].map(|squares| a * b * c * squares / 12.0);
        assert!((cuboid.volume - 8.0).abs() < 1e-14);
        assert!((0..3).all(|k| (cuboid.moments[k] / moments[k] - 1.0).abs() < 1e-14), "{:?}", cuboid.moments);
        // A regular polygon in a circle of radius 1: area n sin(2 pi/n) / 2, polar moment area (2 + cos(2 pi/n)) / 6.
        for (sides, slenderness) in [(3, 1.0), (6, 0.1), (12, 20.0)] {
            let prism = solid(GrainShape::Prism { sides, slenderness });
            let angle = std::f64::consts::TAU / sides as f64;
            let (area, height) = (0.5 * sides as f64 * angle.sin(), 2.0 * slenderness);
            let volume = area * height;
            assert!((prism.volume / volume - 1.0).abs() < 1e-13);
            let polar = volume * (2.0 + angle.cos()) / 6.0;
            let across = 0.5 * polar + volume * height * height / 12.0;
            let expected = [across, across, polar];
            assert!((0..3).all(|k| (prism.moments[k] / expected[k] - 1.0).abs() < 1e-12), "{:?}", prism.moments);
        }
    }
}
