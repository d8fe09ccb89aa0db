//! Messages of cd-pre as a user meets them: mistakes in the text of a scene with line and column, warnings, exit codes.

mod good;

use std::process::{Command, Output};
use std::sync::LazyLock;

use good::{Case, check_messages, faults, faults_of_changed};

/// The good scene with more options.
static GOOD: LazyLock<String> =
    LazyLock::new(|| good::GOOD.replace("(dt: 1.0e-3)", "(dt: 1.0e-3, output_every: 10, self_gravity: true)"));

/// Faults of the good scene in which `from` is replaced by `to`.
#[track_caller]
fn messages(from: &str, to: &str) -> String {
    faults_of_changed(&GOOD, &[(from, to)])
}

#[track_caller]
fn check(cases: &[Case]) {
    check_messages(&GOOD, cases);
}

/// Runs the program.
fn cd_pre(arguments: &[&str]) -> (i32, String) {
    let Output { status, stderr, .. } = Command::new(env!("CARGO_BIN_EXE_cd-pre")).args(arguments).output().unwrap();
    (status.code().unwrap(), String::from_utf8(stderr).unwrap())
}

/// Writes a scene into a folder and runs the program; exit code and stderr, without the folder's name.
fn run_on_scene(scene: &str, arguments: &[&str]) -> (i32, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ron");
    std::fs::write(&path, scene).unwrap();
    let (code, text) = cd_pre(&[&[path.to_str().unwrap()], arguments].concat());
    (code, text.replace(&format!("{}/", folder.path().display()), ""))
}

