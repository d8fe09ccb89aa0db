//! The program from outside: files in, files out, messages, exit status.

mod samples;
#[path = "../../tests/src/vtp.rs"]
mod vtp;

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Output, Stdio};

use cd_formats::compute::ExternalField;
use cd_formats::orbit::OrbitSpec;
use cd_formats::snapshot;
use nalgebra::Vector3;
use samples::Scene;

fn cd_post(args: &[&str], case: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_cd-post")).args(args).arg(case).output().unwrap()
}

/// Exit status and stderr.
fn exit_and_errors(case: &Path) -> (i32, String) {
    let output = cd_post(&[], case);
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

/// Three spheres on a floor at a step; later they are higher.
fn scene(step: u64) -> Scene {
    let mut scene = Scene::self_gravitating(6.67430e-11);
    let meta = &mut scene.snapshot.meta;
    (meta.step, meta.time, meta.h) = (step, step as f64 * 0.25, 0.25);
    let floor = scene.plate([0.0, 0.0, -0.1], [5.0, 5.0, 0.1]);
    for k in 0..3 {
        scene.grain([2.0 * k as f64, 0.0, 1.0 + step as f64 * 1e-4], 1.0);
    }
    scene.push(1, 2, 3.0);
    scene.push(3, 2, 0.0);
    scene.contact_at(1, floor, [0.0; 3], Vector3::new(0.1, 0.0, 2.0));
    let before = step.saturating_sub(1) as f64 * 0.25;
    scene.since(before, &[([1, floor as u32], 0.25 * 2.0), ([1, 2], 0.25 * 6.0)]);
    scene
}

fn case(steps: &[u64]) -> tempfile::TempDir {
    let case = tempfile::tempdir().unwrap();
    for &step in steps {
        scene(step).snapshot.write(&snapshot::snapshot_path(&case.path().join("OUTBOX"), step)).unwrap();
    }
    case
}

/// The fields of a column of a table, from its second line on.
fn column(table: &Path, name: &str) -> Vec<f64> {
    let text = fs::read_to_string(table).unwrap();
    let place = text.lines().next().unwrap().split(',').position(|known| known == name).unwrap();
    let field = |line: &str| line.split(',').nth(place).unwrap().parse().unwrap_or(f64::NAN);
    text.lines().skip(1).map(field).collect()
}

/// All numbers of a ParaView file: points, connectivity and arrays.
fn vtp_numbers(path: &Path) -> Vec<f64> {
    let arrays = vtp::arrays(&fs::read_to_string(path).unwrap());
    arrays.unwrap_or_else(|error| panic!("{}: {error}", path.display())).into_values().flatten().collect()
}

/// Asserts that no file of a folder holds a number that is not finite: of binary arrays the values, of others the words.
#[track_caller]
fn all_finite(folder: &Path) {
    for (name, bytes) in files(folder) {
        if name.ends_with(".vtp") {
            let numbers = vtp_numbers(&folder.join(&name));
            assert!(!numbers.is_empty() && numbers.iter().all(|x| x.is_finite()), "{name}");
        } else {
            let text = String::from_utf8_lossy(&bytes).into_owned();
            assert!(!text.contains("NaN") && !text.contains("inf,"), "{name}");
        }
    }
}

/// Every file below a folder with its bytes.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|e| (e.file_name().into_string().unwrap(), fs::read(e.path()).unwrap())).collect()
}

fn names(folder: &Path) -> Vec<String> {
    files(folder).into_keys().collect()
}

#[test]
fn writes_series_plots_picture_and_paraview_files() {
    let case = case(&[0, 10, 20]);
    let output = cd_post(&[], case.path());
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(output.stderr.is_empty(), "nothing but results without a terminal: {output:?}");
    assert_eq!(
        names(&case.path().join("POSTPRO")),
        [
            "aggregate.svg",
            "aggregate_energy.svg",
            "coordination.svg",
            "dissipation.svg",
            "energy.svg",
            "pressure.svg",
            "semi_axes.svg",
            "series.csv",
            "snapshots.svg",
            "solid_fraction.svg"
        ]
    );
    let mut expected = Vec::new();
    for kind in ["contacts", "grains", "walls"] {
        expected.extend(["000000", "000010", "000020"].map(|step| format!("{kind}-{step}.vtp")));
        expected.push(format!("{kind}.pvd"));
    }
    expected.push("view.py".to_string());
    expected.sort();
    assert_eq!(names(&case.path().join("DISPLAY")), expected);
    all_finite(&case.path().join("DISPLAY"));
    let series = fs::read_to_string(case.path().join("POSTPRO/series.csv")).unwrap();
    let lines: Vec<&str> = series.lines().collect();
    assert!(lines[0].starts_with("step,time,n_contacts,Z,"));
    assert_eq!(lines.len(), 4);
    assert!(lines[3].starts_with("20,5.0,2,1.0,"), "{}", lines[3]); // (2 x 1 + 1) / 3
    let pvd = fs::read_to_string(case.path().join("DISPLAY/grains.pvd")).unwrap();
    assert!(pvd.contains("timestep=\"2.5\" part=\"0\" file=\"grains-000010.vtp\""));
    let view = fs::read_to_string(case.path().join("DISPLAY/view.py")).unwrap();
    let folder = fs::canonicalize(case.path().join("DISPLAY")).unwrap();
    assert!(view.contains(&format!("else {folder:?}\n")), "{view}");
}

#[test]
fn threads_change_no_byte() {
    for (command, folders) in [
        (&[][..], &["POSTPRO", "DISPLAY"][..]),
        (&["report"], &["POSTPRO"]),
        (&["state"], &["POSTPRO/state-000006"]),
        (&["track", "--body", "2"], &["POSTPRO/track-2"]),
    ] {
        let case = case(&[0, 1, 2, 3, 4, 5, 6]);
        let run = |threads: &str| -> Vec<_> {
            let output = cd_post(&[command, &["--threads", threads]].concat(), case.path());
            assert!(output.status.success(), "{command:?}: {output:?}");
            folders.iter().map(|folder| files(&case.path().join(folder))).collect()
        };
        let one = run("1");
        assert!(one == run("3") && one.iter().all(|files| !files.is_empty()), "{command:?}");
        let refused = cd_post(&[command, &["--threads", "1025"]].concat(), case.path());
        assert!(String::from_utf8(refused.stderr).unwrap().contains("1025 is not in 0..=1024"), "{command:?}");
    }
}

#[test]
fn every_takes_some_and_the_last_and_leaves_no_stale_file() {
    let case = case(&[0, 10, 20, 30, 40, 50]);
    assert!(cd_post(&[], case.path()).status.success());
    fs::write(case.path().join("DISPLAY/grains-view.pvsm"), "a user's own").unwrap();
    assert!(cd_post(&["--every", "2"], case.path()).status.success());
    let grains: Vec<String> =
        names(&case.path().join("DISPLAY")).into_iter().filter(|name| name.starts_with("grains")).collect();
    assert_eq!(
        grains,
        [
            "grains-000000.vtp",
            "grains-000020.vtp",
            "grains-000040.vtp",
            "grains-000050.vtp",
            "grains-view.pvsm",
            "grains.pvd"
        ]
    );
}

#[test]
fn each_format_of_paraview_files_replaces_the_other() {
    let case = case(&[0, 10, 20]);
    let display = case.path().join("DISPLAY");
    let run = |flags: &[&str]| {
        assert!(cd_post(&[&["--no-plots"], flags].concat(), case.path()).status.success());
        (names(&display), files(&display))
    };
    let (vtp, _) = run(&[]);
    let (hdf, bytes) = run(&["--vtk-format", "vtkhdf", "--threads", "1"]);
    assert_eq!(hdf, ["contacts.vtkhdf", "grains.vtkhdf", "view.py", "walls.vtkhdf"]);
    assert_eq!(run(&["--vtk-format", "vtkhdf", "--threads", "3"]).1, bytes);
    assert_eq!(run(&["--vtk-format", "vtp"]).0, vtp);
    let both = cd_post(&["--no-vtk", "--vtk-format", "vtkhdf"], case.path());
    assert_eq!(both.status.code(), Some(2));
}

#[test]
fn a_rejected_snapshot_leaves_the_vtkhdf_files_as_they_were() {
    let case = case(&[0, 1, 2]);
    let run = || cd_post(&["--no-plots", "--vtk-format", "vtkhdf"], case.path()).status.code();
    assert_eq!(run(), Some(0));
    let before = files(&case.path().join("DISPLAY"));
    fs::write(snapshot::snapshot_path(&case.path().join("OUTBOX"), 2), "").unwrap();
    assert_eq!(run(), Some(2));
    assert_eq!(files(&case.path().join("DISPLAY")), before);
}

#[test]
fn parts_can_be_left_out() {
    let case = case(&[0]);
    assert!(cd_post(&["--no-vtk", "--no-plots"], case.path()).status.success());
    assert_eq!(names(&case.path().join("POSTPRO")), ["series.csv"]);
    assert!(!case.path().join("DISPLAY").exists());
}

#[test]
fn a_case_without_results_is_rejected() {
    let case = tempfile::tempdir().unwrap();
    let outbox = case.path().join("OUTBOX");
    let expected = "expected snapshot-*.npz, the results of cd-solve";
    let message = |found: &str| format!("cd-post: {}: folder: {found}; {expected}\n", outbox.display());
    assert_eq!(exit_and_errors(case.path()), (2, message("is missing")));
    fs::create_dir(&outbox).unwrap();
    assert_eq!(exit_and_errors(case.path()), (2, message("has no snapshot")));
}

