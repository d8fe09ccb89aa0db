//! OUTBOX in text, `--text`: a DATBOX of this program and of LMGC90.

use std::fs;
use std::path::{Path, PathBuf};

use cd_formats::bodies::{Bodies, ShapeRecord};
use cd_formats::dof::Dof;
use cd_formats::drv_dof::Evolution;

use crate::case::{Case, Figures, Vec3, near, solve};

const INPUTS: [&str; 4] = ["BODIES", "BULK_BEHAV", "TACT_BEHAV", "DRV_DOF"];

/// Case whose DATBOX is the OUTBOX of another, with the state of an output.
fn continued(outbox: &Path, number: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let datbox = folder.path().join("DATBOX");
    fs::create_dir(&datbox).unwrap();
    for name in INPUTS {
        fs::copy(outbox.join(format!("{name}.OUT")), datbox.join(format!("{name}.DAT"))).unwrap();
    }
    if outbox.join("COMPUTE.RON").exists() {
        fs::copy(outbox.join("COMPUTE.RON"), datbox.join("COMPUTE.RON")).unwrap();
    }
    for name in ["DOF", "Vloc_Rloc"] {
        fs::copy(outbox.join(format!("{name}.{number}")), datbox.join(format!("{name}.INI"))).unwrap();
    }
    folder
}

/// Largest differences of positions (m), velocities (m/s), spins (rad/s) and axes of the bodies of two files.
fn differences(a: &Path, b: &Path) -> [f64; 4] {
    let (a, b) = (Dof::read(a).unwrap(), Dof::read(b).unwrap());
    assert_eq!(a.step, b.step);
    let mut most = [0.0f64; 4];
    for (a, b) in a.bodies.iter().zip(&b.bodies) {
        let differ = |p: &[f64], q: &[f64]| p.iter().zip(q).map(|(p, q)| (p - q).abs()).fold(0.0, f64::max);
        let of_axes = a.axes.iter().zip(&b.axes).map(|(p, q)| differ(p, q)).fold(0.0, f64::max);
        let found = [
            differ(&a.displacement[..3], &b.displacement[..3]),
            differ(&a.velocity[..3], &b.velocity[..3]),
            differ(&a.velocity[3..], &b.velocity[3..]),
            of_axes,
        ];
        most.iter_mut().zip(found).for_each(|(most, found)| *most = most.max(found));
    }
    most
}

#[track_caller]
fn expect_within(found: [f64; 4], bounds: [f64; 4]) {
    assert!(found.iter().zip(&bounds).all(|(found, bound)| found <= bound), "{found:?} of {bounds:?}");
}

/// Ball and box on a floor, rolling, sliding and turning; the box by vertices about another origin than its centre, without
/// inertia.
fn ball_and_box() -> Case {
    let mut case = Case::new();
    case.gravity = [0.0, 0.0, -9.81];
    case.law_of_all("IQS_CLB", &[0.3]);
    case.floor();
    let ball = case.sphere(0.1, [1.0, 0.0, 0.1]);
    case.launch(ball, [0.5, 0.3, 0.0], [1.0, 2.0, 3.0]);
    let corner = |k: u32| {
        [0.1, 0.2, 0.3].map(f64::from).map(|half| half).into_iter().enumerate().map(move |(i, half)| {
            let side = if k >> i & 1 == 1 { half } else { -half };
            side + [0.5, 0.25, 0.3][i]
        })
    };
    let vertices: Vec<[f64; 3]> = (0..8).map(|k| corner(k).collect::<Vec<_>>().try_into().unwrap()).collect();
    let body = case.polyhedron(&vertices, &crate::case::BOX, [0.0; 3]);
    // Its axes are those of the file.
    case.launch(body, [0.5, 0.3, 0.0], [0.2, 0.1, 2.0]);
    (case.options.dt, case.options.steps, case.options.output_every) = (1e-3, Some(60), 10);
    (case.options.tol, case.options.text) = (Some(1e-10), true);
    case
}

