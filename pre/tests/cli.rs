//! The program from its command line: what it writes, what it says, what it returns.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use cd_formats::bodies::{Bodies, ShapeRecord};
use cd_formats::bulk_behav::BulkBehav;
use cd_formats::compute::Compute;
use cd_formats::dof::Dof;
use cd_formats::drv_dof::{DrivenKind, DrvDof, Evolution};
use cd_formats::tact_behav::TactBehav;
use cd_formats::vloc_rloc::VlocRloc;
use nalgebra::Vector3;

fn cd_pre(arguments: &[&Path]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_cd-pre")).args(arguments).output().unwrap()
}

fn example(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples").join(name).join("scene.ron")
}

/// DATBOX of an example, in a folder that lives as long as the first value.
fn datbox(name: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let output = cd_pre(&[&example(name), Path::new("-o"), folder.path()]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let datbox = folder.path().join("DATBOX");
    (folder, datbox)
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// All spheres: centre and radius.
fn spheres(bodies: &Bodies) -> Vec<(Vector3<f64>, f64)> {
    let sphere = |body: &cd_formats::bodies::Body| match body.contactors[0].shape {
        ShapeRecord::Sphere { radius } => Some((Vector3::from(body.position), radius)),
        _ => None,
    };
    bodies.0.iter().filter_map(sphere).collect()
}

/// Smallest distance of two surfaces, m, over all pairs.
fn smallest_gap(spheres: &[(Vector3<f64>, f64)]) -> f64 {
    let gaps =
        spheres.iter().enumerate().flat_map(|(k, a)| spheres[..k].iter().map(move |b| (a.0 - b.0).norm() - a.1 - b.1));
    gaps.fold(f64::INFINITY, f64::min)
}

#[test]
fn accretion_is_a_thousand_grains_at_rest() {
    let (_folder, datbox) = datbox("accretion");
    let bodies = Bodies::read(&datbox.join("BODIES.DAT")).unwrap();
    let spheres = spheres(&bodies);
    assert_eq!((bodies.0.len(), spheres.len()), (1000, 1000));
    assert!(spheres.iter().all(|(_, radius)| (8.0..=12.0).contains(radius)));
    assert!(bodies.0.iter().zip(&spheres).all(|(body, (_, radius))| body.equivalent_radius == *radius));
    assert!(smallest_gap(&spheres) >= 0.0);
    let dof = Dof::read(&datbox.join("DOF.INI")).unwrap();
    assert_eq!((dof.step, dof.time, dof.bodies.len()), (0, 0.0, 1000));
    assert!(dof.bodies.iter().all(|body| body.velocity == [0.0; 6] && body.displacement == [0.0; 6]));
    let bulk = BulkBehav::read(&datbox.join("BULK_BEHAV.DAT")).unwrap();
    assert_eq!((bulk.gravity, bulk.materials[0].density), ([0.0; 3], 2700.0));
    let tact = TactBehav::read(&datbox.join("TACT_BEHAV.DAT")).unwrap();
    assert_eq!((tact.laws[0].kind.as_str(), &tact.laws[0].parameters[..]), ("IQS_CLB", &[0.4][..]));
    assert!((tact.visibility[0].alert - 1.0).abs() < 0.05); // a tenth of the mean radius, about 10 m
    assert!(DrvDof::read(&datbox.join("DRV_DOF.DAT")).unwrap().0.is_empty());
    assert!(VlocRloc::read(&datbox.join("Vloc_Rloc.INI")).unwrap().contacts.is_empty());
    let compute = Compute::read(&datbox.join("COMPUTE.RON")).unwrap();
    assert_eq!((compute.dt, compute.end_time, compute.self_gravity), (2.0, Some(9000.0), true));
}

#[test]
fn spheres_box_has_five_plates_that_stand_still() {
    let (_folder, datbox) = datbox("spheres-box");
    let bodies = Bodies::read(&datbox.join("BODIES.DAT")).unwrap();
    assert_eq!((bodies.0.len(), spheres(&bodies).len()), (65, 60));
    assert!(smallest_gap(&spheres(&bodies)) >= 0.0);
    let driven = DrvDof::read(&datbox.join("DRV_DOF.DAT")).unwrap().0;
    let expected: Vec<_> = (60..65).flat_map(|body| (0..6).map(move |component| (body, component))).collect();
    assert_eq!(driven.iter().map(|d| (d.body, d.component)).collect::<Vec<_>>(), expected);
    assert!(driven.iter().all(|d| d.kind == DrivenKind::Velocity && d.evolution == Evolution::constant(0.0)));
    let tact = TactBehav::read(&datbox.join("TACT_BEHAV.DAT")).unwrap();
    let shapes: Vec<_> = tact.visibility.iter().map(|see| see.antagonist.contactor.as_str()).collect();
    assert_eq!(shapes, ["SPHER", "PLANx"]);
    // Mass by equal volume: (8 + 2) x (8 + 2) x 1 m^3 of the floor.
    let floor = &bodies.0[60];
    let volume = 4.0 / 3.0 * std::f64::consts::PI * floor.equivalent_radius.powi(3);
    assert!((volume - 100.0).abs() < 1e-5); // 8 digits
    let axes = Dof::read(&datbox.join("DOF.INI")).unwrap().bodies[60].axes;
    assert_eq!(axes[2], [0.0, 0.0, 1.0]);
}

#[test]
fn two_aggregates_spin_rigidly_and_approach() {
    let (_folder, datbox) = datbox("two-aggregates");
    let spheres = spheres(&Bodies::read(&datbox.join("BODIES.DAT")).unwrap());
    let dof = Dof::read(&datbox.join("DOF.INI")).unwrap();
    assert!(smallest_gap(&spheres) >= 0.0);
    for (group, sign) in [(0..100, 1.0), (100..200, -1.0)] {
        let spin = Vector3::new(0.0, 0.0, sign * 2e-4);
        let mass = |k: usize| spheres[k].1.powi(3);
        let velocity = |k: usize| Vector3::from_fn(|c, _| dof.bodies[k].velocity[c]);
        let total: f64 = group.clone().map(mass).sum();
        let mean: Vector3<f64> = group.clone().map(|k| velocity(k) * mass(k)).sum::<Vector3<f64>>() / total;
        // Seven digits of velocities of about 0.07 m/s.
        assert!((mean - Vector3::new(sign * 0.05, 0.0, 0.0)).norm() < 1e-8);
        let first = group.start;
        for k in group {
            let (dx, dv) = (spheres[k].0 - spheres[first].0, velocity(k) - velocity(first));
            assert!((dv - spin.cross(&dx)).norm() < 3e-8);
            assert_eq!(dof.bodies[k].velocity[3..], [0.0, 0.0, sign * 2e-4]);
        }
    }
}

/// DATBOX of a scene, which without -o lies in the scene's folder.
fn write_case(scene: &str) -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ron");
    std::fs::write(&path, scene).unwrap();
    assert_eq!(cd_pre(&[&path]).status.code(), Some(0));
    let datbox = folder.path().join("DATBOX");
    (folder, datbox)
}

#[test]
fn moving_walls_driven_grains_and_tables() {
    let (_folder, datbox) = write_case(
        r#"(
            materials: [(name: "ROCKx", density: 2700)],
            laws: [(name: "rst", kind: RST_CLB(normal_restitution: 0.5, tangential_restitution: 0, friction: 0.3))],
            contacts: [
                (between: ("BALLx", "BALLx"), law: "rst"),
                (between: ("PLATE", "BALLx"), law: "rst", alert: 0.01),
            ],
            grains: [(
                material: "ROCKx", colour: "BALLx", sizes: Single(0.1),
                placement: List(positions: [(0, 0, 0.1), (0, 0, 0.3)]),
                driven: (Constant(0), Harmonic(amplitude: 2, omega: 3), Table([(0, 1), (1, 2)])),
            ), (material: "ROCKx", colour: "BALLx", sizes: Single(0.1), placement: List(positions: [(0, 0, 9)]))],
            walls: [Plate(
                material: "ROCKx", colour: "PLATE", centre: (0, 0, -0.5), half_lengths: (3, 2, 0.5),
                velocity: (Constant(0.25), Constant(0), Table([(0, 1), (1, 2)])),
                spin: (Constant(0), Constant(0), Constant(1)),
            )],
        )"#,
    );
    let driven = DrvDof::read(&datbox.join("DRV_DOF.DAT")).unwrap().0;
    assert_eq!(driven.len(), 18);
    assert_eq!(driven[1].evolution.value_at(0.0), 2.0);
    assert_eq!((driven[2].evolution.value_at(3.0), driven[14].evolution.value_at(3.0)), (4.0, 4.0)); // beyond the end: linear
    let velocity = |body: usize| Dof::read(&datbox.join("DOF.INI")).unwrap().bodies[body].velocity;
    assert_eq!(velocity(0), [0.0, 2.0, 1.0, 0.0, 0.0, 0.0]);
    assert_eq!(velocity(3), [0.25, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let see = TactBehav::read(&datbox.join("TACT_BEHAV.DAT")).unwrap().visibility;
    assert_eq!(see[1].candidate.contactor, "SPHER"); // against a plane the sphere is the candidate
    assert_eq!((see[1].candidate.colour.as_str(), see[1].alert), ("BALLx", 0.01));
    // A step of 1e-3 s at sqrt(5) m/s is less than a tenth of the radius 0.1 m.
    assert_eq!(see[0].alert, 0.01);
}

/// Scene with a law for balls BALLx and plates PLATE; `bodies`: its grains and walls.
fn scene_of_balls_and_plates(bodies: &str) -> String {
    let head = r#"
            materials: [(name: "ROCKx", density: 2700)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.5))],
            contacts: [(between: ("BALLx", "BALLx"), law: "iqsc0"), (between: ("PLATE", "BALLx"), law: "iqsc0")],
        "#;
    format!("({head}{bodies})")
}