#[test]
fn mistakes_in_the_text_are_placed() {
    let wall = "-11.0),";
    check(&[
        (
            "    gravity:",
            "    # down\n    gravity:",
            "2:5: scene: '#' begins no comment; expected // before it, or /* */ around it",
        ),
        ("gravity:", "\"gravity\":", "2:5: scene: the name \"gravity\" in quotes; expected gravity: without quotes"),
        ("number: 20", "number: 50.5", "8:17: grains 1, number: 50.5; expected an integer"),
        ("number: 20", "number: -20", "8:17: grains 1, number: -20; expected an integer of 0 or more"),
        ("number: 20", "number: \"20\"", "8:17: grains 1, number: \"20\"; expected an integer"),
        ("number: 20", "number: 20 m", "8:17: grains 1, number: 20 m; expected a number without unit"),
        ("number: 20", "number 20", "8:15: grains 1: no ':' behind 'number'; expected number: value"),
        ("number: 20", "number = 20", "8:16: grains 1: '=' behind number; expected number: value"),
        ("number: 20,", "number: 20", "8:19: grains 1, number: no ',' before 'sizes'; expected ',' here"),
        ("number: 20,", "number: 20;", "8:19: grains 1, number: ';'; expected ','"),
        ("number: 20", "number:", "8:16: grains 1, number: ','; expected a value before it"),
        ("number: 20", "numbr: 20", "8:9: grains 1: unknown field 'numbr'; did you mean number?"),
        ("min: 0.5", "min: 0,5", "9:29: grains 1, sizes: 0,5; expected a decimal point, 0.5"),
        ("min: 0.5", "min: 1,000.5", "9:29: grains 1, sizes: 1,000.5; expected digits without separators, 1000.5"),
        ("min: 0.5", "min: 0.5, min: 0.6", "9:34: grains 1, sizes: 'min' occurs twice; expected it once"),
        (", max: 1.0)", ")", "9:16: grains 1, sizes: no field 'max'; expected the field max of Uniform"),
        ("max: 1.0)", "max: 1.0", "9:23: scene: '(' without ')'; expected ')' in this line"),
        ("Uniform(", "Unifrom(", "9:16: grains 1, sizes: unknown 'Unifrom'; did you mean Uniform?"),
        (
            "Uniform(min: 0.5, max: 1.0)",
            "Single",
            "9:16: grains 1, sizes: Single; expected Single(...) with its values",
        ),
        (
            "Uniform(min: 0.5, max: 1.0)",
            "0.5",
            "9:16: grains 1, sizes: 0.5; expected one of Single, Uniform, PowerLaw, LogNormal, List",
        ),
        (
            "Uniform(min: 0.5, max: 1.0)",
            "Single(0.5, 1.0)",
            "9:16: grains 1, sizes: too many values in Single(0.5, 1.0); expected one value",
        ),
        (
            wall,
            "-11.0), velocity: (0, 0, 0.1),",
            "13:93: wall 1, velocity 1: 0; expected a function, one of Constant, Harmonic, Table, such as Constant(0)",
        ),
        (wall, "-11.0), velocity: 0.1,", "13:92: wall 1, velocity: 0.1; expected 3 values in ( )"),
        ("-9.81)", "-9.81", "2:14: scene: '(' without ')'; expected ')' in this line"),
        ("(0.0, 0.0, -9.81)", "(0.0, -9.81)", "2:14: gravity: 2 values in (0.0, -9.81); expected 3 values in ( )"),
        (
            "(0.0, 0.0, -9.81)",
            "(0.0, 0.0, 0.0, -9.81)",
            "2:14: gravity: too many values in (0.0, 0.0, 0.0, -9.81); expected 3 values in ( )",
        ),
        ("(0.0, 0.0, -9.81)", "[0.0, 0.0, -9.81]", "2:14: gravity: [0.0, 0.0, -9.81]; expected 3 values in ( )"),
        (
            "IQS_CLB(friction: 0.4)",
            "IQS_WET_DS_CLB(cohesion: 3, dynamic_friction: 0.3, static_friction: 0.4)",
            "4:34: law 1, kind: no field 'range'; expected the field range of IQS_WET_DS_CLB",
        ),
        ("IQS_CLB(", "IQS_CBL(", "4:34: law 1, kind: unknown 'IQS_CBL'; did you mean IQS_CLB?"),
        (
            "IQS_CLB(friction: 0.4)",
            "IQS_CLB(0.4)",
            "4:42: law 1, kind: 0.4; expected name: value, with the field friction",
        ),
        (
            "\"ROCKx\", density",
            "\"ROCKx, density",
            "3:24: material 1, name: no '\"' behind \"ROCKx, density: 2700.0)],; expected '\"' at the end of the text",
        ),
        ("\"ROCKx\", density", "'ROCKx', density", "3:24: material 1, name: 'ROCKx'; expected \"ROCKx\""),
        ("(0.0, 0.0, -9.81)", "'0,0,1'", "2:14: gravity: '0,0,1'; expected (0,0,1), or \"0,0,1\" for a text"),
        (
            "IQS_CLB(friction: 0.4)",
            "\"IQS_CLB\"",
            "4:34: law 1, kind: \"IQS_CLB\"; expected IQS_CLB(...) without quotes, with the field friction",
        ),
        ("\"ROCKx\", density", "ROCKx, density", "3:24: material 1, name: ROCKx; expected a text in quotes, \"ROCKx\""),
        ("2700.0", "\"heavy\"", "3:42: material 1, density: \"heavy\"; expected a number"),
        ("output_every", "output_evry", "14:27: compute: unknown field 'output_evry'; did you mean output_every?"),
        ("output_every", "output-every", "14:27: compute: the name 'output-every'; did you mean output_every?"),
        ("self_gravity: true", "self_gravity: yes", "14:59: compute, self_gravity: yes; expected true or false"),
        ("self_gravity: true", "accuracy: drat", "14:55: compute, accuracy: unknown 'drat'; did you mean draft?"),
        (
            "self_gravity: true",
            "adaptive: 16",
            "14:55: compute, adaptive: 16; expected ( ) around fields of max_multiple, travel, penetration",
        ),
        (
            "self_gravity: true",
            "events: [(time: 0, action: AddSpin(0, 0, 1))]",
            "14:80: compute, event 1, action 1: 0; expected 3 values in ( )",
        ),
        (
            "    )],\n    walls",
            "    ],\n    walls",
            "12:5: grains 1: ']', while '(' of 6:14 is open; expected ')' before it",
        ),
        (
            "    )],\n    walls",
            "    ),\n    walls",
            "13:5: grains: 'walls:' in a list, while '[' of 6:13 is open; expected ']' before it",
        ),
        ("(\n    gravity", "    gravity", "1:5: scene: 'gravity' outside of ( ); expected '(' before it"),
        ("    compute", "    /* compute", "14:5: scene: a comment without end; expected */ behind it"),
        ("true),\n)\n", "true),\n", "1:1: scene: '(' without ')'; expected ')' before the end of the text"),
        ("true),\n)\n", "true),\n))\n", "15:2: scene: ')' closes nothing; expected nothing more"),
    ]);
    assert_eq!(faults(""), "scene.ron:1:1: scene: no value; expected one");
    // Several at once.
    let twice = GOOD.replace("    gravity", "    # a\n    \"gravity\"");
    assert_eq!(faults(&twice).lines().count(), 2, "{}", faults(&twice));
}