#[test]
fn a_damaged_snapshot_is_rejected_and_the_series_stays_as_it_was() {
    let case = case(&[0, 1, 2]);
    assert!(cd_post(&[], case.path()).status.success());
    let series = fs::read(case.path().join("POSTPRO/series.csv")).unwrap();
    let damaged = snapshot::snapshot_path(&case.path().join("OUTBOX"), 1);
    let bytes = fs::read(&damaged).unwrap();
    fs::write(&damaged, &bytes[..bytes.len() / 2]).unwrap();
    let (code, message) = exit_and_errors(case.path());
    assert_eq!(code, 2);
    assert!(message.starts_with(&format!("cd-post: {}: snapshot: ", damaged.display())), "{message}");
    assert_eq!(fs::read(case.path().join("POSTPRO/series.csv")).unwrap(), series);
}

#[test]
fn a_snapshot_of_another_run_is_rejected() {
    let case = case(&[0, 1]);
    let mut other = scene(2);
    other.snapshot.bodies.body_mass[1] *= 2.0;
    let path = snapshot::snapshot_path(&case.path().join("OUTBOX"), 2);
    other.snapshot.write(&path).unwrap();
    let (code, message) = exit_and_errors(case.path());
    assert_eq!(code, 2);
    let expected = format!("cd-post: {}: snapshot: other bodies; expected those of ", path.display());
    assert!(message.starts_with(&expected), "{message}");
}

#[test]
fn a_lack_of_all_snapshots_is_reported_once() {
    let case = tempfile::tempdir().unwrap();
    for step in 0..3 {
        let mut scene = scene(step);
        scene.cube([0.0, 0.0, 9.0], 1.0);
        scene.snapshot.write(&snapshot::snapshot_path(&case.path().join("OUTBOX"), step)).unwrap();
    }
    let output = cd_post(&["--threads", "3"], case.path());
    let printed = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), printed.matches("BODIES.DAT").count()), (Some(2), 1), "{printed}");
}

#[test]
fn shapes_of_another_datbox_are_rejected_once() {
    let case = tempfile::tempdir().unwrap();
    let cubes = |half: f64, count: usize| {
        let mut scene = scene(0);
        for k in 0..count {
            scene.cube([4.0 * k as f64, 0.0, 9.0], half);
        }
        scene
    };
    for step in 0..4 {
        let mut scene = cubes(1.0, 8);
        scene.snapshot.meta.step = step;
        scene.snapshot.write(&snapshot::snapshot_path(&case.path().join("OUTBOX"), step)).unwrap();
    }
    let datbox = case.path().join("DATBOX");
    fs::create_dir(&datbox).unwrap();
    for (now, expected) in [
        (cubes(1.0, 8), &[][..]),
        (cubes(1.5, 8), &["body 5: radius", "body 6: ", "body 7: ", "body 8: ", "body 9: ", "3 more bodies differ"]),
        (cubes(1.0, 3), &["file: 7 bodies; expected 12 as in "]),
    ] {
        fs::write(datbox.join("BODIES.DAT"), now.records().to_text()).unwrap();
        for command in [&["--threads", "2"][..], &["report"], &["state"]] {
            let output = cd_post(command, case.path());
            let printed = String::from_utf8(output.stderr).unwrap();
            assert_eq!(output.status.code(), Some(if expected.is_empty() { 0 } else { 2 }), "{command:?}: {printed}");
            assert_eq!(printed.lines().count(), expected.len(), "{printed}");
            let says = |(line, part): (&str, &&str)| line.contains("DATBOX/BODIES.DAT") && line.contains(part);
            assert!(printed.lines().zip(expected).all(says), "{printed}");
        }
    }
}

#[test]
fn one_waits_for_another_in_the_same_case() {
    let case = case(&[0, 10]);
    let taken = fs::File::open(case.path()).unwrap();
    taken.lock().unwrap();
    for command in [&[][..], &["state"], &["report"], &["track", "--body", "2"]] {
        let mut second = Command::new(env!("CARGO_BIN_EXE_cd-post"));
        let second = second.args(command).arg(case.path()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut second = second.spawn().unwrap();
        let mut printed = String::new();
        BufReader::new(second.stderr.take().unwrap()).read_line(&mut printed).unwrap();
        assert!(
            printed.ends_with(": another cd-post runs in this case; waiting for its end\n"),
            "{command:?}: {printed}"
        );
        assert!(!case.path().join("POSTPRO").exists() && second.try_wait().unwrap().is_none());
        second.kill().unwrap();
        second.wait().unwrap();
    }
    drop(taken);
    let run = || Command::new(env!("CARGO_BIN_EXE_cd-post")).arg(case.path()).stdout(Stdio::null()).spawn().unwrap();
    let mut both = [run(), run()];
    assert!(both.iter_mut().all(|run| run.wait().unwrap().success()));
    assert_eq!(column(&case.path().join("POSTPRO/series.csv"), "step"), [0.0, 10.0]);
}

#[test]
fn a_broken_state_is_rejected_row_by_row() {
    let case = case(&[0]);
    let mut broken = scene(0).snapshot;
    broken.bodies.body_mass[3] = -1.0;
    let path = snapshot::snapshot_path(&case.path().join("OUTBOX"), 0);
    broken.write(&path).unwrap();
    let file = path.display();
    let expected = format!("cd-post: {file}: body 4, body_mass: [-1.0]; expected numbers > 0\n");
    assert_eq!(exit_and_errors(case.path()), (2, expected));
    broken.bodies.body_v[2][1] = f64::NAN;
    broken.contacts.contact_gap[1] = f64::INFINITY;
    broken.write(&path).unwrap();
    let expected = format!(
        "cd-post: {file}: array body_v, row 3: [0.0, NaN, 0.0]; expected finite numbers\n\
         cd-post: {file}: array contact_gap, row 2: [inf]; expected finite numbers\n"
    );
    assert_eq!(exit_and_errors(case.path()), (2, expected));
    assert!(!case.path().join("POSTPRO").exists());
}

#[test]
fn a_case_without_grains_is_done_with_a_report() {
    let case = tempfile::tempdir().unwrap();
    let mut scene = Scene::default();
    scene.plate([0.0; 3], [1.0; 3]);
    scene.snapshot.write(&snapshot::snapshot_path(&case.path().join("OUTBOX"), 0)).unwrap();
    let (code, message) = exit_and_errors(case.path());
    assert_eq!((code, message.as_str()), (1, "cd-post: 1 of 1 snapshots have no grains: their fields are empty\n"));
    let series = fs::read_to_string(case.path().join("POSTPRO/series.csv")).unwrap();
    assert!(series.lines().nth(1).unwrap().starts_with("0,0.0,0,,,,"));
}

#[test]
fn a_wrong_command_line_is_rejected() {
    for args in [
        vec!["--every", "0"],
        vec!["study", "case", "--from", "nan"],
        vec!["accuracy-study", "a", "b", "--early", "inf"],
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_cd-post")).args(&args).output().unwrap();
        assert_eq!(output.status.code(), Some(2));
        assert!(String::from_utf8(output.stderr).unwrap().contains("invalid value"), "{args:?}");
    }
    let version = Command::new(env!("CARGO_BIN_EXE_cd-post")).arg("--version").output().unwrap();
    let version = String::from_utf8(version.stdout).unwrap();
    let commit = version.trim_end().strip_prefix(concat!("cd-post ", env!("CARGO_PKG_VERSION"))).unwrap();
    assert!(commit.is_empty() || commit.starts_with(" (") && commit.ends_with(')'), "{version}");
    let help = Command::new(env!("CARGO_BIN_EXE_cd-post")).arg("--help").output().unwrap();
    assert_eq!(help.status.code(), Some(0));
    assert!(String::from_utf8(help.stdout).unwrap().contains("--no-vtk"));
}

#[test]
fn a_bed_in_a_cell_has_layers_and_columns_of_its_own() {
    // Two columns of two grains on a floor, each pushed by the weight above.
    let mut scene = Scene::default();
    let meta = &mut scene.snapshot.meta;
    meta.parameters.uniform_gravity = [0.0, 0.0, -2.0];
    (meta.parameters.xperiode, meta.parameters.yperiode) = (Some(2.0), Some(1.0));
    let floor = scene.plate([0.0, 0.0, -0.1], [5.0, 5.0, 0.1]);
    for x in [-0.5, 0.5] {
        let mut below = floor;
        for k in 0..2 {
            let grain = scene.grain([x, 0.0, f64::from(k) + 0.5], 0.5);
            let weight = f64::from(2 - k) * 2.0 * scene.snapshot.bodies.body_mass[grain];
            scene.contact_at(grain, below, [x, 0.0, f64::from(k)], [0.0, 0.0, weight].into());
            below = grain;
        }
    }
    let case = tempfile::tempdir().unwrap();
    scene.snapshot.write(&snapshot::snapshot_path(&case.path().join("OUTBOX"), 0)).unwrap();
    assert_eq!(cd_post(&[], case.path()).status.code(), Some(0));
    let series = case.path().join("POSTPRO/series.csv");
    let found = |name: &str| column(&series, name)[0];
    // The weight of two spheres of density 1 over an area of 1, half of it in the mean; rounding.
    let pi = std::f64::consts::PI;
    for (name, expected) in [("bed_height", 2.0), ("bed_nu", pi / 6.0), ("bed_pressure", pi / 9.0)] {
        assert!((found(name) - expected).abs() < 1e-14, "{name} {}", found(name));
    }
    let plot = fs::read_to_string(case.path().join("POSTPRO/solid_fraction.svg")).unwrap();
    assert!(plot.contains("bed"));
    assert_eq!(cd_post(&["state"], case.path()).status.code(), Some(1)); // a note: no profile by radius
    let state = case.path().join("POSTPRO/state-000000");
    let layers = names(&state).into_iter().filter(|name| name.starts_with("layers")).collect::<Vec<_>>();
    assert_eq!(layers, ["layers.csv", "layers_Z.svg", "layers_nu.svg", "layers_stress.svg"]);
    // Each sphere fills what it is high, ten layers of twenty.
    let nu = column(&state.join("layers.csv"), "nu");
    assert!((nu.iter().sum::<f64>() / 20.0 - pi / 6.0).abs() < 1e-14, "{nu:?}");
    // Nothing is sheared or moves; of the whole weight the lowest of twenty layers has all but half a twentieth above its
    // middle, as spheres fill it: a cap of height 0.05, of volume pi 0.05^2 (1.5 - 0.05)/3 a sphere, of two spheres and two columns.
    let layer = |name: &str| column(&state.join("layers.csv"), name)[0];
    let cap = pi * 0.05f64.powi(2) * 1.45 / 3.0;
    assert!((layer("weight") - 2.0 * (2.0 * pi / 6.0 - cap)).abs() < 1e-14, "{}", layer("weight"));
    assert_eq!(["shear_stress", "v_x", "v_y", "v_z"].map(layer), [0.0; 4]);
    // The mean of two of which the second moves by 1 m/s along x.
    scene.snapshot.bodies.body_v.iter_mut().for_each(|v| v[0] = 1.0);
    scene.snapshot.meta.step = 1;
    scene.snapshot.write(&snapshot::snapshot_path(&case.path().join("OUTBOX"), 1)).unwrap();
    let state = case.path().join("POSTPRO/state-000001/layers.csv");
    for (count, v_x) in [("1", 1.0), ("2", 0.5)] {
        assert_eq!(cd_post(&["state", "--mean", count], case.path()).status.code(), Some(1));
        assert_eq!((column(&state, "v_x")[0], column(&state, "nu")), (v_x, nu.clone()));
    }
    let output = cd_post(&["state", "--mean", "3"], case.path());
    assert_eq!(output.status.code(), Some(2));
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(
        said.contains("--mean: a mean over 3 snapshots, of which 2 are not later than step 1; expected at most 2"),
        "{said}"
    );
    // One in which all have left the floor counts for nothing.
    scene.snapshot.meta.step = 2;
    scene.snapshot.contacts = Default::default();
    scene.snapshot.write(&snapshot::snapshot_path(&case.path().join("OUTBOX"), 2)).unwrap();
    let output = cd_post(&["state", "--mean", "3"], case.path());
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("2 of 3 snapshots have a bed: the layers are means over these"), "{said}");
    let layers = case.path().join("POSTPRO/state-000002/layers.csv");
    assert_eq!(column(&layers, "v_x")[0], 0.5);
    // A state without a bed removes the layers of the mean before.
    let output = cd_post(&["state"], case.path());
    assert_eq!((output.status.code(), layers.exists()), (Some(1), false));
    scene.snapshot.meta.step = 3;
    scene.snapshot.write(&snapshot::snapshot_path(&case.path().join("OUTBOX"), 3)).unwrap();
    let output = cd_post(&["state", "--mean", "2"], case.path());
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("none of 2 snapshots has a bed: no layers are written\n"), "{said}");
}

