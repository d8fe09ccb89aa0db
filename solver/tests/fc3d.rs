//! Stored contact problems: real ones to 1e-8 by every solver, degenerate ones without a number that is not finite.

use std::path::{Path, PathBuf};

use cd_formats::fc3d::Fc3d;
use cd_solve::solve::matrix::{
    LocalVector, MatrixBlock, MatrixProblem, MatrixSolution, MatrixSolver, SolverLimits, residual, solve,
};
use proptest::prelude::*;

const TOL: f64 = 1e-8;
const ONE: MatrixBlock = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fc3d").join(name).with_extension("fc3d")
}

fn load(name: &str) -> MatrixProblem {
    let Fc3d { mu, free_velocities: q, blocks, .. } = Fc3d::read(&file(name)).unwrap();
    MatrixProblem::new(mu, q, blocks.iter().map(|b| (b.row, b.column, b.w))).unwrap()
}

fn limits(max_sweeps: u64) -> SolverLimits {
    SolverLimits { tol: TOL, max_sweeps, max_time: None, max_cost: f64::INFINITY }
}

fn solved(problem: &MatrixProblem, solver: MatrixSolver, max_sweeps: u64) -> MatrixSolution {
    solve(problem, solver, &[], limits(max_sweeps))
}

/// Sweeps that each solver may take: twice what it took when this was written. Plain sweeps never solve oneobject-499.
#[test]
fn real_problems_reach_the_tolerance() {
    use MatrixSolver::{Admm, Auto, InteriorPoint, Nlgs, NlgsAnderson, ProxNewton};
    for (name, limits) in [
        ("onecontact-rr", [(Auto, 2), (Nlgs, 2), (NlgsAnderson, 2), (ProxNewton, 10), (Admm, 32), (InteriorPoint, 36)]),
        (
            "confeti-ex13-4c",
            [(Auto, 2), (Nlgs, 2), (NlgsAnderson, 2), (ProxNewton, 4), (Admm, 18), (InteriorPoint, 18)],
        ),
        ("rover-4609", [(Auto, 14), (Nlgs, 26), (NlgsAnderson, 14), (ProxNewton, 12), (Admm, 74), (InteriorPoint, 46)]),
        (
            "nespheres-10",
            [(Auto, 16), (Nlgs, 38), (NlgsAnderson, 16), (ProxNewton, 8), (Admm, 52), (InteriorPoint, 34)],
        ),
        (
            "oneobject-499",
            [(Auto, 662), (Nlgs, 0), (NlgsAnderson, 2000), (ProxNewton, 20), (Admm, 500), (InteriorPoint, 72)],
        ),
    ] {
        let problem = load(name);
        for (solver, max_sweeps) in limits.into_iter().filter(|limit| limit.1 > 0) {
            let solution = solved(&problem, solver, max_sweeps);
            assert!(solution.converged && solution.residual <= TOL, "{name} {solver:?}: {solution:?}");
            assert_eq!(solution.residual, residual(&problem, &solution.r));
            let again = solved(&problem, solver, max_sweeps);
            assert_eq!((solution.r, solution.sweeps), (again.r, again.sweeps), "{name} {solver:?}");
        }
    }
}

#[test]
fn an_unreached_tolerance_is_reported_with_the_best_solution() {
    let problem = load("oneobject-499");
    let few = solved(&problem, MatrixSolver::Nlgs, 300);
    assert!(!few.converged && few.sweeps == 300 && few.residual < 0.1, "{}", few.residual);
    let none = solve(&problem, MatrixSolver::Auto, &[], SolverLimits { tol: 0.0, ..limits(3000) });
    assert!(!none.converged && none.residual < TOL, "{}", none.residual);
    let at_once =
        solve(&problem, MatrixSolver::Auto, &[], SolverLimits { max_time: Some(Default::default()), ..limits(9) });
    assert!(!at_once.converged && at_once.sweeps == 0);
}

/// A block on a slope: closed forms of parting, sticking and sliding, at any friction.
#[test]
fn one_contact_of_every_kind() {
    for (_, solver) in MatrixSolver::ALL {
        let one = |mu: f64, q: LocalVector| {
            let problem = MatrixProblem::new(vec![mu], vec![q], [(0, 0, ONE)]).unwrap();
            let solution = solved(&problem, solver, 2000);
            assert!(solution.converged, "{solver:?} {mu} {q:?}: {solution:?}");
            solution.r[0]
        };
        let near = |a: LocalVector, b: LocalVector| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-7);
        assert!(near(one(0.5, [1.0, 2.0, 0.0]), [0.0, 0.0, 0.0]), "{solver:?}");
        assert!(near(one(0.5, [-2.0, 0.5, 0.0]), [2.0, -0.5, 0.0]), "{solver:?}");
        assert!(near(one(0.5, [-2.0, 0.0, 3.0]), [2.0, 0.0, -1.0]), "{solver:?}");
        assert!(near(one(0.0, [-2.0, 3.0, 3.0]), [2.0, 0.0, 0.0]), "{solver:?}");
        // Alternating directions creep where mu |u_T| is large.
        let large = if solver == MatrixSolver::Admm { 2.5 } else { 1e6 };
        assert!(near(one(large, [-2.0, 3.0, 3.0]), [2.0, -3.0, -3.0]), "{solver:?}");
        assert!(near(one(0.5, [0.0, 0.0, 0.0]), [0.0, 0.0, 0.0]), "{solver:?}");
    }
}

