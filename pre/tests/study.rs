//! `cd-pre study`: expansion into cases, faults, and what is left alone.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use tempfile::TempDir;

const SCENE: &str = r#"(
    materials: [(name: "ROCKx", density: 2700.0)],
    laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
    contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0")],
    grains: [(material: "ROCKx", colour: "BLUEx", number: 20, solid_fraction: 0.2, sizes: Single(0.1), placement: JitteredLattice(envelope: Ball()))],
    compute: (dt: 0.1, steps: 10),
)"#;

/// A folder with scene.ron and a study.
struct Study(TempDir);

impl Study {
    fn new(study: &str) -> Study {
        let folder = Study(tempfile::tempdir().unwrap());
        folder.write("scene.ron", SCENE);
        folder.write("study.ron", study);
        folder
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.path().join(name), text).unwrap();
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// Exit status and stderr of `cd-pre study study.ron FLAGS`.
    fn run(&self, flags: &[&str]) -> (Option<i32>, String) {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cd-pre"));
        let output = command.current_dir(self.path()).args(["study", "study.ron"]).args(flags).output().unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    }

    fn succeeds(&self) {
        assert_eq!(self.run(&[]), (Some(0), String::new()));
    }

    /// Expects a rejection with lines that begin so, each without the name of the program, and nothing written.
    fn is_refused(&self, expected: &[&str]) {
        let before = self.files();
        let (status, said) = self.run(&[]);
        let said: Vec<&str> = said.lines().map(|line| line.strip_prefix("cd-pre: ").unwrap()).collect();
        assert_eq!(status, Some(2));
        let alike =
            said.len() == expected.len() && said.iter().zip(expected).all(|(said, start)| said.starts_with(start));
        assert!(alike, "{said:#?} begin not as {expected:#?}");
        assert_eq!(self.files(), before);
    }

    /// All files with their bytes.
    fn files(&self) -> BTreeMap<String, Vec<u8>> {
        fn walk(folder: &Path, files: &mut BTreeMap<String, Vec<u8>>) {
            for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
                if path.is_dir() {
                    walk(&path, files);
                } else {
                    files.insert(path.display().to_string(), fs::read(&path).unwrap());
                }
            }
        }
        let mut files = BTreeMap::new();
        walk(self.path(), &mut files);
        files
    }
}

const GRID: &str = r#"(groups: [
    (
        name: "N{N}-mu{mu}-s{seed}",
        base: "scene.ron",
        set: [("compute.steps", 7)],
        parameters: [
            (name: "mu", paths: ["laws.1.kind.friction"], values: [0, 0.5], with: [(paths: ["compute.dt"], values: [0.2, 0.3])]),
            (name: "N", paths: ["grains.1.number"], values: [8, 12]),
        ],
        seeds: [1, 2],
    ),
    (name: "on-mu{mu}", base: "on.ron", from: "N8-mu{mu}-s1", parameters: [(name: "mu", values: [0, 0.5])]),
])"#;