#[test]
fn a_state_in_depth_has_its_tables_and_figures() {
    let case = case(&[0, 10]);
    assert_eq!(cd_post(&["state"], case.path()).status.code(), Some(0));
    let folder = case.path().join("POSTPRO/state-000010");
    let expected = [
        "ejecta.csv",
        "ejecta.svg",
        "fabric.csv",
        "forces.csv",
        "forces.svg",
        "fragments.csv",
        "mobilisation.csv",
        "mobilisation.svg",
        "profile.csv",
        "profile_Z.svg",
        "profile_nu.svg",
        "profile_stress.svg",
        "slopes.csv",
        "slopes.svg",
        "surface.csv",
        "surface.vtp",
        "surface_height.svg",
        "surface_slope.svg",
    ];
    assert_eq!(names(&folder), expected);
    all_finite(&folder);
    assert_eq!(cd_post(&["state", "--snapshot", "0"], case.path()).status.code(), Some(0));
    assert!(case.path().join("POSTPRO/state-000000/profile.csv").exists());
    let none = cd_post(&["state", "--snapshot", "7"], case.path());
    assert_eq!(none.status.code(), Some(2));
    assert!(
        String::from_utf8_lossy(&none.stderr)
            .ends_with("has no snapshot of step 7; expected one of steps 0 to 10, such as 0 or 10\n"),
        "{none:?}"
    );
    // Counts are whole numbers.
    let fragments = fs::read_to_string(folder.join("fragments.csv")).unwrap();
    assert!(fragments.lines().nth(1).unwrap().starts_with("0,3,"), "{fragments}");
    let nowhere = cd_post(&["state"], Path::new("nosuch"));
    assert_eq!(nowhere.status.code(), Some(2));
    let expected = "nosuch: folder: there is no such folder; expected the folder of a case, with OUTBOX in it\n";
    assert!(String::from_utf8_lossy(&nowhere.stderr).ends_with(expected), "{nowhere:?}");
}

#[test]
fn turning_axes_hide_no_motion() {
    // Two spheres at rest in a rotating frame at 1.6 times the rate of the circle: above the root of 2 they part.
    let (distance, k, constant) = (8.0, 1.6, 1.0);
    let case = tempfile::tempdir().unwrap();
    let mut scene = Scene::self_gravitating(constant);
    let rows = [scene.grain([0.0; 3], 1.0), scene.grain([distance, 0.0, 0.0], 1.0)];
    let mass = scene.snapshot.bodies.body_mass[rows[0]];
    let rate = k * (2.0 * constant * mass / f64::powi(distance, 3)).sqrt();
    scene.snapshot.meta.parameters.fields =
        vec![ExternalField::RotatingFrame { rate: [0.0, 0.0, rate], centre: [1.0, 2.0, 0.0] }];
    scene.snapshot.write(&snapshot::snapshot_path(&case.path().join("OUTBOX"), 0)).unwrap();
    for command in [&["--no-vtk"][..], &["state"]] {
        assert_eq!(cd_post(command, case.path()).status.code(), Some(0));
    }
    let near = |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 1e-12, "{found} {expected}");
    let series = |name: &str| column(&case.path().join("POSTPRO/series.csv"), name)[0];
    assert_eq!((series("bound_fraction"), series("escaping_fraction")), (0.0, 0.5));
    near(series("largest_spin"), rate);
    near(series("spin_z"), rate);
    near(series("L_z"), rate * mass * (0.5 * distance * distance + 2.0 * 0.4));
    // The axes show the quantity that is balanced: with E_fields, the energy that stays is that of Jacobi.
    for name in ["Ec_mean", "Ec_rigid_mean", "P_x", "P_y", "pressure_kinetic"] {
        assert_eq!(series(name), 0.0, "{name}");
    }
    let state = |table: &str, name: &str| column(&case.path().join("POSTPRO/state-000000").join(table), name);
    near(state("fragments.csv", "orbit_e")[1], k * k - 1.0);
    let (v_x, v_y) = (state("fragments.csv", "v_x"), state("fragments.csv", "v_y"));
    near(v_y[1] - v_y[0], rate * distance);
    near(v_x[0], rate * 2.0);
    near(state("fragments.csv", "speed")[1], rate * distance);
    near(state("ejecta.csv", "speed")[0], rate * distance);
}

