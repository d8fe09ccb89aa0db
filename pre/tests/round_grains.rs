//! Cylinders and capsules as grains: mass and inertia in DATBOX, sizes, orientations, overlaps, rows, and scenes that are
//! rejected.

use std::f64::consts::PI;
use std::path::Path;

use cd_formats::bodies::{Bodies, ShapeRecord};
use cd_formats::dof::Dof;
use cd_formats::scan::AsciiText;
use cd_pre::write;
use nalgebra::Matrix3;

/// A scene of one group of grains, with the given fields and other parts.
fn scene(fields: &str, parts: &str) -> String {
    format!(
        r#"(
            seed: 3,
            materials: [(name: "ROCKx", density: 2000.0)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0")],
            grains: [(material: "ROCKx", colour: "BLUEx", {fields})],
            {parts}
        )"#
    )
}

/// BODIES.DAT, DOF.INI, TACT_BEHAV.DAT and the summary of a scene.
fn files(text: &str) -> (Bodies, Dof, String, String) {
    let (scene, population) =
        cd_pre::read_scene(Path::new("scene.ron"), text, &[]).unwrap_or_else(|faults| panic!("{faults}"));
    let files = write::datbox_files(&scene, &population);
    let of = |name: &str| files.iter().find(|(known, _)| known == name).unwrap().1.clone();
    let bodies = Bodies::parse(Path::new("BODIES.DAT"), &AsciiText::new(of("BODIES.DAT").as_bytes())).unwrap();
    let dof = Dof::parse(Path::new("DOF.INI"), &AsciiText::new(of("DOF.INI").as_bytes())).unwrap();
    (bodies, dof, of("TACT_BEHAV.DAT"), cd_pre::summary::scene_summary(&scene, &population))
}

/// Faults of a scene, a line each; "nothing" without any.
fn faults(text: &str) -> String {
    cd_pre::read_scene(Path::new("scene.ron"), text, &[])
        .map_or_else(|faults| faults.to_string(), |_| "nothing".to_string())
}

const ONE: &str = "placement: List(positions: [(1, 2, 3)]), grain_orientation: Same((axis: (1, 0, 0), angle: 0))";

#[test]
fn rods_have_their_mass_and_inertia() {
    let (h, r) = (0.75, 0.5f64);
    let [barrel, ball] = [2.0 * PI * r * r * h, 4.0 / 3.0 * PI * r.powi(3)];
    let across_barrel = barrel * (r * r / 4.0 + h * h / 3.0);
    let across_ball = ball * (0.4 * r * r + h * h + 0.75 * h * r);
    for (shape, volume, across, along) in [
        ("Cylinder(half_height: 0.75, radius: 0.5)", barrel, across_barrel, 0.5 * barrel * r * r),
        (
            "Capsule(half_length: 0.75, radius: 0.5)",
            barrel + ball,
            across_barrel + across_ball,
            (0.5 * barrel + 0.4 * ball) * r * r,
        ),
    ] {
        let (bodies, dof, tact, summary) = files(&scene(&format!("shape: {shape}, {ONE}"), ""));
        let checked = bodies.0[0].check_at_density(2000.0).unwrap().inertial;
        assert!((checked.mass / (2000.0 * volume) - 1.0).abs() < 1e-14, "{shape}: {checked:?}");
        for (moment, expected) in checked.inertia.into_iter().zip([across, across, along]) {
            assert!((moment / (2000.0 * expected) - 1.0).abs() < 1e-14, "{shape}: {checked:?}");
        }
        // Eight digits of the file.
        assert!((bodies.0[0].inertia.unwrap()[2] / along - 1.0).abs() < 1e-7);
        assert_eq!((bodies.0[0].position, dof.bodies[0].axes), ([1.0, 2.0, 3.0], Matrix3::identity().into()));
        let (contactor, kind) = if shape.starts_with("Cyl") { ("CYLND", "cylinder") } else { ("CAPSx", "capsule") };
        assert!(tact.contains(&format!("RBDY3  {contactor}  BLUEx  iqsc0  RBDY3  {contactor}  BLUEx")), "{tact}");
        assert!(summary.contains(&format!("1 {kind}, radius")), "{summary}");
    }
}

