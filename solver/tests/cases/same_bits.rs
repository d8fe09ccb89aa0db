//! The same bytes again: any number of threads, and in two runs as in one.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use cd_formats::compute::{ComputeFlags, ContactSolver, Event, EventAction};
use cd_formats::dof::Dof;
use cd_formats::drv_dof::Evolution;
use cd_formats::snapshot::{Snapshot, list_snapshots, part_path, snapshot_path};
use cd_solve::math::simd::SimdWidth;

use crate::case::{Case, Figures, Vec3, equal, near, shaken_lattice, uniform};
use crate::solvers::column_at_rest;

/// Wet spheres of their own gravity in a shaken tub, with events before and after step 30.
pub fn scene(side: i64) -> Case {
    let mut case = Case::new();
    case.law_with("SPHER", "IQS_WET_DS_CLB", &[0.05, 0.0, 0.02, 0.3, 0.5]);
    case.law_with("PLANx", "RST_DS_CLB", &[0.6, 0.2, 0.3, 0.4]);
    case.gravity = [0.1, 0.0, -4.0];
    let mut random = uniform(2);
    let height = 0.56 * side as f64;
    for (radius, [x, y, z]) in shaken_lattice(side, 4) {
        let body = case.sphere(radius, [x, y, z + height]);
        case.launch(body, [0; 3].map(|_| random() - 0.5), [0; 3].map(|_| 5.0 * random()));
    }
    case.pull(7, 0, 0.5);
    case.tub(height);
    let floor = side.pow(3) as usize;
    let shaking =
        Evolution::Harmonic { constant: 0.0, amplitude: 0.5, omega: 9.0, phase: 0.0, ramp_start: 0.1, ramp_rate: 2.0 };
    case.drive_along(floor, 2, shaking);
    let table = Evolution::Table { name: "turn.dat".into(), points: vec![[0.0, 0.0], [0.3, 0.5], [0.5, -0.5]] };
    case.drive_along(floor + 1, 5, table);
    case.options.events.push(Event {
        time: 0.1,
        every: Some(0.15),
        until: Some(0.5),
        action: EventAction::AddSpin([0.0, 0.1, 0.3]),
    });
    case.options.events.push(Event {
        time: 0.12,
        every: Some(0.1),
        until: None,
        action: EventAction::Shake { speed: 0.1, seed: 0 },
    });
    case.event(0.05, EventAction::SetTorque([0.0, 20.0, 0.0]));
    case.event(0.2, EventAction::SetGravity([0.0, 0.2, -8.0]));
    case.event(0.25, EventAction::SetQuench(0.001));
    case.event(0.4, EventAction::SetQuench(0.0));
    let options = &mut case.options;
    (options.self_gravity, options.gravity_constant) = (true, 0.01);
    (options.dt, options.tol, options.max_sweeps) = (0.01, Some(1e-4), Some(500));
    options.penetration_tol = Some(1e-7);
    (options.steps, options.output_every, options.text) = (Some(60), 15, true);
    case
}

/// A slab of bonded spheres that falls on the floor and breaks, with events before and after step 30.
pub fn slab() -> Case {
    let mut case = Case::new();
    case.law_with("SPHER", "IQS_MOHR_DS_CLB", &[300.0, 200.0, 0.3, 0.5]);
    case.law_with("PLANx", "xQS_WET_DS_CLB", &[0.5, 0.0, 0.02, 0.3, 0.5]);
    case.gravity = [0.3, 0.0, -8.0];
    case.floor();
    for (i, j) in (0..5).flat_map(|i| (0..4).map(move |j| (i, j))) {
        let body = case.sphere(0.5, [f64::from(i), f64::from(j), 0.51 + 0.2 * f64::from(i)]);
        case.launch(body, [0.0, 0.0, -2.0], [0.5, 0.1 * f64::from(j), 0.0]);
    }
    case.event(0.1, EventAction::SetFriction("law01".into(), 0.1));
    case.event(0.15, EventAction::Bond);
    case.event(0.35, EventAction::SetCohesion("law00".into(), 250.0));
    let options = &mut case.options;
    (options.dt, options.tol, options.max_sweeps) = (0.01, Some(1e-6), Some(500));
    (options.steps, options.output_every, options.text) = (Some(60), 15, true);
    case
}