#[test]
fn runs_are_compared_in_one_figure() {
    let (one, two, output) = (case(&[0, 10]), case(&[0, 20]), tempfile::tempdir().unwrap());
    let compare = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cd-post"));
        command.arg("compare").args([one.path(), two.path()]).arg("-o").arg(output.path()).args(more);
        command.output().unwrap()
    };
    // The series come first.
    let early = compare(&[]);
    assert_eq!(early.status.code(), Some(2), "{early:?}");
    assert_eq!(String::from_utf8_lossy(&early.stderr).lines().count(), 2);
    for case in [&one, &two] {
        assert!(cd_post(&["--no-vtk", "--no-plots"], case.path()).status.success());
    }
    let done = compare(&["--labels", "first,second", "--columns", "Z,nu"]);
    assert_eq!(done.status.code(), Some(0), "{done:?}");
    assert_eq!(names(output.path()), ["Z.csv", "Z.svg", "nu.csv", "nu.svg"]);
    let table = fs::read_to_string(output.path().join("Z.csv")).unwrap();
    let lines: Vec<&str> = table.lines().collect();
    assert_eq!(lines[0], "time,first,second");
    assert!(lines[2].starts_with("2.5,1.0,") && lines[2].ends_with(','), "{table}"); // the second has no such time
    assert!(fs::read_to_string(output.path().join("Z.svg")).unwrap().contains("second"));
    // A run alone has its figures too: a row of runs may be one run long.
    let folder = output.path().join("alone");
    let mut alone = Command::new(env!("CARGO_BIN_EXE_cd-post"));
    alone.arg("compare").arg(one.path()).arg("-o").arg(&folder).args(["--columns", "Z"]);
    assert_eq!(alone.output().unwrap().status.code(), Some(0));
    assert_eq!(fs::read_to_string(folder.join("Z.csv")).unwrap().lines().next().unwrap().split(',').count(), 2);
    fs::remove_dir_all(folder).unwrap();
    // The same folder twice has no name of its own.
    let mut twice = Command::new(env!("CARGO_BIN_EXE_cd-post"));
    let twice = twice.arg("compare").args([one.path(), one.path()]).arg("-o").arg(output.path()).output().unwrap();
    let printed = String::from_utf8_lossy(&twice.stderr);
    assert_eq!(twice.status.code(), Some(2));
    assert!(printed.starts_with("cd-post: options: runs: '"), "{printed}");
    assert!(printed.ends_with("' is given again as number 2; expected each name once\n"), "{printed}");
    for (option, wrong) in [
        ("columns", "no_such"),
        ("labels", "one"),
        ("labels", "one,one"),
        ("labels", "time,one"),
        ("labels", ",one"),
        ("table", "no_such.csv"),
        ("columns", "depth"),
        ("against", "no_such"),
    ] {
        let printed = compare(&[&format!("--{option}"), wrong]);
        assert_eq!(printed.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&printed.stderr).contains(&format!("options: --{option}: ")), "{printed:?}");
    }
    // A table that has lost a column, and one that has it twice.
    let series = one.path().join("POSTPRO/series.csv");
    let whole = fs::read_to_string(&series).unwrap();
    for (header, message) in [
        ("step,tim,", "column 'time': is missing; write the table again with this version"),
        ("time,time,", "column 'time': is given again as number 2; expected each name once"),
    ] {
        fs::write(&series, whole.replace("step,time,", header)).unwrap();
        let printed = compare(&["--columns", "Z"]);
        assert_eq!(printed.status.code(), Some(2));
        assert!(
            String::from_utf8_lossy(&printed.stderr).ends_with(&format!("series.csv:1: {message}\n")),
            "{printed:?}"
        );
    }
    // One of no snapshot.
    fs::write(&series, whole.lines().next().unwrap()).unwrap();
    let printed = compare(&[]);
    assert_eq!(printed.status.code(), Some(2));
    let expected = "series.csv: table: has no snapshot; expected at least one\n";
    assert!(String::from_utf8_lossy(&printed.stderr).ends_with(expected), "{printed:?}");
    fs::write(&series, whole).unwrap();
    // The ways of a body, and the ground around it.
    for case in [&one, &two] {
        let tracked =
            Command::new(env!("CARGO_BIN_EXE_cd-post")).arg("track").arg(case.path()).args(["--body", "1"]).output();
        assert!(tracked.unwrap().status.success());
    }
    assert!(compare(&["--table", "track-1/track.csv"]).status.success());
    assert!(compare(&["--table", "track-1/crater.csv", "--columns", "after"]).status.success());
    assert_eq!(names(output.path()).len(), 4 + 2 * 3);
    assert!(fs::read_to_string(output.path().join("after.csv")).unwrap().starts_with("radius,"));
    let depth = fs::read_to_string(output.path().join("depth.svg")).unwrap();
    assert!(depth.contains("depth (m)") && depth.contains("time (s)"), "{depth}");
    assert_eq!(compare(&["--table", "track-2/track.csv"]).status.code(), Some(2));
    // The last states, whose steps differ.
    let missing = compare(&["--table", "state/slopes.csv"]);
    assert_eq!(missing.status.code(), Some(2));
    let printed = String::from_utf8_lossy(&missing.stderr);
    let [state, track] = [("state", ""), ("track", " --body N")].map(|(command, more)| {
        format!("expected a table that cd-post {command} {}{more} has written: run it first\n", one.path().display())
    });
    assert!(printed.contains("POSTPRO/state/slopes.csv") && printed.contains(&state), "{printed}");
    let untracked = compare(&["--table", "track-2/track.csv"]);
    assert!(String::from_utf8_lossy(&untracked.stderr).contains(&track), "{untracked:?}");
    for (case, steps) in [(&one, &["0", "10"][..]), (&two, &["20"])] {
        for step in steps {
            let state = Command::new(env!("CARGO_BIN_EXE_cd-post"))
                .args(["state", "--snapshot", step])
                .arg(case.path())
                .output();
            assert!(state.unwrap().status.success());
        }
    }
    for (table, column, axis) in [
        ("profile", "pressure", "inner"),
        ("forces", "P_normal", "force_over_mean"),
        ("mobilisation", "P", "share"),
        ("ejecta", "mass_share_faster", "speed"),
        ("slopes", "slope", "share_below"),
    ] {
        let done = compare(&["--table", &format!("state/{table}.csv")]);
        assert_eq!(done.status.code(), Some(0), "{done:?}");
        let text = fs::read_to_string(output.path().join(format!("{column}.csv"))).unwrap();
        assert!(text.starts_with(axis), "{text}");
    }
    // Files that a longer run before has left are none of this one.
    let stale = one.path().join("POSTPRO/state-000030");
    fs::create_dir(&stale).unwrap();
    fs::write(stale.join("profile.csv"), "another run").unwrap();
    assert_eq!(compare(&["--table", "state/profile.csv"]).status.code(), Some(0));
    let own = fs::read_to_string(one.path().join("POSTPRO/state-000010/profile.csv")).unwrap();
    let (inner, pressure) =
        (own.lines().nth(1).unwrap().split(',').next(), own.lines().nth(1).unwrap().split(',').nth(5));
    let laid = fs::read_to_string(output.path().join("pressure.csv")).unwrap();
    let row: Vec<&str> = laid.lines().nth(1).unwrap().split(',').collect();
    assert_eq!((Some(row[0]), Some(row[1])), (inner, pressure), "{laid}");
}

#[test]
fn runs_are_measured_by_the_finest() {
    let cases = [case(&[0, 4]), case(&[0, 4]), case(&[0, 4])];
    let output = tempfile::tempdir().unwrap();
    let accuracy_study = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cd-post"));
        command
            .arg("accuracy-study")
            .args(cases.iter().map(|case| case.path()))
            .arg("-o")
            .arg(output.path())
            .args(more);
        command.output().unwrap()
    };
    let timer = "step,gravity,detection,assembly,solve,integration,writing\n1,1,2,3,4,5,6\n2,1,2,3,4,5,6\n";
    for case in &cases {
        assert_eq!(cd_post(&["--no-plots", "--no-vtk"], case.path()).status.code(), Some(0));
        fs::write(case.path().join("TIMER.csv"), timer).unwrap();
    }
    assert_eq!(accuracy_study(&[]).status.code(), Some(2)); // without what the runs say of their errors
    for case in &cases {
        let errors = "source,option,error,seconds\ncontacts,tol,1e-2,1\nstep,dt,2e-2,1\n";
        fs::write(case.path().join("ERRORS.csv"), errors).unwrap();
    }
    let done = accuracy_study(&["--groups", "dt,dt,finest", "--values", "2,1,0.5"]);
    assert_eq!(done.status.code(), Some(0), "{done:?}");
    assert_eq!(names(output.path()), ["accuracy.csv", "accuracy.svg", "orders.csv"]);
    let table = fs::read_to_string(output.path().join("accuracy.csv")).unwrap();
    let row: Vec<&str> = table.lines().nth(1).unwrap().split(',').collect();
    let of = |name: &str| row[table.lines().next().unwrap().split(',').position(|column| column == name).unwrap()];
    // Equal runs.
    assert_eq!((of("group"), of("value"), of("seconds")), ("dt", "2.0", "30.0"));
    assert_eq!((of("Z"), of("worst"), of("positions"), of("positions_early")), ("0.0", "0.0", "0.0", "0.0"));
    assert_eq!(of("estimated").parse::<f64>().unwrap(), 1e-2 + 2e-2);
    assert_eq!(accuracy_study(&["--values", "1"]).status.code(), Some(2));
    let printed = accuracy_study(&["--groups", "dt,,finest"]);
    assert!(String::from_utf8_lossy(&printed.stderr).contains("groups: '' is given as number 2"), "{printed:?}");
    let mut twice = Command::new(env!("CARGO_BIN_EXE_cd-post"));
    let twice = twice.arg("accuracy-study").args([cases[0].path(); 2]).arg("-o").arg(output.path()).output().unwrap();
    let printed = String::from_utf8_lossy(&twice.stderr);
    assert!(printed.contains("' is given again as number 2; expected each name once"), "{printed}");
    // The last row of a run that was cut off does not count, nor does a series of the run before.
    fs::write(cases[0].path().join("TIMER.csv"), format!("{timer}3,1,2")).unwrap();
    assert_eq!(accuracy_study(&["--groups", "dt,dt,finest", "--values", "2,1,0.5"]).status.code(), Some(0));
    assert_eq!(fs::read_to_string(output.path().join("accuracy.csv")).unwrap(), table);
    let newer = snapshot::snapshot_path(&cases[0].path().join("OUTBOX"), 8);
    scene(8).snapshot.write(&newer).unwrap();
    let printed = accuracy_study(&[]);
    assert_eq!(printed.status.code(), Some(2));
    assert!(
        String::from_utf8_lossy(&printed.stderr).contains("ends at step 4 and 1 s; expected step 8"),
        "{printed:?}"
    );
    fs::remove_file(newer).unwrap();
    let printed = accuracy_study(&["--from", "3"]);
    let expected = "time: 2 from 0 to 1 s; expected one at the time of --from or later\n";
    assert_eq!(printed.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&printed.stderr).ends_with(expected), "{printed:?}");
    // Two realisations, here one twice, have errors together; a request that needs single runs is rejected.
    let [once, both] = [output.path().to_path_buf(), output.path().join("both")];
    let of_both = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cd-post"));
        command.arg("accuracy-study").args([&once, &once]).arg("-o").arg(&both).args(more).output().unwrap()
    };
    assert_eq!(of_both(&["--from", "1"]).status.code(), Some(2));
    assert_eq!(of_both(&["--title", "Both"]).status.code(), Some(0));
    assert_eq!(fs::read_to_string(both.join("accuracy.csv")).unwrap(), table);
    assert!(fs::read_to_string(both.join("accuracy.svg")).unwrap().contains("Both"));
    // Names of earlier versions: of the command, of the table and of a column.
    let former = table.replace(",single_over_estimated", ",over_estimated");
    fs::remove_file(once.join("accuracy.csv")).unwrap();
    fs::write(once.join("trade.csv"), former).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_cd-post"));
    let done = command.arg("trade").args([&once, &once]).arg("-o").arg(&both).output().unwrap();
    let written = both.join("accuracy.csv");
    let warning =
        format!("cd-post: warning: trade: renamed; write accuracy-study; the table is {}\n", written.display());
    assert_eq!((done.status.code(), String::from_utf8_lossy(&done.stderr).into_owned()), (Some(0), warning));
    assert_eq!(fs::read_to_string(both.join("accuracy.csv")).unwrap(), table);
}

