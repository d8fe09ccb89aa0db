//! Runs that choose their options for a target error.

use cd_formats::accuracy::{Accuracy, AccuracyControl, Adaptive};
use cd_formats::compute::TargetErrors;

use crate::case::Case;
use crate::same_bits::{collapse, files, same};

/// Spheres or blocks that fall on a floor, with a target for each of some observables.
fn targeted(blocks: bool, target_error: TargetErrors) -> Case {
    let mut case = collapse(3, blocks);
    let options = &mut case.options;
    options.self_gravity = false;
    options.target_error = Some(target_error);
    (options.tol, options.max_sweeps) = (None, None);
    (options.steps, options.output_every) = (Some(240), 30);
    case
}

/// Targets of z and pressure.
fn both(error: f64) -> TargetErrors {
    TargetErrors { z: Some(error), pressure: Some(error), ..TargetErrors::default() }
}

/// State of the choice in the last snapshot.
fn last_control(case: &Case) -> AccuracyControl {
    case.last().meta.accuracy_control.expect("a choice of options")
}

#[test]
fn a_resumed_run_and_other_threads_make_the_same_choices() {
    for blocks in [false, true] {
        let case = || targeted(blocks, both(0.02));
        let unbroken_case = case();
        let unbroken = files(&unbroken_case, &[&["--threads", "1"]]);
        let control = last_control(&unbroken_case);
        assert!(control.comparisons > 1, "{control:?}");
        // A stop at a snapshot, where steps end anyway.
        same(&unbroken, &files(&case(), &[&["--steps", "90"], &["--resume", "--steps", "240"]]));
        same(&unbroken, &files(&case(), &[&["--threads", "3"]]));
    }
}

/// A smaller target is reached by smaller steps and more sweeps. `tol` itself may end larger: shorter steps leave smaller errors
/// at the same residual.
#[test]
fn a_smaller_target_takes_more_sweeps() {
    let runs = [0.1, 0.02, 0.005].map(|error| {
        let case = targeted(true, both(error));
        case.write();
        assert_eq!(case.solve(&["--threads", "1"]), 0);
        let control = last_control(&case);
        (control.penetration, case.column("time").len(), control.step_sweeps)
    });
    for pair in runs.windows(2) {
        let [(penetration, steps, sweeps), (next_penetration, next_steps, next_sweeps)] = [pair[0], pair[1]];
        assert!(next_penetration < penetration && next_steps > steps && next_sweeps > sweeps, "{runs:?}");
    }
}

/// End of the line about a target of ν in the summary of a changed run: the last words first.
fn verdict(nu: f64, change: impl FnOnce(&mut Case)) -> String {
    let mut case = targeted(false, TargetErrors { nu: Some(nu), ..TargetErrors::default() });
    change(&mut case);
    case.write();
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    let line = text.lines().find(|line| line.contains("  target error  ")).unwrap_or_else(|| panic!("{text}"));
    line.rsplit("; ").take(2).collect::<Vec<_>>().join("; ")
}

/// Estimates do not count where they were never measured.
#[test]
fn no_target_is_called_reached_without_a_measured_error() {
    assert!(verdict(0.3, |_| ()).starts_with("reached; "), "{}", verdict(0.3, |_| ()));
    let doubt = verdict(0.3, |case| case.options.steps = Some(0));
    assert!(doubt.contains("not known: no contact has carried force"), "{doubt}");
    let doubt = verdict(0.3, |case| case.options.max_sweeps = Some(1));
    assert!(doubt.contains("did not converge") && doubt.starts_with("raise max_sweeps; "), "{doubt}");
    let doubt = verdict(0.3, |case| case.options.dt *= 8.0);
    assert!(doubt.contains("not known: errors by dt are known up to a dt of "), "{doubt}");
    assert!(doubt.starts_with("lower dt; "), "{doubt}");
}

/// An `adaptive` that is set is what to change where its steps are too long.
#[test]
fn the_option_to_lower_is_the_one_that_is_in_force() {
    let verdict = verdict(0.01, |case| {
        case.options.adaptive = Some(Adaptive { max_multiple: 4, travel: 1.0, penetration: 0.1 });
    });
    let expected = "not reached, mainly length of steps: lower travel and penetration of adaptive; ";
    assert!(verdict.starts_with(expected), "{verdict}");
}

/// An option that is set keeps its value, and is in force in all snapshots.
#[test]
fn options_that_are_set_are_not_chosen() {
    let mut case = targeted(false, both(0.02));
    case.options.tol = Some(1e-3);
    for state in case.states(60, 30) {
        assert_eq!(state.meta.parameters.tol, 1e-3);
        assert!(state.meta.parameters.adaptive.is_some());
    }
}

