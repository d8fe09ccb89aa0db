//! The three programs one after the other: what they owe each other and the user.

use std::fs;
use std::process::{Command, Stdio};
use std::time::Duration;

use cd_formats::compute::{Compute, EventAction};
use cd_formats::dof::Dof;
use cd_formats::snapshot::list_snapshots;
use cd_formats::vloc_rloc::VlocRloc;
use cd_tests::case::{Case, assert_same_results, cloud, files, post, pre, surfaces_of_an_l};
use cd_tests::columns::vtp;
use cd_tests::process::{Executables, run_requested_program};

/// Forty rocks in the thick of their collisions at the end; snapshots 0, 50, ... 300.
fn collapse() -> Case {
    Case::from_scene(&cloud(40, 0.4, 1, "dt: 8.0, steps: 300, output_every: 50, text: true"))
}

/// Rocks that stick, an event before and one after the middle, a driven plate: all that a restart must carry.
const BUSY: &str = r#"(
    seed: 5,
    gravity: (0.0, 0.0, -2.0e-5),
    materials: [(name: "ROCKx", density: 2700.0)],
    laws: [
        (name: "wet00", kind: IQS_WET_DS_CLB(cohesion: 100.0, range: 0.2, dynamic_friction: 0.3, static_friction: 0.4)),
        (name: "rstc0", kind: RST_CLB(normal_restitution: 0.3, tangential_restitution: 0.0, friction: 0.3)),
    ],
    contacts: [(between: ("BLUEx", "BLUEx"), law: "wet00"), (between: ("BLUEx", "FLOOR"), law: "rstc0")],
    grains: [(
        material: "ROCKx",
        colour: "BLUEx",
        number: 30,
        solid_fraction: 0.3,
        sizes: PowerLaw(min: 8.0, max: 14.0, exponent: 2.5),
        placement: RandomSequential(envelope: Ball()),
        spin: (0.0, 1.0e-4, 0.0),
        orbit: None,
        thermal_velocity: 0.01,
    )],
    walls: [Plate(
        material: "ROCKx",
        colour: "FLOOR",
        centre: (0.0, 0.0, -70.0),
        half_lengths: (100.0, 100.0, 2.0),
        velocity: (Constant(0.0), Constant(0.0), Harmonic(amplitude: 0.02, omega: 0.01)),
    )],
    compute: (
        dt: 4.0,
        steps: 240,
        self_gravity: true,
        output_every: 40,
        quench: 0.001,
        events: [
            (time: 300.0, action: AddSpin((0.0, 0.0, 1.0e-4))),
            (time: 320.0, action: SetQuench(0.0)),
            (time: 700.0, action: SetGravity((1.0e-5, 0.0, 0.0))),
        ],
    ),
)"#;

#[test]
fn threads_never_change_a_byte() {
    let one = collapse().solved(&["--threads", "1"]);
    let two = one.twin().solved(&["--threads", "2"]);
    assert_same_results(&one, &two);
    let three = one.twin().solved(&["--threads=3"]);
    assert_same_results(&one, &three);
    assert!(one.last_snapshot().contacts.contact_impulse.iter().any(|r| r[0] > 0.0), "nothing has met");
}

#[test]
fn a_run_that_stops_and_continues_equals_the_unbroken_one() {
    for case in [collapse(), Case::from_scene(BUSY)] {
        let broken = case.twin();
        let unbroken = case.solved(&[]);
        let last = list_snapshots(&unbroken.outbox()).unwrap().pop().unwrap().0;
        for steps in ["40", "80", "100", "160", "200"] {
            // Only at the moments of snapshots: a run writes its last step too.
            if !unbroken.outbox().join(format!("snapshot-{:06}.npz", steps.parse::<u64>().unwrap())).exists() {
                continue;
            }
            let first = !broken.outbox().exists();
            assert_eq!(broken.solve(&["--steps", steps, if first { "--force" } else { "--resume" }]), 0);
        }
        assert!(broken.last_snapshot().meta.step < last);
        assert_eq!(broken.solve(&["--resume"]), 0);
        assert_same_results(&unbroken, &broken);
    }
}

#[test]
fn a_stop_between_two_snapshots_changes_nothing_that_follows() {
    let case = Case::from_scene(BUSY);
    let broken = case.twin().solved(&["--steps", "123"]);
    let unbroken = case.solved(&[]);
    assert_eq!(broken.solve(&["--resume"]), 0);
    fs::remove_file(broken.outbox().join("snapshot-000123.npz")).unwrap();
    assert_same_results(&unbroken, &broken);
}