#[test]
fn runs_are_measured_at_the_times_that_they_share() {
    // The second is where the third is, but for its first snapshot after the start, a radius away; the first ends before.
    let cases = [case(&[0, 2]), case(&[0, 1, 2, 3, 4]), case(&[0, 1, 2, 3, 4])];
    let mut moved = scene(1).snapshot;
    for x in &mut moved.bodies.body_x {
        x[1] += 1.0;
    }
    moved.write(&snapshot::snapshot_path(&cases[1].path().join("OUTBOX"), 1)).unwrap();
    for case in &cases {
        fs::write(case.path().join("TIMER.csv"), "step,gravity,detection,assembly,solve,integration\n1,1,2,3,4,5\n")
            .unwrap();
        fs::write(case.path().join("ERRORS.csv"), "source,option,error,seconds\n").unwrap();
    }
    let output = tempfile::tempdir().unwrap();
    let accuracy_study = |cases: &[tempfile::TempDir]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cd-post"));
        command.arg("accuracy-study").args(cases.iter().map(|case| case.path())).arg("-o").arg(output.path());
        command.output().unwrap()
    };
    for every in ["1", "4"] {
        for case in &cases {
            assert!(cd_post(&["--no-plots", "--no-vtk", "--every", every], case.path()).status.success());
        }
        assert_eq!(accuracy_study(&cases[1..]).status.code(), Some(0));
        let of = |name: &str| column(&output.path().join("accuracy.csv"), name)[0];
        assert_eq!((of("positions_early"), of("positions"), of("worst")), (1.0, 0.0, 0.0));
    }
    let printed = accuracy_study(&cases);
    let expected = "series.csv: time: 2 from 0 to 0.5 s; expected a time of the snapshots of";
    assert_eq!(printed.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&printed.stderr).contains(expected), "{printed:?}");
}

#[test]
fn late_in_a_run_snapshots_are_not_taken_for_others() {
    // At 1e7 s a snapshot a second, of the finest less often: a millionth of the time is ten of them.
    let late = 40_000_000;
    let cases = [case(&[0, late, late + 4, late + 8, late + 12]), case(&[0, late + 8, late + 12])];
    for case in &cases {
        fs::write(case.path().join("TIMER.csv"), "step,gravity,detection,assembly,solve,integration\n1,1,2,3,4,5\n")
            .unwrap();
        fs::write(case.path().join("ERRORS.csv"), "source,option,error,seconds\n").unwrap();
        assert!(cd_post(&["--no-plots", "--no-vtk"], case.path()).status.success());
    }
    let output = tempfile::tempdir().unwrap();
    let mut accuracy_study = Command::new(env!("CARGO_BIN_EXE_cd-post"));
    accuracy_study.arg("accuracy-study").args(cases.iter().map(|case| case.path())).arg("-o").arg(output.path());
    assert_eq!(accuracy_study.output().unwrap().status.code(), Some(0));
    for name in ["worst", "positions_early", "positions"] {
        assert_eq!(column(&output.path().join("accuracy.csv"), name), [0.0; 2], "{name}");
    }
}

#[test]
fn many_runs_are_points_of_one_study() {
    let cases = [case(&[0, 4]), case(&[0, 4])];
    for case in &cases {
        assert_eq!(cd_post(&["--no-plots", "--no-vtk"], case.path()).status.code(), Some(0));
        let steps = "step,contacts_active,sweeps,converged\n1,2,10,1\n2,2,20,0\n";
        fs::write(case.path().join("OUTBOX/steps.csv"), steps).unwrap();
        let timer = "step,gravity,detection,assembly,solve,integration,writing\n1,1,2,3,4,5,6\n2,1,2,3,4,5,6\n";
        fs::write(case.path().join("TIMER.csv"), timer).unwrap();
    }
    let folder = tempfile::tempdir().unwrap();
    let study = |flags: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cd-post"));
        command.arg("study").args(cases.iter().map(|case| case.path())).args(flags).arg("-o").arg(folder.path());
        let output = command.output().unwrap();
        (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
    };
    // Tables of replicates of other runs.
    for name in ["means.csv", "differences.csv"] {
        fs::write(folder.path().join(name), "").unwrap();
    }
    assert_eq!(study(&["--groups", "one,two", "--from", "0.5"]), (0, String::new()));
    let expected = [
        "Z.svg",
        "cost-one.svg",
        "cost-two.svg",
        "fits.csv",
        "nu.svg",
        "nu_sphere.svg",
        "pressure.svg",
        "runs.csv",
        "sweeps.svg",
    ];
    assert_eq!(names(folder.path()), expected);
    let runs = fs::read_to_string(folder.path().join("runs.csv")).unwrap();
    let lines: Vec<Vec<&str>> = runs.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!((lines.len(), lines[1].len(), lines[2][1]), (3, lines[0].len(), "two"));
    let value = |name: &str| lines[1][lines[0].iter().position(|known| *known == name).unwrap()];
    assert_eq!(
        ["time", "sweeps", "unconverged", "seconds_contacts", "seconds", "Z_isostatic"].map(value),
        ["1.0", "15.0", "0.5", "7.0", "21.0", "2.0"]
    );

    // The table of cd-pre study gives the cases, and their parameters.
    let table = folder.path().join("study.csv");
    let row = |k: usize| format!("{},,0.{k}\n", cases[k].path().display());
    fs::write(&table, format!("case,from,mu\n{}{}", row(0), row(1))).unwrap();
    let both = folder.path().join("both");
    let mut command = Command::new(env!("CARGO_BIN_EXE_cd-post"));
    let done = command.arg("study").arg(&table).args(["--by", "mu", "-o"]).arg(&both).output().unwrap();
    assert_eq!((done.status.code(), String::from_utf8_lossy(&done.stderr).as_ref()), (Some(0), ""));
    let of_table = fs::read_to_string(both.join("runs.csv")).unwrap();
    let fields: Vec<Vec<&str>> = of_table.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!((&fields[0][1..4], &fields[2][1..3]), (&["group", "mu", "step"][..], &["mu 0.1", "0.1"][..]));
    assert_eq!(study(&["--parameters", table.to_str().unwrap(), "--by", "mu"]), (0, String::new()));
    assert_eq!(fs::read_to_string(folder.path().join("runs.csv")).unwrap(), of_table);
    assert!(study(&["--by", "mu"]).1.ends_with("by: mu is not a parameter of the study; expected none\n"));

    // The first snapshot is at 0 s; times are sums of steps.
    for times in [&["--until", "0.9999999999"][..], &["--from", "1.0000000001", "--until", "1.0000000001"]] {
        assert_eq!(study(times), (0, String::new()));
        assert_eq!(column(&folder.path().join("runs.csv"), "time"), [1.0; 2], "{times:?}");
    }
    let (status, printed) = study(&["--from", "2"]);
    assert!(status == 2 && printed.contains("series.csv: time: ends at 1 s; expected"), "{printed}");
    let (status, printed) = study(&["--groups", "one"]);
    assert!(status == 2 && printed.contains("options: --groups: 1 names; expected 2"), "{printed}");
    let (status, printed) = study(&["--groups", "one,"]);
    assert!(
        status == 2 && printed.contains("options: --groups: '' is given as number 2; expected a name"),
        "{printed}"
    );
    let (status, printed) = study(&[cases[0].path().to_str().unwrap()]);
    assert!(status == 2 && printed.contains("' is given again as number 3; expected each name once"), "{printed}");
    // A name is one field of one line.
    assert_eq!(study(&["--groups", "say \"one\",two\n\ttimes"]).0, 0);
    let runs = fs::read_to_string(folder.path().join("runs.csv")).unwrap();
    assert!(runs.lines().count() == 3 && runs.contains(",say 'one',") && runs.contains(",two  times,"), "{runs}");
    // The last row of a run that was cut off does not count.
    for table in ["OUTBOX/steps.csv", "TIMER.csv"] {
        let path = cases[0].path().join(table);
        let whole = fs::read_to_string(&path).unwrap();
        fs::write(&path, whole + "3,1,5").unwrap();
    }
    assert_eq!(study(&[]), (0, String::new()));
    assert_eq!(column(&folder.path().join("runs.csv"), "sweeps"), [15.0; 2]);
    // A series of the run before.
    let newer = snapshot::snapshot_path(&cases[0].path().join("OUTBOX"), 8);
    scene(8).snapshot.write(&newer).unwrap();
    let (status, printed) = study(&[]);
    let expected = format!(
        "POSTPRO/series.csv: table: ends at step 4 and 1 s; expected step 8 and 2 s, as the last snapshot of OUTBOX: \
         run cd-post {} again\n",
        cases[0].path().display()
    );
    assert!(status == 2 && printed.ends_with(&expected), "{printed}");
    fs::remove_file(newer).unwrap();
    let series = cases[0].path().join("POSTPRO/series.csv");
    let whole = fs::read_to_string(&series).unwrap();
    fs::write(&series, whole.replace(",mass,", ",weight,")).unwrap();
    let (status, printed) = study(&[]);
    assert!(
        status == 2 && printed.ends_with("column 'mass': is missing; write the table again with this version\n"),
        "{printed}"
    );
}

#[test]
fn a_reader_that_goes_away_stops_nothing() {
    let case = case(&[0]);
    let mut child = Command::new(env!("CARGO_BIN_EXE_cd-post"))
        .args(["--no-vtk"])
        .arg(case.path())
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), String::from_utf8(output.stderr).unwrap()), (Some(1), String::new()));
    assert!(case.path().join("POSTPRO/series.csv").is_file());
}

