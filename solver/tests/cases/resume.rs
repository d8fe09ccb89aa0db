//! Snapshots of other runs are rejected, changed options are named, and the next run keeps what a snapshot has.

use std::collections::BTreeMap;
use std::fs;

use cd_formats::compute::ComputeFlags;
use cd_formats::probe::BodySelection;
use cd_formats::region::SpaceRegion;
use cd_formats::sinks_and_sources::{Sink, Source};
use cd_formats::snapshot::Snapshot;
use cd_solve::read::read_case;
use cd_solve::read::resume::{counted_from, restore_last};

use crate::case::{AXES, Case, expect_same_bytes};
use crate::refusals::spawn;

/// Two balls in free fall, of which the first has passed z = 0 after four steps.
fn falling() -> Case {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    for (x, z) in [(0.0, 0.25), (4.0, 2.0)] {
        let body = case.sphere(0.5, [x, 0.0, z]);
        case.launch(body, [0.0, 0.0, -1.0], [0.0; 3]);
    }
    case.options.dt = 0.125;
    case
}

/// Resumes a case whose last snapshot is of step 4 and expects this fault of it.
#[track_caller]
fn expect_fault(case: &Case, expected: &str) {
    let (code, text) = spawn(case, &["--resume", "--steps", "8"]);
    let line = format!("cd-solve: CASE/OUTBOX/snapshot-000004.npz: snapshot: {expected}\n");
    assert!(code == 2 && text.contains(&line), "{code} {text}");
}

/// Changes the last snapshot, which is of step 4.
fn edit(case: &Case, change: impl Fn(&mut Snapshot)) {
    let mut snapshot = case.last();
    change(&mut snapshot);
    fs::write(case.path().join("OUTBOX/snapshot-000004.npz"), snapshot.to_bytes()).unwrap();
    // With the list of checksums the snapshot would be damaged.
    let list = case.path().join("OUTBOX/SHA256SUMS");
    if list.exists() {
        fs::remove_file(list).unwrap();
    }
}

#[test]
fn sinks_and_sources_are_those_of_the_run_so_far() {
    let mut case = falling();
    let region = SpaceRegion::Below { point: [0.0; 3], normal: [0.0, 0.0, 1.0] };
    case.options.sinks = vec![Sink { name: "lost".into(), region }];
    case.run(4);
    case.options.sinks.clear();
    case.write();
    expect_fault(&case, "1 body not in the run; expected the options sinks and sources of the run so far");
    let mut case = falling();
    case.run(4);
    let bodies = BodySelection::Body(2);
    case.options.sources = vec![Source { name: "rain".into(), bodies, order: None, from: 1.0, rate: 1.0 }];
    case.write();
    expect_fault(&case, "of a run without sinks and sources; expected a run with sources from its start");
}

#[test]
fn contactors_and_rotors_are_those_of_datbox() {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    case.gravity = [0.0, 0.0, -8.0];
    case.options.dt = 1.0 / 256.0;
    case.floor();
    case.block([0.5, 0.25, 0.375], [0.0, 0.0, 0.375], AXES);
    case.block([0.5, 0.25, 0.375], [0.0, 0.0, 1.125], AXES);
    case.run(4);
    let sound = case.last();
    let expected = "other contactors or moments of inertia; expected those of DATBOX";
    edit(&case, |snapshot| snapshot.shapes.as_mut().unwrap().pairs.pair_rank[0] = [7, 0]);
    expect_fault(&case, expected);
    edit(&case, |snapshot| {
        *snapshot = sound.clone();
        let turning = &mut snapshot.shapes.as_mut().unwrap().turning;
        turning.turning_body.pop();
        turning.turning_momentum.pop();
    });
    expect_fault(&case, expected);
    edit(&case, |snapshot| *snapshot = Snapshot { shapes: None, ..sound.clone() });
    expect_fault(&case, expected);
    edit(&case, |snapshot| *snapshot = sound.clone());
    // The search for contacts begins with the features of the last step.
    let (mut scene, mut state) = read_case(&case.path(), &ComputeFlags::default()).unwrap();
    assert!(restore_last(&case.path().join("OUTBOX"), &mut scene, &mut state).unwrap().is_some());
    assert_eq!(state.detection_cache.restored_pairs.len(), 2);
    assert_eq!(case.solve(&["--resume", "--steps", "8"]), 0);
}

