//! Mirror-symmetric scenes: what has one solution stays symmetric, and what has none is reported in every step.

use cd_formats::compute::ContactSolver;
use cd_formats::drv_dof::Evolution;
use cd_formats::snapshot::Snapshot;

use crate::case::{Case, Figures, Vec3, near};

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];

/// Two plates around |x| < `half` that move apart at `speed` (m/s) each, and a floor.
fn abutments(case: &mut Case, half: f64, speed: f64) {
    case.floor();
    for side in [-1.0, 1.0] {
        let plate = case.plate([64.0, 64.0, 0.5], [side * (half + 0.5), 0.0, 0.0], [Y, Z, X]);
        case.drive_along(plate, 0, Evolution::constant(side * speed));
    }
}

/// A wall of blocks of 1 x 1/2 x 1/2 in running bond, `length` blocks long; each block comes with its mirror image.
fn wall(friction: f64, courses: usize, length: usize, speed: f64) -> (Case, Vec<[usize; 2]>) {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[friction]);
    case.gravity = [0.0, 0.0, -8.0];
    let half = 0.5 * length as f64;
    abutments(&mut case, half, speed);
    let mut pairs = Vec::new();
    for course in 0..courses {
        let z = 0.5 * course as f64 + 0.25;
        // Ends of the blocks of a course from left to right: every other one begins with half a block.
        let begin = if course % 2 == 0 { 0.0 } else { 0.5 };
        let cuts = (0..=length).map(|k| k as f64 + begin - half).filter(|x| *x < half);
        let mut ends: Vec<f64> = std::iter::once(-half).chain(cuts).chain([half]).collect();
        ends.dedup();
        let mut block = |[a, b]: [f64; 2]| case.block([0.5 * (b - a), 0.25, 0.25], [0.5 * (a + b), 0.0, z], [X, Y, Z]);
        let of_course: Vec<usize> = ends.windows(2).map(|ends| block([ends[0], ends[1]])).collect();
        pairs.extend(of_course.iter().zip(of_course.iter().rev()).map(|(a, b)| [*a, *b]));
    }
    (case, pairs)
}

#[track_caller]
fn is_symmetric(state: &Snapshot, pairs: &[[usize; 2]], bound: f64) {
    for &[a, b] in pairs {
        let [v, w] = [state.v(b), state.w(b)];
        near(state.v(a), Vec3::new(-v.x, v.y, v.z), bound);
        near(state.w(a), Vec3::new(w.x, -w.y, -w.z), bound);
    }
}

/// Nothing of it moves; where it rests its load is shared in many ways, and none of them turns a block.
#[test]
fn a_wall_stands_where_its_abutments_recede() {
    for friction in [0.0, 0.3, 0.8] {
        let (mut case, pairs) = wall(friction, 4, 4, 0.05);
        (case.options.dt, case.options.tol) = (1e-3, Some(1e-8));
        for state in &case.states(40, 10)[1..] {
            // 1e-8 of the speed of a step of free fall, 8e-3 m/s, and what twenty faces on each other make of it.
            is_symmetric(state, &pairs, 1e-8);
            pairs.iter().for_each(|[a, _]| near(state.v(*a), [0.0; 3], 1e-8));
        }
        assert!(case.column("converged").iter().all(|converged| *converged == 1.0), "{friction}");
    }
}

/// Ten balls of radius 1/2 in an upright triangle on the floor; each ball comes with its mirror image, the top one last.
fn triangle(case: &mut Case) -> Vec<[usize; 2]> {
    let mut pairs = Vec::new();
    for row in 0..4 {
        let count = 4 - row;
        let x = |k: usize| k as f64 - 0.5 * (count - 1) as f64;
        let z = 0.5 + row as f64 * 0.75f64.sqrt();
        let balls: Vec<usize> = (0..count).map(|k| case.sphere(0.5, [x(k), 0.0, z])).collect();
        pairs.extend(balls.iter().zip(balls.iter().rev()).map(|(a, b)| [*a, *b]));
    }
    pairs
}