/// Name and bytes of all files of OUTBOX but the list of checksums, which has those of DATBOX, too.
pub fn outbox(case: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(case.join("OUTBOX")).unwrap().map(Result::unwrap);
    let file =
        |entry: std::fs::DirEntry| (entry.file_name().into_string().unwrap(), std::fs::read(entry.path()).unwrap());
    entries.map(file).filter(|(name, _)| name != "SHA256SUMS").collect()
}

/// The files of a run after each of the `pieces`, sets of flags.
pub fn files(case: &Case, pieces: &[&[&str]]) -> BTreeMap<String, Vec<u8>> {
    case.write();
    for flags in pieces {
        assert_eq!(case.solve(flags), 0);
    }
    outbox(&case.path())
}

#[track_caller]
pub fn same(a: &BTreeMap<String, Vec<u8>>, b: &BTreeMap<String, Vec<u8>>) {
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>());
    for (name, bytes) in a {
        assert!(bytes == &b[name], "{name} differs");
    }
}

/// Snapshots in parts are the same states, and those whose index is missing, as after a killed run, are none.
#[test]
fn snapshots_in_parts_are_those_in_one_file() {
    let parts: &[&str] = &["--part-bodies", "20"];
    let (whole, case) = (files(&scene(4), &[&[]]), scene(4));
    let unbroken = files(&case, &[parts]);
    let steps: Vec<u64> = list_snapshots(&case.path().join("OUTBOX")).unwrap().iter().map(|(step, _)| *step).collect();
    assert_eq!(steps, [0, 15, 30, 45, 60]);
    for step in steps {
        let path = snapshot_path(&case.path().join("OUTBOX"), step);
        let name = path.file_name().unwrap().to_str().unwrap();
        assert!(Snapshot::read(&path).unwrap().to_bytes() == whole[name], "{name}");
        // Bodies: 64 spheres and the plates.
        let parts = (0..).take_while(|&number| part_path(&path, number).exists()).count();
        assert_eq!(parts, 4);
    }
    let names = |files: &BTreeMap<String, Vec<u8>>| -> Vec<String> {
        files.keys().filter(|name| !name.contains("-part-")).cloned().collect()
    };
    assert_eq!(names(&unbroken), names(&whole));

    let broken = scene(4);
    let outbox_of_broken = broken.path().join("OUTBOX");
    files(&broken, &[&["--part-bodies", "20", "--steps", "40"]]);
    // The run is killed while it writes snapshot 40, and a part of an earlier attempt is left.
    std::fs::remove_file(snapshot_path(&outbox_of_broken, 40)).unwrap();
    std::fs::write(part_path(&snapshot_path(&outbox_of_broken, 45), 9), "").unwrap();
    assert_eq!(broken.solve(&["--part-bodies", "20", "--resume"]), 0);
    let binary = |files: BTreeMap<String, Vec<u8>>| -> BTreeMap<String, Vec<u8>> {
        files.into_iter().filter(|(name, _)| !name.contains(".OUT.")).collect()
    };
    same(&binary(unbroken), &binary(outbox(&broken.path())));
}

#[test]
fn threads_change_nothing() {
    let one = files(&scene(7), &[&["--threads", "1"]]);
    let names: Vec<&str> = one.keys().map(String::as_str).collect();
    let numbered = |name: &str| (1..5).map(|k| format!("{name}.OUT.{k}")).collect::<Vec<_>>();
    let copies = ["BODIES", "BULK_BEHAV", "DRV_DOF", "TACT_BEHAV"].map(|name| format!("{name}.OUT"));
    let mut expected = [0, 15, 30, 45, 60].map(|k| format!("snapshot-{k:06}.npz")).to_vec();
    expected.extend(copies.into_iter().chain(numbered("DOF")).chain(numbered("Vloc_Rloc")));
    expected.extend(["COMPUTE.RON", "DOF.LAST", "Vloc_Rloc.LAST", "steps.csv", "turn.dat"].map(String::from));
    expected.sort();
    assert_eq!(names, expected);
    for threads in ["2", "3", "5"] {
        same(&one, &files(&scene(7), &[&["--threads", threads]]));
    }
}