#[test]
fn syntax_of_another_program_is_recognized() {
    let json = GOOD.replacen("(\n    gravity", "{\n    \"gravity\"", 1);
    let said = faults(&json);
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(lines[0], "scene.ron:1:1: scene: '{'; expected '(' around fields, '[' around lists");
    assert_eq!(lines[1], "scene.ron:2:5: scene: the name \"gravity\" in quotes; expected gravity: without quotes");
    assert_eq!(lines.len(), 2, "{said}");
}

/// Wherever a letter or a bracket is lost, nothing of the RON library is said, and the place is there.
#[test]
fn no_text_of_the_library_reaches_the_user() {
    let words = ["Expected ", "Unexpected", "identifier", "raw ", "std ", "struct", "trailing", "`"];
    let mut refused = 0;
    for (at, letter) in GOOD.char_indices() {
        for with in ["", "x", ")", "\"", ",", "#", "-"] {
            let said = faults(&format!("{}{with}{}", &GOOD[..at], &GOOD[at + letter.len_utf8()..]));
            if said == "nothing" {
                continue;
            }
            refused += 1;
            for line in said.lines() {
                assert!(!words.iter().any(|word| line.contains(word)), "{at} {with}: {line}");
                let mut parts = line.splitn(4, ':').skip(1);
                assert!(parts.next().is_some_and(|line| line.parse::<usize>().is_ok()), "{at} {with}: {line}");
            }
        }
    }
    assert!(refused > 2000, "{refused}");
}

#[test]
fn settings_are_rejected_by_their_own_text() {
    let messages = |set: &str| run_on_scene(&GOOD, &["--set", set]);
    for (set, message) in [
        ("grains.1.number=5.5", "5.5; expected an integer"),
        ("grains.1.numbr=5", "unknown field 'numbr'; did you mean number?"),
        ("compute.output_evry=5", "unknown field 'output_evry'; did you mean output_every?"),
        ("grain.1.number=5", "no 'grain' in the file; did you mean grains?"),
        ("grains.1.material=\"ROCK", "value: no '\"' behind \"ROCK; expected '\"' at the end of the text"),
        ("laws.1.kind.friction=-1", "-1; expected a finite number >= 0"),
        ("walls.1.velocity=(0, 0, 1)", "0; expected a function, one of Constant, Harmonic, Table, such as Constant(0)"),
    ] {
        assert_eq!(messages(set), (2, format!("cd-pre: options: --set {set}: {message}\n")));
    }
    let twice = "cd-pre: options: --set seed=2: sets the value of --set seed=1 again; expected it once\n";
    assert_eq!(run_on_scene(&GOOD, &["--set", "seed=1", "--set", "seed=2"]), (2, twice.into()));
    let folder = "cd-pre: OUT: is not expected here; the folder is given by -o OUT\n";
    assert_eq!(run_on_scene(&GOOD, &["OUT"]), (2, folder.into()));
}

