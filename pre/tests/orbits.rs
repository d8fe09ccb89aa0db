//! Groups of grains that start on Kepler orbits.

use std::path::Path;

use cd_pre::grain::{Grain, Population};
use nalgebra::Vector3;

/// Scene with a planet of one grain and the groups `grains`; G is 1.
fn scene(grains: &str, options: &str) -> Result<Population, String> {
    let text = format!(
        r#"(
            materials: [(name: "ROCKx", density: 1000.0)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
            contacts: [
                (between: ("BLUEx", "BLUEx"), law: "iqsc0"),
                (between: ("BLUEx", "PLANE"), law: "iqsc0"),
                (between: ("PLANE", "PLANE"), law: "iqsc0"),
            ],
            grains: [
                (material: "ROCKx", colour: "PLANE", sizes: Single(1), centre: (3, 1, 0), velocity: (0.5, 0, 0),
                    placement: List(positions: [(0, 0, 0)])),
                {grains}
            ],
            compute: (dt: 1.0e-3, gravity_constant: 1.0, {options}),
        )"#
    );
    cd_pre::read_scene(Path::new("scene.ron"), &text, &[])
        .map(|(_, population)| population)
        .map_err(|faults| faults.to_string())
}

/// A group of two grains on an orbit.
fn pair_on(orbit: &str) -> String {
    format!(
        "(material: \"ROCKx\", colour: \"BLUEx\", sizes: List([0.2, 0.3]), orbit: {orbit},
            placement: List(positions: [(0, 0, 0), (0.5, 0, 0)])),"
    )
}

/// Mass, centre of mass and its velocity.
fn mean(grains: &[Grain]) -> (f64, Vector3<f64>, Vector3<f64>) {
    let mass: f64 = grains.iter().map(|grain| grain.mass).sum();
    let position = grains.iter().map(|grain| grain.position * grain.mass).sum::<Vector3<f64>>() / mass;
    (mass, position, grains.iter().map(|grain| grain.velocity * grain.mass).sum::<Vector3<f64>>() / mass)
}

#[test]
fn a_group_starts_at_the_periapsis_about_other_grains() {
    let orbit = "(about: Colour(\"PLANE\"), path: Elements(periapsis: 10, eccentricity: 0.5, inclination: 0.3))";
    let population = scene(&pair_on(orbit), "self_gravity: true").unwrap();
    let (planet, moon) = population.grains.split_at(1);
    let ((planet_mass, x_0, v_0), (moon_mass, x, v)) = (mean(planet), mean(moon));
    // Positions and velocities have the 8 digits of the files.
    assert!((x - x_0 - Vector3::new(10.0, 0.0, 0.0)).norm() < 1e-6, "{x}");
    let speed = ((planet_mass + moon_mass) * 1.5 / 10.0).sqrt();
    let expected = Vector3::new(0.0, speed * 0.3f64.cos(), speed * 0.3f64.sin());
    assert!((v - v_0 - expected).norm() < 1e-6 * speed, "{v} {expected}");
    assert_eq!(v_0, Vector3::new(0.5, 0.0, 0.0));
    // The grains of the group keep their places in it.
    assert!((moon[1].position - moon[0].position - Vector3::new(0.5, 0.0, 0.0)).norm() < 1e-6);
}

#[test]
fn a_group_moves_about_a_primary_as_a_speck() {
    let fields =
        "fields: [PointMass(mass: 4.0, position: (0, 0, 7)), RotatingFrame(rate: (0, 0, 0), centre: (0, 0, 0))]";
    let orbit = "(about: Primary(1), path: State(position: (20, 0, 0), velocity: (0, 0.1, 0)))";
    let (_, x, v) = mean(&scene(&pair_on(orbit), fields).unwrap().grains[1..]);
    assert!((x - Vector3::new(20.0, 0.0, 7.0)).norm() < 1e-6 && (v - Vector3::new(0.0, 0.1, 0.0)).norm() < 1e-9);
    // In axes that turn at 0.25 rad/s about z, 0.25 rad/s x 20 m less.
    let turning = fields.replace("rate: (0, 0, 0)", "rate: (0, 0, 0.25)");
    let (_, x, v) = mean(&scene(&pair_on(orbit), &turning).unwrap().grains[1..]);
    assert!((x - Vector3::new(20.0, 0.0, 7.0)).norm() < 1e-6 && (v - Vector3::new(0.0, -4.9, 0.0)).norm() < 1e-6);
}

#[test]
fn orbits_that_cannot_be_are_refused() {
    let elements = "path: Elements(periapsis: 10, eccentricity: 0.5)";
    let about = |centre: &str| pair_on(&format!("(about: {centre}, {elements})"));
    for (grains, options, expected) in [
        (about("Primary(1)"), "", "grains 2, orbit, about: Primary(1); expected the number of a primary at rest"),
        (
            about("Primary(1)"),
            "fields: [RotatingFrame(rate: (0, 0, 0), centre: (0, 0, 0)), PointMass(mass: 4.0, position: (0, 0, 7))]",
            "Primary(1); expected the number of a primary at rest among compute.fields: 2",
        ),
        (about("Colour(\"REDxx\")"), "self_gravity: true", "no grains of the colour 'REDxx'"),
        (about("Colour(\"PLANE\")"), "", "expected self_gravity: true"),
        (
            pair_on("(about: Colour(\"PLANE\"), path: Elements(periapsis: -1, eccentricity: 0.5))"),
            "self_gravity: true",
            "expected periapsis > 0 and eccentricity >= 0",
        ),
        (
            about("Colour(\"PLANE\")").replace("orbit:", "velocity: (1, 0, 0), orbit:"),
            "self_gravity: true",
            "expected an orbit alone",
        ),
    ] {
        let found = scene(&grains, options).unwrap_err();
        assert!(found.contains(expected), "{found}");
        assert_eq!(found.lines().count(), 1, "{found}");
    }
}