/// Spheres or blocks of their own gravity, pressed into each other at the start, that move at random and collapse on a
/// floor. Most have several contacts, so that every list is long enough to be divided over 16 threads.
pub fn collapse(side: i64, blocks: bool) -> Case {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.4]);
    case.gravity = [0.1, 0.0, -4.0];
    let (mut random, spacing) = (uniform(5), 0.75);
    for (radius, x) in shaken_lattice(side, 6) {
        let [x, y, z] = x.map(|x| spacing * x);
        let (x, half) = ([x, y, z + 0.43 * side as f64], [radius, 0.8 * radius, 0.9 * radius]);
        let axes = [[1.0, 0.0, 0.0], [0.0, 0.8, 0.6], [0.0, -0.6, 0.8]];
        let body = if blocks { case.block(half, x, axes) } else { case.sphere(radius, x) };
        case.launch(body, [0; 3].map(|_| 2.0 * random() - 1.0), [0; 3].map(|_| 4.0 * random() - 2.0));
    }
    case.floor();
    let options = &mut case.options;
    (options.self_gravity, options.gravity_constant) = (true, 0.01);
    (options.dt, options.tol, options.max_sweeps) = (0.01, Some(1e-4), Some(20));
    (options.steps, options.output_every) = (Some(3), 1);
    case
}

#[test]
fn threads_change_nothing_in_a_collapse_of_spheres() {
    let one = files(&collapse(14, false), &[&["--threads", "1"]]);
    for threads in ["2", "3", "8", "16"] {
        same(&one, &files(&collapse(14, false), &[&["--threads", threads]]));
    }
}

#[test]
fn threads_change_nothing_in_a_collapse_of_blocks() {
    let one = files(&collapse(11, true), &[&["--threads", "1"]]);
    for threads in ["2", "3", "8", "16"] {
        same(&one, &files(&collapse(11, true), &[&["--threads", threads]]));
    }
}

/// Names of the vector widths of this machine, smallest first.
fn vector_widths() -> Vec<&'static str> {
    SimdWidth::all_widths().into_iter().map(SimdWidth::name).collect()
}

/// Files of a run of the program with vectors of this width.
fn files_at_width(case: &Case, width: &str) -> BTreeMap<String, Vec<u8>> {
    case.write();
    let mut run = Command::new(env!("CARGO_BIN_EXE_cd-solve"));
    let run = run.arg(case.path()).args(["--threads", "1", "--vector-width", width]).output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    outbox(&case.path())
}

#[track_caller]
fn widths_change_nothing(scene: impl Fn() -> Case) {
    let detected = files(&scene(), &[&["--threads", "1"]]);
    for width in vector_widths() {
        same(&detected, &files_at_width(&scene(), width));
    }
}

#[test]
fn widths_of_vectors_change_nothing_with_spheres() {
    widths_change_nothing(|| scene(4));
}

#[test]
fn widths_of_vectors_change_nothing_in_a_column_at_rest() {
    widths_change_nothing(|| {
        let mut case = column_at_rest(ContactSolver::Auto);
        case.options.steps = Some(1);
        case
    });
}

#[test]
fn widths_of_vectors_change_nothing_with_polyhedra() {
    widths_change_nothing(|| collapse(6, true));
}

/// Emulator of other x86-64 processors, or `None` where it is not installed.
#[cfg(target_arch = "x86_64")]
fn processor_emulator() -> Option<&'static str> {
    let is_there = |program: &&str| Command::new(program).arg("--version").output().is_ok();
    let emulator = ["qemu-x86_64-static", "qemu-x86_64"].into_iter().find(is_there);
    let required = std::env::var("CD_REQUIRE_QEMU").is_ok_and(|value| value == "1");
    assert!(emulator.is_some() || !required, "qemu-x86_64 is not there");
    emulator
}

/// Processors with neither AVX nor fused multiply-add, and with both of them but without AVX-512.
#[cfg(target_arch = "x86_64")]
#[test]
fn other_processors_change_nothing() {
    let Some(emulator) = processor_emulator() else {
        return eprintln!("qemu-x86_64 is not there: other processors are not tested");
    };
    for scene in [|| scene(2), || collapse(3, true)] {
        let detected = files(&scene(), &[&["--threads", "1"]]);
        for (processor, widths) in [("Nehalem", "scalar"), ("Haswell", "scalar, avx2")] {
            let case = scene();
            case.write();
            let run = |words: &[&str]| {
                let mut command = Command::new(emulator);
                command.args(["-cpu", processor, env!("CARGO_BIN_EXE_cd-solve")]).arg(case.path());
                command.args(["--threads", "1"]).args(words).output().unwrap()
            };
            let emulated = run(&[]);
            assert!(emulated.status.success(), "{}", String::from_utf8_lossy(&emulated.stderr));
            same(&detected, &outbox(&case.path()));
            // The processor is the one that it is said to be.
            let message = String::from_utf8(run(&["--vector-width", "x"]).stderr).unwrap();
            assert!(message.contains(&format!("expected a width of this machine: {widths};")), "{message}");
        }
    }
}

