//! Clumps from scene.ron to observables.

use std::f64::consts::PI;

use cd_formats::snapshot::Snapshot;
use cd_tests::case::{Case, from_outbox, post};

/// A scene of clumps; `parts` are the fields `grains`, `walls` and `compute`.
fn scene(gravity: f64, parts: &str) -> String {
    let wall = if parts.contains("WALLx") { r#", (between: ("BLUEx", "WALLx"), law: "iqsc0")"# } else { "" };
    format!(
        r#"(
            gravity: (0.0, 0.0, {gravity:?}),
            materials: [(name: "ROCKx", density: 2000.0)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.5))],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0"){wall}],
            {parts}
        )"#
    )
}

const UPRIGHT: &str = "grain_orientation: Same((axis: (0.0, 0.0, 1.0), angle: 0.0))";

/// Four balls of radius 1/2 in a square of side 0.6, of which opposite ones overlap too.
const SQUARE: &str =
    "shape: Clump([(0.3, 0.3, 0.0, 0.5), (-0.3, 0.3, 0.0, 0.5), (0.3, -0.3, 0.0, 0.5), (-0.3, -0.3, 0.0, 0.5)])";

/// Volume of the union of the square's balls: a quarter is the part of a ball with x and y above -0.3 from its centre, whose
/// slices across z are integrated by the midpoint rule.
fn square_volume() -> f64 {
    // Area of the part of a disc of radius s with x > -d and y > -d.
    let area = |s: f64, d: f64| {
        if s <= d {
            return PI * s * s;
        }
        let segment = |h: f64| s * s * (h / s).acos() - h * (s * s - h * h).sqrt();
        // Two segments are cut off, and their common part twice: a corner, if it lies within the disc.
        let corner = if 2.0 * d * d < s * s {
            let (x, angle) = ((s * s - d * d).sqrt(), (d / s).acos() - (d / s).asin());
            0.5 * s * s * angle - d * (x - d)
        } else {
            0.0
        };
        PI * s * s - 2.0 * segment(d) + corner
    };
    let count = 20_000;
    let step = 1.0 / f64::from(count);
    let slice = |k: i32| {
        let z: f64 = -0.5 + (f64::from(k) + 0.5) * step;
        area((0.25 - z * z).sqrt(), 0.3)
    };
    4.0 * step * (0..count).map(slice).sum::<f64>()
}

fn energy(state: &Snapshot) -> f64 {
    let (inertia, w) = (state.bodies.body_inertia[0], state.bodies.body_w[0]);
    (0..3).map(|k| 0.5 * inertia[k] * w[k] * w[k]).sum()
}

/// A clump without symmetry keeps energy and angular momentum; one that spins about a principal axis keeps its spin.
#[test]
fn spinning_clumps_keep_energy_and_angular_momentum() {
    let spun_clump = |shape: &str, spin: &str| {
        let grains = format!(
            r#"grains: [(material: "ROCKx", colour: "BLUEx", {shape}, {UPRIGHT}, spin: {spin},
                placement: List(positions: [(0.0, 0.0, 0.0)]))], compute: (dt: 1e-2, end_time: 20.0, output_every: 1000)"#
        );
        Case::from_scene(&scene(0.0, &grains)).solved(&["--threads", "1"])
    };
    let skew =
        "shape: Clump([(0.0, 0.0, 0.0, 0.5), (0.6, 0.1, 0.0, 0.4), (0.0, 0.5, 0.3, 0.3), (-0.3, 0.0, -0.5, 0.25)])";
    let case = spun_clump(skew, "(0.3, 2.0, 0.5)");
    let (start, end) = (case.snapshot(0), case.last_snapshot());
    // Rounding of 2000 steps.
    assert!((energy(&end) / energy(&start) - 1.0).abs() < 1e-12);
    let momentum = |state: &Snapshot| state.shapes.as_ref().unwrap().turning.turning_momentum[0];
    assert_eq!(momentum(&start), momentum(&end));
    assert_ne!(start.bodies.body_w[0], end.bodies.body_w[0]);
    // The axes of the square are principal, the third one with the largest moment.
    let case = spun_clump(SQUARE, "(0.0, 0.0, 2.0)");
    let inertia = case.snapshot(0).bodies.body_inertia[0];
    assert!(inertia[2] > 1.1 * inertia[0] && (inertia[0] / inertia[1] - 1.0).abs() < 1e-7, "{inertia:?}");
    let w = case.last_snapshot().bodies.body_w_world[0];
    assert!((w[2] - 2.0).abs() < 1e-12 && w[0].abs() < 1e-12 && w[1].abs() < 1e-12, "{w:?}");
}

