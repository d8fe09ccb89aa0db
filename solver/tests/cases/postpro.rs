//! POSTPRO.DAT: rows of figures every few steps.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crate::case::{Case, solve};

/// Files of POSTPRO by name.
fn files(case: &Path) -> BTreeMap<String, String> {
    let entries = fs::read_dir(case.join("POSTPRO")).unwrap().map(|entry| entry.unwrap().path());
    entries
        .map(|path| (path.file_name().unwrap().to_str().unwrap().to_string(), fs::read_to_string(path).unwrap()))
        .collect()
}

/// Numbers of a row.
fn row(line: &str) -> Vec<f64> {
    line.split_whitespace().map(|field| field.parse().unwrap()).collect()
}

#[track_caller]
fn close(found: &[f64], expected: &[f64], bound: f64) {
    assert_eq!(found.len(), expected.len());
    let near = found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= bound);
    assert!(near, "{found:?}, expected {expected:?}");
}

/// A ball of 4/3 π kg that falls next to one that rests on the floor.
fn falling_and_resting() -> Case {
    let mut case = Case::new();
    case.gravity = [0.0, 0.0, -8.0];
    case.law_of_all("IQS_CLB", &[0.5]);
    case.sphere(1.0, [0.0, 0.0, 100.0]);
    case.sphere(1.0, [8.0, 0.0, 1.0]);
    case.floor();
    (case.options.dt, case.options.output_every, case.options.steps) = (0.25, 2, Some(6));
    case.write();
    case
}

fn request(case: &Case, commands: &str) {
    fs::write(case.path().join("DATBOX/POSTPRO.DAT"), commands).unwrap();
}