#[test]
fn presses_and_guided_grains_are_driven_in_part() {
    let (_folder, datbox) = write_case(&scene_of_balls_and_plates(
        r#"
            grains: [(
                material: "ROCKx", colour: "BALLx", sizes: Single(0.1), placement: List(positions: [(0, 0, 0.1)]),
                driven: (Constant(2), None, Constant(0)),
            ), (material: "ROCKx", colour: "BALLx", sizes: Single(0.1), placement: List(positions: [(0, 0, 9)]))],
            walls: [Plate(
                material: "ROCKx", colour: "PLATE", centre: (0, 0, 1), half_lengths: (3, 2, 0.5),
                velocity: (Constant(0.25), Constant(0), Constant(0)),
                force: (None, None, Table([(0, -1), (1, -50)])),
            )],
        "#,
    ));
    let driven = DrvDof::read(&datbox.join("DRV_DOF.DAT")).unwrap().0;
    let of = |body: usize, kind: DrivenKind| -> Vec<(usize, f64)> {
        let rows = driven.iter().filter(|row| row.body == body && row.kind == kind);
        rows.map(|row| (row.component, row.evolution.value_at(1.0))).collect()
    };
    assert_eq!(of(0, DrivenKind::Velocity), [(0, 2.0), (2, 0.0), (3, 0.0), (4, 0.0), (5, 0.0)]);
    assert_eq!(of(2, DrivenKind::Velocity), [(0, 0.25), (1, 0.0), (3, 0.0), (4, 0.0), (5, 0.0)]);
    assert_eq!((of(0, DrivenKind::Force), of(2, DrivenKind::Force)), (vec![], vec![(2, -50.0)]));
    let velocity = |body: usize| Dof::read(&datbox.join("DOF.INI")).unwrap().bodies[body].velocity;
    assert_eq!([velocity(0), velocity(2)], [[2.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.25, 0.0, 0.0, 0.0, 0.0, 0.0]]);
}

