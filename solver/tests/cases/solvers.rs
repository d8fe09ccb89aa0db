//! The option `solver`: all of them find the same, `auto` continues where sweeps stall; and LMGC90's criteria.

use std::process::Command;

use cd_formats::compute::ContactSolver::{self, Admm, Auto, InteriorPoint, Nlgs, NlgsAnderson, ProxNewton};
use cd_formats::compute::SweepPrecision;
use cd_formats::fc3d::Fc3d;
use cd_formats::snapshot::Snapshot;
use cd_solve::solve::matrix::{MatrixProblem, MatrixSolver, SolverLimits, solve};

use crate::case::{Case, Figures, Vec3, near};
use crate::same_bits::{files, same};

/// Spheres of radius 1/2 that fill a tub without a gap, two layers of three by three, pushed askew: more contacts than
/// motions, and rough ones.
fn packed(solver: ContactSolver, friction: f64) -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[friction]);
    case.gravity = [2.0, 1.0, -8.0];
    case.tub(1.5);
    for k in 0..18 {
        let [i, j, l] = [k % 3, k / 3 % 3, k / 9].map(f64::from);
        // With the overlaps that half a step at these velocities makes.
        let (v, half) = ([0.3 * j, -0.2 * l, -0.1 * i], 0.5 * case.options.dt);
        let ball = case.sphere(0.5, [i - 1.0 + half * v[0], j - 1.0 + half * v[1], l + 0.5 + half * v[2]]);
        case.launch(ball, v, [i, -j, 2.0 * l]);
    }
    // A round of sweeps, and a margin for the sweeps after it, which count too.
    (case.options.solver, case.options.tol, case.options.max_sweeps) = (solver, Some(1e-8), Some(5000));
    case
}

/// Two spheres on a floor and a third on top, that slide.
fn pyramid(solver: ContactSolver) -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.25]);
    case.gravity = [1.0, 0.0, -8.0];
    case.floor();
    for x in [[-0.5, 0.0, 0.5], [0.5, 0.0, 0.5], [0.0, 0.0, 0.5 + 0.75f64.sqrt()]] {
        let ball = case.sphere(0.5, x);
        case.launch(ball, [2.0, 0.5, 0.0], [0.0; 3]);
    }
    (case.options.solver, case.options.tol, case.options.max_sweeps) = (solver, Some(1e-8), Some(2000));
    case
}

/// Three hundred spheres that have settled in a box three of them wide, as if nothing were known of their forces.
pub fn column_at_rest(solver: ContactSolver) -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    case.gravity = [0.0, 0.0, -9.81];
    case.tub(1.5);
    for line in include_str!("column_of_300.csv").lines().skip(1) {
        let numbers: Vec<f64> = line.split(',').map(|number| number.parse().unwrap()).collect();
        case.sphere(numbers[3], [numbers[0], numbers[1], numbers[2]]);
    }
    (case.options.solver, case.options.tol, case.options.dt) = (solver, Some(1e-2), 5e-3);
    case.options.max_sweeps = Some(5000);
    case
}

fn all_converged(case: &Case) -> bool {
    case.column("converged").iter().all(|c| *c == 1.0)
}

/// Largest difference of velocities, m/s.
fn difference(a: &Snapshot, b: &Snapshot) -> f64 {
    a.free().iter().map(|&i| (a.v(i) - b.v(i)).norm().max((a.w(i) - b.w(i)).norm())).fold(0.0, f64::max)
}

#[test]
fn newtons_method_finds_what_auto_finds_where_sweeps_stall() {
    let run = |solver| {
        let mut case = packed(solver, 0.3);
        let end = case.run(3);
        (all_converged(&case), end)
    };
    let (auto, newton) = (run(Auto), run(ProxNewton));
    assert_eq!([auto.0, newton.0, run(Nlgs).0], [true, true, false]);
    // Velocities of 1 m/s solved to 1e-8, in a system that may amplify that a hundred times.
    assert!(difference(&auto.1, &newton.1) < 1e-6, "{}", difference(&auto.1, &newton.1));
}

#[test]
fn a_column_takes_up_its_weight_where_sweeps_would_let_it_creep() {
    let run = |solver, precision| {
        let mut case = column_at_rest(solver);
        case.options.sweep_precision = precision;
        let end = case.run(1);
        let squares: f64 = end.free().iter().map(|&i| end.v(i).norm_squared()).sum();
        let speed = (squares / end.free().len() as f64).sqrt() / (9.81 * case.options.dt);
        println!("{solver} {precision:?}: {} sweeps, speed {speed}", case.column("sweeps")[0]);
        assert!(all_converged(&case), "{solver}");
        (case.column("sweeps")[0], speed)
    };
    for precision in [SweepPrecision::Single, SweepPrecision::Double] {
        let (auto, nlgs) = (run(Auto, precision), run(Nlgs, precision));
        assert!(auto.0 < nlgs.0 && auto.1 < nlgs.1, "{auto:?} {nlgs:?}");
    }
}

