//! Damaged, mixed and unfinished files of a case are found, and no file outside of it is touched.

use std::fs;
use std::path::Path;
use std::process::{Output, Stdio};

use cd_formats::accuracy::AccuracyControl;
use cd_formats::lock::FolderLock;
use cd_tests::case::{Case, assert_same_results, copy, files, from_outbox, pre};
use cd_tests::process::{Executables, STDOUT, exit_code, run_requested_program};

/// Ball on a plate, `radius` in m: 40 steps, a snapshot every 10.
fn scene(radius: f64) -> String {
    format!(
        r#"(
    gravity: (0.0, 0.0, -9.81),
    materials: [(name: "ROCKx", density: 2700.0)],
    laws: [(name: "iqs00", kind: IQS_CLB(friction: 0.5))],
    contacts: [(between: ("BLUEx", "BLUEx"), law: "iqs00"), (between: ("BLUEx", "FLOOR"), law: "iqs00")],
    grains: [(
        material: "ROCKx",
        colour: "BLUEx",
        number: 3,
        sizes: Single({radius:?}),
        placement: List(positions: [(0.0, 0.0, 0.2), (1.0, 0.0, 0.3), (2.0, 0.0, 0.4)]),
    )],
    walls: [Plate(material: "ROCKx", colour: "FLOOR", centre: (0.0, 0.0, -0.1), half_lengths: (5.0, 5.0, 0.1))],
    compute: (dt: 2e-3, steps: 40, output_every: 10),
)"#
    )
}

/// Runs one of the programs as a process of its own. Its text goes to the file `text`, if there is one.
fn program(words: &[&str], text: Option<&Path>) -> Output {
    Executables::of_test()
        .command(words)
        .envs(text.map(|path| (STDOUT, path)))
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
        .wait_with_output()
        .unwrap()
}

/// The programs of other tests, which start this test as a process.
#[test]
fn program_process() {
    run_requested_program();
}