#[test]
fn a_width_that_the_machine_lacks_is_rejected() {
    let case = scene(2);
    case.write();
    let run = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).args(["--vector-width", "x"]).output();
    let run = run.unwrap();
    let message =
        format!("'--vector-width <NAME>': expected a width of this machine: {}; see", vector_widths().join(", "));
    assert_eq!(run.status.code(), Some(2));
    assert!(String::from_utf8(run.stderr).unwrap().contains(&message));
}

#[test]
fn a_resumed_run_is_the_unbroken_one() {
    let unbroken = files(&scene(4), &[&[]]);
    // With wall motion, cohesion, slid contacts and events behind and before it.
    let resumed = files(&scene(4), &[&["--steps", "15"], &["--resume", "--steps", "30"], &["--resume"]]);
    same(&unbroken, &resumed);
    // Stopped between two outputs, the end of a run is written besides.
    let mut resumed = files(&scene(4), &[&["--steps", "37"], &["--resume"]]);
    assert!(resumed.remove("snapshot-000037.npz").is_some());
    same(&unbroken, &resumed);
    // Resuming a finished run, or one that never began, is no fault.
    same(&unbroken, &files(&scene(4), &[&["--resume"], &["--resume"]]));
}

/// Each source of ERRORS.csv with its estimate.
fn estimates(case: &Case) -> Vec<String> {
    let text = std::fs::read_to_string(case.path().join("ERRORS.csv")).unwrap();
    text.lines().map(|line| line.rsplit_once(',').unwrap().0.to_string()).collect()
}

#[test]
fn a_resumed_run_states_the_errors_of_the_unbroken_one() {
    let (unbroken, resumed) = (scene(4), scene(4));
    files(&unbroken, &[&[]]);
    files(&resumed, &[&["--steps", "59"], &["--resume"]]);
    assert_eq!(estimates(&unbroken), estimates(&resumed));
    // A check of the check: of the last step alone nothing is known.
    assert!(estimates(&unbroken).iter().filter(|line| !line.ends_with(",0e0")).count() > 4);
}

#[test]
#[cfg(unix)]
fn a_stopped_run_continues_where_it_was() {
    let case = scene(4);
    case.write();
    let flags = ["--steps", "1000000", "--output-every", "15"];
    let mut run = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).args(flags).spawn().unwrap();
    while !case.path().join("OUTBOX/snapshot-000015.npz").exists() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    assert!(Command::new("kill").arg(run.id().to_string()).status().unwrap().success());
    assert_eq!(run.wait().unwrap().code(), Some(4));
    let stopped = case.last().meta.step;
    assert!(stopped < 1_000_000);
    let end = (stopped + 7).to_string();
    let mut resumed = files(&case, &[&["--resume", "--steps", &end]]);
    let mut unbroken = files(&scene(4), &[&["--steps", &end]]);
    // Both may have stopped between two outputs.
    resumed.remove(&format!("snapshot-{stopped:06}.npz"));
    unbroken.remove(&format!("snapshot-{stopped:06}.npz"));
    // Texts count the outputs.
    for files in [&mut resumed, &mut unbroken] {
        files.retain(|name, _| !name.contains(".OUT."));
    }
    same(&unbroken, &resumed);
}