#[test]
fn every_combination_is_a_case() {
    let study = Study::new(GRID);
    study.write("on.ron", "(compute: (dt: 0.1, steps: 5))");
    study.succeeds();
    assert_eq!(
        study.read("study.csv"),
        "case,from,mu,N,seed\n\
         N8-mu0-s1,,0,8,1\nN8-mu0-s2,,0,8,2\nN12-mu0-s1,,0,12,1\nN12-mu0-s2,,0,12,2\n\
         N8-mu0.5-s1,,0.5,8,1\nN8-mu0.5-s2,,0.5,8,2\nN12-mu0.5-s1,,0.5,12,1\nN12-mu0.5-s2,,0.5,12,2\n\
         on-mu0,N8-mu0-s1,0,,\non-mu0.5,N8-mu0.5-s1,0.5,,\n"
    );
    let scene = study.read("N12-mu0.5-s2/scene.ron");
    for part in ["friction: 0.5", "dt: 0.3", "number: 12", "steps: 7", "seed: 2"] {
        assert!(scene.contains(part), "{part}: {scene}");
    }
    assert!(study.read("on-mu0/changes.ron").ends_with("(compute: (dt: 0.1, steps: 5))"));
    let rules = study.read("study.mk");
    for line in [
        "CASES := N8-mu0-s1 N8-mu0-s2 ",
        "study.mk: study.ron scene.ron on.ron\n",
        "N12-mu0-s1/DATBOX/.done: N12-mu0-s1/scene.ron\n",
        "on-mu0/DATBOX/.done: on-mu0/changes.ron N8-mu0-s1/OUTBOX/.done\n",
    ] {
        assert!(rules.contains(line), "{line}: {rules}");
    }

    // The DATBOX is that of the same values by --set.
    let datbox = |scene: &str, folder: &str, settings: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cd-pre"));
        command.current_dir(study.path()).args([scene, "-o", folder]);
        settings.iter().for_each(|setting| _ = command.args(["--set", setting]));
        assert!(command.output().unwrap().status.success());
        let compute = study.read(&format!("{folder}/DATBOX/COMPUTE.RON"));
        let options: Vec<String> = compute.lines().filter(|line| !line.starts_with("//")).map(str::to_string).collect();
        (
            ["BODIES.DAT", "DOF.INI", "TACT_BEHAV.DAT"].map(|file| study.read(&format!("{folder}/DATBOX/{file}"))),
            options,
        )
    };
    let case = datbox("N12-mu0.5-s2/scene.ron", "N12-mu0.5-s2", &[]);
    let settings = ["compute.steps=7", "laws.1.kind.friction=0.5", "compute.dt=0.3", "grains.1.number=12", "seed=2"];
    assert!(case == datbox("scene.ron", "same", &settings));
}

#[test]
fn a_second_run_writes_what_has_changed_alone() {
    let study = Study::new(GRID);
    study.write("on.ron", "()");
    study.succeeds();
    let (before, time) =
        (study.files(), |name: &str| fs::metadata(study.path().join(name)).unwrap().modified().unwrap());
    let times = ["N8-mu0-s1/scene.ron", "N8-mu0.5-s1/scene.ron"].map(time);
    std::thread::sleep(std::time::Duration::from_millis(25));
    study.succeeds();
    assert!(study.files() == before);
    study.write("study.ron", &GRID.replace("0.2, 0.3", "0.2, 0.25"));
    study.succeeds();
    assert_eq!(time("N8-mu0-s1/scene.ron"), times[0]);
    assert!(time("N8-mu0.5-s1/scene.ron") > times[1]);
}

#[test]
fn another_folder_and_values_from_the_command_line() {
    let study = Study::new(GRID);
    study.write("on.ron", "()");
    let flags = ["-o", "out", "--set", "groups.1.seeds=[1, 5]", "--set", "groups.1.parameters.2.values=[8]"];
    assert_eq!(study.run(&flags), (Some(0), String::new()));
    assert!(study.read("out/N8-mu0.5-s5/scene.ron").contains("seed: 5"));
    assert_eq!(study.read("out/study.csv").lines().count(), 7);
    // Faults of these values name the flag.
    let (status, said) = study.run(&["--set", "groups.1.parameters.2.values=[-8]"]);
    assert_eq!(status, Some(2));
    assert!(
        said.contains("options: --set groups.1.parameters.2.values=[-8]: grains.1.number: -8; expected "),
        "{said}"
    );
}

#[test]
fn scenes_from_elsewhere_are_not_replaced() {
    let study = Study::new("(groups: [(name: \"a\", base: \"scene.ron\")])");
    fs::create_dir(study.path().join("a")).unwrap();
    study.write("a/changes.ron", "()");
    study.succeeds();
    assert_eq!(study.read("a/changes.ron"), "()");
    study.write("a/scene.ron", SCENE);
    study.is_refused(&[
        "a/scene.ron: file: was not written by a study and would be replaced; expected another name for the case",
    ]);
}