#[test]
fn doubtful_values_are_asked_about_and_accepted() {
    for (from, to, warning) in [
        ("2700.0", "2.7", "3:42: material 1, density: 2.7; did you mean kg/m^3? 2.7 g/cm^3 are 2700 kg/m^3"),
        (
            "2700.0",
            "2700e3",
            "3:42: material 1, density: 2700e3; did you mean kg/m^3? water has 1000, rock 2500 to 3500",
        ),
        (
            "friction: 0.4",
            "friction: 50",
            "4:52: law 1, kind, friction: 50; did you mean an angle? 50 degrees are 1.192",
        ),
        (
            "-11.0),",
            "-11.0), velocity: (Constant(0), Constant(0), Harmonic(amplitude: 1, omega: 3, ramp_start: 0)),",
            "13:119: wall 1, velocity 3: ramp_start 0 without ramp_rate: the function is 0 at all times; \
             leave ramp_start out, or give a ramp_rate in 1/s",
        ),
        (
            "-11.0),",
            "-11.0), spin: (Table([(0, 0), (1, 0)]), Constant(0), Constant(0)),",
            "13:89: wall 1, spin 1: the function is 0 at all times; give values, or Constant(0.0)",
        ),
        (
            "spin: (0.0, 0.0, 0.1)",
            "driven: (None, None, None)",
            "11:17: grains 1, driven: imposes no translation, but holds the rotation; \
             write driven_spin: (Constant(0.0), Constant(0.0), Constant(0.0)) alone, or leave driven out",
        ),
        (
            "spin: (0.0, 0.0, 0.1)",
            "driven: (None, None, None), driven_spin: (None, None, None)",
            "11:17: grains 1, driven: imposes nothing; give a function, or leave it out",
        ),
        (
            "spin: (0.0, 0.0, 0.1)",
            "spin: (0.0, 0.0, 0.1), orientation: (axis: (0, 0, 1), angle: 45)",
            "11:70: grains 1, orientation, angle: 45; did you mean degrees? 45 degrees are 0.785 rad",
        ),
        (
            "0.1),\n    )]",
            "0.1),\n    ), (material: \"ROCKx\", colour: \"BLUEx\", sizes: Single(0.5), placement: List(positions: [(0, 0, 0)]),
        orbit: (about: Colour(\"BLUEx\"), path: Elements(periapsis: 50, eccentricity: 0, inclination: 30, node: -6.28)))]",
            "13:101: grains 2, orbit, path, inclination: 30; did you mean degrees? 30 degrees are 0.524 rad",
        ),
        (
            "self_gravity: true",
            "self_gravity: true, fields: [PointMass(mass: 1e9, orbit: Elements(periapsis: 5e3, eccentricity: 0.5, \
             inclination: 6.2832, node: -90))]",
            "14:173: compute, field 1, orbit, node: -90; did you mean degrees? -90 degrees are -1.571 rad",
        ),
        (
            "self_gravity: true",
            "self_gravity: true, fields: [PointMass(mass: 1e9, orbit: Elements(periapsis: 5e3, eccentricity: 0.5, \
             argument: 400))]",
            "14:156: compute, field 1, orbit, argument: 400; did you mean degrees? 400 degrees are 6.981 rad",
        ),
        (
            "walls: [",
            "walls: [Plate(material: \"ROCKx\", colour: \"WALLx\", centre: (0, 0, 20), half_lengths: (1, 1, 1), \
             force: (None, None, Constant(-5))), ",
            "13:107: wall 1, force: a plate that moves by a force, and another plate of the colour 'WALLx'; two plates \
             never touch each other: press with a solid Cylinder or a Box of grains that is driven in part; if they cannot \
             meet, write (between: (\"WALLx\", \"WALLx\"), law: None)",
        ),
        (
            "(friction: 0.4))",
            "(friction: 0.4)), (name: \"iqsc1\", kind: IQS_CLB(friction: 0.5))",
            "4:66: law 2, name: no contact uses the law 'iqsc1'; name it in a row of contacts, or remove it",
        ),
    ] {
        let expected = format!("cd-pre: warning: scene.ron:{warning}\n");
        assert_eq!(run_on_scene(&GOOD.replacen(from, to, 1), &[]), (0, expected), "{to}");
    }
    assert_eq!(run_on_scene(&GOOD, &[]), (0, String::new()));
    // A wall may be as light as its user wants.
    let light = GOOD.replacen("2700.0)", "2700.0), (name: \"LIGHT\", density: 10.0)", 1);
    let (grains, wall) = light.split_once("walls:").unwrap();
    let wall = wall.replacen("\"ROCKx\"", "\"LIGHT\"", 1);
    assert_eq!(run_on_scene(&format!("{grains}walls:{wall}"), &[]), (0, String::new()));
    // A setting is named in place of a line.
    let (code, said) = run_on_scene(&GOOD, &["--set", "materials.1.density=3.1"]);
    assert!(
        code == 0 && said.starts_with("cd-pre: warning: options: --set materials.1.density=3.1: 3.1; did you"),
        "{said}"
    );
}

#[test]
fn events_before_the_start_are_rejected() {
    let event = "events: [(time: 1, action: Bond),\n (time: -1, action: AddSpin((0, 0, 1)))]";
    let message = "15:9: compute, event 2, time: -1 s is before the start of the run; expected at least 0 s";
    assert_eq!(messages("self_gravity: true", event), format!("scene.ron:{message}"));
}

#[test]
fn grains_larger_than_their_region_are_named() {
    let cm = "Uniform(min: 80.0, max: 120.0)";
    let said = messages("Uniform(min: 0.5, max: 1.0)", cm);
    assert!(said.starts_with("scene.ron:10:20: grains 1, placement: the smallest grain, of radius 8"), "{said}");
    assert!(
        said.ends_with(
            " m, is larger than a ball of radius 10 m; expected smaller grains or a larger envelope, lengths in m"
        ),
        "{said}"
    );
    let (small, both) = ("Uniform(min: 0.5, max: 1.0)", "List([0.5, 12.0])");
    let scene = GOOD.replacen("number: 20,", "", 1).replacen(small, both, 1);
    assert!(faults(&scene).contains("the largest grain, of radius 12 m, is larger than a ball"), "{}", faults(&scene));
}

#[test]
fn a_missing_surface_is_a_fault_of_the_grains_that_name_it() {
    let (code, said) =
        run_on_scene(&GOOD.replacen("number: 20,", "number: 20, shape: Model(file: \"rock.obj\"),", 1), &[]);
    let expected = "cd-pre: scene.ron:8:28: grains 1, shape: rock.obj cannot be read: there is no such file; \
                    expected a file next to the scene, or an absolute path\n";
    assert_eq!((code, said.as_str()), (2, expected));
}

#[test]
fn one_body_needs_no_law_with_itself() {
    let one = |number: &str| {
        let both = GOOD.replacen("(between: (\"BLUEx\", \"BLUEx\"), law: \"iqsc0\"), ", "", 1);
        faults(&both.replacen("number: 20", number, 1))
    };
    assert_eq!(one("number: 1"), "nothing");
    assert!(one("number: 2").contains("no law between 'BLUEx' and 'BLUEx'"), "{}", one("number: 2"));
}

#[test]
fn commands_and_files_that_are_not_there() {
    let said = cd_pre(&["from-outbx", "a", "b"]);
    assert_eq!(said, (2, "cd-pre: from-outbx: is neither a file nor a command; did you mean from-outbox?\n".into()));
    let said = cd_pre(&["no-such.ron"]);
    assert_eq!(said, (2, "cd-pre: no-such.ron: file: cannot be read: there is no such file\n".into()));
}

#[test]
fn datbox_names_the_scene_that_it_is_from() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ron");
    std::fs::write(&path, GOOD.as_str()).unwrap();
    let compute = |arguments: &[&str], case: &str| {
        let (code, said) = cd_pre(&[&[path.to_str().unwrap()], arguments].concat());
        assert_eq!((code, said), (0, String::new()));
        std::fs::read_to_string(folder.path().join(case).join("DATBOX/COMPUTE.RON")).unwrap()
    };
    let sum = cd_formats::origin::checksum(GOOD.as_bytes());
    let text = compute(&["--set", "compute.dt=2e-3"], "");
    assert!(
        text.starts_with(&format!("// Made from scene.ron, checksum {sum:016x}, --set compute.dt=2e-3\n")),
        "{text}"
    );
    let run = folder.path().join("run");
    let text = compute(&["-o", run.to_str().unwrap()], "run");
    assert!(text.starts_with(&format!("// Made from ../scene.ron, checksum {sum:016x}\n")), "{text}");
    let elsewhere = tempfile::tempdir().unwrap();
    let text = compute(&["-o", elsewhere.path().to_str().unwrap()], elsewhere.path().to_str().unwrap());
    assert!(!text.contains("checksum"), "{text}");
}

#[test]
fn a_case_of_from_outbox_that_is_none_is_one_fault() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(at("scene.ron"), "()").unwrap();
    let messages = |arguments: &[&str]| {
        let (code, text) = cd_pre(arguments);
        assert_eq!(code, 2, "{text}");
        text.replace(&folder.path().display().to_string(), "DIR")
    };
    let steps = "run cd-pre DIR/scene.ron and cd-solve DIR first";
    assert_eq!(
        messages(&["from-outbox", &at("scene.ron"), &at("x")]),
        format!("cd-pre: DIR/scene.ron: file: is a scene, not a case; {steps}\n")
    );
    assert_eq!(
        messages(&["from-outbox", &at("absent"), &at("x")]),
        "cd-pre: DIR/absent: folder: there is no such folder; expected the folder of a case, with OUTBOX in it\n"
    );
    assert_eq!(
        messages(&[&at(""), "from-outbox", &at("x")]),
        "cd-pre: from-outbox: a command comes first; did you mean cd-pre from-outbox DIR/ DIR/x?\n"
    );
}