/// Not a test of its own: a program as a process that a test can kill, or listen to.
#[test]
fn program_process() {
    run_requested_program();
}

/// Process of cd-solve.
fn process(case: &Case, flag: &str) -> Command {
    Executables::of_test().command(&["cd-solve".as_ref(), case.path().as_os_str(), flag.as_ref()])
}

#[test]
fn a_killed_run_continues_to_the_same_bytes() {
    let case = Case::from_scene(&cloud(40, 0.4, 1, "dt: 8.0, steps: 400, output_every: 7"));
    let killed = case.twin();
    let unbroken = case.solved(&[]);
    let mut process = process(&killed, "--force").stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    // If the process is too fast for this, it ends by itself, and the rest holds all the more.
    while list_snapshots(&killed.outbox()).unwrap().len() < 20 && process.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(1));
    }
    let _ = process.kill();
    process.wait().unwrap();
    assert!(list_snapshots(&killed.outbox()).unwrap().len() >= 20);
    assert_eq!(killed.solve(&["--resume"]), 0);
    // A kill in the middle of writing may leave a part, which nobody reads.
    for name in files(&killed.outbox()).iter().filter(|name| name.ends_with(".part")) {
        fs::remove_file(killed.outbox().join(name)).unwrap();
    }
    assert_same_results(&unbroken, &killed);
}

#[test]
fn a_run_that_was_killed_after_its_last_snapshot_gets_its_last_files() {
    let case = collapse().solved(&["--steps", "100"]);
    let killed = case.twin().solved(&["--steps", "100"]);
    for name in ["DOF.LAST", "Vloc_Rloc.LAST"] {
        fs::rename(killed.outbox().join(name), killed.outbox().join(format!(".{name}.part"))).unwrap();
    }
    assert_eq!(killed.solve(&["--steps", "100", "--resume"]), 0);
    assert_same_results(&case, &killed);
}

#[test]
fn results_are_not_overwritten_unasked() {
    let case = Case::from_scene(&cloud(12, 0.4, 1, "dt: 8.0, steps: 20, output_every: 10")).solved(&[]);
    let before = case.results();
    assert_eq!(case.solve(&[]), 2);
    assert_eq!(case.solve(&["--steps", "40"]), 2);
    assert_eq!(case.solve(&["--resume", "--force"]), 2);
    assert_eq!(case.results(), before);

    // Anew: what the earlier run wrote and this one does not is gone, what is not ours stays.
    fs::write(case.outbox().join("notes.txt"), "mine").unwrap();
    assert_eq!(case.solve(&["--force", "--steps", "5", "--output-every", "5"]), 0);
    let names = files(&case.outbox());
    assert_eq!(names, ["SHA256SUMS", "notes.txt", "snapshot-000000.npz", "snapshot-000005.npz", "steps.csv"]);
    assert_eq!(case.steps()["step"], [1.0, 2.0, 3.0, 4.0, 5.0]);

    // Rejected input leaves the results of before.
    fs::write(case.datbox("TACT_BEHAV.DAT"), "$behav\n").unwrap();
    assert_eq!(case.solve(&["--force"]), 2);
    assert_eq!(files(&case.outbox()), names);
}

#[test]
fn one_run_of_a_case_at_a_time() {
    let case = Case::from_scene(&cloud(12, 0.4, 1, "dt: 8.0, steps: 2"));
    fs::create_dir(case.outbox()).unwrap();
    // As by a run that is at work; its DATBOX is written anew meanwhile.
    let folder = fs::File::open(case.outbox()).unwrap();
    folder.lock().unwrap();
    assert_eq!(pre(&case.path().join("scene.ron"), case.path()), 0);
    assert_eq!(case.solve(&[]), 2);
    assert!(files(&case.outbox()).is_empty());
    assert_eq!(case.solve(&["--plan"]), 0);
    folder.unlock().unwrap();
    assert_eq!(case.solve(&[]), 0);
}

