//! What is known of a self-gravitating aggregate at rest, through the whole chain.

use cd_tests::case::{Case, cloud};

const GRAVITATION: f64 = 6.6743e-11;

/// At rest the pressure from contact forces is that of the virial theorem, -E_grav / 3V, and near to that of
/// a homogeneous sphere as large as the aggregate with its voids, (4 pi / 15) G (nu rho)^2 R^2. The ratio is 1 for infinitely many grains
/// and above it by the edge, where the enclosing ball is empty.
#[test]
fn pressure_is_that_of_the_virial_and_near_the_homogeneous_sphere() {
    for (number, seed) in [(100, 2), (200, 2)] {
        let scene = cloud(number, 0.4, seed, "dt: 4.0, end_time: 10000.0, output_every: 500");
        let case = Case::of(&scene).solved(&[]);
        let series = case.series();
        let last = |name: &str| *series[name].last().unwrap();
        let (pressure, virial) = (last("pressure"), last("pressure_virial"));
        assert!((pressure / virial - 1.0).abs() < 0.02, "{number}: pressure {pressure}, virial {virial}");

        let radius = last("R_enclosing");
        let volume = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
        let from_energy = -last("E_grav") / (3.0 * volume);
        assert!((virial / from_energy - 1.0).abs() < 1e-3, "{number}: virial {virial}, from the energy {from_energy}");
        let density = last("mass") / volume;
        let sphere = 4.0 * std::f64::consts::PI / 15.0 * GRAVITATION * (density * radius).powi(2);
        let ratio = pressure / sphere;
        assert!(ratio > 1.0 && ratio < 1.3, "{number}: ratio {ratio}");
        assert_eq!((last("n_fragments"), last("largest_fraction")), (1.0, 1.0));

        let steps = case.steps();
        let worst = |name: &str| steps[name].iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        assert!(worst("momentum_drift") < 1e-10, "{number}: momentum drift {}", worst("momentum_drift"));
        assert!(worst("penetration_largest") < 0.01, "{number}: penetration {}", worst("penetration_largest"));
        let tenth = steps["converged"].len() / 10;
        assert!(steps["converged"].iter().rev().take(tenth).all(|c| *c == 1.0), "{number}: late steps not converged");
    }
}

/// Frictionless unequal spheres at true rest are isostatic: the 3N equations of force balance, of which six hold of
/// themselves (the aggregate as a whole), determine the normal forces. Another count is a redundant
/// contact or a grain that can still move.
#[test]
fn frictionless_spheres_at_rest_are_isostatic() {
    for seed in [3, 2] {
        let number = 30;
        let scene = cloud(number, 0.0, seed, "dt: 8.0, steps: 12000, tol: 1.0e-8, quench: 0.03, output_every: 2000");
        let case = Case::of(&scene).solved(&[]);
        let series = case.series();
        let isostatic = (3 * number - 6) as f64;
        assert_eq!(series["n_contacts"].last(), Some(&isostatic), "seed {seed}: {:?}", series["n_contacts"]);
        assert_eq!(series["Z"].last(), Some(&(2.0 * isostatic / number as f64)));
        let steps = case.steps();
        assert!(steps["residual"].last().unwrap() <= &1e-8);
    }
}