#[test]
fn numbers_with_something_behind_them() {
    let message = |value: &str| messages("density: 2700.0", &format!("density: {value}"));
    for (value, expected) in [
        ("2.7D3", "scene.ron:3:42: material 1, density: 2.7D3; expected a number, 2.7e3"),
        ("2.7d3", "scene.ron:3:42: material 1, density: 2.7d3; expected a number, 2.7e3"),
        ("2.7*1000", "scene.ron:3:42: material 1, density: 2.7*1000; expected one number: arithmetic is not supported"),
        ("1/2", "scene.ron:3:42: material 1, density: 1/2; expected one number: arithmetic is not supported"),
        ("2700.0 kg/m3", "scene.ron:3:42: material 1, density: 2700.0 kg/m3; expected a number without unit"),
        ("2700.0kg/m3", "scene.ron:3:42: material 1, density: 2700.0kg/m3; expected a number without unit"),
        ("2700.0kg", "scene.ron:3:42: material 1, density: 2700.0kg; expected a number without unit"),
        ("2700 kg m^-3", "scene.ron:3:42: material 1, density: 2700 kg m^-3; expected a number without unit"),
    ] {
        assert_eq!(message(value), expected);
    }
}

#[test]
fn friction_of_an_event_is_questioned() {
    let event = "output_every: 10, events: [(time: 1.0, action: SetFriction(\"iqsc0\", 50.0))],";
    let (code, text) = run_on_scene(&GOOD.replace("output_every: 10,", event), &[]);
    let line = "cd-pre: warning: scene.ron:14:54: compute, event 1: SetFriction 50; did you mean an angle? 50 degrees are \
                1.192\n";
    assert_eq!((code, text.as_str()), (0, line));
}