#[test]
fn degenerate_problems_stay_finite() {
    let zero = [[0.0; 3]; 3];
    let dependent = |q: LocalVector| {
        // Twice the same contact: W is singular, any share of the impulse will do.
        MatrixProblem::new(vec![0.5; 2], vec![q; 2], [(0, 0, ONE), (0, 1, ONE), (1, 0, ONE), (1, 1, ONE)]).unwrap()
    };
    for (_, solver) in MatrixSolver::ALL {
        let empty = solved(&MatrixProblem::new(vec![], vec![], []).unwrap(), solver, 10);
        assert!(empty.converged && empty.r.is_empty());
        for q in [[-1.0, 0.2, 0.0], [-1.0, 3.0, 0.0], [1.0, 1.0, 1.0]] {
            let solution = solved(&dependent(q), solver, 2000);
            assert!(solution.converged, "{solver:?} {q:?}: {solution:?}");
        }
        // No impulse can stop what has no W: rejected by the residual, not by a NaN.
        let fixed = MatrixProblem::new(vec![0.5; 2], vec![[-1.0, 0.1, 0.0]; 2], [(0, 0, ONE), (1, 1, zero)]).unwrap();
        let solution = solved(&fixed, solver, 500);
        assert!(!solution.converged && solution.residual.is_finite(), "{solver:?}: {solution:?}");
        assert!(solution.r.as_flattened().iter().all(|x| x.is_finite()));
    }
}

#[test]
fn what_is_no_problem_is_rejected() {
    let refused = |mu: f64, q: f64, at: usize, w: f64| {
        MatrixProblem::new(vec![mu], vec![[q, 0.0, 0.0]], [(0, at, ONE.map(|row| row.map(|x| x * w)))]).is_err()
    };
    assert!(!refused(0.5, 1.0, 0, 1.0));
    for bad in [f64::NAN, f64::INFINITY] {
        assert!(refused(bad, 1.0, 0, 1.0) && refused(0.5, bad, 0, 1.0) && refused(0.5, 1.0, 0, bad));
    }
    assert!(refused(-0.1, 1.0, 0, 1.0) && refused(0.5, 1.0, 1, 1.0));
    assert!(MatrixProblem::new(vec![], vec![[0.0; 3]], []).is_err());
}

#[test]
fn the_residual_is_that_of_the_definition() {
    // r = 0: F = -P_K(-rho u^) = -rho P_K((1, 0, 0)), and rho |q| = rho.
    let problem = MatrixProblem::new(vec![0.5], vec![[-1.0, 0.0, 0.0]], [(0, 0, ONE)]).unwrap();
    assert_eq!(residual(&problem, &[[0.0; 3]]), 1.0);
    assert_eq!(residual(&problem, &[[1.0, 0.0, 0.0]]), 0.0);
    assert_eq!(residual(&problem, &[[3.0, 0.0, 0.0]]), 2.0);
    // The same in other units.
    let scaled =
        MatrixProblem::new(vec![0.5], vec![[-6.0, 0.0, 0.0]], [(0, 0, ONE.map(|w| w.map(|x| 2.0 * x)))]).unwrap();
    assert_eq!(residual(&scaled, &[[9.0, 0.0, 0.0]]), 2.0);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// W = H' H of random arms with fewer bodies than contacts need, q = H' v: some impulse always solves it.
    #[test]
    fn random_hyperstatic_problems_are_solved(
        h in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 6 * 5),
        v in prop::array::uniform6(-1.0..1.0f64),
        mu in prop_oneof![Just(0.0), 0.1..1.0f64],
    ) {
        // Contact i has the rows h[6 i ..][k] for the velocities k of one body; normals are made to oppose v.
        let contacts = 5;
        let row = |i: usize, l: usize, k: usize| h[6 * i + k][l] + if l == 0 && k == 0 { 1.5 } else { 0.0 };
        let blocks = (0..contacts * contacts).map(|p| {
            let (i, j) = (p / contacts, p % contacts);
            let w = std::array::from_fn(|a| std::array::from_fn(|b| (0..6).map(|k| row(i, a, k) * row(j, b, k)).sum()));
            (i, j, w)
        });
        let q = (0..contacts).map(|i| std::array::from_fn(|a| (0..6).map(|k| row(i, a, k) * v[k]).sum())).collect();
        let problem = MatrixProblem::new(vec![mu; contacts], q, blocks).unwrap();
        let solution = solved(&problem, MatrixSolver::Auto, 20_000);
        prop_assert!(solution.converged, "{:?}", solution);
    }

    /// For any W, symmetric or not, solvers end with finite numbers and an honest residual.
    #[test]
    fn any_matrix_leaves_finite_numbers(
        w in prop::collection::vec(prop::array::uniform9(-1e3..1e3f64), 9),
        q in prop::collection::vec(prop::array::uniform3(-1e3..1e3f64), 3),
        mu in prop::collection::vec(0.0..2.0f64, 3),
        solver in 0..MatrixSolver::ALL.len(),
    ) {
        let blocks = w.iter().enumerate().map(|(p, w)| (p / 3, p % 3, [0, 1, 2].map(|a| [0, 1, 2].map(|b| w[3 * a + b]))));
        let problem = MatrixProblem::new(mu, q, blocks).unwrap();
        let solution = solved(&problem, MatrixSolver::ALL[solver].1, 1500);
        prop_assert!(solution.r.as_flattened().iter().all(|x| x.is_finite()));
        prop_assert_eq!(solution.residual, residual(&problem, &solution.r));
    }
}
