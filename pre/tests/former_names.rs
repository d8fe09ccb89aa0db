//! Names of earlier versions: they are read as the current ones, with a warning; the docs list them.

use std::path::Path;
use std::process::Command;

use cd_formats::former_names::{FORMER_FIELDS, FORMER_VALUES};
use cd_pre::from_outbox;

/// Scene with every former name of fields and values of scenes.
const FORMER_SCENE: &str = r#"(
    materials: [(name: "ROCKx", density: 2700.0)],
    laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
    contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0"), (between: ("BLUEx", "WALLx"), law: "iqsc0")],
    grains: [
        (
            material: "ROCKx", colour: "BLUEx", number: 3, sizes: Single(1.0),
            shape: Model(file: "rock.obj", scaled: Factor(2.0), contact: Pieces(most: 4, vertices: 32)),
            standing: Same((axis: (0, 0, 1), angle: 0.5)),
            place: RandomSequential(envelope: Model(file: "rock.obj", scaled: Factor(20.0))),
        ),
        (
            material: "ROCKx", colour: "BLUEx", shape: Model(file: "rock.obj", contact: Whole),
            place: List(positions: [(99, 0, 0)]),
        ),
    ],
    walls: [
        Cylinder(
            material: "ROCKx", colour: "WALLx", centre: (0, 0, -90), half_height: 1, radius: 1, rotation: Constant(0.1),
        ),
        Cylinder(
            material: "ROCKx", colour: "WALLx", centre: (0, 0, 90), half_height: 1, radius: 1,
            angular_velocity: Constant(0.2),
        ),
    ],
    compute: (adaptive: (most: 4)),
)
"#;

const ROCK: &str = "v 1 1 1\nv 1 -1 -1\nv -1 1 -1\nv -1 -1 1\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n";

/// The same scene with current names.
fn current_scene() -> String {
    let mut scene = FORMER_SCENE.to_string();
    for name in FORMER_FIELDS.iter().filter(|name| !name.holder.starts_with("bodies")) {
        scene = match name.former {
            // As a field of the shape `Pieces` only.
            "vertices" => scene.replace("vertices: 32", "max_vertices: 32"),
            former => scene.replace(&format!(" {former}: "), &format!(" {}: ", name.current)),
        };
    }
    let scene = scene.replace("Pieces(most: ", "Pieces(max_pieces: ").replace("(most: ", "(max_multiple: ");
    scene.replace(": Whole", ": Surface")
}

/// Runs cd-pre on a scene; returns the exit code, stderr without the folder's name, and the files of DATBOX.
fn datbox(scene: &str, arguments: &[&str]) -> (i32, String, Vec<(String, Vec<u8>)>) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.ron"), scene).unwrap();
    std::fs::write(folder.path().join("rock.obj"), ROCK).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_cd-pre"))
        .arg(folder.path().join("scene.ron"))
        .args(arguments)
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap().replace(&format!("{}/", folder.path().display()), "");
    let entries = std::fs::read_dir(folder.path().join("DATBOX")).into_iter().flatten().map(Result::unwrap);
    let file = |entry: std::fs::DirEntry| {
        let text = std::fs::read_to_string(entry.path()).unwrap();
        // The checksum of the scene is that of its bytes.
        let lines = text.lines().filter(|line| !line.starts_with("// Made from"));
        (entry.file_name().into_string().unwrap(), lines.collect::<Vec<_>>().join("\n").into_bytes())
    };
    // Its checksums change with the comment that is left out.
    let mut files: Vec<_> = entries.map(file).filter(|(name, _)| name != "SHA256SUMS").collect();
    files.sort();
    (output.status.code().unwrap(), said, files)
}

#[test]
fn former_names_are_read_with_a_warning_each() {
    let (code, said, former) = datbox(FORMER_SCENE, &[]);
    let expected: String = [
        "8:44: scaled: renamed, 2 times in this file; write scale",
        "8:65: contact: renamed, 2 times in this file; write contact_shape",
        "8:81: most: renamed; write max_pieces",
        "8:90: vertices: renamed; write max_vertices",
        "9:13: standing: renamed; write grain_orientation",
        "10:13: place: renamed, 2 times in this file; write placement",
        "13:89: Whole: renamed; write Surface",
        "19:97: rotation: renamed; write spin",
        "23:13: angular_velocity: renamed; write spin",
        "26:26: most: renamed; write max_multiple",
    ]
    .map(|line| format!("cd-pre: warning: scene.ron:{line}\n"))
    .concat();
    assert_eq!((code, said), (0, expected));
    let (code, said, current) = datbox(&current_scene(), &[]);
    assert_eq!((code, said), (0, String::new()));
    assert!(former.len() >= 6 && former == current);
}