#[test]
fn a_film_has_a_picture_of_each_snapshot_for_any_number_of_threads() {
    let case = case(&[0, 10, 20]);
    let film = |flags: &[&str]| {
        let output = cd_post(&[&["movie"], flags].concat(), case.path());
        (output, fs::read(case.path().join("POSTPRO/movie.gif")).unwrap_or_default())
    };
    let small = ["--size", "160"];
    let (output, bytes) = film(&[&small[..], &["--threads", "1", "--fps", "10", "--colour", "radius"]].concat());
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert_eq!(names(&case.path().join("POSTPRO")), ["movie.gif"]);
    let times = |bytes: &[u8]| {
        let mut decoder = gif::DecodeOptions::new().read_info(bytes).unwrap();
        assert_eq!(decoder.height(), 160);
        let mut times = Vec::new();
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            times.push(frame.delay);
        }
        times
    };
    assert_eq!(times(&bytes), [10, 10, 110]); // hundredths of a second; the last stays a second more
    let (_, others) = film(&[&small[..], &["--threads", "3", "--fps", "10", "--colour", "radius"]].concat());
    assert!(bytes == others, "the bytes depend on the number of threads");
    // Fewer pictures are reported.
    let (output, bytes) = film(&[&small[..], &["--max-frames", "2"]].concat());
    assert_eq!((output.status.code(), times(&bytes).len()), (Some(1), 2));
    let note = String::from_utf8(output.stderr).unwrap();
    assert!(note.contains("the film has 2 of 3 snapshots") && note.contains("--max-frames 3"), "{note}");
    assert_eq!(times(&film(&[&small[..], &["--every", "2"]].concat()).1).len(), 2);
    assert_eq!(times(&film(&[&small[..], &["--max-frames", "1"]].concat()).1), [105]); // one at 20 a second
}

#[test]
fn films_that_cannot_be_made_are_rejected() {
    let case = case(&[0]);
    for (flags, expected) in [
        (
            &["-o", "film.avi"][..],
            "options: --output: film.avi has no known ending; expected a name that ends in .gif or .mp4",
        ),
        (&["--range", "2,1"], "expected two numbers LOW,HIGH"),
        (
            &["--range", "1,2"],
            "options: --range: is given with --colour neighbours, which has counts or names; expected",
        ),
        (&["--view", "0,100"], "expected two numbers AZIMUTH,ELEVATION"),
        (&["--size", "10"], "160"),
        (&["--fps", "0"], "50"),
        (&["--colour", "sped"], "speed"),
    ] {
        let output = cd_post(&[&["movie"], flags].concat(), case.path());
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{flags:?}: {message}");
        assert!(message.starts_with("cd-post: ") && message.contains(expected), "{flags:?}: {message}");
    }
    // Without ffmpeg the message says what to do, and nothing is left behind.
    let mut command = Command::new(env!("CARGO_BIN_EXE_cd-post"));
    let film = case.path().join("film.mp4");
    let output = command.arg("movie").arg("-o").arg(&film).arg(case.path()).env("PATH", "").output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(
        message.contains("--output: ffmpeg is not installed; expected ffmpeg on PATH, or a name that ends in .gif")
    );
    assert!(!film.exists() && !case.path().join(".film.mp4.part").exists());
}

/// A run is a lock of OUTBOX, which systems have whose folders can be opened as files.
#[cfg(unix)]
#[test]
fn the_page_of_a_running_case_follows_it_to_its_end() {
    let case = case(&[0]);
    let page = || fs::read_to_string(case.path().join("POSTPRO/report.html")).unwrap_or_default();
    let steps = |page: &str| page.matches("\"step\":").count();
    let run = fs::File::open(case.path().join("OUTBOX")).unwrap();
    run.lock().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_cd-post"));
    let mut watch = command.args(["watch", "--interval", "1"]).arg(case.path()).stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(watch.stdout.take().unwrap()).lines();
    let line = lines.next().unwrap().unwrap();
    assert!(line.ends_with("report.html: 1 snapshot, to step 0"), "{line}");
    assert!(page().contains("<body data-reload=\"1\">") && steps(&page()) == 1);
    // Another cd-post is not kept waiting.
    assert_eq!(cd_post(&["--no-vtk", "--no-plots"], case.path()).status.code(), Some(0));
    scene(10).snapshot.write(&snapshot::snapshot_path(&case.path().join("OUTBOX"), 10)).unwrap();
    scene(20).snapshot.write(&snapshot::snapshot_path(&case.path().join("OUTBOX"), 20)).unwrap();
    // The end of the run ends the pause between two reports.
    run.unlock().unwrap();
    assert!(watch.wait().unwrap().success());
    assert!(!page().contains("data-reload=\"") && steps(&page()) == 3);
    // After the run it is the page of `report`.
    let last = page();
    assert_eq!(cd_post(&["report"], case.path()).status.code(), Some(0));
    assert!(last == page());
}

#[test]
fn a_report_has_contents_walls_and_tables() {
    let case = case(&[0, 10]);
    assert_eq!(cd_post(&["report"], case.path()).status.code(), Some(0));
    let page = fs::read_to_string(case.path().join("POSTPRO/report.html")).unwrap();
    let links: Vec<&str> = page.split("<a href=\"#").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
    assert_eq!(links.len(), 7, "{links:?}");
    for link in links {
        assert_eq!(page.matches(&format!("id=\"{link}\"")).count(), 1, "{link}");
    }
    let summary = page.split("<h2 id=\"summary\">").nth(1).unwrap().split("</table>").next().unwrap();
    let lines = summary.matches("<tr>").count();
    assert!((6..=10).contains(&lines) && summary.contains("Z = 1"), "{summary}");
    // The table within the page is that of the file.
    assert_eq!(cd_post(&["--no-vtk", "--no-plots"], case.path()).status.code(), Some(0));
    let table = page.split("data-table=\"series.csv\">").nth(1).unwrap().split("</script>").next().unwrap();
    assert_eq!(table, fs::read_to_string(case.path().join("POSTPRO/series.csv")).unwrap());
    assert!(page.contains("data-table=\"state-forces.csv\""));
    let start = page.find("id=\"grain-data\">").unwrap() + "id=\"grain-data\">".len();
    let data: serde_json::Value = serde_json::from_str(page[start..].split("</script>").next().unwrap()).unwrap();
    // Six faces of a plate in two triangles each, and twelve edges.
    let count = |kind: &str| data["walls"][kind]["owners"].as_array().unwrap().len();
    assert_eq!(["balls", "solid", "glass", "lines"].map(count), [0, 0, 36, 24]);
    assert!(data["states"].as_array().unwrap().iter().all(|state| state["walls"]["places"].is_string()));
}

#[test]
fn a_report_is_one_page_that_needs_nothing_else() {
    let case = case(&[0, 10]);
    assert_eq!(cd_post(&["report"], case.path()).status.code(), Some(0));
    assert_eq!(names(&case.path().join("POSTPRO")), ["report.html"]);
    let page = fs::read_to_string(case.path().join("POSTPRO/report.html")).unwrap();
    let addresses = page.split("http").skip(1).filter(|rest| !rest.starts_with("://www.w3.org/2000/svg")).count();
    assert_eq!(addresses, 0, "no address but the name of SVG");
    for wanted in [
        "<canvas",
        "Mean kinetic energy per grain",
        "largest_period",
        "iqsc0",
        "\"gravity_constant\"",
        "data-name=\"energy\"",
    ] {
        assert!(page.contains(wanted), "{wanted}");
    }
    assert!(!page.contains("NaN"));
    let start = page.find("id=\"grain-data\">").unwrap() + "id=\"grain-data\">".len();
    let grains: serde_json::Value = serde_json::from_str(page[start..].split("</script>").next().unwrap()).unwrap();
    let steps: Vec<_> = grains["states"].as_array().unwrap().iter().map(|state| state["step"].as_u64()).collect();
    assert_eq!(steps, [Some(0), Some(10)]);
    for quantity in grains["quantities"].as_array().unwrap() {
        let lasting = ["radius", "colour", "number"].contains(&quantity["name"].as_str().unwrap());
        assert_eq!(quantity["states"].as_array().unwrap().len(), if lasting { 1 } else { 2 }, "{quantity}");
    }
    // A run that keeps the time of another has the steps after its first snapshot; counts have all their digits.
    {
        let kept = tempfile::tempdir().unwrap();
        for step in [12_345_600, 12_345_678] {
            let mut scene = scene(step).snapshot;
            scene.meta.ledger.sweeps = 156 * (step - 12_345_600) / 78;
            scene.write(&snapshot::snapshot_path(&kept.path().join("OUTBOX"), step)).unwrap();
        }
        let of_sweeps = |sweeps: &str| format!("<td>sweeps of the contact solver per step</td><td>{sweeps}</td>");
        let page = || {
            assert_eq!(cd_post(&["report"], kept.path()).status.code(), Some(0));
            fs::read_to_string(kept.path().join("POSTPRO/report.html")).unwrap()
        };
        assert!(page().contains(&of_sweeps("2")) && page().contains("<td>steps</td><td>78</td>"));
        assert!(page().contains("<td>step</td><td class=\"number\">12345678</td>"));
        // A row a step, but those after the last snapshot and one that was cut off.
        let steps: String = (12_345_627..12_345_690).map(|step| format!("{step},1\n")).collect();
        fs::write(kept.path().join("OUTBOX/steps.csv"), format!("step,sweeps\n{steps}1")).unwrap();
        assert!(page().contains(&of_sweeps("3")), "of 52");
    }
    // Steps of their own length are counted by steps.csv, where there is one.
    let path = snapshot::snapshot_path(&case.path().join("OUTBOX"), 10);
    let mut last = scene(10).snapshot;
    (last.meta.parameters.adaptive, last.meta.ledger.sweeps) = (Some(Default::default()), 6);
    last.write(&path).unwrap();
    let run = || {
        assert_eq!(cd_post(&["report"], case.path()).status.code(), Some(0));
        fs::read_to_string(case.path().join("POSTPRO/report.html")).unwrap()
    };
    let page = run();
    assert!(
        page.contains("<td>units of dt</td><td>10</td>") && !page.contains("sweeps of the contact solver per step")
    );
    fs::write(case.path().join("OUTBOX/steps.csv"), "step\n4\n8\n10\n").unwrap();
    assert!(run().contains("<td>sweeps of the contact solver per step</td><td>2</td>"));
}

