//! Alternating direction method of multipliers.
//!
//! In units in which the diagonal blocks have trace 3, with v the only state and c = [`PENALTY`]:
//!
//! ```text
//! z = P_K(v),   y = v - z,   (W + c) r = c (z - y) - q - mu c |y_T| n,   v <- r + y
//! ```
//!
//! At rest r = z solves the problem and u + mu |u_T| n = -c y. One factorisation serves all iterations, which are
//! accelerated by Anderson's method.
//!
//! Sources: S. Boyd et al., Found. Trends Mach. Learn. 3 (2011) 1-122; for contact problems V. Acary, M. Bremond, O.
//! Huber, in Advanced Topics in Nonsmooth Dynamics, Springer (2018).

use super::anderson::AndersonAcceleration;
use super::factors::{BlockEntry, LuFactors, solution_cost};
use super::gauss_seidel::ANDERSON_DEPTH;
use super::run::SolverRun;
use super::scaled::ScaledProblem;
use super::types::LocalVector;

/// The penalty c, relative to the mean diagonal.
const PENALTY: f64 = 0.1;

/// Continues from the best iterate of the run until the run or the budget of `steps` is over.
pub fn solve_admm(run: &mut SolverRun, steps: u64) {
    let scaled = ScaledProblem::new(run.problem);
    let n = run.problem.len();
    if run.is_over() {
        return;
    }
    let mut matrix: Vec<BlockEntry> = Vec::new();
    for i in 0..n {
        for (j, w) in scaled.row_blocks(i) {
            let mut block = *w;
            if i == j {
                (0..3).for_each(|k| block[k][k] += PENALTY);
            }
            matrix.push((i, j, block));
        }
    }
    run.cost += run.problem.newton_cost();
    // LU rather than Cholesky factors: W may be slightly unsymmetric or indefinite.
    let Some(factors) = LuFactors::new(n, &matrix) else { return };
    let z = scaled.impulses_in(&run.best_r);
    let u = scaled.relative_velocities(&z);
    let mut v: Vec<LocalVector> = (0..n)
        .map(|i| {
            let slip = scaled.mu[i] * libm::hypot(u[i][1], u[i][2]);
            std::array::from_fn(|k| z[i][k] - (u[i][k] + if k == 0 { slip } else { 0.0 }) / PENALTY)
        })
        .collect();
    let mut anderson = AndersonAcceleration::new(ANDERSON_DEPTH, 3 * n);
    let solve_cost = solution_cost(3 * n, 9 * matrix.len());
    let mut right_side = vec![[0.0; 3]; n];
    let end = run.sweeps.saturating_add(steps);
    while !run.is_over() && run.sweeps < end {
        run.count_pass(solve_cost + run.problem.sweep_cost());
        let z: Vec<LocalVector> = v.iter().zip(&scaled.mu).map(|(v, mu)| project_to_cone(*v, *mu)).collect();
        run.record_iterate(&scaled.impulses_out(&z));
        for i in 0..n {
            let y: LocalVector = std::array::from_fn(|k| v[i][k] - z[i][k]);
            let slip = scaled.mu[i] * libm::hypot(y[1], y[2]);
            for k in 0..3 {
                let cone_shift = if k == 0 { slip } else { 0.0 };
                right_side[i][k] = PENALTY * (z[i][k] - y[k] - cone_shift) - scaled.q(i)[k];
            }
        }
        let r = factors.solve(&right_side);
        let next: Vec<LocalVector> = (0..n).map(|i| std::array::from_fn(|k| r[i][k] + v[i][k] - z[i][k])).collect();
        if !next.as_flattened().iter().all(|x| x.is_finite()) {
            return;
        }
        anderson.next_iterate(&mut v, &next);
    }
}

/// Nearest point of Coulomb's cone { |v_T| <= mu v_n }.
fn project_to_cone(v: LocalVector, mu: f64) -> LocalVector {
    let slope = (1.0 + mu * mu).sqrt();
    let (cos, sin) = (1.0 / slope, mu / slope);
    let t = libm::hypot(v[1], v[2]);
    // Along the side of the cone in the plane of v and n.
    let along = v[0] * cos + t * sin;
    if v[0] >= 0.0 && t * cos <= v[0] * sin {
        v
    } else if along <= 0.0 {
        [0.0; 3]
    } else {
        [along * cos, along * sin * v[1] / t, along * sin * v[2] / t]
    }
}