#[test]
fn forces_that_change_at_a_resume_do_work_from_outside() {
    let mut case = Case::new();
    case.gravity = [0.0, 0.0, -8.0];
    case.sphere(0.5, [0.0, 0.0, 3.0]);
    case.sphere(0.5, [0.0, 2.0, 3.0]);
    (case.options.dt, case.options.gravity_constant) = (0.01, 0.5);
    case.run(10);
    let drift = |case: &Case| {
        let (end, ledger) = (case.last(), case.last().meta.ledger);
        let z: f64 = end.bodies.body_x.iter().map(|x| x[2]).sum();
        let [a, b] = [0, 1].map(|k| Vec3::from(end.bodies.body_x[k]));
        let parameters = &end.meta.parameters;
        let mass = end.bodies.body_mass[0];
        let pull =
            if parameters.self_gravity { parameters.gravity_constant * mass * mass / (a - b).norm() } else { 0.0 };
        let potential = -parameters.uniform_gravity[2] * mass * z - pull;
        let kinetic: f64 = end.bodies.body_v.iter().map(|v| 0.5 * mass * Vec3::from(*v).norm_squared()).sum();
        kinetic + potential - ledger.energy_start - ledger.outside_work - ledger.contact_work
    };
    // Round-off of energies of some 20 J.
    assert!(drift(&case).abs() < 1e-13);
    case.gravity[2] = -1.0;
    case.write();
    assert_eq!(case.solve(&["--resume", "--steps", "11"]), 0);
    assert!(drift(&case).abs() < 1e-13, "{}", drift(&case));
    // One step errs by the cube of its length.
    assert_eq!(case.solve(&["--resume", "--steps", "12", "--self-gravity"]), 0);
    assert!(drift(&case).abs() < 1e-6, "{}", drift(&case));
    // Nothing changes any more.
    let before = case.last().meta.ledger.outside_work;
    assert_eq!(case.solve(&["--resume", "--steps", "13", "--self-gravity"]), 0);
    assert_eq!(case.last().meta.ledger.outside_work, before);
}

#[test]
fn bonds_outlive_a_restart() {
    let case = slab();
    let unbroken = files(&case, &[&[]]);
    let held = |state: &Snapshot| {
        let memory = state.memory.as_ref().unwrap();
        memory.contact_bonded.iter().map(|&b| usize::from(b)).sum::<usize>()
    };
    let held: Vec<usize> = case.written().iter().map(held).collect();
    // Some of the 31 bonds break, some hold, and an event makes new ones.
    assert!(held[1] < 31 && held[1] < held[2] && held[4] > 0, "{held:?}");
    same(&unbroken, &files(&slab(), &[&["--steps", "0"], &["--resume", "--steps", "15"], &["--resume"]]));
    let mut rolling = slab();
    rolling.law_with("SPHER", "IQS_WET_DS_ROLL_CLB", &[0.5, 0.0, 0.02, 0.3, 0.5, 0.1, 0.1]);
    rolling.tact.visibility.remove(0);
    rolling.options.events.remove(2);
    let unbroken_rolling = files(&rolling, &[&[]]);
    same(&unbroken_rolling, &files(&rolling, &[&["--force", "--steps", "30"], &["--resume"]]));
    let threads = files(&slab(), &[&["--threads", "1", "--steps", "30"], &["--resume", "--threads", "3"]]);
    same(&unbroken, &threads);
}

#[test]
fn a_snapshot_has_the_laws_and_the_gravity_in_force() {
    let mut case = slab();
    case.event(0.35, EventAction::SetGravity([0.0, 0.0, -4.0]));
    files(&case, &[&["--steps", "45"], &["--resume"]]);
    let states = case.written();
    let laws = |k: usize| states[k].meta.laws.iter().map(|law| law.parameters.clone()).collect::<Vec<_>>();
    let (bonds, bridges) = (vec![300.0, 200.0, 0.3, 0.5], vec![0.5, 0.0, 0.02, 0.3, 0.5]);
    assert_eq!(laws(0), [bonds.clone(), bridges.clone()]);
    let slippery = vec![0.5, 0.0, 0.02, 0.1, 0.1];
    assert_eq!(laws(1), [bonds.clone(), slippery.clone()]);
    // Cohesion in shear goes with that in traction.
    assert_eq!(laws(3), [vec![250.0, 200.0 * (250.0 / 300.0), 0.3, 0.5], slippery]);
    assert_eq!([2, 3].map(|k| states[k].meta.parameters.uniform_gravity), [[0.3, 0.0, -8.0], [0.0, 0.0, -4.0]]);
    let at_start = |k: usize| states[k].meta.laws_at_start.iter().map(|law| &law.parameters).collect::<Vec<_>>();
    assert_eq!((at_start(0), at_start(4)), (vec![], vec![&bonds, &bridges]));
    // DATBOX may still not change under the run.
    case.tact.laws[1].parameters[4] = 0.1;
    case.write();
    assert_eq!(case.solve(&["--resume", "--steps", "70"]), 2);
}