/// The options of the series and of a state, and what they give, are those of the page.
#[test]
fn a_report_has_the_figures_of_the_series_and_of_the_state() {
    let case = tempfile::tempdir().unwrap();
    let mut scene = Scene::default();
    scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -9.81];
    let floor = scene.plate([0.0, 0.0, -0.1], [30.0, 30.0, 0.1]);
    // A cone of some hundred spheres on a floor.
    for (layer, count) in [(0, 8), (1, 6), (2, 4), (3, 2)] {
        for (i, k) in (0..count * count).map(|n| (n / count, n % count)) {
            let place = |n: i32| 2.0 * (f64::from(n) - 0.5 * f64::from(count - 1));
            let grain = scene.grain([place(i), place(k), 1.0 + 2.0 * f64::from(layer)], 1.0);
            if layer == 0 {
                scene.contact_at(grain, floor, [place(i), place(k), 0.0], Vector3::new(0.0, 0.0, 1.0));
            }
        }
    }
    scene.snapshot.write(&snapshot::snapshot_path(&case.path().join("OUTBOX"), 0)).unwrap();
    let page = |flags: &[&str]| {
        let output = cd_post(&[&["report"], flags].concat(), case.path());
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        fs::read_to_string(case.path().join("POSTPRO/report.html")).unwrap()
    };
    let value = |page: &str, name: &str| {
        let cell = format!("<td>{name}</td><td class=\"number\">");
        page[page.find(&cell).expect(name) + cell.len()..].split('<').next().unwrap().to_string()
    };
    let postpro = case.path().join("POSTPRO");
    let mut pages = Vec::new();
    for (region, reach) in [("ball:5@0,0,3", "3"), ("box:4,4,4@0,0,3", "8")] {
        let flags = ["--region", region, "--slope-reach", reach];
        let page = page(&flags);
        assert_eq!(cd_post(&flags, case.path()).status.code(), Some(0));
        for name in ["nu", "region_volume", "pressure", "surface_slope"] {
            let expected = column(&postpro.join("series.csv"), name)[0];
            let found: f64 = value(&page, name).parse().unwrap();
            assert!((found - expected).abs() <= 5e-3 * expected.abs(), "{name}: {found}, {expected}");
        }
        assert_eq!(cd_post(&["state", "--slope-reach", reach], case.path()).status.code(), Some(0));
        for figure in ["surface_height.svg", "surface_slope.svg", "slopes.svg"] {
            let svg = fs::read_to_string(postpro.join("state-000000").join(figure)).unwrap();
            assert!(page.contains(&svg), "{figure}");
        }
        assert!(page.contains(&format!("within {reach} mean radii")));
        pages.push(page);
    }
    let slope = |page: &str| value(page, "surface_slope");
    assert!(slope(&pages[0]) != slope(&pages[1]), "{}", slope(&pages[0]));
    let layer = cd_post(&["report", "--region", "layer:0,2"], case.path());
    assert_eq!(layer.status.code(), Some(1), "{layer:?}");
    assert!(
        String::from_utf8_lossy(&layer.stderr).contains("a shape over ten thousand periods, in 1 of 1 snapshots"),
        "{layer:?}"
    );
}

#[test]
fn a_body_is_tracked_along_the_first_gravity() {
    // Gravity begins at the second snapshot, along -z, and turns to -x at the fourth.
    let tracked = |turns: bool| {
        let case = tempfile::tempdir().unwrap();
        for step in 0..4 {
            let mut scene = scene(step);
            let gravity = [[0.0; 3], [0.0, 0.0, -2.0], [0.0; 3], [if turns { -2.0 } else { 0.0 }, 0.0, -2.0]];
            scene.snapshot.meta.parameters.uniform_gravity = gravity[step as usize];
            scene.grain([0.0, 0.0, 5.0], 0.5);
            scene.snapshot.write(&snapshot::snapshot_path(&case.path().join("OUTBOX"), step)).unwrap();
        }
        let output = cd_post(&["track", "--body", "5"], case.path());
        let depth = column(&case.path().join("POSTPRO/track-5/track.csv"), "depth");
        (output.status.code(), String::from_utf8(output.stderr).unwrap(), depth, case)
    };
    let (status, printed, depth, case) = tracked(false);
    assert_eq!((status, printed.as_str()), (Some(0), ""));
    // The grain below, of radius 1 at z = 1, is highest at 2, and within 0.375 around at 1.927.
    assert!(depth == [depth[0]; 4] && (-2.573..-2.5).contains(&depth[0]), "{depth:?}");
    let text = fs::read_to_string(case.path().join("POSTPRO/track-5/track.csv")).unwrap();
    assert!(text.lines().skip(1).all(|line| line.ends_with(",0")), "{text}"); // contacts, a whole number
    let (status, printed, same, _) = tracked(true);
    let expected = "cd-post: gravity changes direction at step 3: up is opposite to the gravity of step 1 throughout\n";
    assert_eq!((status, printed.as_str(), same), (Some(1), expected, depth));
}

#[test]
fn an_impact_has_its_tables_and_says_what_is_missing() {
    // A ball approaches three that touch, and rebounds.
    let case = tempfile::tempdir().unwrap();
    for (step, v) in [(0, -2.0), (10, 0.5)] {
        let mut scene = scene(step);
        let shot = scene.grain([2.0, 0.0, 5.0], 0.5);
        scene.snapshot.bodies.body_v[shot] = [0.0, 0.0, v];
        scene.snapshot.write(&snapshot::snapshot_path(&case.path().join("OUTBOX"), step)).unwrap();
    }
    let measured = |flags: &[&str]| {
        let output = cd_post(&[&["impact"][..], flags].concat(), case.path());
        (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
    };
    let walls =
        "cd-post: walls or fields act on the target from step 0 on: the momentum that it gains contains theirs\n";
    assert_eq!(measured(&["--projectile", "5"]), (1, walls.to_string()));
    let folder = case.path().join("POSTPRO/impact");
    assert_eq!(names(&folder).len(), 12);
    all_finite(&folder);
    assert_eq!(column(&folder.join("beta.csv"), "beta")[0], 0.0);
    let (code, notes) =
        measured(&["--projectile", "5", "--point", "40,0,0", "--normal", "0,0,1", "--direction", "-1,0,-1"]);
    assert_eq!(
        (code, notes),
        (1, format!("{walls}cd-post: no surface is around the point of the impact: there is no crater\n"))
    );
    for (flags, expected) in [
        (
            &["--projectile", "9"][..],
            "options: --projectile: 9 is not in the first snapshot; expected a free body that is in the run from the start",
        ),
        (
            &["--projectile", "2-5"],
            "options: --target: has no grain in the first snapshot; expected free bodies besides the projectile",
        ),
        (
            &["--projectile", "3"],
            "options: --projectile: 3 is at rest relative to the target in the first snapshot; expected an approaching body",
        ),
        (
            &["--projectile", "5", "--target", "colour:GREEN"],
            "options: --target: colour:GREEN has no grain in the first snapshot; expected free bodies besides the projectile",
        ),
    ] {
        let target_at_rest = flags == ["--projectile", "3"];
        let flags = if target_at_rest { &["--projectile", "3", "--target", "2,4"][..] } else { flags };
        assert_eq!(measured(flags), (2, format!("cd-post: {expected}\n")));
    }
    for wrong in [&["--direction", "0,0,0"][..], &["--direction", "1,2"], &["--within", "-1"], &["--point", "a,0,0"]] {
        let (code, printed) = measured(&[&["--projectile", "5"][..], wrong].concat());
        assert!(code == 2 && printed.contains("expected"), "{printed}");
    }
    assert!(measured(&["--projectile", "x"]).1.contains("expected numbers of bodies in BODIES.DAT"));
}

#[test]
fn a_depth_below_nothing_is_reported() {
    let case = case(&[0]);
    let mut scene = scene(0);
    scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -2.0];
    scene.grain([30.0, 0.0, 5.0], 0.5);
    scene.snapshot.write(&snapshot::snapshot_path(&case.path().join("OUTBOX"), 0)).unwrap();
    let output = cd_post(&["track", "--body", "5"], case.path());
    let printed = String::from_utf8(output.stderr).unwrap();
    let expected = "cd-post: no surface is under body 5 in the first snapshot: its depth is empty\n";
    assert_eq!((output.status.code(), printed.as_str()), (Some(1), expected));
}

#[cfg(target_os = "linux")]
#[test]
fn a_folder_that_no_text_names_is_reported() {
    use std::os::unix::ffi::OsStrExt;
    let folder = tempfile::tempdir().unwrap();
    let case = folder.path().join(std::ffi::OsStr::from_bytes(b"bad\xff"));
    scene(0).snapshot.write(&snapshot::snapshot_path(&case.join("OUTBOX"), 0)).unwrap();
    let (status, printed) = exit_and_errors(&case);
    assert!(status == 1 && printed.contains("DISPLAY: the name of the folder is not UTF-8"), "{printed}");
}

#[test]
fn a_file_that_may_not_grow_is_rejected() {
    let case = case(&[0, 10, 20]);
    let limited = ["-c", "ulimit -f 4; exec \"$@\"", "sh", env!("CARGO_BIN_EXE_cd-post")];
    let output = Command::new("sh").args(limited).arg(case.path()).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(2) && said.contains(": cannot be written: "), "{said}");
    let parts = ["POSTPRO", "DISPLAY"].map(|folder| names(&case.path().join(folder)));
    assert!(parts.iter().flatten().all(|name| !name.ends_with(".part")), "{parts:?}");
}

