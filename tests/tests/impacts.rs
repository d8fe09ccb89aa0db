//! Impacts whose momentum enhancement is known in closed form, from scene.ron to the tables of `cd-post impact`.

use std::ffi::OsString;
use std::path::Path;

use cd_tests::case::Case;
use cd_tests::columns::{Columns, csv};

/// Scene of a target and a projectile of colour DARTx that hits it along -z, with one law for their contacts.
fn scene(law: &str, target: &str, shot: &str, parts: &str) -> String {
    let walls = r#"(between: ("BLUEx", "WALLx"), law: "law_0"), (between: ("DARTx", "WALLx"), law: None),"#;
    let walls = if parts.contains("WALLx") { walls } else { "" };
    format!(
        r#"(
            materials: [(name: "ROCKx", density: 2700.0)],
            laws: [(name: "law_0", kind: {law})],
            contacts: [
                (between: ("BLUEx", "BLUEx"), law: "law_0"),
                (between: ("BLUEx", "DARTx"), law: "law_0"),
                (between: ("DARTx", "DARTx"), law: None),
                {walls}
            ],
            grains: [
                (material: "ROCKx", colour: "BLUEx", {target}),
                (material: "ROCKx", colour: "DARTx", {shot}),
            ],
            {parts}
        )"#
    )
}

/// Runs `cd-post impact` on a solved case; returns its exit status.
fn impact(case: &Path, flags: &[&str]) -> i32 {
    let words = ["cd-post", "impact", "--projectile", "colour:DARTx"].iter().chain(flags).map(OsString::from);
    cd_post::run(words.chain([OsString::from(case)]))
}

/// Columns of beta.csv of a scene.
fn betas(scene: &str) -> Columns {
    let case = Case::from_scene(scene).solved(&["--threads", "1"]);
    assert!(impact(case.path(), &[]) <= 1);
    csv(&case.path().join("POSTPRO/impact/beta.csv")).unwrap()
}

#[track_caller]
fn assert_last(columns: &Columns, name: &str, expected: f64, tolerance: f64) {
    let found = *columns[name].last().unwrap();
    assert!((found - expected).abs() <= tolerance, "{name}: found {found}, expected {expected} within {tolerance:e}");
}

#[test]
fn a_rebound_off_a_target_that_keeps_together_has_one_plus_restitution() {
    let mass_ratio = 0.25f64.powi(3);
    for e in [0.0, 0.4, 1.0] {
        let law = format!("RST_CLB(normal_restitution: {e:?}, tangential_restitution: 0.0, friction: 0.3)");
        let target = "sizes: Single(1.0), placement: List(positions: [(0.0, 0.0, 0.0)]), velocity: (0.2, 0.1, 0.3)";
        let shot = "sizes: Single(0.25), placement: List(positions: [(0.0, 0.0, 2.0)]), velocity: (0.2, 0.1, -4.7)";
        let parts = "compute: (dt: 0.01, end_time: 2.0, output_every: 20, tol: 1e-9)";
        let columns = betas(&scene(&law, target, shot, parts));
        assert!(columns["beta"][0].abs() < 1e-12); // rounding
        // The tolerance of the contact solver; without restitution the projectile stays.
        let expected = if e > 0.0 { (1.0 + e) / (1.0 + mass_ratio) } else { 1.0 };
        for name in ["beta", "beta_normal", "beta_ejecta"] {
            assert_last(&columns, name, expected, 1e-8);
        }
        assert_last(&columns, "beta_z", -expected, 1e-8);
        assert_last(&columns, "beta_x", 0.0, 1e-8);
    }
}

