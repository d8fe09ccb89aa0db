//! Which pairs are listed: those that come near each other, whatever motion they share, and none that closes is missed.

use cd_formats::compute::{Adaptive, ContactSolver, ExternalField};
use cd_formats::drv_dof::Evolution;
use cd_formats::snapshot::Snapshot;

use crate::case::{Case, Figures, Vec3, uniform};

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];

const DT: f64 = 0.0078125;

/// Shapes of the grains: the two ways in which contacts are found.
const SHAPES: [bool; 2] = [false, true];

/// Adds 125 grains about a place that move at random and, in addition, as `v` and `w` say of a place.
fn cluster(case: &mut Case, blocks: bool, about: [f64; 3], motion: impl Fn(Vec3) -> (Vec3, Vec3)) {
    let mut random = uniform(5);
    for k in 0..125 {
        // Gaps of half the alert distance.
        let x = Vec3::from([k % 5, k / 5 % 5, k / 25].map(|c| 1.0005 * (f64::from(c) - 2.0))) + Vec3::from(about);
        let body = if blocks { case.block([0.5; 3], x.into(), [X, Y, Z]) } else { case.sphere(0.5, x.into()) };
        let (v, w) = motion(x);
        let own = Vec3::from_fn(|_, _| 0.2 * (random() - 0.5));
        case.launch(body, (v + own).into(), w.into());
    }
}

fn scene(blocks: bool, motion: impl Fn(Vec3) -> (Vec3, Vec3)) -> Case {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    // Solutions decide nothing here.
    (case.options.dt, case.options.tol, case.options.max_sweeps) = (DT, Some(1e-2), Some(100));
    case.options.solver = ContactSolver::Nlgs;
    cluster(&mut case, blocks, [0.0; 3], motion);
    case
}

fn at_rest(_: Vec3) -> (Vec3, Vec3) {
    (Vec3::zeros(), Vec3::zeros())
}

/// Largest numbers of contacts listed and solved in the steps of a run.
fn largest_counts(case: &mut Case, steps: u64) -> [f64; 2] {
    case.run(steps);
    ["contacts_listed", "contacts_solved"].map(|name| case.column(name).into_iter().fold(0.0, f64::max))
}

/// Runs the scene and demands no more than `times` the contacts of 125 grains at rest.
#[track_caller]
fn expect_few(blocks: bool, case: &mut Case, steps: u64, times: f64) {
    let alone = largest_counts(&mut scene(blocks, at_rest), steps);
    let found = largest_counts(case, steps);
    assert!(alone[0] >= 300.0 && alone[1] >= 100.0, "{alone:?}");
    for (found, alone) in found.into_iter().zip(alone) {
        assert!(found <= times * alone, "blocks: {blocks}: {found}; alone {alone}");
    }
}

#[test]
fn common_motion_and_acceleration_list_no_pair() {
    for blocks in SHAPES {
        for speed in [1e2, 1e6] {
            let mut moving = scene(blocks, |_| (Vec3::new(speed, -2.0 * speed, 0.5 * speed), Vec3::zeros()));
            expect_few(blocks, &mut moving, 4, 3.0);
        }
        for gravity in [1e3, 1e6] {
            let mut falling = scene(blocks, at_rest);
            falling.gravity = [0.3 * gravity, 0.0, -gravity];
            expect_few(blocks, &mut falling, 4, 3.0);
            falling.options.adaptive = Some(Adaptive { max_multiple: 16, ..Adaptive::default() });
            expect_few(blocks, &mut falling, 20, 3.0);
        }
    }
}

#[test]
fn a_fall_to_a_planet_lists_no_pair() {
    for blocks in SHAPES {
        // At 1e6 m the fall is 2.5 m in a step, and tides part neighbours by 1e-5 m.
        let mut falling = scene(blocks, |_| (Vec3::new(3e4, 0.0, 0.0), Vec3::zeros()));
        let mass = 4e4 * 1e12 / 6.6743e-11;
        falling.options.fields =
            vec![ExternalField::PointMass { mass, position: Some([0.0, 1e6, 0.0]), orbit: None, response: false }];
        expect_few(blocks, &mut falling, 20, 3.0);
    }
}

#[test]
fn one_fast_fragment_lists_no_other_pair() {
    for blocks in SHAPES {
        for speed in [1e2, 1e6] {
            // It leaves from the surface, passes by, or flies far away.
            for (x, v) in [
                ([3.2, 0.0, 0.0], [speed, 0.0, 0.0]),
                ([-9.0, 4.0, 0.0], [speed, 0.0, 0.0]),
                ([1e6, 0.0, 0.0], [0.0, speed, speed]),
            ] {
                let mut case = scene(blocks, at_rest);
                let body = if blocks { case.block([0.5; 3], x, [X, Y, Z]) } else { case.sphere(0.5, x) };
                case.launch(body, v, [0.0; 3]);
                expect_few(blocks, &mut case, 4, 3.0);
            }
        }
    }
}

#[test]
fn a_body_far_away_lists_no_pair() {
    for blocks in SHAPES {
        for (distance, radius) in [(1e7, 0.5), (1e8, 1e7)] {
            let mut case = scene(blocks, at_rest);
            let body = case.sphere(radius, [distance, 0.0, 0.0]);
            case.launch(body, [-1e3, 1e3, 0.0], [0.0; 3]);
            expect_few(blocks, &mut case, 4, 3.0);
        }
    }
}