#[test]
fn an_outbox_is_a_datbox() {
    let case = ball_and_box();
    case.write();
    assert_eq!(case.solve(&[]), 0);
    let outbox = case.path().join("OUTBOX");
    let mut names: Vec<String> = fs::read_dir(&outbox)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| !name.starts_with("snapshot") && name != "steps.csv" && name != "SHA256SUMS")
        .collect();
    names.sort();
    let numbered =
        |kind: &str| (1..=6).map(|k| format!("{kind}.OUT.{k}")).chain([format!("{kind}.LAST")]).collect::<Vec<_>>();
    let mut expected =
        [numbered("DOF"), numbered("Vloc_Rloc"), INPUTS.map(|name| format!("{name}.OUT")).to_vec()].concat();
    expected.push("COMPUTE.RON".into());
    expected.sort();
    assert_eq!(names, expected);
    for kind in ["DOF", "Vloc_Rloc"] {
        let read = |name: String| fs::read(outbox.join(name)).unwrap();
        assert_eq!(read(format!("{kind}.OUT.6")), read(format!("{kind}.LAST")));
    }
    // The frame of the ball turns.
    let dof = Dof::read(&outbox.join("DOF.OUT.6")).unwrap();
    assert!(dof.bodies[1].axes[0][0] < 0.99, "{:?}", dof.bodies[1]);

    // Bodies are centred, in the axes of DOF.OUT, with inertia.
    let bodies = Bodies::read(&outbox.join("BODIES.OUT")).unwrap();
    assert_eq!(bodies.0[2].position, [0.5, 0.25, 0.3]);
    let ShapeRecord::Polyhedron { vertices, .. } = &bodies.0[2].contactors[0].shape else { panic!() };
    assert!((Vec3::from(vertices[0]) - Vec3::new(-0.1, -0.2, -0.3)).norm() < 1e-12);

    // From output 3 the second half differs by the digits of the files, 7 of velocities and displacements.
    let half = continued(&outbox, "OUT.3");
    // COMPUTE.RON has dt, the tolerance, the outputs and the friction of faces.
    assert_eq!(solve(half.path().into(), &["--steps=30"]), 0);
    for (k, number) in [(1, 4), (3, 6)] {
        // Numbers begin with 1 again.
        let [ours, whole] = [half.path().join("OUTBOX"), outbox.clone()];
        let found = differences(&ours.join(format!("DOF.OUT.{k}")), &whole.join(format!("DOF.OUT.{number}")));
        expect_within(found, [1e-7, 1e-6, 3e-6, 1e-7]);
    }
    assert!(!half.path().join("OUTBOX/DOF.OUT.4").exists());
}