/// Between the first and the last snapshot it hits and leaves.
#[test]
fn a_projectile_that_leaves_by_a_sink_between_two_snapshots_has_the_velocity_after_its_blow() {
    let law = "RST_CLB(normal_restitution: 0.5, tangential_restitution: 0.0, friction: 0.3)";
    let shot = "sizes: Single(0.25), placement: List(positions: [(0.0, 0.0, 4.0)]), velocity: (0.0, 0.0, -5.0)";
    let sink = r#"sinks: [(name: "up", region: Below(point: (0, 0, 5), normal: (0, 0, -1)))]"#;
    let space = format!("compute: (dt: 0.01, end_time: 3.0, output_every: 300, tol: 1e-9, {sink})");
    let bed = format!(
        r#"gravity: (0.0, 0.0, -0.005),
        walls: [Plate(material: "ROCKx", colour: "WALLx", centre: (0, 0, -0.5), half_lengths: (5, 5, 0.5))],
        {space}"#
    );
    let mass_ratio = 0.25f64.powi(3);
    let target = "sizes: Single(1.0), placement: List(positions: [(0.0, 0.0, 1.0)])";
    // In the bed gravity changes it by 2 g h / v^2 = 4e-4.
    for (parts, expected, tolerance) in [(space, 1.5 / (1.0 + mass_ratio), 1e-8), (bed, 1.5, 1e-3)] {
        let columns = betas(&scene(law, target, shot, &parts));
        assert_eq!(columns["time"].len(), 2);
        assert_last(&columns, "beta_normal", expected, tolerance);
        let [gained, carried] = ["gained_z", "carried_z"].map(|name| *columns[name].last().unwrap());
        let incident = -5.0 * 2700.0 * 4.0 / 3.0 * std::f64::consts::PI * 0.25f64.powi(3);
        // P + c = p; gravity, as above.
        assert!(((gained + carried) / incident - 1.0).abs() < tolerance, "{gained} {carried} {incident}");
    }
}

#[test]
fn a_rebound_off_a_bed_counts_the_momentum_of_the_floor() {
    // A ball on a plate, of which another one rebounds with half of its speed; gravity changes it by 2 g h / v^2 = 4e-4.
    let law = "RST_CLB(normal_restitution: 0.5, tangential_restitution: 0.0, friction: 0.3)";
    let target = "sizes: Single(1.0), placement: List(positions: [(0.0, 0.0, 1.0)])";
    let shot = "sizes: Single(0.25), placement: List(positions: [(0.0, 0.0, 4.0)]), velocity: (0.0, 0.0, -5.0)";
    let parts = r#"gravity: (0.0, 0.0, -0.005),
        walls: [Plate(material: "ROCKx", colour: "WALLx", centre: (0, 0, -0.5), half_lengths: (5, 5, 0.5))],
        compute: (dt: 0.01, end_time: 3.0, output_every: 20, tol: 1e-9)"#;
    let columns = betas(&scene(law, target, shot, parts));
    assert_eq!(columns["beta"][0], 0.0);
    assert_last(&columns, "beta_normal", 1.5, 1e-3);
    assert_last(&columns, "beta_z", -1.5, 1e-3);
}