#[test]
fn errors_that_a_killed_run_has_not_written_are_written() {
    let case = Case::from_scene(&cloud(12, 0.4, 1, "dt: 8.0, steps: 20, output_every: 10")).solved(&[]);
    let file = case.path().join("ERRORS.csv");
    let lines = |text: String| {
        text.lines().map(|line| line.split(',').take(3).map(String::from).collect::<Vec<_>>()).collect::<Vec<_>>()
    };
    let before = lines(fs::read_to_string(&file).unwrap());
    fs::remove_file(&file).unwrap();
    assert_eq!(case.solve(&["--resume"]), 0);
    assert_eq!(lines(fs::read_to_string(&file).unwrap()), before);
}

#[test]
fn text_files_are_numbered_on() {
    let scene = "dt: 8.0, steps: 8, output_every: 1, text: true";
    let case = Case::from_scene(&cloud(12, 0.4, 1, scene)).solved(&["--steps", "4"]);
    assert_eq!(case.solve(&["--resume", "--steps", "8", "--output-every", "2"]), 0);
    let step = |k: u64| Dof::read(&case.outbox().join(format!("DOF.OUT.{k}"))).unwrap().step;
    assert_eq!((1..=6).map(step).collect::<Vec<_>>(), [1, 2, 3, 4, 6, 8]);
    assert!(case.outbox().join("Vloc_Rloc.OUT.6").exists() && !case.outbox().join("DOF.OUT.7").exists());
    // A stop between two outputs does not count.
    let case = case.twin().solved(&["--steps", "3", "--output-every", "2"]);
    assert_eq!(case.solve(&["--resume", "--output-every", "2"]), 0);
    let step = |k: u64| Dof::read(&case.outbox().join(format!("DOF.OUT.{k}"))).unwrap().step;
    assert_eq!((1..=4).map(step).collect::<Vec<_>>(), [2, 4, 6, 8]);
}

#[test]
fn an_event_that_has_happened_does_not_come_again_in_shorter_steps() {
    // Due in the step from 16 s on, which is a little early.
    let event = "events: [(time: 16.004, action: AddVelocity((1.0, 0.0, 0.0)))]";
    let case = Case::from_scene(&cloud(12, 0.4, 1, &format!("dt: 8.0, {event}"))).solved(&["--steps", "3"]);
    assert_eq!(case.solve(&["--resume", "--dt", "0.1", "--steps", "10"]), 0);
    let bodies = case.last_snapshot().bodies;
    let along: f64 = bodies.body_v.iter().zip(&bodies.body_mass).map(|(v, m)| v[0] * m).sum();
    let mass: f64 = bodies.body_mass.iter().sum();
    assert!((along / mass - 1.0).abs() < 1e-12, "{}", along / mass); // rounding of ten steps
}

#[test]
fn a_run_that_began_before_its_datbox_does_not_go_on() {
    let case = Case::from_scene(&cloud(12, 0.4, 1, "dt: 8.0, steps: 20, output_every: 10")).solved(&[]);
    for name in ["DOF.INI", "Vloc_Rloc.INI"] {
        let text = fs::read_to_string(case.datbox(name)).unwrap();
        let begin = text.lines().find(|line| line.starts_with("$steps")).unwrap();
        let later = begin.replacen(" 0 ", " 5 ", 1).replace("0.0000000D+00", "0.4000000D+02");
        assert_ne!(begin, later);
        fs::write(case.datbox(name), text.replace(begin, &later)).unwrap();
    }
    let before = case.results();
    assert_eq!(case.solve(&["--resume", "--steps", "40"]), 2);
    assert_eq!(case.results(), before);
}