#[test]
fn a_resumed_run_takes_other_events_by_their_times() {
    let mut case = Case::new();
    let ball = case.sphere(0.5, [0.0; 3]);
    case.options.dt = 0.01;
    case.event(0.0, EventAction::AddVelocity([0.0, 1.0, 0.0]));
    case.run(10);
    let events = "[(time: 0.0, action: AddVelocity((0.0, 1.0, 0.0))), (time: 0.05, action: AddVelocity((0.0, 0.0, 9.0))), \
                  (time: 0.15, action: SetGravity((0.0, 0.0, -1.0)))]";
    for events in [events, "[(time: 0.15, action: SetGravity((0.0, 0.0, -1.0)))]"] {
        case.run(10);
        assert_eq!(case.solve(&["--resume", "--steps", "20", "--events", events]), 0);
        // What would have been before is past, and gravity acts for 5 steps.
        crate::case::near(case.last().v(ball), [0.0, 1.0, -0.05], 1e-12);
    }
}

#[test]
fn a_resumed_run_extrapolates_gravity_as_the_unbroken_one() {
    let scene = || {
        let mut case = scene(4);
        case.options.gravity_refresh = Some(7);
        case
    };
    let unbroken = files(&scene(), &[&[]]);
    let resumed = files(&scene(), &[&["--steps", "15"], &["--resume", "--steps", "30"], &["--resume"]]);
    same(&unbroken, &resumed);
}

#[test]
fn a_killed_run_continues_from_its_last_snapshot() {
    let unbroken = files(&scene(4), &[&[]]);
    let case = scene(4);
    files(&case, &[&["--steps", "45"]]);
    let outbox = case.path().join("OUTBOX");
    // As if killed after step 37: rows and texts later than the last snapshot, one torn.
    std::fs::remove_file(outbox.join("snapshot-000045.npz")).unwrap();
    let steps = std::fs::read_to_string(outbox.join("steps.csv")).unwrap();
    std::fs::write(outbox.join("steps.csv"), &steps[..steps.len() * 5 / 6]).unwrap();
    std::fs::write(outbox.join(".snapshot-000045.npz.part"), b"half").unwrap();
    let mut resumed = files(&case, &[&["--resume"]]);
    resumed.remove(".snapshot-000045.npz.part");
    same(&unbroken, &resumed);
}

#[test]
fn force_starts_anew() {
    let unbroken = files(&scene(4), &[&[]]);
    let case = scene(4);
    std::fs::create_dir_all(case.path().join("OUTBOX")).unwrap();
    std::fs::write(case.path().join("OUTBOX/notes.txt"), b"mine").unwrap();
    let mut forced = files(&case, &[&["--steps", "100", "--dt", "0.02"], &["--force"]]);
    assert_eq!(forced.remove("notes.txt").unwrap(), b"mine");
    same(&unbroken, &forced);
}

#[test]
fn a_resumed_run_may_change_its_step() {
    let case = scene(4);
    files(&case, &[&["--steps", "30"], &["--resume", "--dt", "0.005", "--steps", "40", "--tol", "1e-6"]]);
    let end = case.last();
    equal(end.meta.time, 0.3 + 0.05, 1e-14);
    assert_eq!((end.meta.step, end.meta.h, end.meta.parameters.tol), (40, 0.005, 1e-6));
    // What is accounted for does not depend on the step: round-off.
    let away = end.momentum() - Vec3::from(end.meta.ledger.momentum_expected);
    assert!(away.norm() < 1e-12 * end.meta.ledger.momentum_scale);
}

#[test]
fn a_resumed_run_ends_in_time_whatever_its_steps_are() {
    let case = scene(4);
    files(&case, &[&["--steps", "30"]]);
    for (dt, end, step) in [("0.005", 0.4, 50), ("0.02", 0.5, 55), ("0.01", 0.5, 55)] {
        files(&case, &[&["--resume", "--dt", dt, "--end-time", &end.to_string()]]);
        let state = case.last();
        equal(state.meta.time, end, 1e-14); // sums of some tens of steps
        assert_eq!(state.meta.step, step);
    }
}