/// One grain has neither a plane of its surface nor rings around the axis, wherever it is hit.
#[test]
fn a_target_of_one_grain_has_finite_figures_and_no_crater() {
    for (gravity, offset) in [0.0, 0.01].into_iter().flat_map(|g| [0.0, 0.3, 0.9, 1.2, 3.0].map(|x| (g, x))) {
        let law = "RST_CLB(normal_restitution: 0.5, tangential_restitution: 0.0, friction: 0.3)";
        let target = "sizes: Single(1.0), placement: List(positions: [(0.0, 0.0, 1.0)])";
        let shot = format!(
            "sizes: Single(0.25), placement: List(positions: [({offset:?}, 0.0, 4.0)]), velocity: (0.0, 0.0, -5.0)"
        );
        let parts = format!(
            r#"gravity: (0.0, 0.0, -{gravity:?}),
            walls: [Plate(material: "ROCKx", colour: "WALLx", centre: (0, 0, -0.5), half_lengths: (5, 5, 0.5))],
            compute: (dt: 0.01, end_time: 1.5, output_every: 50, tol: 1e-9)"#
        );
        let case = Case::from_scene(&scene(law, target, &shot, &parts)).solved(&["--threads", "1"]);
        // 1: with a note that there is no crater.
        assert_eq!(impact(case.path(), &[]), 1, "{gravity} {offset}");
        let table = |name: &str| csv(&case.path().join("POSTPRO/impact").join(name)).unwrap();
        let betas = table("beta.csv");
        // Without self-gravity there is no escape speed, without a hit no normal, and in a bed no level that momenta refer to.
        let is_hit = offset < 1.25;
        let is_defined_in_a_missed_bed = |name: &str| ["time", "target_mass", "ejecta", "ejecta_mass"].contains(&name);
        let is_empty = |name: &str| {
            name.starts_with("escaping")
                || !is_hit && (name == "beta_normal" || gravity > 0.0 && !is_defined_in_a_missed_bed(name))
        };
        for (name, values) in &betas {
            assert!(values.iter().all(|x| x.is_finite() != is_empty(name)), "{gravity} {offset}: {name} {values:?}");
        }
        for name in ["crater-size.csv", "crater-profile.csv"] {
            assert!(table(name).values().all(Vec::is_empty), "{gravity} {offset}: {name}");
        }
    }
}

#[test]
fn all_momentum_is_in_the_target_or_carried_away() {
    // A loose cluster under its own gravity, which the projectile scatters; twice with other numbers of threads.
    let target = "number: 60, solid_fraction: 0.2, sizes: Uniform(min: 0.8, max: 1.2), placement: JitteredLattice(envelope: Ball())";
    let shot = "sizes: Single(1.0), placement: List(positions: [(0.5, 0.0, 12.0)]), velocity: (0.1, 0.0, -3.0)";
    let parts = "compute: (dt: 0.02, end_time: 12.0, self_gravity: true, output_every: 100)";
    let law = "IQS_CLB(friction: 0.4)";
    let case = Case::from_scene(&scene(law, target, shot, parts)).solved(&["--threads", "1"]);
    assert_eq!(impact(case.path(), &["--threads", "1"]), 0);
    let folder = case.path().join("POSTPRO/impact");
    let read = || -> Vec<Vec<u8>> {
        cd_tests::case::files(&folder).iter().map(|name| std::fs::read(folder.join(name)).unwrap()).collect()
    };
    let (columns, one) = (csv(&folder.join("beta.csv")).unwrap(), read());
    assert_eq!(impact(case.path(), &["--threads", "3"]), 0);
    assert!(one == read() && one.len() == 12);
    let incident = ["x", "y", "z"].map(|axis| columns[&format!("carried_{axis}")][0]);
    let size = incident.iter().map(|part| part * part).sum::<f64>().sqrt();
    for (axis, incident) in ["x", "y", "z"].into_iter().zip(incident) {
        let [gained, carried] = ["gained", "carried"].map(|name| &columns[&format!("{name}_{axis}")]);
        // Momentum is kept to the rounding of contacts, and to the error of self-gravity, a part in 1e3 of a small force.
        assert!(gained.iter().zip(carried).all(|(p, c)| (p + c - incident).abs() < 1e-6 * size), "{axis}");
    }
    // Loose grains are thrown out: much of the target is lost, and the enhancement is not that of a catch.
    let last = |name: &str| *columns[name].last().unwrap();
    assert!(last("ejecta") > 5.0 && last("escaping") > 0.0 && last("ejecta_mass") >= last("escaping_mass"));
    let shares = csv(&folder.join("ejecta-speeds.csv")).unwrap();
    assert_eq!(shares["grains_faster"].first(), Some(&last("ejecta")));
    let angles = csv(&folder.join("ejecta-angles.csv")).unwrap();
    assert!((angles["mass"].iter().sum::<f64>() / last("ejecta_mass") - 1.0).abs() < 1e-12); // rounding of a sum
}
