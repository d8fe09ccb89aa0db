//! Known properties of a self-gravitating aggregate at rest, through the whole chain.

use cd_tests::case::{Case, cloud};

const GRAVITATION: f64 = 6.6743e-11;

/// At rest the pressure from contact forces is that of the virial theorem, -E_grav / 3V, and near to that of
/// a homogeneous sphere as large as the aggregate with its voids, (4 pi / 15) G (nu rho)^2 R^2. The ratio is 1 for infinitely many grains
/// and above it by the edge, where the enclosing ball is empty.
#[test]
fn pressure_is_that_of_the_virial_and_near_the_homogeneous_sphere() {
    for (number, seed) in [(100, 2), (200, 2)] {
        let scene = cloud(number, 0.4, seed, "dt: 4.0, end_time: 10000.0, output_every: 500");
        let case = Case::from_scene(&scene).solved(&[]);
        let series = case.series();
        let last = |name: &str| *series[name].last().unwrap();
        let (pressure, virial) = (last("pressure"), last("pressure_virial"));
        assert!((pressure / virial - 1.0).abs() < 0.02, "{number}: pressure {pressure}, virial {virial}");

        let radius = last("R_enclosing");
        let volume = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
        let from_energy = -last("E_grav") / (3.0 * last("region_volume"));
        assert!((virial / from_energy - 1.0).abs() < 1e-3, "{number}: virial {virial}, from the energy {from_energy}");
        let density = last("mass") / volume;
        let sphere = 4.0 * std::f64::consts::PI / 15.0 * GRAVITATION * (density * radius).powi(2);
        let ratio = last("pressure_sphere") / sphere;
        // A hull of a single group is smaller than the ball around it, and holds the same grains and contacts.
        let share = last("region_volume") / volume;
        assert!((0.5..1.0).contains(&share) && last("region") == 1.0, "{number}: {share}");
        for (hull, ball) in [("pressure", "pressure_sphere"), ("nu", "nu_sphere")] {
            assert!((last(hull) * share / last(ball) - 1.0).abs() < 1e-12, "{number}: {hull}");
        }
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
        let case = Case::from_scene(&scene).solved(&[]);
        let series = case.series();
        let isostatic = (3 * number - 6) as f64;
        assert_eq!(series["n_contacts"].last(), Some(&isostatic), "seed {seed}: {:?}", series["n_contacts"]);
        assert_eq!(series["Z"].last(), Some(&(2.0 * isostatic / number as f64)));
        let steps = case.steps();
        assert!(steps["residual"].last().unwrap() <= &1e-8);
    }
}

/// Two touching spheres at rest in a frame that rotates at half the rate at which they part: attraction less what the axes pull
/// outwards is what the contact carries, and so the pressure is that of the virial of both.
#[test]
fn what_fields_pull_is_in_the_virial_and_the_energy() {
    let (density, radius) = (3000.0, 1.0f64);
    let mass = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3) * density;
    let rate = 0.25 * (4.0 / 3.0 * std::f64::consts::PI * GRAVITATION * density).sqrt();
    let scene = format!(
        r#"(
            materials: [(name: "ROCKx", density: {density:?})],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.5))],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0")],
            grains: [(
                material: "ROCKx",
                colour: "BLUEx",
                sizes: Single({radius:?}),
                placement: List(positions: [(-{radius:?}, 0.0, 0.0), ({radius:?}, 0.0, 0.0)]),
            )],
            compute: (
                dt: 0.1, steps: 20, output_every: 20, self_gravity: true, gravity: direct, tol: 1.0e-12,
                fields: [RotatingFrame(rate: (0.0, 0.0, {rate:e}), centre: (0.0, 0.0, 0.0))],
            ),
        )"#
    );
    let series = Case::from_scene(&scene).solved(&[]).series();
    let last = |name: &str| *series[name].last().unwrap();
    // Radii and densities are written with eight digits.
    let near = |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 1e-7, "{found:e} {expected:e}");
    let force = GRAVITATION * mass * mass / (4.0 * radius * radius) - mass * rate * rate * radius;
    // The hull of two balls: one of them and a cylinder between.
    let volume = (4.0 / 3.0 + 2.0) * std::f64::consts::PI * radius.powi(3);
    near(last("pressure"), force * 2.0 * radius / (3.0 * volume));
    near(last("pressure_virial"), last("pressure"));
    // Of the centres, and of the balls about them.
    near(last("E_fields"), -(1.0 + 0.4) * mass * rate * rate * radius * radius);
    near(last("E_total"), last("E_grav") + last("E_fields"));
}