#[test]
fn auto_waits_longer_and_longer_where_all_that_it_can_is_in_vain() {
    let hopeless = || {
        let mut case = packed(Auto, 0.3);
        // Below what rounding lets solvers reach, unless all parts; and ten passes after the sweeps gain next to nothing.
        (case.options.tol, case.options.steps, case.options.output_every) = (Some(1e-18), Some(12), 12);
        case.options.max_sweeps = Some(1010);
        case
    };
    let case = hopeless();
    let unbroken = files(&case, &[&[]]);
    let (mut failures, mut due, mut spared) = (0, 0, 0);
    for (step, (converged, sweeps)) in case.column("converged").into_iter().zip(case.column("sweeps")).enumerate() {
        if step < due {
            assert!(sweeps <= 1000.0, "step {step}: {sweeps} sweeps");
            spared += 1;
        } else if converged == 0.0 {
            assert!(sweeps > 1000.0, "step {step}: {sweeps} sweeps");
            failures += 1;
            due = step + (1 << failures);
        } else if sweeps > 1000.0 {
            (failures, due) = (0, 0);
        }
    }
    assert!(spared >= 4, "{spared}");
    // The wait outlives a restart, which leaves nothing else behind.
    let mut resumed = files(&hopeless(), &[&["--steps", "4"], &["--resume"]]);
    assert!(resumed.remove("snapshot-000004.npz").is_some());
    same(&unbroken, &resumed);
}

#[test]
fn all_solvers_let_a_pyramid_slide_alike() {
    let ends = [Auto, Nlgs, NlgsAnderson, ProxNewton, Admm, InteriorPoint].map(|solver| {
        let mut case = pyramid(solver);
        let end = case.run(3);
        assert!(all_converged(&case), "{solver}");
        end
    });
    for end in &ends {
        assert!(difference(&ends[0], end) < 1e-6, "{}", difference(&ends[0], end));
    }
}

#[test]
fn a_problem_written_out_has_the_impulses_of_its_step() {
    let mut case = pyramid(Nlgs);
    (case.options.tol, case.options.output_every, case.options.steps) = (Some(1e-10), 1, Some(3));
    case.write();
    assert_eq!(case.solve(&["--dump-problem", "2"]), 0);
    let Fc3d { name, mu, free_velocities: q, blocks, .. } =
        Fc3d::read(&case.path().join("problem-000002.fc3d")).unwrap();
    assert_eq!(name, "step-000002");
    let problem = MatrixProblem::new(mu, q, blocks.iter().map(|b| (b.row, b.column, b.w))).unwrap();
    let limits = SolverLimits { tol: 1e-10, max_sweeps: 2000, max_time: None, max_cost: f64::INFINITY };
    let found = solve(&problem, MatrixSolver::ProxNewton, &[], limits);
    assert!(found.converged, "{}", found.residual);
    // All contacts of the step touch, so all are in the problem, in the same order.
    let step = &case.written()[2];
    let forces = &step.contacts.contact_force;
    assert!(forces.len() == found.r.len() && forces.len() >= 4, "{} {}", forces.len(), found.r.len());
    let scale = forces.iter().map(|force| Vec3::from(*force).norm()).fold(0.0, f64::max) * case.options.dt;
    for (force, r) in forces.iter().zip(found.r) {
        // Both to 1e-10, in a system that may amplify that a hundred times.
        near(Vec3::from(*force) * case.options.dt, r, 2e-8 * scale);
    }
}

#[test]
fn a_resting_ball_stays_solved_when_the_step_changes() {
    // Its impulse is m g h: rescaled by the warm start, it is the solution of the next step, too.
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.3]);
    case.gravity = [0.0, 0.0, -8.0];
    case.floor();
    case.sphere(0.5, [0.0, 0.0, 0.5]);
    case.run(5);
    assert_eq!(case.solve(&["--resume", "--steps", "10", "--dt", "0.00025"]), 0);
    let sweeps = case.column("sweeps");
    assert!(sweeps[0] > 0.0 && sweeps[1..].iter().all(|s| *s == 0.0), "{sweeps:?}");
    near(case.last().v(1), Vec3::zeros(), 1e-15);
}