/// Two squares, one on top of the other on a floor: masses of the union, ν of it in a region, neighbours by bodies, and
/// pictures, pages and files for ParaView.
#[test]
fn observables_count_bodies_and_the_volume_of_the_union() {
    let parts = format!(
        r#"grains: [(material: "ROCKx", colour: "BLUEx", {SQUARE}, {UPRIGHT},
            placement: List(positions: [(0.0, 0.0, 0.5), (0.0, 0.0, 1.5)]))],
        walls: [Plate(material: "ROCKx", colour: "WALLx", centre: (0.0, 0.0, -0.5), half_lengths: (5.0, 5.0, 0.5))],
        compute: (dt: 1e-3, steps: 100, output_every: 50, tol: 1e-12, max_sweeps: 20000)"#
    );
    let case = Case::from_scene(&scene(-9.81, &parts)).solved(&["--threads", "1"]);
    let end = case.last_snapshot();
    let volume = square_volume();
    for body in 0..2 {
        // Eight digits of the files; the midpoint rule has some 1e-7.
        assert!((end.bodies.body_mass[body] / (2000.0 * volume) - 1.0).abs() < 1e-6);
        // Each step leaves some 1e-12 of the velocity of a free fall in it.
        assert!((end.bodies.body_x[body][2] - (0.5 + body as f64)).abs() < 1e-9);
    }
    assert_eq!(end.contacts.contact_body.len(), 8);
    assert_eq!(post(case.path(), &["--region", "box:4,4,4@0,0,1"]), 0);
    let series = cd_tests::columns::csv(&case.path().join("POSTPRO/series.csv")).unwrap();
    let last = |name: &str| *series[name].last().unwrap();
    assert!((last("nu") / (2.0 * volume / 64.0) - 1.0).abs() < 1e-6, "{}", last("nu"));
    // The lower one touches the other and the floor, the upper one the other.
    assert_eq!(last("Z"), 1.5);
    assert!(case.path().join("DISPLAY").is_dir());
    // The last state is continued in another case, as the same bodies, under a third one that touches them.
    let next = Case::empty();
    let changes = |z: f64| {
        format!(
            r#"(
                grains: [(material: "ROCKx", colour: "BLUEx", {SQUARE}, {UPRIGHT},
                    placement: List(positions: [(0.0, 0.0, {z})]))],
                compute: (dt: 1e-3, steps: 20),
            )"#
        )
    };
    assert_eq!(from_outbox(case.path(), next.path(), &changes(2.5)), 0);
    let state = next.solved(&["--threads", "1"]).last_snapshot();
    assert_eq!(state.bodies.body_mass[..2], end.bodies.body_mass[..2]);
    assert_eq!(state.bodies.body_inertia[..2], end.bodies.body_inertia[..2]);
    assert!((state.bodies.body_x.iter().map(|x| x[2]).fold(0.0, f64::max) - 2.5).abs() < 1e-6);
    assert_eq!(state.contacts.contact_body.len(), 12);
    // One that overlaps them by their balls is rejected.
    assert_eq!(from_outbox(case.path(), Case::empty().path(), &changes(2.4)), 2);
}