/// Steps have 4 `dt` for Z 1 %, and 6 `dt` of polyhedra for other observables, proportional to the target to the power 0.63,
/// of Z of spheres to twice that power.
#[test]
fn steps_are_limited_by_z_and_with_polyhedra_by_all_observables() {
    let multiple = |blocks, targets| {
        let states = targeted(blocks, targets).states(60, 30);
        states.last().unwrap().meta.parameters.adaptive.map_or(1, |adaptive| adaptive.max_multiple)
    };
    let z = |error| TargetErrors { z: Some(error), ..TargetErrors::default() };
    let nu = |error| TargetErrors { nu: Some(error), ..TargetErrors::default() };
    assert_eq!([0.001, 0.01, 0.03].map(|error| multiple(false, z(error))), [1, 4, 15]);
    assert_eq!([0.001, 0.01, 0.03].map(|error| multiple(true, z(error))), [1, 4, 7]);
    assert_eq!([0.001, 0.01, 0.03].map(|error| multiple(true, nu(error))), [1, 6, 11]);
    assert_eq!(multiple(true, both(0.03)), 7);
    assert!(multiple(false, nu(0.03)) > 1000);
}

/// Errors of Z by contacts, and by the step without that by overlaps, twice its other error, in ERRORS.csv; `None` where the
/// field is empty.
fn z_errors(case: &Case) -> [Option<f64>; 2] {
    let text = std::fs::read_to_string(case.path().join("ERRORS.csv")).unwrap();
    [("contacts", 0.0), ("step", 2.0)].map(|(name, factor)| {
        let row = text.lines().find(|line| line.starts_with(name)).unwrap();
        let cells: Vec<&str> = row.split(',').collect();
        let z_error = cells[3].parse::<f64>().ok();
        z_error.map(|z_error| z_error - factor * cells[2].parse::<f64>().unwrap())
    })
}

/// Blocks or spheres that fall on a floor with a preset.
fn preset(blocks: bool, accuracy: Option<Accuracy>) -> Case {
    let mut case = targeted(blocks, both(0.02));
    (case.options.target_error, case.options.accuracy) = (None, accuracy);
    case
}

/// `tol` of the presets is 0.02, 0.005 and 0.001, of which the first has an error of 1.2 % and the others, by the root, of 0.6 %
/// and 0.27 %. The length of steps adds to that of runs with longer steps than `dt`.
#[test]
fn runs_with_a_preset_state_their_error_of_z() {
    let errors = |accuracy| {
        let case = preset(false, accuracy);
        files(&case, &[&[]]);
        z_errors(&case)
    };
    let [draft, standard, fine] = [Accuracy::Draft, Accuracy::Standard, Accuracy::Fine].map(|it| errors(Some(it)));
    let [contacts, steps] = [0, 1].map(|k| [draft, standard, fine].map(|errors: [Option<f64>; 2]| errors[k].unwrap()));
    assert!((contacts[0] - 1.2e-2).abs() < 1e-12 && (contacts[1] - 6e-3).abs() < 1e-12, "{contacts:?}");
    assert!((contacts[2] - 2.7e-3).abs() < 1e-4, "{contacts:?}");
    // 3.5 % by 0.3 and 0.1, the penetrations over 0.01, to the power 0.6.
    let expected = [1.6996e-2, 8.7916e-3, 0.0];
    assert!(steps.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-6), "{steps:?}");
    assert_eq!(errors(None), [None; 2]);
}

/// Grains that fly in self-gravity have an error of the step that is none of Z.
#[test]
fn an_error_in_flight_is_no_error_of_z() {
    let mut case = preset(false, Some(Accuracy::Fine));
    case.options.self_gravity = true;
    files(&case, &[&[]]);
    let [_, step] = z_errors(&case);
    // The part by overlaps is twice what the error has without that in flight; steps are not longer than `dt`.
    assert!(step.unwrap() < 0.0, "{step:?}");
}

#[test]
fn a_resumed_run_and_other_threads_state_the_same_error_of_z() {
    for blocks in [false, true] {
        let errors = |runs: &[&[&str]]| {
            let case = preset(blocks, Some(Accuracy::Draft));
            files(&case, runs);
            z_errors(&case)
        };
        let unbroken = errors(&[&["--threads", "1"]]);
        assert!(unbroken[1].unwrap() > 0.0);
        assert_eq!(errors(&[&["--steps", "90"], &["--resume", "--steps", "240"]]), unbroken);
        assert_eq!(errors(&[&["--threads", "3"]]), unbroken);
    }
}