#[test]
fn criteria_of_lmgc90_fall_with_the_residual() {
    let criteria = |tol: f64| {
        let mut case = packed(Nlgs, 0.3);
        (case.options.lmgc90_norms, case.options.tol) = (true, Some(tol));
        case.run(1);
        ["quad_dv", "quad_dvr", "maxm_dv", "maxm_dvr", "mean_dvor"].map(|name| case.column(name)[0].abs())
    };
    let (loose, tight) = (criteria(1e-2), criteria(1e-8));
    for (loose, tight) in loose.into_iter().zip(tight) {
        assert!(loose > 1e-6 && loose < 1.0 && tight < 1e-3 * loose, "{loose} {tight}");
    }
}

#[test]
fn convergence_is_checked_where_it_is_requested() {
    for law in ["IQS_CLB", "IQS_DS_ROLL_CLB"] {
        let mut case = packed(Nlgs, 0.3);
        if law == "IQS_DS_ROLL_CLB" {
            case.law(law, &[0.3, 0.3, 0.1, 0.1]);
        }
        (case.options.tol, case.options.check_every) = (Some(1e-2), Some(30));
        case.run(4);
        // The first blocks too: a start that is right already is not asked.
        assert!(case.column("sweeps").iter().all(|sweeps| *sweeps >= 30.0 && sweeps % 30.0 == 0.0), "{law}");
        assert!(all_converged(&case), "{law}");
    }
}

/// Output and warnings of a run from the beginning.
pub fn message(case: &Case) -> [String; 2] {
    case.write();
    let program = env!("CARGO_BIN_EXE_cd-solve");
    let output = Command::new(program).arg(case.path()).args(["--force", "--steps", "3"]).output().unwrap();
    assert!(output.status.success());
    [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap())
}

#[test]
fn the_worst_contact_is_reported_with_its_position() {
    // A block on a floor, pushed askew: four contacts of one pair.
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.3]);
    case.gravity = [1.0, 0.5, -8.0];
    case.floor();
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let block = case.block([1.0, 0.5, 0.25], [3.0, 2.0, 0.25], axes);
    case.launch(block, [1.0, 0.3, -1.0], [0.5, 0.2, 0.7]);
    (case.options.solver, case.options.max_sweeps) = (Nlgs, Some(1));
    let [_, warnings] = message(&case);
    let line = warnings.lines().next().expect("a step that did not converge");
    let (_, place) = line.split_once(", worst contact bodies 2-1 at (").expect(line);
    let (numbers, rest) = place.split_once(") m").expect(line);
    assert_eq!(rest, "; continuing; raise max_sweeps or use a smaller dt", "{line}");
    let numbers: Vec<f64> = numbers.split(", ").map(|number| number.parse().unwrap()).collect();
    // Of the first step, in which the block moves by less than 1e-3 m: one of the corners below it.
    let corner = [(numbers[0] - 3.0).abs(), (numbers[1] - 2.0).abs(), numbers[2]];
    near(corner, [1.0, 0.5, 0.0], 2e-3);
}

#[test]
fn steps_are_solved_further_where_overlap_was_left() {
    let run = |solver, penetration_tol| {
        let mut case = packed(solver, 0.3);
        (case.options.tol, case.options.penetration_tol) = (Some(1e-2), penetration_tol);
        let states = case.states(6, 1);
        let left = [1, 6].map(|step| states[step].meta.ledger.penetration_left);
        assert!(all_converged(&case), "{solver}");
        (case.column("residual"), case.column("sweeps"), left)
    };
    for solver in [Auto, Nlgs, ProxNewton] {
        let [plain, coarse, fine] = [None, Some(1.0), Some(1e-12)].map(|tol| run(solver, tol));
        // Little has been left, and nothing is required.
        assert_eq!(plain, coarse, "{solver}");
        assert!(1e-9 < plain.2[0] && plain.2[1] < 5e-4, "{solver}: {:?}", plain.2);
        // The first step does not know yet what it leaves; the others go to a hundredth of the tolerance.
        assert_eq!(plain.0[0], fine.0[0], "{solver}");
        assert!(fine.0[1..].iter().all(|residual| *residual <= 1e-4), "{solver}: {:?}", fine.0);
        let grown = |[first, last]: [f64; 2]| last - first;
        assert!(grown(fine.2) < 0.3 * grown(plain.2), "{solver}: {:?} and {:?}", fine.2, plain.2);
    }
}

#[test]
fn what_a_solver_leaves_unsolved_it_has_not_found() {
    let mut case = pyramid(Admm);
    (case.options.steps, case.options.max_sweeps) = (Some(3), Some(8));
    case.write();
    let output = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).output().unwrap();
    let message = String::from_utf8(output.stdout).unwrap();
    assert!(
        message.contains("unconverged steps      3 in this run") && !message.contains("matrix solver"),
        "{message}"
    );
}