#[test]
fn misspelt_names_of_a_scene_get_the_nearest() {
    for (from, to, expected) in [
        (
            "material: \"ROCKx\", colour: \"BLUEx\"",
            "material: \"ROKCx\", colour: \"BLUEx\"",
            "'ROKCx' is not defined; did you mean ROCKx?",
        ),
        (
            "(\"BLUEx\", \"WALLx\"), law: \"iqsc0\"",
            "(\"BLUEx\", \"WALLx\"), law: \"iqcs0\"",
            "'iqcs0' is not defined; did you mean iqsc0?",
        ),
        (
            "(\"BLUEx\", \"WALLx\")",
            "(\"BLUEx\", \"WALLy\")",
            "no grains and no wall have the colour 'WALLy'; did you mean WALLx?",
        ),
        ("IQS_CLB", "IQS_CBL", "unknown 'IQS_CBL'; did you mean IQS_CLB?"),
    ] {
        let text = messages(from, to);
        assert!(text.contains(expected), "{text}");
    }
}

#[test]
fn datbox_names_the_models_that_it_is_from() {
    let folder = tempfile::tempdir().unwrap();
    let stone = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    std::fs::create_dir(folder.path().join("models")).unwrap();
    std::fs::write(folder.path().join("models/stone.obj"), stone).unwrap();
    let place = "shape: Model(file: \"models/stone.obj\"), placement: List(positions: [(0.0, 0.0, 0.0)]),\n        spin: (0.0, 0.0, 0.0),";
    let grains = GOOD.find("number: 20,").unwrap()..GOOD.find("    )],\n    walls").unwrap();
    let scene = format!("{}{place}\n{}", &GOOD[..grains.start], &GOOD[grains.end..]);
    std::fs::write(folder.path().join("scene.ron"), scene).unwrap();
    let (code, said) = cd_pre(&[folder.path().join("scene.ron").to_str().unwrap()]);
    assert_eq!(code, 0, "{said}");
    let text = std::fs::read_to_string(folder.path().join("DATBOX/COMPUTE.RON")).unwrap();
    let line =
        format!("// Made with models/stone.obj, checksum {:016x}", cd_formats::origin::checksum(stone.as_bytes()));
    assert_eq!(text.lines().nth(1), Some(line.as_str()));
    let origin = cd_formats::origin::SceneOrigin::from_compute_text(&text).unwrap();
    assert_eq!(origin.change_warning(folder.path()), None);
    std::fs::write(folder.path().join("models/stone.obj"), "v").unwrap();
    assert!(origin.change_warning(folder.path()).unwrap().contains("models/stone.obj has changed since"));
}