/// Exit code and standard error of `cd-solve CASE FLAGS`.
fn solve_process(case: &Path, flags: &[&str]) -> (i32, String) {
    let words: Vec<&str> = ["cd-solve", case.to_str().unwrap()].into_iter().chain(flags.iter().copied()).collect();
    let output = program(&words, None);
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

/// Exit code and standard output of `cd-solve CASE --verify`.
fn verification(case: &Case) -> (i32, String) {
    let text = case.path().join("said");
    let output = program(&["cd-solve", case.path().to_str().unwrap(), "--verify"], Some(&text));
    (output.status.code().unwrap(), fs::read_to_string(text).unwrap())
}

#[test]
fn an_edited_datbox_is_reported_and_one_with_missing_files_is_rejected() {
    let case = Case::from_scene(&scene(0.1));
    let bodies = case.datbox("BODIES.DAT");
    let text = fs::read_to_string(&bodies).unwrap();
    fs::write(&bodies, text.clone() + "! a comment\n").unwrap();
    let (code, said) = solve_process(case.path(), &["--force"]);
    assert!(code == 0 && said.contains("DATBOX: changed since cd-pre "), "{said}");
    let advice = "the run uses them; if they were not edited on purpose, run cd-pre again";
    assert!(said.contains(&format!("wrote them: BODIES.DAT; {advice}")), "{said}");
    fs::write(&bodies, text).unwrap();
    let (code, said) = solve_process(case.path(), &["--force"]);
    assert!(code == 0 && !said.contains("changed"), "{said}");
    // Without COMPUTE.RON the run would have other options.
    fs::remove_file(case.datbox("COMPUTE.RON")).unwrap();
    let (code, said) = solve_process(case.path(), &["--force"]);
    assert!(code == 2 && said.contains("COMPUTE.RON: file: is missing; cd-pre "), "{said}");
    fs::remove_file(case.datbox("SHA256SUMS")).unwrap();
    assert_eq!(case.solve(&["--force"]), 0);
}

#[test]
fn a_mixture_of_two_scenes_is_reported_or_rejected() {
    let [case, other] = [0.1, 0.12].map(|radius| Case::from_scene(&scene(radius)));
    // As a program leaves it that is killed between two renames.
    fs::write(case.datbox(".unfinished"), "").unwrap();
    fs::copy(other.datbox("BODIES.DAT"), case.datbox("BODIES.DAT")).unwrap();
    let (code, said) = solve_process(case.path(), &[]);
    assert!(code == 2 && said.contains("cd-pre was ended before it had replaced all files"), "{said}");
    assert!(said.contains("run cd-pre again") && !case.outbox().exists(), "{said}");
    fs::remove_file(case.datbox(".unfinished")).unwrap();
    let (code, said) = solve_process(case.path(), &[]);
    assert!(code == 0 && said.contains("wrote them: BODIES.DAT;"), "{said}");
    assert_eq!(pre(&case.path().join("scene.ron"), case.path()), 0);
    let (code, said) = solve_process(case.path(), &["--force"]);
    assert!(code == 0 && !said.contains("warning"), "{said}");
}

#[test]
fn two_programs_do_not_write_one_datbox() {
    let case = Case::from_scene(&scene(0.1));
    let datbox = case.path().join("DATBOX");
    let before: Vec<Vec<u8>> = files(&datbox).iter().map(|name| fs::read(datbox.join(name)).unwrap()).collect();
    let lock = FolderLock::exclusive(&datbox).unwrap().unwrap();
    assert_eq!(pre(&case.path().join("scene.ron"), case.path()), 2);
    assert_eq!(case.solve(&[]), 2);
    drop(lock);
    let after: Vec<Vec<u8>> = files(&datbox).iter().map(|name| fs::read(datbox.join(name)).unwrap()).collect();
    assert!(before == after);
    let reader = FolderLock::shared(&datbox).unwrap();
    assert_eq!(pre(&case.path().join("scene.ron"), case.path()), 2);
    assert_eq!(case.solve(&[]), 0);
    drop(reader);
    assert_eq!(pre(&case.path().join("scene.ron"), case.path()), 0);
}

#[test]
fn damaged_files_are_found_and_a_run_continues_from_the_last_sound_snapshot() {
    let case = Case::from_scene(&scene(0.1)).solved(&[]);
    let unbroken = case.twin().solved(&[]);
    assert_eq!(case.solve(&["--verify"]), 0);
    // The list of the results covers the files of DATBOX, the snapshots and the log, as sha256sum reads it.
    let list = fs::read_to_string(case.outbox().join("SHA256SUMS")).unwrap();
    let paths: Vec<&str> =
        list.lines().filter(|line| !line.starts_with('#')).filter_map(|line| Some(line.split_once("  ")?.1)).collect();
    assert_eq!(
        paths.iter().filter(|path| path.starts_with("../DATBOX/")).count(),
        files(&case.path().join("DATBOX")).len() - 1
    );
    let results =
        [0, 10, 20, 30, 40].map(|step| format!("snapshot-{step:06}.npz")).into_iter().chain(["steps.csv".into()]);
    assert!(paths.iter().filter(|path| !path.starts_with("..")).map(|path| path.to_string()).eq(results), "{list}");

    for (name, at) in [("snapshot-000040.npz", 700), ("snapshot-000030.npz", 900), ("steps.csv", 300)] {
        let path = case.outbox().join(name);
        let mut bytes = fs::read(&path).unwrap();
        bytes[at] ^= 4;
        fs::write(&path, bytes).unwrap();
        assert_eq!(case.solve(&["--verify"]), 1, "{name}");
    }
    fs::remove_file(case.outbox().join("snapshot-000010.npz")).unwrap();
    let (_, said) = verification(&case);
    for line in [
        "snapshot-000030.npz: differs from its checksum in OUTBOX/SHA256SUMS",
        "snapshot-000040.npz: differs from its checksum in OUTBOX/SHA256SUMS",
        "steps.csv: differs from its checksum in OUTBOX/SHA256SUMS",
        "snapshot-000010.npz: is missing",
        "snapshots: 2 of 4 sound",
        "restore the damaged logs, or rename them to continue without their rows; then --resume --skip-damaged continues \
         from step 20",
    ] {
        assert!(said.contains(line), "{line}: {said}");
    }
    assert_eq!(case.solve(&["--resume"]), 2);
    // The rows of a damaged log are not continued; nothing is changed, and the damage is still found.
    let (damaged_log, list) = (fs::read(case.outbox().join("steps.csv")).unwrap(), list.as_bytes());
    let (code, said) = solve_process(case.path(), &["--resume", "--skip-damaged"]);
    let fault = "OUTBOX/steps.csv: log: differs from its checksum in OUTBOX/SHA256SUMS; restore the file, or rename it to \
                 continue without its rows";
    assert!(code == 2 && said.contains(fault), "{said}");
    assert_eq!(fs::read(case.outbox().join("steps.csv")).unwrap(), damaged_log);
    assert_eq!(fs::read(case.outbox().join("SHA256SUMS")).unwrap(), list);
    fs::copy(unbroken.outbox().join("steps.csv"), case.outbox().join("steps.csv")).unwrap();
    fs::copy(unbroken.outbox().join("snapshot-000010.npz"), case.outbox().join("snapshot-000010.npz")).unwrap();
    assert_eq!(case.solve(&["--resume", "--skip-damaged"]), 0);
    for name in ["snapshot-000040.npz.damaged", "snapshot-000030.npz.damaged"] {
        fs::remove_file(case.outbox().join(name)).unwrap();
    }
    assert_same_results(&unbroken, &case);
    assert_eq!(case.solve(&["--verify"]), 0);
}

/// A last snapshot that its list says is changed is not continued, though it can be read, and `.damaged` files stay.
#[test]
fn changed_files_are_not_resumed() {
    let case = Case::from_scene(&scene(0.1)).solved(&[]);
    let unbroken = case.twin().solved(&[]);
    for k in 1..=2 {
        let mut snapshot = case.last_snapshot();
        snapshot.bodies.body_x[0][0] += 1e-3;
        fs::write(case.outbox().join("snapshot-000040.npz"), snapshot.to_bytes()).unwrap();
        let (code, said) = solve_process(case.path(), &["--resume"]);
        let fault = "snapshot-000040.npz: snapshot: differs from its checksum in OUTBOX/SHA256SUMS; \
                     --resume --skip-damaged continues from the last sound snapshot";
        assert!(code == 2 && said.contains(fault), "{said}");
        assert_eq!(verification(&case).0, 1);
        assert_eq!(case.solve(&["--resume", "--skip-damaged"]), 0);
        assert_eq!(files(&case.outbox()).iter().filter(|name| name.contains(".damaged")).count(), k);
    }
    for name in ["snapshot-000040.npz.damaged", "snapshot-000040.npz.damaged-2"] {
        fs::remove_file(case.outbox().join(name)).unwrap();
    }
    assert_same_results(&unbroken, &case);
    // A list with a line that is none says what to do.
    let list = case.outbox().join("SHA256SUMS");
    fs::write(&list, fs::read_to_string(&list).unwrap().replacen("  snapshot", " snapshot", 1)).unwrap();
    let (code, said) = solve_process(case.path(), &["--resume"]);
    assert!(code == 2 && said.contains("restore the file, or remove it: other files are then not compared"), "{said}");
    fs::remove_file(list).unwrap();
    assert_eq!(case.solve(&["--resume"]), 0);
}

/// A run that is interrupted twice between two rows has the rows of the unbroken run.
#[test]
fn rows_survive_a_second_interruption() {
    let case = Case::from_scene(&scene(0.1));
    let unbroken = case.twin().solved(&["--log-every", "7"]);
    assert_eq!(case.solve(&["--log-every", "7", "--steps", "17"]), 0);
    // A run that is rejected has opened the first log.
    let timer = case.path().join("TIMER.csv");
    for _ in 0..2 {
        fs::rename(&timer, case.path().join("T")).unwrap();
        fs::create_dir(&timer).unwrap();
        assert_eq!(case.solve(&["--log-every", "7", "--resume"]), 2);
        fs::remove_dir(&timer).unwrap();
        fs::rename(case.path().join("T"), &timer).unwrap();
    }
    assert_eq!(case.solve(&["--log-every", "7", "--resume"]), 0);
    fs::remove_file(case.outbox().join("snapshot-000017.npz")).unwrap();
    assert_same_results(&unbroken, &case);
}

/// cd-solve rejects a DATBOX without all files of its list, or one that cd-pre has not finished.
#[test]
fn a_datbox_that_is_rejected_is_verified_as_such() {
    let case = Case::from_scene(&scene(0.1));
    let make_datbox = || assert_eq!(pre(&case.path().join("scene.ron"), case.path()), 0);
    let last_line = |said: &str| said.lines().last().unwrap().to_string();
    let reject = |damage: &str, next: &str| {
        let (code, said) = verification(&case);
        assert!(code == 1 && said.contains(damage), "{code} {said}");
        assert_eq!(last_line(&said), format!("run cd-pre again; then {next}"));
        assert_eq!(case.solve(&["--resume"]), 2);
    };
    let damage = |next: &str| {
        fs::remove_file(case.datbox("COMPUTE.RON")).unwrap();
        reject("DATBOX/COMPUTE.RON: is missing", next);
        make_datbox();
        fs::write(case.datbox(".unfinished"), "").unwrap();
        reject("DATBOX: folder: cd-pre was ended before it had replaced all files", next);
        make_datbox();
        let (code, said) = verification(&case);
        assert_eq!((code, last_line(&said)), (0, next.to_string()));
    };
    damage("a run starts from DATBOX");
    assert_eq!(case.solve(&[]), 0);
    damage("--resume continues from step 40");
    // Files of DATBOX are named once for each list, by one path.
    fs::write(case.datbox("BULK_BEHAV.DAT"), "").unwrap();
    let (_, said) = verification(&case);
    let path = case.datbox("BULK_BEHAV.DAT");
    for list in ["DATBOX", "OUTBOX"] {
        let line = format!("{}: differs from its checksum in {list}/SHA256SUMS\n", path.display());
        assert!(said.contains(&line), "{line} {said}");
    }
    let first = "mend DATBOX, whose faults cd-solve --plan names, or run cd-pre again";
    assert_eq!(last_line(&said), format!("{first}; then --resume continues from step 40"));
    let writer = FolderLock::exclusive(&case.path().join("DATBOX")).unwrap().unwrap();
    let (code, said) = solve_process(case.path(), &["--verify"]);
    assert!(code == 2 && said.contains("cd-pre is writing it; wait for its end"), "{code} {said}");
    drop(writer);
}

/// The first part of a log that was removed is named on standard output, and the run continues.
#[test]
fn rows_that_a_log_lacks_are_named_at_a_resume() {
    let case = Case::from_scene(&scene(0.1)).solved(&["--steps", "20"]);
    fs::remove_file(case.outbox().join("steps.csv")).unwrap();
    let text = case.path().join("said");
    let output = program(&["cd-solve", case.path().to_str().unwrap(), "--resume"], Some(&text));
    let said = fs::read_to_string(text).unwrap();
    assert!(output.status.success() && output.stderr.is_empty(), "{said}");
    assert!(
        said.contains("OUTBOX/steps.csv: no rows of steps 1 to 20, which were computed before this run\n"),
        "{said}"
    );
}

/// A run that is resumed at its end, as after a kill behind the last snapshot, keeps its log and its list.
#[test]
fn a_run_resumed_at_its_end_stays_as_it_is() {
    let unbroken = Case::from_scene(&scene(0.1)).solved(&["--steps", "35", "--log-every", "8"]);
    let case = unbroken.twin().solved(&["--steps", "35", "--log-every", "8"]);
    assert_eq!(case.solve(&["--steps", "35", "--log-every", "8", "--resume"]), 0);
    assert_same_results(&unbroken, &case);
}

/// A run that was stopped, or continued further than planned, has the list of the unbroken one.
#[test]
fn the_list_of_a_resumed_run_is_that_of_the_unbroken_one() {
    let unbroken = Case::from_scene(&scene(0.1)).solved(&[]);
    for steps in ["20", "25"] {
        let case = unbroken.twin().solved(&["--steps", steps]).solved(&["--resume"]);
        assert_eq!(case.solve(&["--verify"]), 0);
        // The snapshot of the stop is kept, without a line.
        let _ = fs::remove_file(case.outbox().join("snapshot-000025.npz"));
        assert_same_results(&unbroken, &case);
    }
    // A run that is resumed with other files says so.
    let case = unbroken.twin().solved(&["--steps", "20"]);
    let bulk = case.datbox("BULK_BEHAV.DAT");
    fs::write(&bulk, fs::read_to_string(&bulk).unwrap() + "! edited\n").unwrap();
    let (code, said) = solve_process(case.path(), &["--resume"]);
    let warning = "changed or removed since this run began: ../DATBOX/BULK_BEHAV.DAT; the run continues with the present \
                   files; --force starts anew";
    assert!(code == 0 && said.contains(warning), "{said}");
}

#[test]
fn a_snapshot_that_lacks_what_its_laws_need_is_not_resumed() {
    let law =
        "IQS_DS_ROLL_CLB(dynamic_friction: 0.3, static_friction: 0.4, rolling_friction: 0.1, spinning_friction: 0.05)";
    let bonded = scene(0.1).replace("IQS_CLB(friction: 0.5)", law);
    let case = Case::from_scene(&bonded).solved(&["--steps", "10"]);
    let path = case.outbox().join("snapshot-000010.npz");
    let sound = fs::read(&path).unwrap();
    let reject = |edit: &dyn Fn(&mut cd_formats::snapshot::Snapshot), expected: &str| {
        let mut snapshot = case.last_snapshot();
        edit(&mut snapshot);
        fs::write(&path, snapshot.to_bytes()).unwrap();
        let (code, said) = solve_process(case.path(), &["--resume"]);
        assert!(code == 2 && said.contains(expected), "{expected}: {code} {said}");
        fs::write(&path, &sound).unwrap();
    };
    let advice = "move the file away to resume from the snapshot before, or start from DATBOX with --force";
    let lacks =
        |names: &str, reason: &str| format!("arrays {names}: are missing; expected them, because {reason}; {advice}");
    reject(&|s| s.memory = None, &lacks("contact_bonded to contact_moment", "a law has bonds or moments"));
    reject(&|s| s.interval = None, &lacks("interval_body, interval_virial", "meta has interval_start"));
    // Twice dt is a step of adaptive runs only.
    for h in [0.0, -1.0, 1e300, 2.6e-3, 3.1e-3, 4e-3] {
        reject(&|s| s.meta.h = h, "meta, h: ");
    }
    for time in [-1.0, 1e300, 0.021, 0.02 + 1e-9] {
        reject(&|s| s.meta.time = time, "meta, time: ");
    }
    let long_step = |s: &mut cd_formats::snapshot::Snapshot| {
        s.meta.options.remove("dt");
        s.meta.h = 0.021;
    };
    reject(&long_step, "meta, h: 0.021; expected at most the 0.02 s since the start");
    reject(&|s| s.meta.ledger.steps_unconverged = 11, "steps_unconverged: 11; expected at most the 10 steps so far");
    reject(&|s| s.bodies.body_x[0][0] = 1e308, "expected numbers below 1e40");
    let no_choice = AccuracyControl::default();
    reject(&|s| s.meta.accuracy_control = Some(no_choice), "meta, accuracy_control, tol: ");
    let control = AccuracyControl { tol: 0.5, penetration: 0.5, gravity_error: 0.5, ..no_choice };
    let too_large = AccuracyControl { tol: 1.0, ..control };
    reject(
        &|s| s.meta.accuracy_control = Some(too_large),
        "meta, accuracy_control, tol: 1; expected more than 0 and less",
    );
    // Without the list of checksums an edited snapshot is as good as any.
    let list = case.outbox().join("SHA256SUMS");
    fs::remove_file(&list).unwrap();
    let mut snapshot = case.last_snapshot();
    snapshot.meta.accuracy_control = Some(control);
    fs::write(&path, snapshot.to_bytes()).unwrap();
    assert_eq!(case.solve(&["--resume"]), 0);
    fs::remove_file(&list).unwrap();
    fs::write(&path, &sound).unwrap();
    assert_eq!(case.solve(&["--resume"]), 0);
}

/// Snapshots that `--resume` would reject are not called sound by `--verify` and `--skip-damaged`.
#[test]
fn snapshots_that_no_run_can_continue_are_skipped() {
    let case = Case::from_scene(&scene(0.2)).solved(&[]);
    let unbroken = case.twin().solved(&[]);
    type Edit = fn(&mut cd_formats::snapshot::Snapshot);
    let edits: [(Edit, &str); 4] = [
        (|s| s.contacts.contact_status[0] = 77, "a contact with a status other than 0, 1 and 2"),
        (|s| s.contacts.contact_impulse[0][1] = 1e300, "array contact_impulse, row 1: "),
        (|s| s.interval = None, "arrays interval_body, interval_virial: are missing"),
        (|s| s.bodies.body_mass[1] = 1.0, "body 2: mass 1 kg"),
    ];
    for (edit, expected) in edits {
        let mut snapshot = case.last_snapshot();
        edit(&mut snapshot);
        let path = case.outbox().join("snapshot-000040.npz");
        fs::write(&path, snapshot.to_bytes()).unwrap();
        fs::remove_file(case.outbox().join("SHA256SUMS")).unwrap();
        let (code, said) = solve_process(case.path(), &["--resume"]);
        assert!(code == 2 && said.contains(expected), "{expected}: {said}");
        let (code, said) = verification(&case);
        assert!(code == 1 && said.contains(expected), "{expected}: {said}");
        assert!(said.contains("snapshots: 4 of 5 sound\n--resume --skip-damaged continues from step 30"), "{said}");
        assert_eq!(case.solve(&["--resume", "--skip-damaged"]), 0, "{expected}");
        fs::remove_file(path.with_extension("npz.damaged")).unwrap();
        for name in ["snapshot-000040.npz", "steps.csv"] {
            assert!(
                fs::read(unbroken.outbox().join(name)).unwrap() == fs::read(case.outbox().join(name)).unwrap(),
                "{name}"
            );
        }
    }
}

#[test]
fn a_start_that_is_not_of_the_text_files_is_rejected() {
    let cubes = scene(0.1).replace("sizes: Single(0.1)", "shape: Box(lengths: (0.2, 0.2, 0.2))");
    let from = Case::from_scene(&cubes).solved(&["--steps", "10"]);
    let case = Case::empty();
    assert_eq!(from_outbox(from.path(), case.path(), "(bodies: [()])"), 0);
    fs::remove_file(case.datbox("SHA256SUMS")).unwrap();
    let path = case.datbox("START.npz");
    let sound = cd_formats::snapshot::Snapshot::read(&path).unwrap();
    let reject = |edit: &dyn Fn(&mut cd_formats::snapshot::BodyArrays), expected: &str| {
        let mut snapshot = sound.clone();
        edit(&mut snapshot.bodies);
        fs::write(&path, snapshot.to_bytes()).unwrap();
        let (code, said) = solve_process(case.path(), &["--steps", "1"]);
        assert!(code == 2 && said.contains(expected), "{expected}: {code} {said}");
        assert_eq!(said.lines().count(), 1, "{said}");
    };
    let (c, s) = (1.0, 0.5e-3);
    let tilted = |[w, x, y, z]: [f64; 4]| [w * c - x * s, x * c + w * s, y * c + z * s, z * c - y * s];
    reject(&|b| b.body_id[1] = 9, "body 9: is not in DATBOX; expected 1 to 4");
    reject(&|b| b.body_id[1] = 1, "body 1: occurs twice; expected once");
    reject(&|b| b.body_x[1][0] += 1e-3, "body 2: at [");
    // A body in another position is reported once.
    reject(
        &|b| {
            (b.body_x[1][0], b.body_v[1][0]) = (b.body_x[1][0] + 1e-3, 1.0);
            b.body_q[1] = tilted(b.body_q[1]);
        },
        "body 2: at [",
    );
    reject(&|b| b.body_v[1][0] += 1e-3, "body 2: velocity [");
    reject(&|b| b.body_w_world[1][0] += 1e-3, "body 2: angular velocity [");
    reject(&|b| b.body_q[1] = tilted(b.body_q[1]), "body 2: turned by 1.0e-3 rad; expected axes a, b, g as in DOF.INI");
    fs::write(&path, sound.to_bytes()).unwrap();
    assert_eq!(case.solve(&["--steps", "1"]), 0);
}

#[test]
fn two_files_of_one_step_are_rejected() {
    let case = Case::from_scene(&scene(0.1)).solved(&[]);
    let snapshot = case.outbox().join("snapshot-000040.npz");
    for twin in ["snapshot-0000040.npz", "snapshot-+40.npz"] {
        let twin = case.outbox().join(twin);
        fs::copy(&snapshot, &twin).unwrap();
        let (code, said) = solve_process(case.path(), &["--resume", "--steps", "50"]);
        assert!(code == 2 && said.contains("are both of step 40; expected one"), "{said}");
        assert_eq!(cd_tests::case::post(case.path(), &[]), 2);
        fs::remove_file(twin).unwrap();
    }
}

#[cfg(unix)]
#[test]
fn no_link_in_a_case_is_followed_for_writing() {
    let case = Case::from_scene(&scene(0.1));
    let precious = case.path().join("precious");
    let link = |path: &Path| {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        let _ = fs::remove_file(path);
        std::os::unix::fs::symlink(&precious, path).unwrap();
    };
    fs::write(&precious, "precious").unwrap();
    let names = ["snapshot-000000.npz", "snapshot-000020.npz", "steps.csv", "SHA256SUMS"];
    for name in names {
        link(&case.outbox().join(format!(".{name}.part")));
    }
    for name in
        ["DATBOX/.BODIES.DAT.part", "DATBOX/BODIES.DAT", "DATBOX/.unfinished", "TIMER.csv", "POSTPRO/series.csv"]
    {
        link(&case.path().join(name));
    }
    assert_eq!(pre(&case.path().join("scene.ron"), case.path()), 0);
    assert_eq!(case.solve(&[]), 0);
    assert!(!case.series().is_empty());
    assert_eq!(fs::read_to_string(&precious).unwrap(), "precious");
    assert!(files(&case.outbox()).iter().all(|name| !case.outbox().join(name).is_symlink()));
}

/// Each folder of a case may be a link to another, in which the files are then written.
#[cfg(unix)]
#[test]
fn folders_of_a_case_may_be_links() {
    let case = Case::from_scene(&scene(0.1));
    let folders =
        [("DATBOX", "BODIES.DAT"), ("OUTBOX", "steps.csv"), ("POSTPRO", "series.csv"), ("DISPLAY", "view.py")];
    let elsewhere = tempfile::tempdir().unwrap();
    for (folder, _) in folders {
        let (target, link) = (elsewhere.path().join(folder), case.path().join(folder));
        fs::create_dir(&target).unwrap();
        let _ = fs::remove_dir_all(&link);
        std::os::unix::fs::symlink(&target, &link).unwrap();
    }
    assert_eq!(pre(&case.path().join("scene.ron"), case.path()), 0);
    assert_eq!(case.solve(&[]), 0);
    assert_eq!(cd_tests::case::post(case.path(), &[]), 0);
    for (folder, file) in folders {
        assert!(case.path().join(folder).is_symlink(), "{folder}");
        assert!(elsewhere.path().join(folder).join(file).is_file(), "{folder}/{file}");
    }
}

/// Results that do not fit on the disk: cd-pre and cd-post end with 2.
#[cfg(unix)]
#[test]
fn results_that_cannot_be_written_are_an_error_of_their_own_code() {
    let case = Case::from_scene(&scene(0.1)).solved(&["--steps", "20"]);
    let scene = case.path().join("scene.ron");
    let [case, scene] = [case.path(), scene.as_path()].map(|path| path.to_str().unwrap().to_string());
    for words in [&["cd-pre", &scene, "-o", &format!("{case}/new")][..], &["cd-post", &case]] {
        let command = Executables::of_test().command(words);
        let mut limited = std::process::Command::new("sh");
        // The shell limits the size of files to 512 bytes and becomes the program.
        limited.args(["-c", "ulimit -f 1; exec \"$0\" \"$@\""]).arg(command.get_program()).args(command.get_args());
        limited.envs(command.get_envs().filter_map(|(name, value)| Some((name, value?))));
        let output = limited.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap().wait_with_output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{words:?}: {said}");
        assert!(said.contains("cannot be written"), "{words:?}: {said}");
    }
}

#[cfg(unix)]
#[test]
fn text_that_cannot_be_printed_is_an_error() {
    let case = Case::from_scene(&scene(0.1));
    for words in [
        &["cd-solve", case.path().to_str().unwrap()][..],
        &["cd-post", case.path().to_str().unwrap()],
        &["cd-pre", case.path().join("scene.ron").to_str().unwrap()],
        &["cd-pre", "--help"],
        &["cd-solve", "--version"],
    ] {
        let output = program(words, Some(Path::new("/dev/full")));
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{words:?} {said}");
        let message = format!("{}: standard output: file: cannot be written: the disk is full", words[0]);
        assert!(said.contains(&message), "{words:?} {said}");
    }
    assert_eq!(case.solve(&["--verify"]), 0, "the files are whole");
}

#[cfg(unix)]
#[test]
fn pipes_and_devices_are_no_input() {
    let case = Case::from_scene(&scene(0.1));
    assert_eq!(pre(Path::new("/dev/zero"), case.path()), 2);
    for (name, device) in [("BODIES.DAT", "/dev/zero"), ("DOF.INI", "/dev/null"), ("SHA256SUMS", "/dev/zero")] {
        let other = case.twin();
        fs::remove_file(other.datbox(name)).unwrap();
        std::os::unix::fs::symlink(device, other.datbox(name)).unwrap();
        let (code, said) = solve_process(other.path(), &[]);
        assert!(code == 2 && said.contains("is a pipe, a socket or a device"), "{name}: {said}");
    }
}

/// Exit code of a program that is ended after a minute, and then `None`.
#[cfg(unix)]
fn code_within_a_minute(words: &[&str]) -> Option<i32> {
    let mut process =
        Executables::of_test().command(words).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    for _ in 0..6000 {
        if let Some(status) = process.try_wait().unwrap() {
            return status.code();
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    process.kill().unwrap();
    process.wait().unwrap();
    None
}

/// A pipe into which nobody writes, in place of a file or a folder that a program compares or locks.
#[cfg(unix)]
#[test]
fn no_program_waits_for_a_pipe() {
    let make_pipe = |path: &Path| {
        let _ = fs::remove_file(path);
        assert!(std::process::Command::new("mkfifo").arg(path).status().unwrap().success());
    };
    let case = Case::from_scene(&scene(0.1));
    let at = |name: &str| case.path().join(name);
    let path = case.path().to_str().unwrap();
    make_pipe(&at("OUTBOX"));
    assert_eq!(code_within_a_minute(&["cd-solve", path]), Some(2), "OUTBOX");
    fs::remove_file(at("OUTBOX")).unwrap();
    make_pipe(&at("scene.ron"));
    for flags in [&[][..], &["--plan"], &["--verify"]] {
        let words = [&["cd-solve", path], flags].concat();
        assert_eq!(code_within_a_minute(&words), Some(0), "{words:?}");
    }

    fs::remove_file(at("scene.ron")).unwrap();
    fs::write(at("base.ron"), scene(0.1)).unwrap();
    let parameter = r#"(name: "dt", paths: ["compute.dt"], values: [1e-3, 2e-3])"#;
    let study = format!("(groups: [(name: \"dt-{{dt}}\", base: \"base.ron\", parameters: [{parameter}])])");
    fs::write(at("study.ron"), study).unwrap();
    let [study, base, output] = ["study.ron", "base.ron", "study"].map(|name| at(name).to_str().unwrap().to_string());
    let study = ["cd-pre", "study", &study, "-o", &output];
    assert_eq!(code_within_a_minute(&study), Some(0));
    make_pipe(&at("study/study.csv"));
    assert_eq!(code_within_a_minute(&study), Some(0), "study.csv is replaced");
    make_pipe(&at("study/dt-1e-3/scene.ron"));
    assert_eq!(code_within_a_minute(&study), Some(2), "a scene that no study wrote");
    make_pipe(&at("study.ron"));
    let accuracy_study = ["cd-pre", "accuracy-study", &base, "-o", path];
    assert_eq!(code_within_a_minute(&accuracy_study), Some(2), "a study that no program wrote");
}

/// Three million grains take more than 400 MB.
#[cfg(target_os = "linux")]
#[test]
fn exhausted_memory_has_its_exit_code_and_leaves_no_files() {
    let folder = tempfile::tempdir().unwrap();
    let placement = "placement: JitteredLattice(envelope: Box(lengths: (780.0, 780.0, 1800.0)))";
    let text = scene(0.1).replace("number: 3,", "number: 3000000,");
    let (start, end) = (text.find("placement:").unwrap(), text.find("]),\n    )],").unwrap());
    let path = folder.path().join("scene.ron");
    fs::write(&path, format!("{}{placement}{}", &text[..start], &text[end + 2..])).unwrap();
    let command = Executables::of_test().command(&["cd-pre", path.to_str().unwrap()]);
    let mut limited = std::process::Command::new("sh");
    limited.args(["-c", "ulimit -v 400000; exec \"$0\" \"$@\""]).arg(command.get_program()).args(command.get_args());
    limited.envs(command.get_envs().filter_map(|(name, value)| Some((name, value?))));
    let output = limited.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(exit_code(output.status), 134, "{said}");
    let datbox = files(&folder.path().join("DATBOX"));
    assert!(datbox.iter().all(|name| name.ends_with("lock")), "{datbox:?}");
}

#[test]
fn numbers_beyond_any_scene_are_rejected_before_the_run() {
    let case = Case::from_scene(&scene(0.1));
    for (flag, word) in [("--dt=1e300", "dt"), ("--alert=1e41", "alert"), ("--end-time=1e40", "end_time")] {
        let (code, said) = solve_process(case.path(), &[flag]);
        assert!(code == 2 && said.contains(&format!("{word}: 1e")) && said.contains("less than 1e40"), "{code} {said}");
    }
    // A fall of 40 steps of 9e39 s under 9.81 m/s^2, of 1e81 m, can be computed, but not one under 9e39 m/s^2.
    let gravity = "[(time: 0, action: SetGravity((0, 0, -9e39)))]";
    let (code, said) = solve_process(case.path(), &["--dt=9e39", "--events", gravity, "--self-gravity=true"]);
    assert!(code == 2 && said.contains("dt: 9e39 s lets bodies travel by up to 1.17e123 m until the end"), "{said}");
    let (code, said) = solve_process(case.path(), &["--dt=9e39", "--self-gravity=true", "--plan"]);
    assert_eq!(code, 0, "{said}");
    let dof = case.datbox("DOF.INI");
    let text = fs::read_to_string(&dof).unwrap();
    fs::write(&dof, text.replacen("V(3)= 0.0000000D+00", "V(3)= 1.800000D+308", 1)).unwrap();
    let (code, said) = solve_process(case.path(), &[]);
    assert!(code == 2 && said.contains("too large a number, 1e100 or more"), "{said}");
    fs::write(&dof, text.replacen("V(3)= 0.0000000D+00", "V(3)= 1.1000000D+40", 1)).unwrap();
    let (code, said) = solve_process(case.path(), &[]);
    assert!(code == 2 && said.contains("too large a number, more than 1e40"), "{said}");
}

/// The largest accepted numbers, one at a time: products of several of them are finite.
#[test]
fn the_largest_numbers_leave_sound_results() {
    let case = Case::from_scene(&scene(0.1));
    let sound = |case: &Case, flags: &[&str], largest: &str| {
        let text = case.path().join("said");
        let _ = fs::remove_file(&text);
        let words = [&["cd-solve", case.path().to_str().unwrap(), "--force", "--steps", "5"], flags].concat();
        let output = program(&words, Some(&text));
        let said = fs::read_to_string(text).unwrap();
        assert_eq!(output.status.code(), Some(0), "{largest}: {}", String::from_utf8_lossy(&output.stderr));
        let words = || said.split(|letter: char| !letter.is_alphanumeric());
        assert!(words().all(|word| !["NaN", "inf"].contains(&word)), "{largest}: {said}");
    };
    for flags in [&["--dt=9e39"][..], &["--dt=9e39", "--quench=0.5"], &["--dt=9e39", "--self-gravity"]] {
        sound(&case, flags, &flags.join(" "));
    }
    for (name, from, to) in [
        ("DOF.INI", "V(3)= 0.0000000D+00", "V(3)= 9.0000000D+39"),
        ("BULK_BEHAV.DAT", "-9.8100000E+00", "-9.0000000E+39"),
        ("DRV_DOF.DAT", " 0.0000000E+00", " 9.0000000E+39"),
    ] {
        let other = case.twin();
        let text = fs::read_to_string(other.datbox(name)).unwrap();
        assert!(text.contains(from), "{name}: {text}");
        fs::write(other.datbox(name), text.replacen(from, to, 1)).unwrap();
        fs::remove_file(other.datbox("SHA256SUMS")).unwrap();
        sound(&other, &[], name);
        sound(&other, &["--self-gravity"], name);
    }
}

#[test]
fn a_report_of_many_faults_is_short() {
    let case = Case::empty();
    let twin = Case::from_scene(&scene(0.1));
    copy(&twin.path().join("DATBOX"), &case.path().join("DATBOX"));
    let mut text = String::new();
    for k in 0..50_000 {
        text += &format!("$bdyty\n RBDY3  {k:>5}\n{}\n$$$$$$\n", ["x", "yy z", "&"][k % 3].repeat(k % 40 + 1));
    }
    fs::write(case.datbox("BODIES.DAT"), text).unwrap();
    let (code, said) = solve_process(case.path(), &[]);
    assert!(code == 2 && said.lines().count() <= 110 && said.len() < 200_000, "{} lines", said.lines().count());
}

/// The folder of results goes while the run writes to it.
#[cfg(unix)]
#[test]
fn results_that_are_moved_away_end_the_run() {
    for is_removed in [false, true] {
        let case =
            Case::from_scene(&scene(0.1).replace("steps: 40, output_every: 10", "steps: 4000000, output_every: 1000"));
        let [outbox, other] = [case.outbox(), case.path().join("elsewhere")];
        let path = case.path().to_str().unwrap().to_string();
        let run = std::thread::spawn(move || program(&["cd-solve", &path], None));
        while !outbox.join("snapshot-001000.npz").exists() {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        fs::rename(&outbox, &other).unwrap();
        if is_removed {
            fs::remove_dir_all(&other).unwrap();
        }
        let output = run.join().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(4), "{said}");
        assert!(said.contains("OUTBOX: folder: was removed, renamed or replaced while the run was writing"), "{said}");
    }
}

#[test]
fn a_run_without_syncing_writes_the_same_files() {
    let [synced, other] = [&[][..], &["--no-sync"]].map(|flags| {
        let case = Case::from_scene(&scene(0.1));
        assert_eq!(case.solve(flags), 0);
        case
    });
    assert_same_results(&synced, &other);
}
