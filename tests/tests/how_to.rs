//! Scenes of docs/how-to that run as the guides say.

use std::path::Path;

use cd_formats::snapshot::Snapshot;
use cd_tests::case::{Case, from_outbox};

/// Text of a file in docs/how-to.
fn guide_file(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/how-to").join(name);
    std::fs::read_to_string(&path).unwrap()
}

/// Last state of the run of a scene in docs/how-to, with these flags.
fn end_of(name: &str, flags: &[&str]) -> Snapshot {
    Case::from_scene(&guide_file(name)).solved(flags).last_snapshot()
}

/// Velocities of the free bodies along x, m/s.
fn speeds_along_x(state: &Snapshot) -> Vec<f64> {
    let rows = state.bodies.body_v.iter().zip(&state.bodies.body_driven);
    rows.filter(|(_, driven)| **driven == 0).map(|(v, _)| v[0]).collect()
}

#[test]
fn a_belt_takes_parcels_along() {
    let speeds = speeds_along_x(&end_of("belt.ron", &[]));
    assert_eq!(speeds.len(), 4);
    // Sticking contacts, to the tolerance of the solution.
    assert!(speeds.iter().all(|v| (v - 0.8).abs() < 1e-4), "{speeds:?}");
}

#[test]
fn the_last_ball_of_the_cradle_leaves() {
    let speeds = speeds_along_x(&end_of("cradle.ron", &[]));
    // The tolerance of the solution.
    let error = speeds.iter().zip([0.0, 0.0, 0.0, 0.0, 1.0]).map(|(v, expected)| (v - expected).abs());
    assert!(error.fold(0.0, f64::max) < 1e-3, "{speeds:?}");
}

#[test]
fn frosted_ice_rebounds_by_its_speed() {
    let speeds = speeds_along_x(&end_of("ice.ron", &[]));
    let restitution = (speeds[1] - speeds[0]) / 0.01;
    assert!((restitution - 0.9 * (0.0156f64).powf(0.234)).abs() < 1e-6, "{restitution}");
    assert!((restitution - 0.34).abs() < 1e-3, "{restitution}");
}

/// The blades and the flap turn; the first steps, before beads are there, are those of a free motion.
#[test]
fn walls_turn_about_their_axes() {
    let mixer = end_of("mixer.ron", &["--steps", "20"]);
    assert_eq!(mixer.bodies.body_x[mixer.bodies.body_x.len() - 2][0], 0.055);
    let flap = end_of("flap.ron", &["--steps", "40"]);
    let last = flap.bodies.body_x.len() - 1;
    assert_eq!(flap.bodies.body_x[last], [0.2, 0.0, 0.2]);
    // 0.02 s under a moment of gravity m g sin 20° l about the y-axis, before it has turned far.
    let [g, l, half_height, half_thickness] = [3.36, 0.09, 0.09f64, 0.005f64];
    let inertia_by_mass = (half_height * half_height + half_thickness * half_thickness) / 3.0 + l * l;
    let spin = flap.bodies.body_w_world[last][1];
    assert!((spin / (-0.02 * g * l / inertia_by_mass) - 1.0).abs() < 2e-2, "{spin}");
}

#[test]
fn a_compressed_cell_is_sheared() {
    let cell = Case::from_scene(&guide_file("cell.ron")).solved(&["--steps", "100"]);
    let case = Case::empty();
    assert_eq!(from_outbox(cell.path(), case.path(), &guide_file("shear.ron")), 0);
    let case = case.solved(&["--steps", "100"]);
    let [compressed, start, end] = [cell.last_snapshot(), case.snapshot(0), case.last_snapshot()];
    let [compressed, start, end] = [compressed, start, end].map(|state| state.meta.cell.unwrap());
    assert!(compressed.periods[0] < 0.07);
    assert_eq!((start.periods, start.mean_stress), (compressed.periods, compressed.mean_stress));
    assert!((end.shear_strains[1] - 0.03).abs() < 1e-12, "{end:?}"); // 100 steps of 1 ms at 0.3 1/s
}

/// The run of 0.1 s, of which this is a tenth, holds the pressure in the mean; single steps deviate by some percent.
#[test]
fn a_round_vessel_holds_a_pressure() {
    let radius = end_of("vessel.ron", &["--steps", "100"]).meta.radii[0];
    assert!((radius.mean_stress / 1e3 - 1.0).abs() < 0.1 && (0.048..0.05).contains(&radius.radius), "{radius:?}");
}
