//! Runs that choose their options for a target error.

use cd_formats::accuracy::AccuracyControl;
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

/// A smaller target is reached by smaller steps and residuals, at a larger cost.
#[test]
fn a_smaller_target_takes_more_sweeps() {
    let runs = [0.1, 0.02, 0.005].map(|error| {
        let case = targeted(true, both(error));
        case.write();
        assert_eq!(case.solve(&["--threads", "1"]), 0);
        let control = last_control(&case);
        (control.penetration, control.tol, case.column("time").len(), control.step_sweeps)
    });
    for pair in runs.windows(2) {
        let [(penetration, tol, steps, sweeps), (next_penetration, next_tol, next_steps, next_sweeps)] =
            [pair[0], pair[1]];
        assert!(next_penetration < penetration && next_tol < tol, "{runs:?}");
        assert!(next_steps > steps && next_sweeps > sweeps, "{runs:?}");
    }
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