#[test]
fn sizes_scale_rods_and_random_orientations_turn_them() {
    let fields = "shape: Capsule(half_length: 1.0, radius: 0.5), sizes: Uniform(min: 0.5, max: 1.0), number: 50, \
                  radius: Circumscribed, placement: RandomSequential(envelope: Ball(radius: 10))";
    let (bodies, dof, ..) = files(&scene(fields, ""));
    for (body, state) in bodies.0.iter().zip(&dof.bodies) {
        let ShapeRecord::Capsule { half_length, radius } = body.contactors[0].shape else { panic!("{body:?}") };
        assert!((half_length / radius - 2.0).abs() < 1e-7 && (0.5..=1.0).contains(&(half_length + radius)), "{body:?}");
        assert!(state.axes[2] != [0.0, 0.0, 1.0]);
    }
    assert_eq!(bodies.0.len(), 50);
    // Bounding spheres do not overlap.
    for (k, one) in bodies.0.iter().enumerate() {
        for other in &bodies.0[..k] {
            let distance: f64 = (0..3).map(|c| (one.position[c] - other.position[c]).powi(2)).sum::<f64>().sqrt();
            let reach = |body: &cd_formats::bodies::Body| body.check_at_density(1.0).unwrap().bounding_radius(body);
            assert!(distance >= (reach(one) + reach(other)) * (1.0 - 1e-6));
        }
    }
}

#[test]
fn overlaps_of_rods_are_found_by_their_shapes() {
    let pair = |shape: &str, x: f64| {
        let fields = format!(
            "shape: {shape}, placement: List(positions: [(0, 0, 0), ({x}, 0, 0)]), \
             grain_orientation: Same((axis: (1, 0, 0), angle: 0))"
        );
        faults(&scene(&fields, ""))
    };
    for shape in ["Cylinder(half_height: 2.0, radius: 0.5)", "Capsule(half_length: 2.0, radius: 0.5)"] {
        // Next to each other, far within their bounding balls.
        assert_eq!(pair(shape, 1.0001), "nothing");
        assert!(pair(shape, 0.9).contains("grain 1 of grains 1 and grain 2 of grains 1 overlap by"), "{shape}");
    }
    let wall = r#"walls: [Plate(material: "ROCKx", colour: "WALLx", centre: (0, 0, -1), half_lengths: (5, 5, 0.5))]"#;
    let contacts = |fields: &str, parts: &str| {
        scene(fields, parts).replace("contacts: [", r#"contacts: [(between: ("BLUEx", "WALLx"), law: "iqsc0"), "#)
    };
    let lying = "shape: Capsule(half_length: 2.0, radius: 0.25), \
                 grain_orientation: Same((axis: (1, 0, 0), angle: 1.5707963267948966))";
    let at = |z: f64| contacts(&format!("{lying}, placement: List(positions: [(0, 0, {z})])"), wall);
    assert_eq!(faults(&at(-0.25)), "nothing");
    assert!(faults(&at(-0.4)).contains("grain 1 of grains 1 and wall 1 overlap by"));
}

#[test]
fn rows_name_each_pair_of_contactors_once() {
    let parts = r#"walls: [
        Cylinder(material: "ROCKx", colour: "BLUEx", centre: (0, 0, 9), half_height: 1, radius: 1),
        Cylinder(material: "ROCKx", colour: "BLUEx", centre: (0, 0, 0), half_height: 20, radius: 20, hollow: true),
        Plate(material: "ROCKx", colour: "BLUEx", centre: (0, 0, -9), half_lengths: (1, 1, 1)),
    ]"#;
    let fields = format!("shape: Cylinder(half_height: 0.75, radius: 0.5), {ONE}");
    let (.., tact, _) = files(&scene(&fields, parts));
    let rows: Vec<String> = tact
        .lines()
        .filter(|line| line.contains("BLUEx  iqsc0"))
        .map(|line| line.split_whitespace().filter(|word| word.len() == 5 && word.ends_with(['D', 'x', 'C'])).collect())
        .collect();
    let count =
        |contactor: &str| tact.matches(&format!("RBDY3  CYLND  BLUEx  iqsc0  RBDY3  {contactor}  BLUEx")).count();
    assert_eq!(["CYLND", "PLANx", "DNLYC"].map(count), [1, 1, 1], "{tact}");
    assert_eq!(rows.len(), 3, "{tact}");
}

#[test]
fn wrong_rods_are_rejected() {
    for (shape, expected) in [
        ("Cylinder(half_height: 0.0, radius: 0.5)", "half_height: 0.0; expected a length > 0 m"),
        ("Capsule(half_length: 0.5, radius: -1.0)", "radius: -1.0; expected a radius > 0 m"),
    ] {
        let found = faults(&scene(&format!("shape: {shape}, {ONE}"), ""));
        assert!(found.contains(expected), "{found}");
    }
}
