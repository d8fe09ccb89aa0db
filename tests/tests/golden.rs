//! Each stage, started from the expected files of the stage before, gives the expected files.
//! `make golden` makes them anew.

use cd_tests::golden::{Stage, changes, expected, run, scenes};

fn check(stage: Stage) {
    let mut faults = Vec::new();
    assert!(scenes().len() >= 2);
    for scene in scenes() {
        let case = tempfile::tempdir().unwrap();
        run(&scene, stage, case.path());
        let changes = changes(stage, &expected(&scene, stage), case.path());
        let name = scene.file_name().unwrap().display().to_string();
        faults.extend(changes.iter().filter(|change| !change.is_allowed()).map(|change| format!("{name}: {change}")));
    }
    assert!(faults.is_empty(), "{} columns have changed:\n{}", faults.len(), faults.join("\n"));
}

#[test]
fn pre_writes_the_expected_bytes() {
    check(Stage::Pre);
}

#[test]
fn solve_computes_the_expected_snapshots() {
    check(Stage::Solve);
}

#[test]
fn post_measures_the_expected_series() {
    check(Stage::Post);
}

/// The comparison itself: a change beyond the tolerance is found, one within is printed but allowed.
#[test]
fn a_changed_number_is_found() {
    let scene = &scenes()[0];
    let (stage, case) = (Stage::Post, tempfile::tempdir().unwrap());
    let series = |factor: f64| {
        let text = std::fs::read_to_string(expected(scene, stage).join("POSTPRO/series.csv")).unwrap();
        let mut lines: Vec<String> = text.lines().map(String::from).collect();
        let column = lines[0].split(',').position(|name| name == "R_enclosing").unwrap();
        let mut fields: Vec<String> = lines[1].split(',').map(String::from).collect();
        fields[column] = format!("{:?}", fields[column].parse::<f64>().unwrap() * factor);
        lines[1] = fields.join(",");
        lines.join("\n")
    };
    run(scene, stage, case.path());
    for (factor, allowed) in [(1.0 + 1e-14, true), (1.0 + 1e-9, false)] {
        std::fs::write(case.path().join("POSTPRO/series.csv"), series(factor)).unwrap();
        let changes = changes(stage, &expected(scene, stage), case.path());
        let change = changes.iter().find(|change| change.column == "R_enclosing").unwrap();
        assert_eq!(change.is_allowed(), allowed, "{change}");
    }
}