#[test]
fn any_of_the_six_components_may_be_imposed() {
    let scene = |grains: &str, moment: &str| {
        scene_of_balls_and_plates(&format!(
            r#"
            grains: [(
                material: "ROCKx", colour: "BALLx", sizes: Single(0.1), placement: List(positions: [(0, 0, 0.1)]),
                {grains}
            )],
            walls: [
                Plate(material: "ROCKx", colour: "PLATE", centre: (0, 0, 9), half_lengths: (3, 2, 0.5), {moment}),
                Cylinder(material: "ROCKx", colour: "PLATE", centre: (0, 0, -9), half_height: 1, radius: 1, moment: Constant(3)),
            ],
        "#
        ))
    };
    let lines = |grains: &str, moment: &str, body: usize| {
        let (_folder, datbox) = write_case(&scene(grains, moment));
        let driven = DrvDof::read(&datbox.join("DRV_DOF.DAT")).unwrap().0;
        let of = |kind: DrivenKind| -> Vec<(usize, f64)> {
            let rows = driven.iter().filter(|row| row.body == body && row.kind == kind);
            rows.map(|row| (row.component, row.evolution.value_at(0.0))).collect()
        };
        let velocity = Dof::read(&datbox.join("DOF.INI")).unwrap().bodies[body].velocity;
        (of(DrivenKind::Velocity), of(DrivenKind::Force), velocity)
    };
    // A plane problem, rotation about one axis, and no rotation.
    let plane = "driven: (None, Constant(0), None), driven_spin: (Constant(0), None, Constant(0))";
    assert_eq!(lines(plane, "", 0), (vec![(1, 0.0), (3, 0.0), (5, 0.0)], vec![], [0.0; 6]));
    let spun = "driven_spin: (None, None, Constant(7)), velocity: (1, 2, 3)";
    assert_eq!(lines(spun, "", 0), (vec![(5, 7.0)], vec![], [1.0, 2.0, 3.0, 0.0, 0.0, 7.0]));
    let still = "driven_spin: (Constant(0), Constant(0), Constant(0))";
    assert_eq!(lines(still, "", 0), (vec![(3, 0.0), (4, 0.0), (5, 0.0)], vec![], [0.0; 6]));
    // A hinged plate, and a cylinder with a motor.
    let hinge = "moment: (None, Constant(0), None), spin: (Constant(0), Constant(0), Constant(1))";
    let (velocities, moments, _) = lines(still, hinge, 1);
    assert_eq!((velocities.len(), velocities[4], moments), (5, (5, 1.0), vec![(4, 0.0)]));
    assert_eq!(lines(still, hinge, 2).1, [(5, 3.0)]);
}