#[test]
fn all_values_of_wrong_type_and_all_missing_fields_are_reported_at_once() {
    let many = faults_of_changed(
        &GOOD,
        &[
            ("gravity:", "gravty:"),
            ("density: 2700.0", "density: \"2700\""),
            ("friction: 0.4", ""),
            ("number: 20", "number: 50.5"),
            (", max: 1.0)", ")"),
            ("colour: \"BLUEx\",", "color: \"BLUEx\","),
            ("output_every: 10", "output_every: -10"),
        ],
    );
    let lines = [
        "2:5: scene: unknown field 'gravty'; did you mean gravity?",
        "3:42: material 1, density: \"2700\"; expected a number",
        "4:34: law 1, kind: no field 'friction'; expected the field friction of IQS_CLB",
        // Only the colour's name is wrong; it is not reported as missing, too.
        "7:28: grains 1: unknown field 'color'; did you mean colour?",
        "8:17: grains 1, number: 50.5; expected an integer",
        "9:16: grains 1, sizes: no field 'max'; expected the field max of Uniform",
        "14:41: compute, output_every: -10; expected an integer of 0 or more",
    ];
    assert_eq!(many, lines.map(|line| format!("scene.ron:{line}")).join("\n"));
    // Each field of a record that is missing, for each kind of record.
    let wall = GOOD.find("Plate(").unwrap()..GOOD.find("    compute:").unwrap();
    let scene = format!("{}Plate(normal: (0, 0, 1))],\n{}", &GOOD[..wall.start], &GOOD[wall.end..]);
    let scene = scene
        .replace("(name: \"ROCKx\", density: 2700.0)", "()")
        .replace("IQS_CLB(friction: 0.4)", "IQS_DS_ROLL_CLB(static_friction: 0.4)")
        .replace("(dt: 1.0e-3,", "(fields: [Oblate(mass: 1.0)], events: [()],");
    let said = faults(&scene);
    for expected in [
        "material 1: no fields 'name', 'density'; expected the fields name, density",
        "law 1, kind: no fields 'dynamic_friction', 'rolling_friction', 'spinning_friction'; expected the fields \
         dynamic_friction, rolling_friction, spinning_friction of IQS_DS_ROLL_CLB",
        "wall 1: no fields 'material', 'colour', 'centre', 'half_lengths'; expected the fields material, colour, centre, \
         half_lengths of Plate",
        "compute, field 1: no fields 'radius', 'j2', 'axis'; expected the fields radius, j2, axis of Oblate",
        "compute, event 1: no fields 'time', 'action'; expected the fields time, action",
    ] {
        assert!(said.contains(expected), "{expected}\n{said}");
    }
    assert_eq!(said.lines().count(), 5, "{said}");
    // The fields behind a misspelt kind are read.
    let kind = "scene.ron:4:34: law 1, kind: unknown 'IQS_CBL'; did you mean IQS_CLB?\n\
                scene.ron:4:42: law 1, kind: unknown field 'frction'; did you mean friction?";
    assert_eq!(faults_of_changed(&GOOD, &[("IQS_CLB(friction", "IQS_CBL(frction")]), kind);
    // Fields of a file of another kind are one fault.
    let other = "scene.ron:1:2: scene: unknown fields 'groups', 'base'; expected one of seed, gravity, materials, laws, \
                 contacts, grains, walls, compute";
    assert_eq!(faults("(groups: [], base: \"a\")"), other);
}