#[test]
fn groups_that_move_past_each_other_list_no_pair() {
    for blocks in SHAPES {
        // Apart from the start on; past each other along a plane.
        for (away, direction) in [([5.5, 0.0, 0.0], X), ([-30.0, 6.5, 0.0], X), ([0.0, 0.0, 40.0], Y)] {
            for speed in [1e2, 1e5] {
                let mut case = scene(blocks, at_rest);
                cluster(&mut case, blocks, away, |_| (Vec3::from(direction) * speed, Vec3::zeros()));
                expect_few(blocks, &mut case, 4, 2.0 * 3.0);
                let second = Vec3::from(direction) * (0.5 * speed);
                cluster(&mut case, blocks, away.map(|x| -1.3 * x), |_| (-second, Vec3::zeros()));
                expect_few(blocks, &mut case, 4, 3.0 * 3.0);
            }
        }
    }
}

#[test]
fn rigid_rotation_and_tides_list_no_pair() {
    for blocks in SHAPES {
        for turn in [0.02, 0.2, 0.5] {
            // Neighbours part along the tangent within a step: only the first has the lattice.
            let w = Vec3::new(0.2, -0.3, 0.9) * (turn / DT);
            let mut rigid = scene(blocks, |x| (w.cross(&x), w));
            rigid.options.theta = 1.0;
            expect_few(blocks, &mut rigid, 1, 3.0);
            let mut tides = scene(blocks, |x| (Vec3::new(2.0 * x.x, -x.y, -x.z) * (0.1 * turn / DT), Vec3::zeros()));
            tides.options.theta = 1.0;
            expect_few(blocks, &mut tides, 1, 3.0);
        }
        // Orbits without spins of their own.
        let w = Vec3::z() * (0.3 / DT);
        let mut orbits = scene(false, |x| (w.cross(&x), Vec3::zeros()));
        orbits.options.theta = 1.0;
        expect_few(false, &mut orbits, 1, 3.0);
    }
}

#[test]
fn a_fast_wall_lists_no_pair_of_grains() {
    for blocks in SHAPES {
        for speed in [1e2, 1e5] {
            // It leaves, moves along itself, or turns in its own plane.
            for component in [2, 0, 5] {
                let mut case = scene(blocks, at_rest);
                let wall = case.plate([1024.0, 1024.0, 0.5], [0.0, 0.0, 3.1], [X, Y, Z]);
                case.drive_along(wall, component, Evolution::constant(speed));
                expect_few(blocks, &mut case, 4, 3.0);
            }
        }
    }
}

#[test]
fn shear_of_a_periodic_cell_lists_no_pair() {
    for blocks in SHAPES {
        for rate in [0.1, 1.0, 3.0] {
            let mut case = scene(blocks, |x| (Vec3::x() * (rate / DT * x.z), Vec3::zeros()));
            (case.options.xperiode, case.options.yperiode) = (Some(5.0025), Some(5.0025));
            // Layers that slide over each other, in the step in which they still are layers.
            expect_few(blocks, &mut case, 1, 3.0);
        }
    }
}

/// Deepest overlap of spheres of radius 0.5 with each other, and of them with a floor in z = 0.
fn deepest(state: &Snapshot) -> f64 {
    let free = state.free();
    let pairs = free.iter().enumerate().flat_map(|(k, &i)| free[..k].iter().map(move |&j| (i, j)));
    let pairs = pairs.map(|(i, j)| 1.0 - (state.x(i) - state.x(j)).norm());
    pairs.chain(free.iter().map(|&i| 0.5 - state.x(i).z)).fold(0.0, f64::max)
}

/// Pairs that a push within the step closes are listed, though the free velocities are equal or 0: columns that fall many
/// radii in a step, and rows of which the first is hit.
#[test]
fn what_pushes_close_is_listed() {
    for speed in [10.0, 100.0, 1e3, 1e5] {
        let mut column = Case::new();
        column.law("IQS_CLB", &[0.5]);
        (column.options.dt, column.options.tol) = (DT, Some(1e-10));
        column.floor();
        for k in 0..6 {
            let body = column.sphere(0.5, [0.0, 0.0, 3.0 + 1.25 * f64::from(k)]);
            column.launch(body, [0.0, 0.0, -speed], [0.0; 3]);
        }
        let mut row = Case::new();
        row.law("IQS_CLB", &[0.0]);
        (row.options.dt, row.options.tol) = (DT, Some(1e-10));
        for k in 0..6 {
            let body = row.sphere(0.5, [1.25 * f64::from(k), 0.0, 0.5]);
            row.launch(body, [if k == 0 { speed } else { 0.0 }, 0.0, 0.0], [0.0; 3]);
        }
        for case in [&mut column, &mut row] {
            // Contacts are detected where bodies are, not half a step on, where they may lie behind their partners.
            case.options.theta = 1.0;
            for state in case.states(12, 1) {
                // Solutions to 1e-10 of the speed, times the step.
                let overlap = deepest(&state);
                assert!(overlap <= 1e-9 * speed * DT, "{speed}: step {}: {overlap}", state.meta.step);
            }
        }
    }
}