/// Without friction velocities are unique: the balls of a triangle push those below them apart.
#[test]
fn a_heap_that_spreads_is_symmetric() {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.0]);
    case.gravity = [0.0, 0.0, -8.0];
    abutments(&mut case, 2.0, 0.5);
    let pairs = triangle(&mut case);
    let states = case.states(200, 50);
    // Each step is solved to 1e-12 of what it changes, 8e-3 m/s; 200 of them, and gaps that follow from them.
    states.iter().for_each(|state| is_symmetric(state, &pairs, 1e-9));
    let fallen = states[0].x(pairs[9][0]).z - states[4].x(pairs[9][0]).z;
    assert!(fallen > 1e-3, "{fallen}");
}

/// The same pile on a floor without abutments, under `friction`, 9.81 m/s² and steps of 5 ms.
fn pile(friction: f64, tol: f64, solver: ContactSolver) -> (Case, Vec<[usize; 2]>) {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[friction]);
    case.gravity = [0.0, 0.0, -9.81];
    case.floor();
    (case.options.dt, case.options.tol, case.options.solver) = (5e-3, Some(tol), solver);
    let pairs = triangle(&mut case);
    (case, pairs)
}

/// Sweeps go from contact to contact in an order that is not symmetric; a step is as symmetric as it is solved.
#[test]
fn a_pile_that_slides_apart_is_as_symmetric_as_its_steps_are_solved() {
    for friction in [0.0, 0.1] {
        for tol in [1e-2, 1e-4, 1e-8] {
            let (mut case, pairs) = pile(friction, tol, ContactSolver::Auto);
            let end = case.run(200);
            // Two mirrored velocities differ by twice the residual of a step, `tol` g h. A ball on a ball topples and magnifies
            // this at the rate of a point on a ball of radius 2R = 1, sqrt(g/(2R)).
            let rate = 9.81f64.sqrt();
            let bound = 2.0 * tol * 9.81 * 5e-3 * rate.sinh() / rate;
            for &[a, b] in &pairs {
                let image = end.x(b);
                near(end.x(a), Vec3::new(-image.x, image.y, image.z), bound);
            }
            assert!((end.x(pairs[0][0]).x + 1.5).abs() > 0.5, "{friction}: {}", end.x(pairs[0][0]));
        }
    }
}

/// Velocities of rigid bodies with friction need not be unique. Both motions satisfy the laws of every contact in every step:
/// the balls wedge each other, or they roll apart.
#[test]
fn one_pile_stands_or_falls() {
    for (solver, stands) in [(ContactSolver::Admm, true), (ContactSolver::Auto, false)] {
        let (mut case, pairs) = pile(0.6, 1e-8, solver);
        let end = case.run(40);
        assert!(case.column("converged").iter().all(|converged| *converged == 1.0), "{solver}");
        let top = end.x(pairs[9][0]) - Vec3::new(0.0, 0.0, 0.5 + 3.0 * 0.75f64.sqrt());
        // Forty steps move by the residual, 1e-8 of h g, or the top falls by a twentieth of g t²/2 = 0.2 m and more.
        assert!(if stands { top.norm() < 1e-8 } else { top.z < -0.01 }, "{solver}: {top}");
    }
}