#[test]
fn flags_win_over_the_file() {
    let mut case = scene(4);
    let by_flags = files(
        &case,
        &[&["--dt", "0.02", "--theta=0.6", "--tol", "1e-5", "--output-every", "60", "--quench=0.01", "--text=false"]],
    );
    let options = &mut case.options;
    (options.dt, options.theta, options.tol, options.output_every) = (0.02, 0.6, Some(1e-5), 60);
    (options.quench, options.text) = (0.01, false);
    same(&by_flags, &files(&case, &[&["--force"]]));
}

#[test]
fn the_texts_of_a_run_start_another() {
    // DATBOX of the last output: LMGC90's way to continue, at 7 digits.
    let case = scene(4);
    files(&case, &[&["--steps", "45"]]);
    let (datbox, outbox) = (case.path().join("DATBOX"), case.path().join("OUTBOX"));
    let before = case.written();
    for (from, to) in [("DOF.OUT.2", "DOF.INI"), ("Vloc_Rloc.OUT.2", "Vloc_Rloc.INI")] {
        std::fs::copy(outbox.join(from), datbox.join(to)).unwrap();
    }
    assert_eq!(case.solve(&["--force", "--steps", "31"]), 0);
    let after = case.written();
    assert_eq!(after[0].meta.step, 30);
    equal(after[0].meta.time, before[2].meta.time, 1e-7);
    for i in before[2].free() {
        // 7 digits of displacements and velocities up to 10.
        near(after[0].x(i), before[2].x(i), 1e-5);
        near(after[0].v(i), before[2].v(i), 1e-5);
        near(after[0].w(i), before[2].w(i), 1e-5);
    }
    // The contacts' forces are there to start from.
    assert_eq!(after[0].contacts.contact_body, before[2].contacts.contact_body);
}

/// Thirty balls, or blocks, that fall into a tub and on each other.
pub fn poured(blocks: bool, law: &str, parameters: &[f64]) -> Case {
    let mut case = Case::new();
    case.law_of_all(law, parameters);
    case.gravity = [0.15, 0.05, -4.0];
    case.tub(2.0);
    let mut random = uniform(3);
    for (radius, [x, y, z]) in shaken_lattice(3, 6) {
        let half = [0.8 * radius, 0.5 * radius, 0.6 * radius];
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let x = [x, y, z + 1.65];
        let body = if blocks { case.block(half, x, axes) } else { case.sphere(radius, x) };
        case.launch(body, [0; 3].map(|_| 2.0 * random() - 1.0), [0; 3].map(|_| 4.0 * random() - 2.0));
    }
    let options = &mut case.options;
    (options.dt, options.tol, options.max_sweeps) = (0.002, Some(1e-6), Some(500));
    case
}

/// Steps are so short that no push within a step carries a body past the shortest alert distance.
#[test]
fn the_alert_distance_changes_nothing() {
    for (blocks, law, parameters) in [
        (false, "IQS_CLB", &[0.4][..]),
        (false, "RST_DS_CLB", &[0.6, 0.2, 0.3, 0.4]),
        (false, "IQS_DS_ROLL_CLB", &[0.4, 0.5, 0.1, 0.1]),
        (true, "IQS_CLB", &[0.4]),
    ] {
        let run = |share: f64| {
            let mut case = poured(blocks, law, parameters);
            case.options.alert = Some(share * 0.4); // of the mean radius
            let end = case.run(220);
            let column = |name: &str| case.column(name).iter().map(|x| x.to_bits()).collect::<Vec<_>>();
            let steps = ["contacts_solved", "contacts_active", "sweeps", "residual"].map(column);
            ((steps, end.bodies.body_x, end.bodies.body_v), case.column("contacts_listed").iter().sum::<f64>())
        };
        let [(near, few), (middle, _), (far, many)] = [0.02, 0.1, 0.3].map(run);
        assert!(near == middle && middle == far, "{law} {blocks}");
        assert!(many > 1.2 * few, "{law} {blocks}: {few} {many}"); // a check of the check
        assert!(near.0[2].iter().any(|sweeps| f64::from_bits(*sweeps) > 0.0), "{law} {blocks}");
    }
}

