//! Files of earlier formats, kept in `tests/fixtures/formats/NUMBER`, are still read; see
//! `docs/development/format-policy.md`.
//!
//! NUMBER is the format number of the snapshots. Each folder in it is a case: a scene, and the files that the programs
//! made from it when that number was the current one. These files never change.

use std::fs;
use std::path::{Path, PathBuf};

use cd_formats::compute::ComputeFlags;
use cd_formats::dof::Dof;
use cd_formats::fc3d::Fc3d;
use cd_formats::snapshot::{FORMAT_VERSION, Snapshot, list_snapshots};
use cd_formats::vloc_rloc::VlocRloc;
use cd_post::tables::{read_columns, read_log};
use cd_tests::case::{Case, copy, files, from_outbox, pre};
use cd_tests::columns::{csv, npz};

/// Columns of series.csv whose definitions do not depend on regions or neighbours.
const SIMPLE_COLUMNS: [&str; 8] = ["step", "time", "n_grains", "mass", "com_x", "P_x", "L_z", "Ec_mean"];

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/formats")
}

/// Folders in a folder, in the order of their names.
fn folders(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().flatten().map(|entry| entry.path());
    let mut folders: Vec<PathBuf> = entries.filter(|path| path.is_dir()).collect();
    folders.sort();
    folders
}

/// Format number and folder of each frozen case.
fn frozen_cases() -> Vec<(u32, PathBuf)> {
    let mut cases = Vec::new();
    for folder in folders(&fixtures()) {
        let number: u32 = folder.file_name().unwrap().to_str().unwrap().parse().unwrap();
        cases.extend(folders(&folder).into_iter().map(|case| (number, case)));
    }
    cases
}

/// Copy of a frozen case that programs may write to.
fn copy_of(frozen: &Path) -> Case {
    let case = Case::empty();
    copy(frozen, case.path());
    for name in ["DATBOX", "OUTBOX"] {
        copy(&frozen.join(name), &case.path().join(name));
    }
    case
}

fn read_snapshot(path: &Path) -> Snapshot {
    Snapshot::read(path).unwrap_or_else(|faults| panic!("{faults}"))
}

#[test]
fn every_format_number_has_cases() {
    let mut numbers: Vec<u32> = frozen_cases().into_iter().map(|(number, _)| number).collect();
    numbers.sort();
    numbers.dedup();
    assert_eq!(numbers, (1..=FORMAT_VERSION).collect::<Vec<u32>>());
}

/// The values are those that an independent reader finds.
#[test]
fn snapshots_are_read() {
    for (number, frozen) in frozen_cases() {
        let snapshots = list_snapshots(&frozen.join("OUTBOX")).unwrap();
        assert!(snapshots.len() >= 2, "{}", frozen.display());
        for (step, path) in snapshots {
            let columns = npz(&path).unwrap();
            assert_eq!(columns["meta.format"], [f64::from(number)], "{}", path.display());
            let snapshot = read_snapshot(&path);
            assert_eq!(snapshot.meta.step, step);
            assert_eq!(snapshot.bodies.body_x.as_flattened(), columns["body_x"]);
            assert_eq!(snapshot.bodies.body_mass, columns["body_mass"]);
            assert_eq!(snapshot.contacts.contact_impulse.as_flattened(), columns["contact_impulse"]);
        }
    }
}

/// Optional arrays are in the cases of the current format too: bonds, extrapolated gravity, shapes, intervals.
#[test]
fn cases_of_the_current_format_have_all_arrays() {
    let mut found = [false; 5];
    for (_, frozen) in frozen_cases().into_iter().filter(|(number, _)| *number == FORMAT_VERSION) {
        for (_, path) in list_snapshots(&frozen.join("OUTBOX")).unwrap() {
            let Snapshot { meta, memory, gravity, shapes, interval, .. } = read_snapshot(&path);
            let holds = memory.is_some_and(|memory| memory.contact_bonded.contains(&1));
            let has_pairs = shapes.is_some_and(|shapes| !shapes.pairs.pair_body.is_empty());
            let has_exchanges = interval.is_some_and(|interval| !interval.interval_body.is_empty());
            let present = [holds, gravity.is_some(), has_pairs, has_exchanges, !meta.laws_at_start.is_empty()];
            found.iter_mut().zip(present).for_each(|(found, present)| *found |= present);
        }
    }
    assert_eq!(found, [true; 5], "bonds, gravity, shapes, interval, laws at the start");
}

#[test]
fn input_and_text_are_read() {
    for (_, frozen) in frozen_cases() {
        let read = cd_solve::read::read_case(&frozen, &ComputeFlags::default());
        read.map(drop).unwrap_or_else(|faults| panic!("{}\n{faults}", frozen.display()));
        for name in files(&frozen.join("OUTBOX")) {
            let path = frozen.join("OUTBOX").join(&name);
            if name.starts_with("DOF.OUT.") {
                assert!(!Dof::read(&path).unwrap().bodies.is_empty(), "{}", path.display());
            } else if name.starts_with("Vloc_Rloc.OUT.") {
                VlocRloc::read(&path).unwrap();
            }
        }
    }
}

#[test]
fn scenes_are_accepted() {
    for (_, frozen) in frozen_cases() {
        let case = Case::empty();
        assert_eq!(pre(&frozen.join("scene.ron"), case.path()), 0, "{}", frozen.display());
    }
}

#[test]
fn runs_are_resumed() {
    for (_, frozen) in frozen_cases() {
        let case = copy_of(&frozen);
        let end = case.last_snapshot().meta.step + 4;
        assert_eq!(case.solve(&["--resume", "--steps", &end.to_string()]), 0, "{}", frozen.display());
        assert_eq!(case.last_snapshot().meta.step, end);
    }
}

#[test]
fn results_start_another_run() {
    for (_, frozen) in frozen_cases() {
        let (case, next) = (copy_of(&frozen), Case::empty());
        assert_eq!(from_outbox(case.path(), next.path(), ""), 0, "{}", frozen.display());
        assert_eq!(next.solve(&["--steps", "2"]), 0, "{}", frozen.display());
    }
}

/// Checks that the observables of cd-post equal those stored when the snapshots were written.
#[test]
fn results_are_measured() {
    for (_, frozen) in frozen_cases() {
        read_log(&frozen.join("OUTBOX/steps.csv"), &["step", "time", "residual"]).unwrap();
        let table = frozen.join("POSTPRO/series.csv");
        read_columns(&table, &SIMPLE_COLUMNS).unwrap();
        let (expected, found) = (csv(&table).unwrap(), copy_of(&frozen).series());
        for name in SIMPLE_COLUMNS {
            let (expected, found) = (&expected[name], &found[name]);
            assert_eq!(expected.len(), found.len(), "{}", frozen.display());
            let scale = expected.iter().fold(0.0, |largest: f64, x| largest.max(x.abs()));
            // Processors differ in the rounding of sums over some ten bodies.
            let agrees = expected.iter().zip(found).all(|(a, b)| (a - b).abs() <= 1e-12 * scale);
            assert!(agrees, "{}: {name}: {found:?}; expected {expected:?}", frozen.display());
        }
    }
}

#[test]
fn contact_problems_are_read() {
    let mut count = 0;
    for (_, frozen) in frozen_cases() {
        for name in files(&frozen).iter().filter(|name| name.ends_with(".fc3d")) {
            let problem = Fc3d::read(&frozen.join(name)).unwrap();
            assert!(!problem.mu.is_empty() && problem.blocks.len() >= problem.mu.len(), "{name}");
            count += 1;
        }
    }
    assert!(count > 0);
}