#[test]
fn numbers_are_shown_as_they_are_written() {
    check(&[
        ("-9.81)", "0x10)", "2:25: gravity 3: 0x10; expected a decimal number, 16"),
        ("-9.81)", "1.2.3)", "2:25: gravity 3: 1.2.3; expected a number"),
        ("-9.81)", "1e400)", "2:25: gravity 3: 1e400; expected a finite number (m/s^2), below 1e40 in magnitude"),
        ("2700.0", "-2700.00", "3:42: material 1, density: -2700.00; expected a density > 0 kg/m^3"),
        ("2700.0", "1e-400", "3:42: material 1, density: 1e-400; expected a density > 0 kg/m^3, at least 1e-99"),
        ("1.0e-3", "1e400", "14:19: compute, dt: 1e400; expected a finite time step > 0 s, below 1.8e308 in magnitude"),
        (
            "dt: 1.0e-3",
            "dt: 1e-20, end_time: 1e5",
            "14:36: compute, end_time: 100000 s with dt 1e-20 s are 1e25 steps; expected at most 9e15 steps: a larger dt or a \
             smaller end_time",
        ),
        ("Uniform(min: 0.5, max: 1.0)", "Single(-1)", "9:23: grains 1, sizes: -1; expected a radius > 0 m"),
    ]);
}

#[test]
fn events_that_no_step_reaches_are_a_warning() {
    let with_event = |time: &str| {
        let event = format!("dt: 1.0e-3, end_time: 0.01, events: [(time: {time}, action: Bond)]");
        run_on_scene(&GOOD.replace("dt: 1.0e-3", &event), &[])
    };
    assert_eq!(with_event("0.009"), (0, String::new()));
    let late = "cd-pre: warning: scene.ron:14:59: compute, event 1, time: no step begins at 0.01 s or later, the last begins at \
                0.009 s; give an earlier time, or a later end of the run\n";
    assert_eq!(with_event("0.01"), (0, late.into()));
}

#[test]
fn unknown_options_are_named_in_front_of_other_words() {
    for (words, expected) in [
        (&["--sett", "a=1"][..], "--sett: is no option of cd-pre; did you mean --set?"),
        (&["scene.ron", "--sett", "a=1"], "--sett: is no option of cd-pre; did you mean --set?"),
        (
            &["from-outbox", "--change", "x", "a", "b"],
            "--change: is no option of cd-pre from-outbox; did you mean --changes?",
        ),
        (&["--changes", "x"], "--changes: is no option of cd-pre; did you mean --changes of cd-pre from-outbox?"),
        (&["from-outbox", "a", "b", "c"], "c: is not expected here; expected from-outbox CASE DIR"),
        (&[], "no <scene.ron>; expected cd-pre <scene.ron> (see cd-pre --help)"),
    ] {
        assert_eq!(cd_pre(words), (2, format!("cd-pre: {expected}\n")));
    }
}

#[test]
fn a_needle_is_named_as_such() {
    let needle =
        "shape: Box(lengths: (1e9, 1, 1)), placement: List(positions: [(0, 0, 0)]),\n        spin: (0.0, 0.0, 0.0),";
    let grains = GOOD.find("number: 20,").unwrap()..GOOD.find("    )],\n    walls").unwrap();
    let said = faults(&format!("{}{needle}\n{}", &GOOD[..grains.start], &GOOD[grains.end..]));
    let expected = "grains 1: its moment of inertia about its long axis is lost in the rounding of the other two; expected a \
                    shape at most 1e7 times as long as it is wide";
    assert!(said.contains(expected), "{said}");
}
