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

/// Faults of a scene in which `from` is replaced by `to`.
#[track_caller]
pub fn said_of(scene: &str, from: &str, to: &str) -> String {
    assert!(scene.contains(from), "{from}");
    faults(&scene.replacen(from, to, 1))
}