#[test]
fn the_seed_decides_every_byte() {
    let scene = std::fs::read_to_string(example("two-aggregates")).unwrap();
    let bytes = |scene: &str| {
        let (_folder, datbox) = write_case(scene);
        ["BODIES.DAT", "DOF.INI", "TACT_BEHAV.DAT"].map(|name| std::fs::read(datbox.join(name)).unwrap())
    };
    let first = bytes(&scene);
    assert!(bytes(&scene) == first);
    assert!(bytes(&scene.replace("seed: 1", "seed: 2")) != first);
}

#[test]
fn says_what_it_made() {
    let folder = tempfile::tempdir().unwrap();
    let output = cd_pre(&[&example("spheres-box"), Path::new("-o"), folder.path()]);
    let said = text(&output.stdout);
    assert!(said.contains("65 bodies, 5 of them walls: 60 spheres, radius 0.8"), "{said}");
    assert!(said.contains(&format!("wrote {}: BODIES.DAT", folder.path().join("DATBOX").display())), "{said}");
    assert_eq!(text(&output.stderr), "");
}

#[test]
fn values_are_set_from_the_command_line() {
    let folder = tempfile::tempdir().unwrap();
    let run = |settings: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cd-pre"));
        command.arg(example("accretion")).arg("-o").arg(folder.path());
        settings.iter().for_each(|setting| _ = command.args(["--set", setting]));
        command.output().unwrap()
    };
    let output = run(&[
        "grains.1.number=50",
        "grains.1.sizes=Single(9.0)",
        "laws.1.kind.friction=0.75",
        "compute.quench=0.01", // left out in the scene
    ]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let datbox = folder.path().join("DATBOX");
    assert!(spheres(&Bodies::read(&datbox.join("BODIES.DAT")).unwrap()).iter().all(|(_, radius)| *radius == 9.0));
    assert_eq!(spheres(&Bodies::read(&datbox.join("BODIES.DAT")).unwrap()).len(), 50);
    assert_eq!(TactBehav::read(&datbox.join("TACT_BEHAV.DAT")).unwrap().laws[0].parameters, [0.75]);
    assert_eq!(Compute::read(&datbox.join("COMPUTE.RON")).unwrap().quench, 0.01);

    // Settings that cannot be read, and values that cannot be; faults of the file keep their line.
    let refused = run(&["grains.1.sizes=Single(9.0)", "grains.1.number=-1"]);
    assert_eq!(refused.status.code(), Some(2));
    let said = text(&refused.stderr);
    assert_eq!(said, "cd-pre: options: --set grains.1.number=-1: -1; expected an integer of 0 or more\n");
    let refused = run(&["grains.1.sizes=Single(9.0)", "grains.1.colours=REDxx"]);
    let said = text(&refused.stderr);
    assert_eq!(said, "cd-pre: options: --set grains.1.colours=REDxx: unknown field 'colours'; did you mean colour?\n");
    let refused = run(&["grains.1.material=NOPE"]);
    let said = text(&refused.stderr);
    assert!(said.starts_with("cd-pre: options: --set grains.1.material=NOPE: "), "{said}");
    let refused = run(&["grains.1.sizes=Single(-9.0)", "compute.dt=0", "materials.1.name=\"OTHER\""]);
    let said = text(&refused.stderr);
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(lines.len(), 3, "{said}");
    assert!(
        lines.iter().any(|line| line.starts_with("cd-pre: options: --set grains.1.sizes=Single(-9.0): ")),
        "{said}"
    );
    assert!(lines.iter().any(|line| line.starts_with("cd-pre: options: --set compute.dt=0: ")), "{said}");
    assert!(
        lines.iter().any(|line| line.contains("scene.ron:9:") && line.contains(": grains 1, material: ")),
        "{said}"
    );
    let refused = run(&["grains.2.number=5", "compute.dt", "seed=1, 2"]);
    assert_eq!(
        text(&refused.stderr),
        "cd-pre: options: --set grains.2.number=5: no 'grains.2' in the file; expected grains.1\n\
         cd-pre: options: --set compute.dt: is no pair; expected PATH=VALUE, such as grains.1.number=2000\n\
         cd-pre: options: --set seed=1, 2: value: ', 2' behind the end; expected nothing more\n"
    );
}