#[test]
fn a_plan_reports_and_writes_nothing() {
    let case = collapse();
    let before = files(case.path());
    let plan = process(&case, "--plan").output().unwrap();
    assert!(plan.status.success());
    let text = String::from_utf8(plan.stdout).unwrap();
    for words in [
        "40 spheres",
        "inactive",
        "polyhedra",
        "kB for each further contact",
        "ms per step",
        "300 steps",
        "shortest orbital period",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
    assert_eq!(files(case.path()), before);
}

#[test]
fn deep_overlaps_at_the_start_are_reported() {
    let case = Case::from_scene(&cloud(2, 0.4, 1, "dt: 1.0, steps: 2, output_every: 1")).solved(&[]);
    let message = |case: &Case| {
        let output = process(case, "--force").output().unwrap();
        String::from_utf8([output.stdout, output.stderr].concat()).unwrap()
    };
    assert!(!message(&case).contains("overlap"));
    // The second 1 m next to the first.
    let bodies = case.snapshot(0).bodies;
    let mut dof = Dof::read(&case.datbox("DOF.INI")).unwrap();
    for (k, beside) in [1.0, 0.0, 0.0].into_iter().enumerate() {
        dof.bodies[1].displacement[k] += bodies.body_x[0][k] + beside - bodies.body_x[1][k];
    }
    fs::write(case.datbox("DOF.INI"), dof.to_text()).unwrap();
    let text = message(&case);
    let [a, b] = [bodies.body_radius[0], bodies.body_radius[1]];
    let share = format!("{:.1} % of the smaller radius;", 100.0 * (a + b - 1.0) / a.min(b));
    for words in ["1 pair of bodies overlaps", "bodies 1-2", &share] {
        assert!(text.contains(words), "{words}: {text}");
    }
}

#[test]
fn a_flag_wins_over_its_option() {
    let case = Case::from_scene(&cloud(12, 0.4, 1, "dt: 8.0, steps: 20, output_every: 10, tol: 1.0e-4, theta: 0.6"));
    let case = case.solved(&[]);
    let meta = case.last_snapshot().meta;
    assert_eq!((meta.step, meta.h, meta.parameters.tol, meta.parameters.theta), (20, 8.0, 1e-4, 0.6));
    assert!(meta.parameters.self_gravity);
    let flags = [
        "--force",
        "--dt=2",
        "--steps=6",
        "--output-every=2",
        "--tol=1e-6",
        "--theta=1",
        "--max-sweeps=77",
        "--alert=3.5",
        "--self-gravity=false",
        "--gravity-error=1e-5",
        "--quench",
        "--threads=1",
        "--text",
    ];
    assert_eq!(case.solve(&flags), 0);
    let meta = case.last_snapshot().meta;
    assert_eq!((meta.step, meta.time, meta.h), (6, 12.0, 2.0));
    let p = meta.parameters;
    assert_eq!((p.tol, p.theta, p.max_sweeps, p.alert), (1e-6, 1.0, 77, Some(3.5)));
    assert_eq!((p.self_gravity, p.gravity_error, p.quench), (false, 1e-5, 0.01));
    assert_eq!(list_snapshots(&case.outbox()).unwrap().iter().map(|(step, _)| *step).collect::<Vec<_>>(), [0, 2, 4, 6]);
    assert!(case.outbox().join("DOF.OUT.3").exists() && case.outbox().join("Vloc_Rloc.OUT.3").exists());
}

#[test]
fn a_datbox_without_options_runs_from_flags_and_defaults() {
    let case = Case::from_scene(&cloud(12, 0.4, 1, "dt: 8.0"));
    let with_options = case.twin();
    for name in ["COMPUTE.RON", "SHA256SUMS"] {
        fs::remove_file(case.datbox(name)).unwrap();
    }
    let case = case.solved(&["--dt=8", "--steps=20", "--output-every=10", "--self-gravity"]);
    // Tolerance and checks are those of LMGC90's examples, the others the defaults.
    let default = Compute::default();
    let p = case.last_snapshot().meta.parameters;
    assert_eq!((p.theta, p.tol, p.max_sweeps), (default.theta, 1e-3, 40_000));
    assert_eq!(p.check_every, Some(50));
    let with_options = with_options.solved(&[
        "--steps=20",
        "--output-every=10",
        "--tol=1e-3",
        "--check-every=50",
        "--max-sweeps=40000",
    ]);
    // Their lists of checksums have those of DATBOX, too.
    for case in [&with_options, &case] {
        fs::remove_file(case.outbox().join("SHA256SUMS")).unwrap();
    }
    assert_same_results(&with_options, &case);
}

#[test]
fn what_cannot_be_read_is_rejected() {
    let empty = Case::empty();
    assert_eq!(empty.solve(&[]), 2);
    assert_eq!(post(empty.path(), &[]), 2);
    for name in ["BODIES.DAT", "BULK_BEHAV.DAT", "TACT_BEHAV.DAT", "COMPUTE.RON", "DOF.INI"] {
        let case = Case::from_scene(&cloud(12, 0.4, 1, "dt: 8.0, steps: 5"));
        fs::write(case.datbox(name), "$behav\n nothing of the kind\n").unwrap();
        assert_eq!(case.solve(&[]), 2, "{name}");
        assert!(!case.outbox().exists(), "{name}");
    }
    let case = Case::from_scene(&cloud(12, 0.4, 1, "dt: 8.0, steps: 5")).solved(&[]);
    let (_, last) = list_snapshots(&case.outbox()).unwrap().pop().unwrap();
    let bytes = fs::read(&last).unwrap();
    fs::write(&last, &bytes[..bytes.len() / 2]).unwrap();
    assert_eq!(case.solve(&["--resume", "--steps", "10"]), 2);
    assert_eq!(post(case.path(), &[]), 2);
}

/// Rounding of 0.1000000, where it is largest; a bit more for the way there.
const SEVEN_DIGITS: f64 = 5.001e-7;

/// The files of `--text` say what the snapshots say, to the digits they have, and a new run can start from them.
#[test]
fn text_files_are_a_start_for_a_nearby_run() {
    let case = collapse().solved(&[]);
    let step = 200;
    let snapshot = case.snapshot(step);
    let (dof_file, vloc_file) = (case.outbox().join("DOF.OUT.4"), case.outbox().join("Vloc_Rloc.OUT.4"));
    let (dof, vloc) = (Dof::read(&dof_file).unwrap(), VlocRloc::read(&vloc_file).unwrap());
    assert_eq!((dof.step, vloc.step), (step, step));
    assert!((dof.time - snapshot.meta.time).abs() <= SEVEN_DIGITS * snapshot.meta.time);
    for (body, v) in dof.bodies.iter().zip(&snapshot.bodies.body_v) {
        let digits = body.velocity.iter().zip(v).all(|(text, v)| (text - v).abs() <= SEVEN_DIGITS * v.abs());
        assert!(digits, "velocity of body {}: {:?}, expected {v:?}", body.body + 1, body.velocity);
    }
    let force = |pair: [usize; 2]| {
        let rows = &snapshot.contacts.contact_body;
        let row = rows.iter().position(|row| row.map(|b| b as usize) == pair).expect("the same contacts");
        snapshot.contacts.contact_force[row][0]
    };
    assert_eq!(vloc.contacts.len(), snapshot.contacts.contact_body.len());
    assert!(vloc.contacts.iter().any(|contact| contact.force[0] > 0.0));
    for contact in &vloc.contacts {
        let expected = force([contact.candidate.body, contact.antagonist.body]);
        assert!((contact.force[0] - expected).abs() <= SEVEN_DIGITS * expected.abs());
    }

    let nearby = case.twin();
    fs::copy(&dof_file, nearby.datbox("DOF.INI")).unwrap();
    fs::copy(&vloc_file, nearby.datbox("Vloc_Rloc.INI")).unwrap();
    let nearby = nearby.solved(&["--steps", "210", "--output-every", "10"]);
    let whole = case.twin().solved(&["--steps", "210", "--output-every", "10"]);
    let (a, b) = (whole.snapshot(210), nearby.snapshot(210));
    assert!((a.meta.time - b.meta.time).abs() < 1e-3);
    // Ten steps of 8 s later: seven digits of displacements of some 10 m and of velocities of some 0.01 m/s, and contacts
    // solved to 1e-3; grains have 10 m.
    let distance = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
    let farthest = a.bodies.body_x.iter().zip(&b.bodies.body_x).map(|(a, b)| distance(a, b)).fold(0.0, f64::max);
    assert!(farthest < 1e-3 && farthest > 0.0, "{farthest} m apart");
}

#[test]
fn events_happen_once_and_at_their_time() {
    let case = Case::from_scene(BUSY).solved(&[]);
    // Those of 300 s and 700 s before the snapshots of 320 s and 800 s, that of 320 s in the step which begins there.
    let done = |step| case.snapshot(step).meta.parameters.events_done;
    assert_eq!([0, 40, 80, 120, 160, 200, 240].map(done), [0, 0, 1, 2, 2, 3, 3]);
    let parameters = |step| case.snapshot(step).meta.parameters;
    assert_eq!((parameters(40).quench, parameters(240).quench), (0.001, 0.0));
    assert_eq!(parameters(160).uniform_gravity, [0.0, 0.0, -2e-5]);
    assert_eq!(parameters(240).uniform_gravity, [1e-5, 0.0, 0.0]);
    let compute = Compute::read(&case.datbox("COMPUTE.RON")).unwrap();
    assert_eq!(compute.events[0].action, EventAction::AddSpin([0.0, 0.0, 1e-4]));
}

/// Files of cd-post for ParaView, read back without VTK; `vtk_readback.py` does it with VTK.
#[test]
fn paraview_files_hold_the_snapshots() {
    let case = Case::from_scene(BUSY).solved(&[]);
    assert_eq!(post(case.path(), &["--every", "3"]), 0);
    let display = case.path().join("DISPLAY");
    let pvd = fs::read_to_string(display.join("grains.pvd")).unwrap();
    for step in [0, 120, 240] {
        let snapshot = case.snapshot(step);
        let (bodies, contacts) = (&snapshot.bodies, &snapshot.contacts);
        assert!(pvd.contains(&format!("timestep=\"{:?}\"", snapshot.meta.time)));
        assert!(pvd.contains(&format!("file=\"grains-{step:06}.vtp\"")));
        let grains = vtp(&display.join(format!("grains-{step:06}.vtp"))).unwrap();
        let count = bodies.body_id.len() - 1; // the last is the plate
        assert_eq!(grains["points"], bodies.body_x[..count].concat());
        assert_eq!(grains["velocity"], bodies.body_v[..count].concat());
        assert_eq!(grains["spin"], bodies.body_w_world[..count].concat());
        assert_eq!(grains["radius"], bodies.body_radius[..count]);
        assert_eq!(grains["stress"].len(), 9 * count);
        let lines = vtp(&display.join(format!("contacts-{step:06}.vtp"))).unwrap();
        assert_eq!(lines["lines"].len(), 2 * contacts.contact_gap.len());
        assert_eq!(lines["gap"], contacts.contact_gap);
        assert_eq!(lines["normal_force"], contacts.contact_force.iter().map(|f| f[0]).collect::<Vec<_>>());
        assert_eq!(vtp(&display.join(format!("walls-{step:06}.vtp"))).unwrap()["polys"].len(), 24);
    }
    let plots = files(&case.path().join("POSTPRO"));
    for name in ["series.csv", "aggregate.svg", "energy.svg", "pressure.svg", "coordination.svg"] {
        assert!(plots.iter().any(|plot| plot == name), "{name} in {plots:?}");
    }
    let picture = fs::read_to_string(case.path().join("POSTPRO/aggregate.svg")).unwrap();
    assert!(picture.contains("<svg") && picture.trim_end().ends_with("</svg>"));
}

#[test]
fn a_cluster_has_mass_and_inertia_of_its_surface() {
    let scene = r#"(
        materials: [(name: "ROCKx", density: 1000.0)],
        laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.5))],
        contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0")],
        grains: [(
            material: "ROCKx",
            colour: "BLUEx",
            shape: Model(file: "l.obj", contact_shape: Files(["leg.obj", "foot.obj"])),
            placement: List(positions: [(0.0, 0.0, 0.0)]),
        )],
        compute: (dt: 0.01, steps: 1),
    )"#;
    let bodies = Case::with_surfaces(scene, surfaces_of_an_l().path()).solved(&[]).last_snapshot().bodies;
    // 3 m^3, where the pieces have 4. The L is three cubes of 1 m, two of them next to one at its corner: about y
    // 3 (1/6) + 2 (1/9 + 4/9) + (1/9 + 1/9) m^5. Twelve digits of the file.
    assert!((bodies.body_mass[0] - 3000.0).abs() < 1e-7, "{}", bodies.body_mass[0]);
    assert!((bodies.body_radius[0] - (0.75 * 3.0 / std::f64::consts::PI).cbrt()).abs() < 1e-11);
    let largest = bodies.body_inertia[0].iter().fold(0.0, |most: f64, moment| most.max(*moment));
    assert!((largest - 1000.0 * (0.5 + 10.0 / 9.0 + 2.0 / 9.0)).abs() < 1e-6, "{largest}");
}