/// G M (m^3/s^2) with G = 1, semi-major axis (m) and eccentricity of the hyperbola of the tests of axes.
const HYPERBOLA: [f64; 3] = [4.0e14, 1.1e7, 4.2];

/// Case with a snapshot of a grain in the origin and one at (3, -2, 1) m that moves with (0.1, 0.2, 0) m/s, while the origin
/// passes a mass on a hyperbola, which is the planet of a `star` or alone.
///
/// Returns the case, and position and velocity of the origin relative to the mass at the anomaly F, in closed form:
/// x = a (e - cosh F), y = a sqrt(e^2 - 1) sinh F at the time sqrt(a^3 / G M) (e sinh F - F).
fn passing_grains(anomaly: f64, star: bool) -> (tempfile::TempDir, [Vector3<f64>; 2]) {
    let [mu, a, e] = HYPERBOLA;
    let mean_motion = (mu / a.powi(3)).sqrt();
    let (sinh, cosh) = (anomaly.sinh(), anomaly.cosh());
    let (minor, rate) = (a * (e * e - 1.0).sqrt(), mean_motion / (e * cosh - 1.0));
    let position = Vector3::new(a * (e - cosh), minor * sinh, 0.0);
    let velocity = Vector3::new(-a * sinh, minor * cosh, 0.0) * rate;
    let orbit = |semi_major_axis: f64, eccentricity: f64| {
        Some(OrbitSpec::Elements {
            periapsis: None,
            semi_major_axis: Some(semi_major_axis),
            eccentricity: Some(eccentricity),
            v_infinity: None,
            inclination: 0.0,
            node: 0.0,
            argument: 0.0,
            periapsis_time: 0.0,
        })
    };
    let point_mass =
        |mass: f64, orbit: Option<OrbitSpec>| ExternalField::PointMass { mass, position: None, orbit, response: false };
    let mut scene = Scene::default();
    scene.grain([0.0; 3], 1.0);
    let other = scene.grain([3.0, -2.0, 1.0], 1.0);
    scene.snapshot.bodies.body_v[other] = [0.1, 0.2, 0.0];
    let meta = &mut scene.snapshot.meta;
    (meta.time, meta.h, meta.parameters.gravity_constant) = ((e * sinh - anomaly) / mean_motion, 1.0, 1.0);
    meta.parameters.fields = vec![point_mass(mu, orbit(-a, e))];
    if star {
        meta.parameters.fields.push(point_mass(1.3e20, orbit(1.5e11, 0.0)));
    }
    let case = tempfile::tempdir().unwrap();
    scene.snapshot.write(&snapshot::snapshot_path(&case.path().join("OUTBOX"), 0)).unwrap();
    (case, [position, velocity])
}

#[test]
fn grains_on_a_hyperbola_are_seen_from_its_focus() {
    for anomaly in [-2.0, 0.0, 0.7, 3.0] {
        let (case, [position, velocity]) = passing_grains(anomaly, false);
        let output = cd_post(&["--no-plots", "--frame", "primary:1"], case.path());
        assert_eq!((output.status.code(), output.stderr.as_slice()), (Some(0), &[][..]));
        let text = fs::read_to_string(case.path().join("DISPLAY/grains-000000.vtp")).unwrap();
        let arrays = vtp::arrays(&text).unwrap();
        // Kepler's equation with the time rounded to 2^-53, and a few roundings.
        let near = |name: &str, first: usize, expected: &Vector3<f64>| {
            let found = Vector3::from_column_slice(&arrays[name][first..first + 3]);
            assert!((found - expected).norm() < 4e-15 * expected.norm(), "{anomaly} {name}: {found} {expected}");
        };
        near("points", 0, &position);
        near("velocity", 0, &velocity);
        near("points", 3, &(position + Vector3::new(3.0, -2.0, 1.0)));
        near("velocity", 3, &(velocity + Vector3::new(0.1, 0.2, 0.0)));
        // The grains keep their distance but for the rounding of their positions.
        let distance: Vec<f64> = (0..3).map(|k| arrays["points"][3 + k] - arrays["points"][k]).collect();
        let rounding = position.amax() * f64::EPSILON;
        assert!(distance.iter().zip([3.0, -2.0, 1.0]).all(|(found, expected)| (found - expected).abs() <= rounding));
        let value = |table: &str, name: &str| column(&case.path().join("POSTPRO").join(table), name)[0];
        let centre = position + Vector3::new(1.5, -1.0, 0.5);
        assert!((value("series.csv", "com_x") - centre.x).abs() < 4e-15 * centre.norm());
        let momentum = (velocity + Vector3::new(0.05, 0.1, 0.0)) * value("series.csv", "mass");
        assert!((value("series.csv", "P_y") - momentum.y).abs() < 4e-15 * momentum.norm());
        // The mass is at rest in the origin of its axes; `distance` is that from the grains.
        assert!(["x", "y", "z", "v_x", "v_y", "v_z"].iter().all(|name| value("primaries.csv", name) == 0.0));
        assert!((value("primaries.csv", "distance") / position.norm() - 1.0).abs() < 4e-15);
        // A mass that nothing attracts is at rest.
        let about_mass = files_without_axes(case.path());
        cd_post(&["--no-plots", "--frame", "inertial"], case.path());
        assert_eq!(files_without_axes(case.path()), about_mass);
    }
}

#[test]
fn tables_of_a_body_and_of_fragments_are_about_the_mass() {
    let (case, [position, velocity]) = passing_grains(0.7, false);
    let value = |table: &str, name: &str| column(&case.path().join("POSTPRO").join(table), name)[0];
    cd_post(&["track", "--body", "2", "--frame", "primary:1"], case.path());
    let near = |found: f64, expected: f64, scale: f64| assert!((found - expected).abs() < 4e-15 * scale, "{found}");
    near(value("track-2/track.csv", "y"), position.y - 2.0, position.norm());
    near(value("track-2/track.csv", "v_x"), velocity.x + 0.1, velocity.norm());
    cd_post(&["state", "--frame", "primary:1"], case.path());
    near(value("state-000000/fragments.csv", "x"), position.x, position.norm());
    near(value("state-000000/fragments.csv", "v_y"), velocity.y, velocity.norm());
    // A point of the surface of the first grain, 1 m across.
    let surface = value("state-000000/surface.csv", "y");
    assert!((surface - position.y).abs() < 1.0 + 1e-6, "{surface}");
}

/// Contents of files with positions, without the line that names their axes.
fn files_without_axes(case: &Path) -> [String; 3] {
    ["POSTPRO/series.csv", "POSTPRO/primaries.csv", "DISPLAY/grains-000000.vtp"].map(|name| {
        let text = fs::read_to_string(case.join(name)).unwrap();
        text.lines().filter(|line| !line.contains("Name=\"axes\"")).collect::<Vec<_>>().join("\n")
    })
}

#[test]
fn axes_of_the_computation_are_the_default() {
    let (case, _) = passing_grains(0.7, true);
    let written = |flags: &[&str]| {
        assert_eq!(cd_post(flags, case.path()).status.code(), Some(0));
        files_without_axes(case.path())
    };
    let recorded = |folder: &str| fs::read_to_string(case.path().join(folder).join("axes.txt")).ok();
    let by_default = written(&[]);
    assert_eq!(written(&["--frame", "computed"]), by_default);
    assert_eq!(["POSTPRO", "DISPLAY"].map(recorded), [None, None]);
    let value = |name: &str| column(&case.path().join("POSTPRO/series.csv"), name)[0];
    assert_eq!([value("com_x"), value("com_y"), value("com_z")], [1.5, -1.0, 0.5]);
    // The planet of a star moves in axes at rest, and these are those about the star.
    let [inertial, about_star, about_planet] =
        ["inertial", "primary:2", "primary:1"].map(|axes| written(&["--frame", axes]));
    assert!(inertial == about_star && about_star != about_planet);
    let primaries = case.path().join("POSTPRO/primaries.csv");
    written(&["--frame", "inertial"]);
    cd_post(&["--frame", "primary:1", "--no-vtk"], case.path());
    // The pictures are as before.
    assert_eq!(["POSTPRO", "DISPLAY"].map(recorded), ["primary:1\n", "inertial\n"].map(|text| Some(text.to_string())));
    let grains = fs::read_to_string(case.path().join("DISPLAY/grains-000000.vtp")).unwrap();
    // "inertial" and a zero as numbers.
    assert!(grains.contains("Name=\"axes\" NumberOfTuples=\"1\" format=\"ascii\">105 110 101 114 116 105 97 108 0<"));
    written(&["--frame", "inertial"]);
    // A circle about the star with G (M + m) = 1.3e20: sqrt(G M / r); relative to this the mass of the planet is not counted.
    let planet_speed =
        ["v_x", "v_y", "v_z"].map(|name| column(&primaries, name)[0]).iter().map(|v| v * v).sum::<f64>().sqrt();
    assert!((planet_speed / (1.3e20_f64 / 1.5e11).sqrt() - 1.0).abs() < 1e-14, "{planet_speed}");
}

#[test]
fn axes_without_a_primary_are_rejected() {
    let (case, _) = passing_grains(0.7, true);
    let message = |flags: &[&str], case: &Path| {
        let output = cd_post(flags, case);
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8(output.stderr).unwrap()
    };
    assert_eq!(
        message(&["--frame", "primary:3"], case.path()),
        "cd-post: options: --frame: primary:3; expected computed, inertial or primary:1 or primary:2\n"
    );
    let text = message(&["--frame", "primary:0"], case.path());
    assert!(text.contains("expected computed, inertial or primary:N"), "{text}");
    for axes in ["inertial", "primary:1"] {
        let found = message(&["--frame", axes], self::case(&[0]).path());
        assert_eq!(
            found,
            format!("cd-post: options: --frame: {axes}; expected computed, as no field of the run has an orbit\n")
        );
    }
}