#[test]
fn a_run_taken_up_at_its_start_is_the_unbroken_one() {
    // Of two blocks so deep in each other it is open which way is out.
    let deep = || {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.25]);
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        case.block([0.5; 3], [0.0; 3], axes);
        let block = case.block([0.5; 3], [0.9375, 0.875, 0.0], axes);
        case.launch(block, [-16.0, 0.0, 0.0], [0.0; 3]);
        (case.options.dt, case.options.steps, case.options.output_every) = (0.0078125, Some(4), 2);
        case
    };
    same(&files(&deep(), &[&[]]), &files(&deep(), &[&["--steps", "0"], &["--resume"]]));
}

#[test]
fn a_resumed_run_ends_where_the_unbroken_one_does() {
    // So late that the sum of the steps falls behind their product.
    let late = || {
        let mut case = Case::new();
        case.sphere(0.5, [0.0; 3]);
        (case.options.dt, case.options.end_time, case.options.output_every) = (0.1, Some(1e8 + 2500.0), 20_000);
        case.write();
        let dof = Dof { step: 0, time: 1e8, bodies: case.dof.clone() }.to_text();
        std::fs::write(case.path().join("DATBOX/DOF.INI"), dof).unwrap();
        case
    };
    let ends = [&[&[][..]][..], &[&["--steps", "20000"], &["--resume"], &["--resume"]]].map(|pieces| {
        let case = late();
        assert!(pieces.iter().all(|flags| case.solve(flags) == 0));
        case.last().meta
    });
    assert_eq!([ends[0].step, ends[1].step], [25_000; 2]);
    assert_eq!(ends[0].time, ends[1].time);
}

#[test]
fn what_continues_from_a_snapshot_knows_how_far_it_has_sunk_in() {
    let heap = || {
        let mut case = Case::new();
        case.law("IQS_CLB", &[0.4]);
        case.gravity = [0.0, 0.0, -8.0];
        for (radius, [x, y, z]) in shaken_lattice(3, 4) {
            case.sphere(radius, [x, y, z + 1.7]);
        }
        case.tub(1.7);
        // The tolerance is so loose that overlap adds up, which then needs more sweeps.
        (case.options.dt, case.options.tol) = (0.01, Some(0.1));
        case.options.penetration_tol = Some(1e-6);
        (case.options.steps, case.options.output_every, case.options.text) = (Some(200), 100, true);
        case
    };
    let unbroken = heap();
    unbroken.write();
    assert_eq!(unbroken.solve(&[]), 0);
    let mut from = heap();
    from.options.steps = Some(100);
    from.write();
    for (there, here) in [("snapshot-000100.npz", "START.npz"), ("DOF.OUT.1", "DOF.INI")] {
        let [there, here] = [unbroken.path().join("OUTBOX").join(there), from.path().join("DATBOX").join(here)];
        std::fs::copy(there, here).unwrap();
    }
    assert_eq!(from.solve(&[]), 0);
    assert!(unbroken.last().meta.ledger.penetration_left > 1e-6);
    assert_eq!(from.last().bodies.body_x, unbroken.last().bodies.body_x);
}

/// A run that begins late, from text, has what events before have set, and warns that their additions are not repeated.
#[test]
fn events_before_a_late_start_have_happened() {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.4]);
    let ball = case.sphere(0.5, [0.0; 3]);
    case.options.dt = 0.25;
    case.options
        .events
        .push(Event { every: Some(10.0), ..Event::at_time(0.0, EventAction::AddVelocity([1.0, 0.0, 0.0])) });
    case.event(50.0, EventAction::SetGravity([0.0, 0.0, -8.0]));
    case.options.end_time = Some(105.0);
    case.write();
    let file = case.path().join("DATBOX/DOF.INI");
    let text = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&file, text.replacen("time= 0.0000000D+00", "time= 0.1000000D+03", 1)).unwrap();
    let (scene, _) = cd_solve::read::read_case(&case.path(), &ComputeFlags::default()).unwrap();
    let message = "events: 10 events before the start at 100 s have no effect (AddSpin, AddVelocity, Shake, Bond)";
    assert!(scene.notes.iter().any(|note| note == message), "{:?}", scene.notes);
    assert_eq!(case.solve(&[]), 0);
    // That of 100 s happens.
    assert_eq!(case.last().bodies.body_v[ball], [1.0, 0.0, -40.0]);
}