#[test]
fn changed_options_are_named_in_full_up_to_100_characters() {
    let mut case = falling();
    case.run(4);
    let sound = case.last();
    let long = "x".repeat(100);
    let values = [
        (long.clone(), format!("{long} in the run so far"), format!("; --theta={long} keeps it")),
        (format!("{long}y"), format!("{long}... in the run so far"), format!("; --theta={long}y keeps it")),
        ("a b".into(), "a b in the run so far".into(), "; --theta='a b' keeps it".into()),
    ];
    for (value, before, advice) in values {
        edit(&case, |snapshot| *snapshot.meta.options.get_mut("theta").unwrap() = value.clone());
        let (code, text) = spawn(&case, &["--resume", "--steps", "4"]);
        let line = format!("cd-solve: warning: theta was {before} and is 0.5 from here on{advice}\n");
        assert!(code == 0 && text.contains(&line), "{code} {text}");
    }
    // `zperiode` is written only if it is given.
    edit(&case, |snapshot| {
        *snapshot = sound.clone();
        snapshot.meta.options.insert("zperiode".into(), "4.0".into());
    });
    let (_, text) = spawn(&case, &["--resume", "--steps", "4"]);
    let line = "zperiode was 4.0 in the run so far and is not given from here on; --zperiode=4.0 keeps it\n";
    assert!(text.contains(line), "{text}");
    // A snapshot without options says nothing of them.
    edit(&case, |snapshot| snapshot.meta.options.clear());
    let (_, text) = spawn(&case, &["--resume", "--steps", "4"]);
    assert!(!text.contains("in the run so far"), "{text}");
}

#[test]
fn a_run_of_no_steps_forms_its_bonds_at_the_resume() {
    let mut case = Case::new();
    case.law("IQS_MOHR_DS_CLB", &[1e4, 1e4, 0.125, 0.25]);
    case.sphere(0.5, [0.0; 3]);
    case.sphere(0.5, [1.0, 0.0, 0.0]);
    case.run(0);
    assert_eq!(case.solve(&["--resume", "--steps", "2"]), 0);
    assert_eq!(case.last().memory.unwrap().contact_bonded, [1]);
}

#[test]
fn steps_are_counted_from_the_run_before_if_its_steps_were_as_long() {
    let case = falling();
    case.write();
    let (mut scene, mut state) = read_case(&case.path(), &ComputeFlags::default()).unwrap();
    scene.options.dt = 1.0;
    // The next number after 1000, and one that differs by more than rounding.
    for (time, first_step) in [(1000.0, 500), (1000.0f64.next_up(), 500), (1000.0 + 1e-9, 1000)] {
        (state.step, state.time) = (1000, time);
        let found = counted_from(&scene, &state, Some((500, 500.0)));
        assert_eq!(found.step, first_step, "{time:?}");
    }
}

/// Bonds of two bodies whose numbers are exchanged in the next run, so that the other one is the candidate.
#[test]
fn bonds_of_bodies_with_other_numbers_continue() {
    let pair = |positions: [f64; 2], has_cubes: bool| {
        let mut case = Case::new();
        case.law_of_all("IQS_MOHR_DS_CLB", &[1e4, 1e4, 0.125, 0.25]);
        for z in positions {
            let x = [0.0, 0.0, z];
            if has_cubes {
                case.block([0.5; 3], x, AXES)
            } else {
                case.sphere(0.5, x)
            };
        }
        case
    };
    for (has_cubes, contacts) in [(false, 1), (true, 4)] {
        let mut start = pair([1.0, 0.0], has_cubes).run(2);
        start.bodies.body_id.reverse();
        // Another gap for each.
        for (k, gap) in (1..).zip(&mut start.memory.as_mut().unwrap().contact_bond_gap) {
            *gap = 1e-6 * f64::from(k);
        }
        let mut after = pair([0.0, 1.0], has_cubes);
        after.options.steps = Some(4);
        after.write();
        fs::write(after.path().join("DATBOX/START.npz"), start.to_bytes()).unwrap();
        assert_eq!(after.solve(&[]), 0);
        let gaps_at_points = [start, after.last()].map(|snapshot| {
            let memory = snapshot.memory.unwrap();
            assert_eq!(memory.contact_bonded, vec![1; contacts]);
            assert_eq!(snapshot.contacts.contact_body, vec![[0, 1]; contacts]);
            let points =
                snapshot.contacts.contact_point.into_iter().map(|[x, y, _]| [x, y].map(|c| (8.0 * c).round() as i32));
            points.zip(memory.contact_bond_gap).collect::<BTreeMap<_, _>>()
        });
        assert_eq!(gaps_at_points[0].len(), contacts);
        assert_eq!(gaps_at_points[0], gaps_at_points[1]);
    }
}

/// The second half of the steps uses self-gravity that was evaluated in the first.
#[test]
fn extrapolated_self_gravity_continues() {
    expect_same_bytes(|| {
        let mut case = Case::new();
        case.law("IQS_CLB", &[0.5]);
        for k in 0..8 {
            let x = [0, 1, 2].map(|axis| 4.0 * f64::from(k >> axis & 1));
            let body = case.sphere(0.5, x);
            case.launch(body, [0.01 * x[1], -0.02 * x[2], 0.03 * x[0]], [0.0; 3]);
        }
        (case.options.self_gravity, case.options.gravity_constant) = (true, 0.01);
        (case.options.gravity_error, case.options.dt) = (Some(1e-3), 1.0 / 256.0);
        (case.options.gravity_refresh, case.options.output_every) = (Some(7), 60);
        case
    });
}