#[test]
fn files_are_seen_from_the_case() {
    let study = Study::new(
        r#"(groups: [(name: "deep/a{a}", base: "scene.ron", parameters: [(name: "a", paths: ["grains.1.number"], values: [5])])])"#,
    );
    let model = r#"shape: Model(file: "rock.obj", scale: Factor(0.1)), "#;
    study.write(
        "scene.ron",
        &SCENE.replace("sizes: Single(0.1), ", model).replace("solid_fraction: 0.2", "solid_fraction: 0.01"),
    );
    study.write("rock.obj", "v 1 1 1\nv 1 -1 -1\nv -1 1 -1\nv -1 -1 1\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n");
    study.succeeds();
    assert!(study.read("deep/a5/scene.ron").contains(r#"file: "../../rock.obj""#));
    let mut command = Command::new(env!("CARGO_BIN_EXE_cd-pre"));
    let output = command.arg(study.path().join("deep/a5/scene.ron")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn files_of_fields_and_of_contact_shapes_are_seen_from_the_case() {
    let study = Study::new(
        r#"(groups: [(name: "d{d}", base: "scene.ron", parameters: [(name: "d", paths: ["compute.fields.1.density"], values: [5])])])"#,
    );
    let model = r#"shape: Model(file: "rock.obj", scale: Factor(0.1), contact_shape: Files(["rock.obj"])), "#;
    let scene = SCENE.replace("sizes: Single(0.1), ", model).replace("solid_fraction: 0.2", "solid_fraction: 0.01");
    let field = r#"compute: (fields: [Polyhedron(surface: "rock.obj", density: 1)], "#;
    study.write("scene.ron", &scene.replace("compute: (", field));
    study.write("rock.obj", "v 1 1 1\nv 1 -1 -1\nv -1 1 -1\nv -1 -1 1\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n");
    study.succeeds();
    assert_eq!(study.read("d5/scene.ron").matches("../rock.obj").count(), 3, "{}", study.read("d5/scene.ron"));
    let mut command = Command::new(env!("CARGO_BIN_EXE_cd-pre"));
    let output = command.arg(study.path().join("d5/scene.ron")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn faults_of_the_form_have_their_line_and_column() {
    let study = |text: &str| Study::new(text);
    study("(groups: [(nmae: \"a\", base: \"scene.ron\")])")
        .is_refused(&["study.ron:1:12: group 1: unknown field 'nmae'; did you mean name?"]);
    study("(groups: [(name: \"a{friciton}\", base: \"scene.ron\", parameters: [(name: \"friction\", values: [1])])])")
        .is_refused(&[
            "study.ron:1:18: group 1, name: {friciton} is not a parameter of the group; did you mean friction?",
        ]);
    study(
        "(groups: [\n (name: \"a\"),\n (name: \"../b\", base: \"scene.ron\"),\n (name: \"c{x}\", base: \"scene.ron\",\n  \
         parameters: [(name: \"x\", values: [1, 2], with: [(values: [1])]), (name: \"y\", values: [])]),\n])",
    )
    .is_refused(&[
        "study.ron:2:2: group 1: no base; expected the file of a scene",
        "study.ron:3:9: group 2, name: '../b'; expected a folder below, of letters, digits and . _ + - /",
        "study.ron:5:60: group 3, parameter 1, with 1, values: 1 values; expected 2 values, as the parameter it varies with",
        "study.ron:5:88: group 3, parameter 2, values: 0 values; expected at least one",
    ]);
    study("(groups: [(name: \"a\", base: \"scene.ron\", parameters: [(name: \"mu\", values: [1, 2])])])").is_refused(
        &["study.ron:1:18: group 1, name: two cases are named 'a'; expected a pattern with every parameter, as {NAME}"],
    );
    // The same row of parameters that vary together, and the same seed, would be the same case twice.
    study(
        "(groups: [(name: \"a{x}-{seed}\", base: \"scene.ron\", seeds: [1, 2, 1],\n parameters: [(name: \"x\", values: \
         [0.5, 1, 0.5, 0.5], with: [(name: \"y\", values: [1, 1, 1, 2])])])])",
    )
    .is_refused(&[
        "study.ron:2:44: group 1, parameter 1, value 3: 0.5 occurs twice; expected different values",
        "study.ron:1:66: group 1, seed 3: 1 occurs twice; expected different values",
    ]);
    study("(groups: [(name: \"a{seed}\", base: \"scene.ron\", seeds: [])])").is_refused(&[
        "study.ron:1:18: group 1, name: {seed}, in a group without seeds; expected seeds in it, such as seeds: [1, 2]",
    ]);
    study("(groups: [(name: \"first\", base: \"scene.ron\"), (name: \"b\", from: \"frist\")])")
        .is_refused(&["study.ron:1:65: group 2, from: frist is not a case; did you mean first?"]);
}

#[test]
fn a_fault_of_a_case_is_that_of_its_value() {
    let study = Study::new(
        r#"(groups: [(
    name: "a{mu}-{n}",
    base: "scene.ron",
    set: [("compute.stps", 3)],
    parameters: [
        (name: "mu", paths: ["laws.1.kind.friction"], values: [0.1, -0.2]),
        (name: "n", paths: ["grains.2.number"], values: [1]),
    ],
)])"#,
    );
    study.is_refused(&[
        "study.ron:7:58: group 1, parameter 2, value 1: grains.2.number: no 'grains.2' in the file; expected grains.1",
    ]);
    study.write("study.ron", &study.read("study.ron").replace("grains.2", "grains.1"));
    study.is_refused(&["study.ron:4:28: group 1, set 1.2: compute.stps: unknown field 'stps'; did you mean steps?"]);
    study.write("study.ron", &study.read("study.ron").replace("stps", "steps"));
    study.is_refused(&["study.ron:6:69: group 1, parameter 1, value 2: laws.1.kind.friction: "]);
    // Faults of the base are its own, once.
    study.write("study.ron", &study.read("study.ron").replace("-0.2", "0.2"));
    study.write("scene.ron", &SCENE.replace("2700.0", "-2700.0"));
    study.is_refused(&["scene.ron:2:"]);
}

#[test]
fn former_names_are_reported_once_each_at_their_position() {
    let wall = r#"Cylinder(material: "ROCKx", colour: "BLUEx", centre: (0, 0, -90), half_height: 1, radius: 1, spin: Constant(0))"#;
    let base =
        SCENE.replace("placement: ", "place: ").replace("    compute:", &format!("    walls: [{wall}],\n    compute:"));
    let study = Study::new(
        r#"(groups: [(
    name: "a{w}-{n}",
    base: "scene.ron",
    set: [("grains.1.place.envelope", Ball(radius: 2.0)), ("grains.1.standing", Random)],
    parameters: [
        (name: "w", paths: ["walls.1.rotation.1"], values: [0, 1, 2, 3]),
        (name: "n", paths: ["grains.1.number"], values: [5, 6], with: [(paths: [ r"grains.1.place"], values: [
            RandomSequential(envelope: Ball()), RandomSequential(envelope: Ball())])]),
    ],
)])"#,
    );
    study.write("scene.ron", &base);
    let (status, said) = study.run(&[]);
    let expected: String = [
        "study.ron:4:22: place: renamed, 2 times in this file; write placement",
        "study.ron:4:70: standing: renamed; write grain_orientation",
        "study.ron:6:38: rotation: renamed; write spin",
        "scene.ron:5:104: place: renamed; write placement",
    ]
    .map(|line| format!("cd-pre: warning: {line}\n"))
    .concat();
    assert_eq!((status, said), (Some(0), expected));
    // Names in a setting of the command line are reported there.
    let setting = "groups.1.parameters.1.paths=[\"walls.1.rotation.1\"]";
    let (status, said) = study.run(&["--set", setting]);
    let warning = format!("options: --set {setting}: rotation: renamed; write spin\n");
    assert!(status == Some(0) && said.contains(&warning), "{said}");
    assert_eq!(said.matches("rotation").count(), 2, "{said}");
}