/// Two cubes on a floor that meet: friction of their faces may press either of them to the floor, whose friction then moves
/// the pair. Each of the motions solves the step.
#[test]
fn mirrored_cubes_that_meet_have_several_motions() {
    let motion = |solver: ContactSolver| {
        let mut case = Case::new();
        case.law_of_all("RST_CLB", &[0.8, 0.0, 0.3]);
        case.gravity = [0.0, 0.0, -9.81];
        case.floor();
        let [left, right] = [-1.0, 1.0].map(|side| case.block([0.25; 3], [0.25 * side, 0.0, 0.25], [X, Y, Z]));
        case.launch(left, [2.0, 0.0, 0.0], [0.0; 3]);
        case.launch(right, [-2.0, 0.0, 0.0], [0.0; 3]);
        (case.options.dt, case.options.tol, case.options.solver) = (1e-3, Some(1e-12), solver);
        let end = case.run(1);
        assert_eq!(case.column("converged"), [1.0], "{solver}");
        (end, [left, right])
    };
    let (swept, [left, right]) = motion(ContactSolver::Nlgs);
    let (symmetric, pair) = motion(ContactSolver::ProxNewton);
    // The residual of 1e-12, of 2 m/s, by the number of contacts and more.
    is_symmetric(&symmetric, &[pair], 1e-9);
    let along = swept.v(left).x + swept.v(right).x;
    assert!(along.abs() > 1e-4, "{along}");
}

/// Rigid blocks between plates that close on them have nowhere to go.
#[test]
fn steps_without_a_solution_are_counted() {
    let (mut case, _) = wall(0.3, 1, 4, -0.02);
    (case.options.dt, case.options.tol, case.options.max_sweeps) = (1e-3, Some(1e-2), Some(200));
    let end = case.run(5);
    assert_eq!(case.column("converged"), [0.0; 5]);
    assert!(case.column("residual").iter().all(|residual| *residual > 1e-2));
    assert_eq!(end.meta.ledger.steps_unconverged, 5);
}

/// Two bars of three bonded cubes at the sides of a cube on a column: their lower edges lie on those of the column. With
/// friction at the limit of the bonds the solution of the step in which the bars tear off is not unique: of the solvers without
/// an order of contacts each finds another symmetric one.
#[test]
fn mirrored_bars_tear_off_a_column_alike() {
    for solver in [ContactSolver::ProxNewton, ContactSolver::Admm, ContactSolver::InteriorPoint] {
        let mut case = Case::new();
        case.law_of_all("IQS_MOHR_DS_CLB", &[100.0, 50.0, 0.2, 0.3]);
        case.gravity = [0.0, 0.0, -27.0];
        case.floor();
        let bars: Vec<usize> = (-3..4).map(|k| case.block([0.5; 3], [f64::from(k), 0.0, 3.0], [X, Y, Z])).collect();
        let pairs: Vec<[usize; 2]> = bars.iter().zip(bars.iter().rev()).map(|(a, b)| [*a, *b]).collect();
        case.block([0.5, 0.5, 1.25], [0.0, 0.0, 1.25], [X, Y, Z]);
        (case.options.dt, case.options.tol, case.options.solver) = (1e-3, Some(1e-8), solver);
        let state = case.run(1);
        assert!(case.column("bonds")[0] < 32.0, "{solver}");
        // Of velocities of 5e-3 m/s.
        is_symmetric(&state, &pairs, 1e-8);
    }
}

/// Cubes at both sides of a held one break off in the same step, at any load that differs from the strength by 3 %.
#[test]
fn mirrored_bonds_break_in_the_same_step() {
    for share in [0.9, 0.97, 1.03, 1.1] {
        let mut case = Case::new();
        // The face bears shear and the moment of half an edge: both upper corners pull with m g/4 each.
        case.law_of_all("IQS_MOHR_DS_CLB", &[1.0 / share, 100.0, 0.2, 0.3]);
        case.gravity = [0.0, 0.0, -1.0];
        case.plate([0.5; 3], [0.0; 3], [X, Y, Z]);
        for x in [-1.0, 1.0] {
            case.block([0.5; 3], [x, 0.0, 0.0], [X, Y, Z]);
        }
        (case.options.dt, case.options.tol) = (1e-3, None);
        case.run(2);
        let bonds = case.column("bonds");
        assert_eq!(bonds, if share < 1.0 { [8.0; 2] } else { [4.0, bonds[1]] }, "{share}");
    }
}
