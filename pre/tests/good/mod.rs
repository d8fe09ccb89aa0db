//! A scene without fault, and the faults of scenes that differ from it.

use std::path::Path;

/// A scene without fault; tests change one of its lines.
pub const GOOD: &str = r#"(
    gravity: (0.0, 0.0, -9.81),
    materials: [(name: "ROCKx", density: 2700.0)],
    laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
    contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0"), (between: ("BLUEx", "WALLx"), law: "iqsc0")],
    grains: [(
        material: "ROCKx", colour: "BLUEx",
        number: 20,
        sizes: Uniform(min: 0.5, max: 1.0),
        placement: JitteredLattice(envelope: Ball(radius: 10.0)),
        spin: (0.0, 0.0, 0.1),
    )],
    walls: [Plate(material: "ROCKx", colour: "WALLx", centre: (0.0, 0.0, -11.0), half_lengths: (9.0, 9.0, 0.5))],
    compute: (dt: 1.0e-3),
)
"#;

/// Faults of a scene, a line each; "nothing" without any.
pub fn faults(scene: &str) -> String {
    match cd_pre::read_scene(Path::new("scene.ron"), scene, &[]) {
        Ok(_) => String::from("nothing"),
        Err(faults) => faults.to_string(),
    }
}

/// Faults of a scene in which the first of each pair of texts is replaced by the second.
#[track_caller]
pub fn faults_of_changed(scene: &str, changes: &[(&str, &str)]) -> String {
    let mut changed = scene.to_string();
    for (from, to) in changes {
        assert!(changed.contains(from), "{from}");
        changed = changed.replacen(from, to, 1);
    }
    faults(&changed)
}

/// A text of the scene, its replacement, and the message without the file's name.
pub type Case = (&'static str, &'static str, &'static str);

/// Checks the messages about changes of a scene.
#[track_caller]
pub fn check_messages(scene: &str, cases: &[Case]) {
    for (from, to, message) in cases {
        assert_eq!(faults_of_changed(scene, &[(from, to)]), format!("scene.ron:{message}"), "{from} -> {to}");
    }
}