#[test]
fn a_rejected_scene_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.ron");
    let good = std::fs::read_to_string(example("accretion")).unwrap();
    std::fs::write(&scene, good.replace("min: 8.0", "min: 18.0")).unwrap();
    let output = cd_pre(&[&scene]);
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(
        text(&output.stderr),
        format!(
            "cd-pre: {}:13:33: grains 1, sizes, min: 18.0 is larger than max 12.0; expected min <= max (m)\n",
            scene.display()
        )
    );
    assert_eq!(text(&output.stdout), "");
    assert!(!folder.path().join("DATBOX").exists());
}

#[test]
fn missing_scene_and_unwritable_folder_are_rejected() {
    let output = cd_pre(&[Path::new("no-such.ron")]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).starts_with("cd-pre: no-such.ron: file: cannot be read: "));
    let taken = tempfile::NamedTempFile::new().unwrap(); // a file where a folder is wanted
    let output = cd_pre(&[&example("accretion"), Path::new("-o"), taken.path()]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("cannot be written"), "{}", text(&output.stderr));
}

/// No folder of DATBOX is left, and so no part either.
#[cfg(unix)]
#[test]
fn a_file_that_may_not_grow_is_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let limited = ["-c", "ulimit -f 20; exec \"$@\"", "sh", env!("CARGO_BIN_EXE_cd-pre")];
    let output = Command::new("sh").args(limited).arg(example("accretion")).arg("-o").arg(folder.path()).output();
    let output = output.unwrap();
    let datbox = folder.path().join("DATBOX");
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    let start = format!("cd-pre: {}: file: cannot be written: ", datbox.join("BODIES.DAT").display());
    assert!(said.starts_with(&start) && said.lines().count() == 1, "{said}");
    assert!(!datbox.exists());
}

#[test]
fn help_and_version_are_no_fault_but_unknown_flags_are() {
    let code = |argument: &str| cd_pre(&[Path::new(argument)]).status.code();
    assert_eq!((code("--help"), code("--version"), code("--nonsense")), (Some(0), Some(0), Some(2)));
    assert!(text(&cd_pre(&[Path::new("--help")]).stdout).contains("scene.ron"));
    let version = text(&cd_pre(&[Path::new("--version")]).stdout);
    let commit = version.trim_end().strip_prefix(concat!("cd-pre ", env!("CARGO_PKG_VERSION"))).unwrap();
    assert!(commit.is_empty() || commit.starts_with(" (") && commit.ends_with(')'), "{version}");
}

