//! Proximal point with a semismooth Newton method inside.
//!
//! The outer loop solves, from r_k, the problem of u = W r + q + a (r - r_k). It is regular even if W is not, and has the
//! same solutions when r = r_k. Newton's method solves it as Phi(r) = 0,
//!
//! ```text
//! tau = r - u,   Phi_n = r_n - max(0, tau_n),   Phi_T = r_T - P(tau_T; mu max(0, tau_n)),
//! ```
//!
//! with P the projection on the disc of that radius, all in units in which the diagonal blocks have trace 3. Easy problems
//! make a smaller, hard ones larger.
//!
//! Sources: P. Alart, A. Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991) 353-375 (Phi); V. Acary, M.
//! Bremond, O. Huber, in Advanced Topics in Nonsmooth Dynamics, Springer (2018) (proximal loop).

use super::anderson::AndersonAcceleration;
use super::factors::{BlockEntry, LuFactors};
use super::gauss_seidel::ANDERSON_DEPTH;
use super::run::SolverRun;
use super::scaled::ScaledProblem;
use super::types::{LocalVector, MatrixBlock};

/// Initial value of the proximal parameter a.
const INITIAL_PROXIMAL: f64 = 1e-3;
/// Smallest and largest value of a.
const PROXIMAL_RANGE: (f64, f64) = (1e-9, 1e2);
/// Largest number of Newton steps for one proximal problem.
const MAX_INNER_STEPS: usize = 20;

/// Continues from `start` until the run or the budget of `steps` Newton steps is over.
pub fn prox_newton(run: &mut SolverRun, start: &[LocalVector], steps: u64) {
    let scaled = ScaledProblem::new(run.problem);
    let mut x = scaled.impulses_in(start);
    let mut anderson = AndersonAcceleration::new(ANDERSON_DEPTH, 3 * x.len());
    let mut a = INITIAL_PROXIMAL;
    let mut successes = 0;
    let end = run.sweeps.saturating_add(steps);
    while !run.is_over() && run.sweeps < end && a <= PROXIMAL_RANGE.1 {
        let sweeps_before = run.sweeps;
        let target = 0.01 * euclidean_norm(&NewtonIterate::new(&scaled, &x, &x, 0.0).phi);
        let mut state = NewtonIterate::new(&scaled, &x, &x, a);
        let mut solved = euclidean_norm(&state.phi) <= target;
        while !solved && run.sweeps - sweeps_before < MAX_INNER_STEPS as u64 {
            run.count_pass(run.problem.newton_cost());
            let Some(next) = state.newton_step().and_then(|step| line_search(&state, &step)) else { break };
            state = next;
            solved = euclidean_norm(&state.phi) <= target;
            run.record_iterate(&scaled.impulses_out(&state.r));
            if run.is_over() {
                return;
            }
        }
        if run.sweeps == sweeps_before {
            run.record_iterate(&scaled.impulses_out(&x));
            return; // Phi is 0: solved in these units
        }
        let g = std::mem::take(&mut state.r);
        if solved {
            anderson.next_iterate(&mut x, &g);
            successes += 1;
            if run.sweeps - sweeps_before <= 3 && successes >= 4 {
                a = (a * 0.2).max(PROXIMAL_RANGE.0);
                successes = 0;
                anderson.clear_history();
            }
        } else {
            a *= 10.0;
            successes = 0;
            anderson.clear_history();
        }
    }
}

/// Iterate with the data of Newton's method.
struct NewtonIterate<'a> {
    problem: &'a ScaledProblem,
    /// Iterate r_k of the outer loop.
    centre: &'a [LocalVector],
    /// Proximal parameter.
    a: f64,
    /// Impulses, scaled.
    r: Vec<LocalVector>,
    /// tau = r - u of these impulses.
    tau: Vec<LocalVector>,
    /// Phi of these impulses.
    phi: Vec<LocalVector>,
}

impl<'a> NewtonIterate<'a> {
    /// Evaluates tau and Phi at `r`.
    fn new(problem: &'a ScaledProblem, r: &[LocalVector], centre: &'a [LocalVector], a: f64) -> Self {
        let u = problem.relative_velocities(r);
        let tau: Vec<LocalVector> =
            (0..r.len()).map(|i| std::array::from_fn(|k| r[i][k] - u[i][k] - a * (r[i][k] - centre[i][k]))).collect();
        let phi = (0..r.len())
            .map(|i| {
                let (r, [n, t1, t2]) = (r[i], tau[i]);
                let n = n.max(0.0);
                let (tangential_length, bound) = ((t1 * t1 + t2 * t2).sqrt(), problem.mu[i] * n);
                let share = if tangential_length > bound { bound / tangential_length } else { 1.0 };
                [r[0] - n, r[1] - share * t1, r[2] - share * t2]
            })
            .collect();
        NewtonIterate { problem, centre, a, r: r.to_vec(), tau, phi }
    }