#[test]
fn figures_of_a_fall_and_of_rest() {
    let case = falling_and_resting();
    request(
        &case,
        "BODY TRACKING\nSTEP 2\n      1\n      1\nTORQUE EVOLUTION\nSTEP 1\n      1\n      2\nKINETIC ENERGY\nSTEP 1\n\
         DISSIPATED ENERGY\nSTEP 1\nVIOLATION EVOLUTION\nSTEP 1\nCOORDINATION NUMBER\nSTEP 1\nSOLVER INFORMATIONS\nSTEP 3\n\
         NEW RIGID SETS\nSTEP 6\n      1\n      2\n      1\n      2\nEND\n",
    );
    assert_eq!(case.solve(&[]), 0);
    let files = files(&case.path());
    let last = |name: &str| row(files[name].lines().last().unwrap());
    let rows = |name: &str| files[name].lines().count();
    let mass = 4.0 / 3.0 * std::f64::consts::PI;
    // After 1.5 s: v = -g t, x = -g t²/2.
    close(&last("BODY_0000001.DAT"), &[1.5, 0.0, 0.0, 91.0, 0.0, 0.0, -9.0, 0.0, 0.0, -12.0, 0.0, 0.0, 0.0], 1e-6);
    assert_eq!([rows("BODY_0000001.DAT"), rows("REAC_0000002.DAT"), rows("SOLVER_INFORMATIONS.DAT")], [3, 6, 2]);
    let weight = 8.0 * mass;
    close(&last("REAC_0000002.DAT"), &[1.5, 0.0, 0.0, weight, 0.0, 0.0, 0.0], 1e-5);
    close(&last("Fext_0000002.DAT"), &[1.5, 0.0, 0.0, -weight, 0.0, 0.0, 0.0], 1e-5);
    close(&last("Fine_0000002.DAT"), &[1.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 1e-5);
    // The work at end velocities: Σ m g² h² k over six steps is h g more than the kinetic energy.
    let kinetic = 0.5 * mass * 144.0;
    let work = mass * 64.0 * 0.0625 * 21.0;
    close(&last("KINETIC_ENERGY.DAT"), &[1.5, kinetic, kinetic, -work, -weight * 9.0, 0.0], 1e-4);
    close(&last("DISSIPATED_ENERGY.DAT"), &[1.5, 0.0, 0.0], 1e-9);
    close(&last("VIOLATION_EVOLUTION.DAT"), &[1.5, 0.0, 0.0, 0.0, 0.0], 1e-12);
    // One contact for two grains, one of them with force.
    close(&last("COORDINATION_NUMBER.DAT"), &[1.5, 0.5, 1.0, 0.0, 1.0], 1e-6);
    close(&last("EVOL_RIGID_SET_0000001.DAT")[..7], &[1.5, 4.0, 0.0, 46.0, 0.0, 0.0, -4.5], 1e-6);
    close(&last("REAC_RIGID_SET_0000001.DAT"), &[1.5, 0.0, 0.0, weight, 0.0, 0.0, 0.0], 1e-5);
    assert_eq!(files.len(), 13);
    assert_eq!(last("SOLVER_INFORMATIONS.DAT")[5], 1.0);
}

#[test]
fn rows_go_on_after_a_resume() {
    let all = "BODY TRACKING\nSTEP 1\n      1\n      1\nKINETIC ENERGY\nSTEP 1\nDISSIPATED ENERGY\nSTEP 3\n\
               SOLVER INFORMATIONS\nSTEP 1\nVIOLATION EVOLUTION\nSTEP 2\nEND\n";
    let run = |parts: &[&[&str]]| {
        let case = falling_and_resting();
        request(&case, all);
        parts.iter().for_each(|flags| assert_eq!(case.solve(flags), 0));
        files(&case.path())
    };
    let unbroken = run(&[&[]]);
    assert_eq!(unbroken, run(&[&["--steps", "3"], &["--resume", "--steps", "4"], &["--resume"]]));
    assert_eq!(unbroken, run(&[&["--resume"], &["--resume"]]));
    // Rows after the last snapshot are written again, and a torn one is dropped.
    let case = falling_and_resting();
    request(&case, all);
    assert_eq!(case.solve(&[]), 0);
    fs::remove_file(case.path().join("OUTBOX/snapshot-000006.npz")).unwrap();
    let torn = case.path().join("POSTPRO/KINETIC_ENERGY.DAT");
    let text = fs::read_to_string(&torn).unwrap();
    fs::write(&torn, &text[..text.len() - 5]).unwrap();
    assert_eq!(case.solve(&["--resume"]), 0);
    assert_eq!(unbroken, files(&case.path()));
}

#[test]
fn results_of_another_program_are_kept() {
    let case = falling_and_resting();
    request(&case, "KINETIC ENERGY\nSTEP 1\nEND\n");
    fs::create_dir(case.path().join("POSTPRO")).unwrap();
    fs::write(case.path().join("POSTPRO/KINETIC_ENERGY.DAT"), "theirs\n").unwrap();
    assert_eq!(case.solve(&[]), 2);
    assert_eq!(files(&case.path())["KINETIC_ENERGY.DAT"], "theirs\n");
    assert_eq!(case.solve(&["--force"]), 0);
    assert_eq!(files(&case.path())["KINETIC_ENERGY.DAT"].lines().count(), 6);
    request(&case, "KINETIC ENERGIE\nSTEP 1\nEND\n");
    assert_eq!(case.solve(&["--force"]), 2);
}

/// Last rows of LMGC90 2025.rc1 after 30 steps of 1e-3 s (theta 0.5, norm Quad at 1e-8, post-processing after the update of
/// the step) of a ball rolling on a plate and of a box sliding on it. Its kinetic energy has the moments of inertia at
/// density 1, ours those of the body, and its `Fine` is 0 after the update: neither is compared.
#[test]
fn columns_of_lmgc90() {
    let expected: [(&str, &[(&str, &str)]); 2] = [
        (
            "roll-postpro",
            &[
                (
                    "BODY_0000002.DAT",
                    " 3.00000000E-02  1.4295420E-02  8.0604971E-03  1.0000000E-01  1.4295420E-02  8.0604971E-03 -5.0000000E-04  4.4702790E-01  2.2936657E-01  0.0000000E+00 -6.9536255E-01  3.4102037E+00  2.9197670E+00",
                ),
                (
                    "COORDINATION_NUMBER.DAT",
                    " 3.00000000E-02  1.0000000E+00  1.0000000E+00  0.0000000E+00  1.0000000E+00",
                ),
                ("DISSIPATED_ENERGY.DAT", " 3.00000000E-02  1.4831417E-01  2.4176565E-03"),
                (
                    "EVOL_RIGID_SET_0000002.DAT",
                    " 3.00000000E-02  7.1477102E-03  4.0302486E-03  6.9388939E-18  7.1477102E-03  4.0302486E-03 -2.5000000E-04  2.2351395E-01  1.1468329E-01  0.0000000E+00 -3.4768128E-01  1.7051018E+00  1.4598835E+00",
                ),
                (
                    "Fext_0000001.DAT",
                    " 3.00000000E-02  0.0000000E+00  0.0000000E+00 -1.9620000E+05 -0.0000000E+00  0.0000000E+00 -0.0000000E+00",
                ),
                (
                    "Fext_0000002.DAT",
                    " 3.00000000E-02  0.0000000E+00  0.0000000E+00 -4.1092033E+01 -0.0000000E+00  0.0000000E+00  0.0000000E+00",
                ),
                (
                    "REAC_0000001.DAT",
                    " 3.00000000E-02  7.3963076E+00  9.8622817E+00 -4.1092033E+01 -1.3127378E+00  1.3178740E+00  8.0011422E-02",
                ),
                (
                    "REAC_RIGID_SET_0000001.DAT",
                    " 3.00000000E-02 -7.3963076E+00 -9.8622817E+00  4.1092033E+01 -9.1432791E-01  8.2314814E-01 -7.8302422E-02",
                ),
                (
                    "VIOLATION_EVOLUTION.DAT",
                    " 3.00000000E-02  0.0000000E+00  0.0000000E+00 -0.0000000E+00 -0.0000000E+00",
                ),
            ],
        ),
        (
            "box-postpro",
            &[
                (
                    "BODY_0000002.DAT",
                    " 3.00000000E-02  1.4880877E-02  8.9512479E-03  3.0101646E-01  1.4880877E-02  8.9512479E-03 -3.9835449E-03  4.5402527E-01  2.8197925E-01 -1.2909809E-01 -6.6129954E-01  2.2777638E-02  1.3452148E+00",
                ),
                (
                    "COORDINATION_NUMBER.DAT",
                    " 3.00000000E-02  1.0000000E+00  1.0000000E+00  0.0000000E+00  1.0000000E+00",
                ),
                ("DISSIPATED_ENERGY.DAT", " 3.00000000E-02  3.2506433E+00  5.2521716E-02"),
                (
                    "Fext_0000002.DAT",
                    " 3.00000000E-02  0.0000000E+00  0.0000000E+00 -4.7088000E+02  2.6003598E-02  1.1119164E+00 -7.2833019E-03",
                ),
                (
                    "REAC_0000002.DAT",
                    " 3.00000000E-02 -6.5739912E+01 -2.1260568E+01  2.3030771E+02 -5.0985554E+01 -2.7921960E+00 -1.5133721E+01",
                ),
            ],
        ),
    ];
    for (scene, rows) in expected {
        let theirs = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/lmgc90").join(scene).join("DATBOX");
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("DATBOX")).unwrap();
        for file in fs::read_dir(theirs).unwrap().map(|entry| entry.unwrap().path()) {
            fs::copy(&file, folder.path().join("DATBOX").join(file.file_name().unwrap())).unwrap();
        }
        assert_eq!(solve(folder.path().into(), &["--dt", "1e-3", "--steps", "30", "--tol", "1e-10"]), 0);
        let files = files(folder.path());
        for (name, theirs) in rows {
            let ours = files[*name].lines().last().unwrap();
            assert_eq!(ours.len(), theirs.len(), "{scene} {name}");
            let largest = row(theirs)[1..].iter().fold(0.0f64, |most, x| most.max(x.abs()));
            let differ = row(ours).iter().zip(row(theirs)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            // LMGC90 turns axes to first order, 6e-5 of a ball's after 30 steps; the box rocks, so that its forces of an
            // impact differ by 3e-3.
            assert!(differ <= 4e-3 * largest + 1e-9, "{scene} {name}: {ours}, expected {theirs}");
        }
    }
}