/// A plane of one large square and, with a corner in the middle of its side, two small ones: grains slide over the side at
/// 1.5 m/s as over a plate.
#[test]
fn grains_slide_over_junctions_of_a_surface() {
    let folder = Case::empty();
    let surface = "v -2 -2 0\nv 0 -2 0\nv 0 2 0\nv -2 2 0\nv 0 0.1 0\nv 2 -2 0\nv 2 0.1 0\nv 2 2 0\n\
                   f 1 2 3\nf 1 3 4\nf 2 6 7\nf 2 7 5\nf 5 7 8\nf 5 8 3\n";
    fs::write(folder.path().join("floor.obj"), surface).unwrap();
    let grain = |shape: &str, y: f64| {
        format!(
            "(material: \"ROCKx\", colour: \"BLUEx\", shape: {shape}, velocity: (1.5, 0, 0), \
             grain_orientation: Same((axis: (0, 0, 1), angle: 0.3)), placement: List(positions: [(-0.4, {y}, 0.2)]))"
        )
    };
    let cylinder = "Cylinder(half_height: 0.2, radius: 0.2)";
    let scene = format!(
        r#"(
        gravity: (0.0, 0.0, -9.81),
        materials: [(name: "ROCKx", density: 2500.0)],
        laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.0))],
        contacts: [(between: ("BLUEx", "WALLx"), law: "iqsc0"), (between: ("BLUEx", "BLUEx"), law: "iqsc0")],
        grains: [{}, {}],
        walls: [Mesh(material: "ROCKx", colour: "WALLx", file: "floor.obj", side: Front)],
        compute: (dt: 1e-3, steps: 500, output_every: 500),
    )"#,
        grain("Box(lengths: (0.4, 0.4, 0.4))", 0.1),
        grain(cylinder, -0.6)
    );
    let state = Case::with_surfaces(&scene, folder.path()).solved(&["--threads", "1"]).last_snapshot();
    for v in &state.bodies.body_v[..2] {
        // 1e-5 of the speed; the side without the corner takes half of it.
        assert!((v[0] - 1.5).abs() < 1.5e-5 && v[1].hypot(v[2]) < 1.5e-5, "{v:?}");
    }
}