/// A ball on a plate that turns under it, or a box that tumbles on a floor, and far from both a sphere that falls freely.
fn turning_and_falling(tumbles: bool) -> (Case, usize) {
    let mut case = Case::new();
    case.gravity = [0.0, 0.0, -9.81];
    case.law_of_all("IQS_CLB", &[0.3]);
    let far = case.sphere(0.1, [0.0, 5.0, 3.0]);
    if tumbles {
        case.floor();
        // On a vertex, which lies √3/10 below the centre.
        let axes = [[2.0, 1.0, -2.0], [1.0, 2.0, 2.0], [2.0, -2.0, 1.0]].map(|axis: [f64; 3]| axis.map(|c| c / 3.0));
        let body = case.block([0.1; 3], [0.0, 0.0, 0.5 / 3.0], axes);
        case.launch(body, [0.3, 0.2, 0.0], [3.0, -2.0, 1.0]);
    } else {
        let plate = case.plate([2.0, 2.0, 0.1], [0.0, 0.0, -0.1], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        case.drive_along(plate, 4, Evolution::constant(-0.3));
        case.sphere(0.1, [0.3, 0.0, 0.1]);
    }
    (case.options.dt, case.options.text, case.options.output_every) = (1e-3, true, 1);
    (case, far)
}

/// At a restart from each of the first outputs the velocities are those that a step has bounded: no body notices it.
#[test]
fn a_restart_from_text_takes_no_implicit_step() {
    for tumbles in [false, true] {
        let (mut case, far) = turning_and_falling(tumbles);
        case.run(40);
        let outbox = case.path().join("OUTBOX");
        for k in [3, 7, 12, 20, 33, 38] {
            let half = continued(&outbox, &format!("OUT.{k}"));
            assert_eq!(solve(half.path().into(), &["--steps=1"]), 0);
            let [ours, whole] = [half.path().join("OUTBOX/DOF.OUT.1"), outbox.join(format!("DOF.OUT.{}", k + 1))];
            let height = |path: &Path| Dof::read(path).unwrap().bodies[far].displacement[2];
            // With θ = 1 the sphere falls by g h²/2 = 4.9e-6 m more; displacements below 0.01 m have nine digits.
            let difference = height(&ours) - height(&whole);
            assert!(difference.abs() < 1e-8, "tumbles: {tumbles}, {k}: {difference}");
        }
    }
}

/// Velocities that an edited DOF.INI gives differ from those of the contacts in Vloc_Rloc.INI: no step has bounded them.
#[test]
fn edited_velocities_are_unbounded() {
    let (mut case, far) = turning_and_falling(false);
    case.run(10);
    let half = continued(&case.path().join("OUTBOX"), "OUT.10");
    let path = half.path().join("DATBOX/DOF.INI");
    let mut dof = Dof::read(&path).unwrap();
    let ball = dof.bodies.len() - 1;
    dof.bodies[ball].velocity[2] -= 0.01;
    fs::write(&path, dof.to_text()).unwrap();
    assert_eq!(solve(half.path().into(), &["--steps=1"]), 0);
    let end = Dof::read(&half.path().join("OUTBOX/DOF.OUT.1")).unwrap();
    let fallen = end.bodies[far].displacement[2] - dof.bodies[far].displacement[2];
    // x⁺ = x + h V⁺; eight digits.
    assert!((fallen - 1e-3 * end.bodies[far].velocity[2]).abs() < 1e-8, "{fallen}");
}

#[test]
fn tables_of_imposed_motion_are_copied() {
    let mut case = Case::new();
    case.sphere(0.5, [0.0, 0.0, 3.0]);
    let wall = case.floor();
    let table = Evolution::Table { name: "up.dat".into(), points: vec![[0.0, 0.0], [1.0, 0.5]] };
    case.driven.retain(|driven| driven.component != 2);
    case.drive_along(wall, 2, table);
    (case.options.steps, case.options.text) = (Some(2), true);
    case.write();
    assert_eq!(case.solve(&[]), 0);
    let outbox = case.path().join("OUTBOX");
    assert_eq!(fs::read_to_string(outbox.join("up.dat")).unwrap().lines().count(), 2);
    // A run from the start without text removes all of it.
    assert_eq!(case.solve(&["--force", "--text=false"]), 0);
    let left: Vec<PathBuf> = fs::read_dir(&outbox).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert_eq!(left.len(), 4, "{left:?}"); // two snapshots, steps.csv and SHA256SUMS
}

/// LMGC90 2025.rc1 (theta 0.5, step 1e-3 s, norm Quad at 1e-8) made 60 steps of a ball rolling on a plate, and of a wedge
/// without inertia line falling on it. DATBOX is its OUTBOX with the state of step 30. From the same files LMGC90 itself
/// comes to within 1e-8 m of its unbroken run.
#[test]
fn lmgc90s_outbox_continues_here() {
    for scene in ["roll-restart", "wedge-restart"] {
        let theirs = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/lmgc90").join(scene);
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("DATBOX")).unwrap();
        for file in fs::read_dir(theirs.join("DATBOX")).unwrap().map(|entry| entry.unwrap().path()) {
            fs::copy(&file, folder.path().join("DATBOX").join(file.file_name().unwrap())).unwrap();
        }
        let flags = ["--dt", "1e-3", "--steps", "30", "--output-every", "1", "--tol", "1e-10", "--text"];
        assert_eq!(solve(folder.path().into(), &flags), 0);
        let outbox = folder.path().join("OUTBOX");
        let differences = |k: u32| {
            differences(&outbox.join(format!("DOF.OUT.{k}")), &theirs.join(format!("OUTBOX/DOF.OUT.{}", k + 30)))
        };
        // In a step LMGC90 turns axes to first order, by (ω h)³ less than the rotation: 2.4e-6 for the ball at 5 rad/s.
        expect_within(differences(1), [1e-7, 1e-5, 2e-5, 3e-6]);
        expect_within(differences(30), [1e-7, 1e-5, 3e-4, 1e-4]);
    }
}

/// A box that falls on a face with an attraction and two coefficients of friction: whether a contact slides in the first step
/// after a restart follows from the state, as in an unbroken run.
#[test]
fn static_friction_is_kept_through_text() {
    for step in [5, 14, 16, 30] {
        let mut case = Case::new();
        case.law_of_all("IQS_WET_DS_CLB", &[20.0, 0.0, 0.008, 0.3, 0.4]);
        case.gravity = [0.0, 0.0, -9.81];
        (case.options.dt, case.options.tol, case.options.text) = (1e-3, Some(1e-5), true);
        case.floor();
        let axes = [
            [0.98178381, 0.18854635, 0.023469779],
            [-0.18787492, 0.98178988, -0.02813606],
            [-0.028347344, 0.023214145, 0.99932854],
        ];
        let block = case.block([0.1, 0.12, 0.1], [0.0, 0.0, 0.1075], axes);
        case.launch(block, [0.2, 0.1, -0.5], [1.0, 1.0, 0.3]);
        let unbroken = case.run(step + 3);
        case.run(step);
        let restarted = case.run_from_text(&case.first_text_states(), 3);
        // Digits of the files; dynamic friction in the first step would change it by 2e-3 m/s.
        near(restarted.v(block), unbroken.v(block), 1e-5);
    }
}
