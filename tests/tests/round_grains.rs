//! Cylinders and capsules from scene.ron to observables.

use std::f64::consts::PI;

use cd_tests::case::{Case, from_outbox, post};

/// A capsule that lies along x with its axis at the height `z`, and fields of its group.
fn capsule(z: f64) -> String {
    format!(
        r#"(material: "ROCKx", colour: "BLUEx", shape: Capsule(half_length: 0.5, radius: 0.25),
            grain_orientation: Same((axis: (0.0, 1.0, 0.0), angle: 1.5707963267948966)),
            placement: List(positions: [(0.0, 0.0, {z})]))"#
    )
}

/// A capsule and a cylinder on a floor: volumes in a region that holds both, neighbours, pictures and files for ParaView;
/// then a capsule on top of the first in another case.
#[test]
fn observables_have_the_exact_volumes() {
    let scene = format!(
        r#"(
            gravity: (0.0, 0.0, -9.81),
            materials: [(name: "ROCKx", density: 2000.0)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.5))],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0"), (between: ("BLUEx", "WALLx"), law: "iqsc0")],
            grains: [
                {},
                (material: "ROCKx", colour: "BLUEx", shape: Cylinder(half_height: 0.5, radius: 0.25),
                    grain_orientation: Same((axis: (0.0, 0.0, 1.0), angle: 0.0)),
                    placement: List(positions: [(1.5, 0.0, 0.5)])),
            ],
            walls: [Plate(material: "ROCKx", colour: "WALLx", centre: (0.0, 0.0, -0.5), half_lengths: (5.0, 5.0, 0.5))],
            compute: (dt: 1e-3, steps: 100, output_every: 50, tol: 1e-12, max_sweeps: 20000),
        )"#,
        capsule(0.25)
    );
    let case = Case::from_scene(&scene).solved(&["--threads", "1"]);
    let end = case.last_snapshot();
    let barrel = PI * 0.0625;
    let volumes = [barrel + 4.0 / 3.0 * PI * 0.25f64.powi(3), barrel];
    for (body, height) in [0.25, 0.5].into_iter().enumerate() {
        assert!((end.bodies.body_mass[body] / (2000.0 * volumes[body]) - 1.0).abs() < 1e-14);
        // Each step leaves some 1e-12 of the velocity of a free fall in it.
        assert!((end.bodies.body_x[body][2] - height).abs() < 1e-9);
    }
    // Two points of the capsule, and four or five round the end of the cylinder.
    assert!((6..=7).contains(&end.contacts.contact_body.len()), "{}", end.contacts.contact_body.len());
    assert_eq!(post(case.path(), &["--region", "box:4,4,4@0,0,1"]), 0);
    let series = cd_tests::columns::csv(&case.path().join("POSTPRO/series.csv")).unwrap();
    let nu = *series["nu"].last().unwrap();
    assert!((nu / ((volumes[0] + volumes[1]) / 64.0) - 1.0).abs() < 1e-9, "{nu}");
    assert!(case.path().join("DISPLAY").is_dir());
    let next = Case::empty();
    let changes = |z: f64| format!("(grains: [{}], compute: (dt: 1e-3, steps: 20))", capsule(z));
    assert_eq!(from_outbox(case.path(), next.path(), &changes(0.75)), 0);
    let state = next.solved(&["--threads", "1"]).last_snapshot();
    assert_eq!(state.bodies.body_mass[..2], end.bodies.body_mass[..2]);
    // Each step leaves the default tolerance of the velocity of a free fall in it in each of two contacts.
    let highest = state.bodies.body_x.iter().map(|x| x[2]).fold(0.0, f64::max);
    assert!((highest - 0.75).abs() < 1e-5, "{highest}");
    // One that overlaps the capsule is rejected.
    assert_eq!(from_outbox(case.path(), Case::empty().path(), &changes(0.65)), 2);
}