    /// Newton step -J^-1 Phi, J an element of Phi's generalised Jacobian; `None` if J is singular.
    fn newton_step(&self) -> Option<Vec<LocalVector>> {
        // Contacts that part have r = 0 after the step and leave the system.
        let closed: Vec<usize> = (0..self.r.len()).filter(|&i| self.tau[i][0] > 0.0).collect();
        // Index of each contact in the system.
        let mut system_index = vec![usize::MAX; self.r.len()];
        closed.iter().enumerate().for_each(|(k, &i)| system_index[i] = k);
        let mut jacobian: Vec<BlockEntry> = Vec::new();
        let mut right_side = vec![[0.0; 3]; closed.len()];
        for (row, &i) in closed.iter().enumerate() {
            let [n, t1, t2] = self.tau[i];
            let mu = self.problem.mu[i];
            let tangential_length = libm::hypot(t1, t2);
            // Factors A and B in Phi' = A u' + B r'.
            let (mut factor_u, mut factor_r) = ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [[0.0; 3]; 3]);
            if tangential_length > mu * n {
                let (d, share) = ([t1 / tangential_length, t2 / tangential_length], mu * n / tangential_length);
                for k in 0..2 {
                    factor_u[k + 1][0] = mu * d[k];
                    factor_r[k + 1][0] = -mu * d[k];
                    for l in 0..2 {
                        let identity = f64::from(u8::from(k == l));
                        factor_u[k + 1][l + 1] = share * (identity - d[k] * d[l]);
                        factor_r[k + 1][l + 1] = identity - factor_u[k + 1][l + 1];
                    }
                }
            }
            right_side[row] = self.phi[i].map(|phi| -phi);
            for (column, w) in self.problem.row_blocks(i) {
                let mut w = *w;
                if column == i {
                    (0..3).for_each(|k| w[k][k] += self.a);
                }
                let mut block: MatrixBlock =
                    std::array::from_fn(|k| std::array::from_fn(|l| (0..3).map(|m| factor_u[k][m] * w[m][l]).sum()));
                if system_index[column] == usize::MAX {
                    let r = self.r[column];
                    (0..3).for_each(|k| right_side[row][k] += (0..3).map(|l| block[k][l] * r[l]).sum::<f64>());
                    continue;
                }
                if column == i {
                    (0..9).for_each(|k| block.as_flattened_mut()[k] += factor_r.as_flattened()[k]);
                }
                jacobian.push((row, system_index[column], block));
            }
        }
        let solution = LuFactors::new(closed.len(), &jacobian)?.solve(&right_side);
        let step: Vec<LocalVector> = (0..self.r.len())
            .map(|i| match system_index[i] {
                usize::MAX => self.r[i].map(|x| -x),
                k => solution[k],
            })
            .collect();
        step.as_flattened().iter().all(|x| x.is_finite()).then_some(step)
    }

    /// Iterate after the given share of a step.
    fn advanced_by(&self, step: &[LocalVector], share: f64) -> Self {
        let r: Vec<LocalVector> =
            self.r.iter().zip(step).map(|(r, d)| std::array::from_fn(|k| r[k] + share * d[k])).collect();
        NewtonIterate::new(self.problem, &r, self.centre, self.a)
    }
}

/// Iterate at the first of the shares 1, 1/2, 1/4 ... of the step that lowers |Phi|.
fn line_search<'a>(state: &NewtonIterate<'a>, step: &[LocalVector]) -> Option<NewtonIterate<'a>> {
    let norm = euclidean_norm(&state.phi);
    (0..10).map(|k| 0.5f64.powi(k)).find_map(|share| {
        let next = state.advanced_by(step, share);
        (euclidean_norm(&next.phi) <= (1.0 - 1e-4 * share) * norm).then_some(next)
    })
}

fn euclidean_norm(a: &[LocalVector]) -> f64 {
    a.as_flattened().iter().map(|x| x * x).sum::<f64>().sqrt()
}