/// Positions of 100 grains of a square of 1 m², in the order in which they enter, one a step.
fn rain(seed: u64, order: &str) -> Vec<[f64; 3]> {
    let scene = format!(
        r#"(
            seed: {seed},
            materials: [(name: "ROCKx", density: 2700.0)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.5))],
            contacts: [(between: ("RAINx", "RAINx"), law: None)],
            grains: [(
                material: "ROCKx",
                colour: "RAINx",
                number: 100,
                sizes: Single(0.01),
                placement: RandomSequential(envelope: Box(lengths: (1.0, 1.0, 0.04))),
            )],
            compute: (
                dt: 1.0,
                steps: 100,
                output_every: 1,
                sources: [(name: "rain", bodies: Colour("RAINx"), rate: 1.0{order})],
            ),
        )"#
    );
    let case = Case::from_scene(&scene).solved(&[]);
    let presence = |step: u64| case.snapshot(step).presence.unwrap().body_presence;
    let position = case.snapshot(0).bodies.body_x;
    let mut entered: Vec<[f64; 3]> = Vec::new();
    for step in 1..=100 {
        let (before, after) = (presence(step - 1), presence(step));
        entered.extend((0..100).filter(|&i| before[i] != after[i]).map(|i| position[i]));
    }
    assert_eq!(entered.len(), 100);
    entered
}