/// An attraction per contact point depends on the corners of faces: the scene is made, with one warning for each law.
#[test]
fn an_attraction_at_every_corner_is_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.ron");
    let printed_warning = |shape: &str, cohesion: &str| {
        let source = format!(
            r#"(materials: [(name: "ROCKx", density: 2700.0)],
            laws: [(name: "wet00", kind: IQS_WET_DS_CLB(cohesion: {cohesion}, range: 0.01, dynamic_friction: 0.3, static_friction: 0.3))],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "wet00"), (between: ("BLUEx", "WALLx"), law: "wet00")],
            grains: [(material: "ROCKx", colour: "BLUEx", shape: {shape}, sizes: Single(0.5), placement: List(positions: [(0, 0, 2), (3, 0, 2)]))],
            walls: [Plate(material: "ROCKx", colour: "WALLx", centre: (0, 0, -0.5), half_lengths: (50, 50, 0.5))],
            compute: (steps: 1))"#
        );
        std::fs::write(&scene, source).unwrap();
        let output = cd_pre(&[&scene]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        text(&output.stderr)
    };
    let warning = printed_warning("Cube", "10.0");
    assert_eq!(warning.lines().count(), 1, "{warning}");
    for part in
        ["cd-pre: warning: ", "scene.ron:2", "IQS_WET_DS_CLB", "BLUEx and BLUEx, BLUEx and WALLx", "IQS_MOHR_DS_CLB"]
    {
        assert!(warning.contains(part), "{part}: {warning}");
    }
    assert_eq!(printed_warning("Sphere", "10.0"), "");
    assert_eq!(printed_warning("Cube", "0.0"), "");
}

/// cd-solve next to cd-pre computes the scene, with the options after `--`; here a script that stops.
#[cfg(unix)]
#[test]
fn pour_runs_the_solver_next_to_cd_pre() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::copy(env!("CARGO_BIN_EXE_cd-pre"), at("cd-pre")).unwrap();
    std::fs::write(at("cd-solve"), "#!/bin/sh\necho \"$@\" > \"$(dirname \"$0\")/ran\"\nexit 4\n").unwrap();
    std::fs::set_permissions(at("cd-solve"), std::fs::Permissions::from_mode(0o755)).unwrap();
    let output = Command::new(at("cd-pre"))
        .args([
            "pour".as_ref(),
            example("accretion").as_path(),
            &at("bed"),
            "--set".as_ref(),
            "grains.1.solid_fraction=0.2".as_ref(),
        ])
        .args(["--", "--threads", "2"])
        .output()
        .unwrap();
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("bed/pour: cd-solve: ended with exit code 4; expected a run to its end"), "{said}");
    let ran = std::fs::read_to_string(at("ran")).unwrap();
    assert_eq!(ran, format!("{} --force --threads 2\n", at("bed/pour").display()));
    assert_eq!(Bodies::read(&at("bed/pour/DATBOX/BODIES.DAT")).unwrap().0.len(), 1000);
    assert!(!at("bed/DATBOX").exists());
}

/// A vertex of two squares inside the side of a third one: the triangle of that side is split, with a warning.
#[test]
fn a_split_of_triangles_is_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let surface = "v -2 -2 0\nv 0 -2 0\nv 0 2 0\nv -2 2 0\nv 0 0 0\nv 2 -2 0\nv 2 0 0\nv 2 2 0\n\
                   f 1 2 3\nf 1 3 4\nf 2 6 7\nf 2 7 5\nf 5 7 8\nf 5 8 3\n";
    std::fs::write(folder.path().join("floor.obj"), surface).unwrap();
    let scene = r#"(
        materials: [(name: "ROCKx", density: 2500.0)],
        laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.0))],
        contacts: [(between: ("BLUEx", "WALLx"), law: "iqsc0"), (between: ("BLUEx", "BLUEx"), law: "iqsc0")],
        grains: [(material: "ROCKx", colour: "BLUEx", sizes: Single(0.1), placement: List(positions: [(0.0, 0.0, 1.0)]))],
        walls: [Mesh(material: "ROCKx", colour: "WALLx", file: "floor.obj")],
        compute: (dt: 1e-3, steps: 1),
    )"#;
    let file = folder.path().join("scene.ron");
    std::fs::write(&file, scene).unwrap();
    let output = cd_pre(&[&file]);
    let warning = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{warning}");
    assert_eq!(warning.lines().count(), 1, "{warning}");
    for part in ["cd-pre: warning: ", "wall 1", "split 1 triangle at vertices on their edges"] {
        assert!(warning.contains(part), "{part}: {warning}");
    }
    let written = std::fs::read_to_string(folder.path().join("DATBOX/MESHx-1.obj")).unwrap();
    assert_eq!(written.lines().filter(|line| line.starts_with("f ")).count(), 7);
}