#[test]
fn former_names_in_settings_are_read_with_a_warning() {
    let rotation = "walls.1.rotation=Constant(0.2)";
    let (code, said, former) = datbox(&current_scene(), &["--set", rotation]);
    let warning = format!("cd-pre: warning: options: --set {rotation}: rotation: renamed; write spin\n");
    assert_eq!((code, said), (0, warning));
    assert_eq!(former, datbox(&current_scene(), &["--set", "walls.1.spin=Constant(0.2)"]).2);
    // A current name in the setting finds the former one in the file.
    assert_eq!(former, datbox(FORMER_SCENE, &["--set", "walls.1.spin=Constant(0.2)"]).2);
    // Former names in a value.
    let shape = r#"grains.2.shape=Model(file: "rock.obj", scaled: Factor(3.0))"#;
    let (code, said, former) = datbox(&current_scene(), &["--set", shape]);
    assert!(code == 0 && said.ends_with("scaled: renamed; write scale\n"), "{said}");
    assert_eq!(former, datbox(&current_scene(), &["--set", &shape.replace("scaled", "scale")]).2);
}

#[test]
fn a_field_under_both_names_is_an_error() {
    let both = "standing: Random, grain_orientation: Random,";
    let scene = current_scene().replace("grain_orientation: Same((axis: (0, 0, 1), angle: 0.5)),", both);
    let (code, said, _) = datbox(&scene, &[]);
    let expected = "cd-pre: scene.ron:9:31: grains 1: 'grain_orientation' and its former name 'standing' are both there; \
                    expected grain_orientation only\n";
    assert_eq!((code, said.as_str()), (2, expected));
    let turned = "grain_orientation: Random, standing: Random,";
    let (code, said, _) = datbox(&scene.replace(both, turned), &[]);
    assert_eq!((code, said), (2, expected.replace("9:31", "9:40")));
}

#[test]
fn mistakes_next_to_former_names_have_their_own_column() {
    let (code, said, _) = datbox(&FORMER_SCENE.replace("most: 4, vertices: 32", "most: 4, vertices: 3x"), &[]);
    assert_eq!(code, 2);
    assert!(said.starts_with("cd-pre: scene.ron:8:100: grains 1, shape, contact_shape, max_vertices: 3x"), "{said}");
    let (_, said, _) = datbox(&FORMER_SCENE.replace("most: 4", "most: 0"), &[]);
    assert!(said.starts_with("cd-pre: scene.ron:8:87: grains 1, shape, contact_shape, max_pieces: 0"), "{said}");
}

#[test]
fn former_names_of_changes_are_read() {
    let read = |text: &str| from_outbox::read(Path::new("changes.ron"), text, &[]).unwrap();
    let turn = "(axis: (0, 0, 1), angle: 1.0)";
    assert_eq!(
        read(&format!("(bodies: [(keep: Largest, stop: Drift, turn: {turn}), (stop: Motion), (stop: RigidMotion)])")),
        read(&format!(
            "(bodies: [(select: Largest, remove_motion: Translation, rotate: {turn}), (remove_motion: All), \
             (remove_motion: RigidMotion)])"
        )),
    );
}

#[test]
fn docs_list_the_former_names() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/reference/scene/README.md");
    let page = std::fs::read_to_string(page).unwrap();
    let (_, section) = page.split_once("## Names of earlier versions").unwrap();
    let mut names: Vec<String> = FORMER_FIELDS
        .iter()
        .chain(&FORMER_VALUES)
        .map(|name| format!("| `{}` | `{}` |", name.former, name.current))
        .collect();
    names.sort();
    names.dedup();
    let rows: Vec<&str> = section.lines().filter(|line| line.starts_with("| `")).collect();
    assert_eq!(rows.len(), names.len());
    names.iter().for_each(|name| assert!(rows.iter().any(|row| row.starts_with(name)), "{name}"));
}