/// Two random points of the unit square are 0.521 m apart in the mean, with a standard deviation of 0.248 m; of 99 pairs,
/// five standard errors, with those of the correlation of pairs that share a point, are less than 0.15 m.
#[test]
fn grains_of_a_source_enter_all_over_their_envelope() {
    let mean_distance = |entered: &[[f64; 3]]| {
        let distance = |pair: &[[f64; 3]]| f64::hypot(pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]);
        entered.windows(2).map(distance).sum::<f64>() / 99.0
    };
    let random = rain(1, "");
    assert!((mean_distance(&random) - 0.521).abs() < 0.15, "{}", mean_distance(&random));
    // By their numbers they come along the Z-curve: a tenth of a metre is the distance of neighbours in a lattice.
    let numbered = rain(1, ", order: Numbers");
    assert!(mean_distance(&numbered) < 0.25, "{}", mean_distance(&numbered));
    // The order is of the seed, and changes neither grains nor numbers.
    assert_eq!(random, rain(1, ", order: Random(1)"));
    assert_ne!(random, rain(1, ", order: Random(2)"));
    let sorted = |mut entered: Vec<[f64; 3]>| {
        entered.sort_by(|a, b| a.partial_cmp(b).unwrap());
        entered
    };
    assert_eq!(sorted(random), sorted(numbered));
}
