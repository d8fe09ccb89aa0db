//! An interior-point method.
//!
//! In units in which the diagonal blocks have trace 3, and with S = diag(1, mu, mu) / max(1, mu) at each contact, x = S^-1 r
//! and y = S (u + mu |u_T| n) must both be in Lorentz's cone, v_n >= |v_T|:
//!
//! ```text
//! y = S W S x + S q + |y_T| n,   x o y = 0,   v o w = (v.w, v_n w_T + w_n v_T).
//! ```
//!
//! From within the cones, Newton's method follows x o y = tau n down to tau = 0, in the scaling of Nesterov and Todd, in
//! which x and y are one point: T x = T^-1 y = l. So no contact has to be guessed open, sticking or sliding, which misleads
//! other methods if much is undetermined. Predictor and corrector are Mehrotra's.
//!
//! Sources: V. Acary, F. Cadoux, C. Lemaréchal, J. Malick, Z. angew. Math. Mech. 91 (2011) 155-175 (the problem on cones); L.
//! Vandenberghe, The CVXOPT linear and quadratic cone program solvers (2010) (scaling, predictor, steps). Treating |y_T| as
//! an unknown, instead of fixing it from one solution to the next, is our own choice.

use super::factors::{BlockEntry, LuFactors};
use super::newton::prox_newton;
use super::run::SolverRun;
use super::scaled::ScaledProblem;
use super::types::{LocalVector, MatrixBlock};

/// Ratio of the length of a step to that at which it reaches the cones' sides.
const STEP_SHARE: f64 = 0.99;
/// Smallest share of a step: shorter steps make no progress.
const MIN_STEP_SHARE: f64 = 1e-8;
/// Number of successive iterates, the first and the last included, over which the smallest residual so far must fall by the
/// factor [`STALL_REDUCTION`]: it falls faster if the method converges.
const STALL_ITERATES: usize = 10;
/// Ratio of the smallest residual at the last of [`STALL_ITERATES`] to that at the first, above which the method stagnates.
const STALL_REDUCTION: f64 = 0.5;

/// Iterates from the middle of the cones until the run or the budget of `steps` Newton steps is over. If rounding stops the
/// method, as near contacts that touch without a force, it continues as [`prox_newton`].
pub fn interior_point(run: &mut SolverRun, steps: u64) {
    let scaled = ScaledProblem::new(run.problem);
    let sizes: Vec<[f64; 2]> = scaled.mu.iter().map(|mu| [1.0 / mu.max(1.0), mu / mu.max(1.0)]).collect();
    let start_n = (0..sizes.len()).flat_map(|i| scaled.q(i)).fold(0.0, |a: f64, x| a.max(x.abs()));
    let mut x = vec![[start_n, 0.0, 0.0]; sizes.len()];
    let mut y = x.clone();
    let end = run.sweeps.saturating_add(steps);
    let mut smallest_residuals = vec![f64::INFINITY];
    while !run.is_over() && run.sweeps < end {
        let before = smallest_residuals.len().saturating_sub(STALL_ITERATES);
        if smallest_residuals[smallest_residuals.len() - 1] > STALL_REDUCTION * smallest_residuals[before] && before > 0
        {
            break;
        }
        run.count_pass(run.problem.newton_cost());
        let Some([dx, dy]) = newton_direction(&scaled, &sizes, &x, &y) else { break };
        let share = (STEP_SHARE * max_step_share(&x, &dx).min(max_step_share(&y, &dy))).min(1.0);
        if share.is_nan() || share < MIN_STEP_SHARE {
            break;
        }
        advance_iterate(&mut x, &dx, share);
        advance_iterate(&mut y, &dy, share);
        let r: Vec<LocalVector> = x.iter().zip(&sizes).map(|(x, size)| apply_cone_scaling(*size, *x)).collect();
        let residual = run.record_iterate(&scaled.impulses_out(&r));
        smallest_residuals.push(residual.min(smallest_residuals[smallest_residuals.len() - 1]));
    }
    let best = run.best_r.clone();
    prox_newton(run, &best, end.saturating_sub(run.sweeps));
}

/// Product S v.
fn apply_cone_scaling([n, t]: [f64; 2], v: LocalVector) -> LocalVector {
    [n * v[0], t * v[1], t * v[2]]
}

/// Changes of x and y; `None` if numbers are not finite.
fn newton_direction(
    problem: &ScaledProblem,
    sizes: &[[f64; 2]],
    x: &[LocalVector],
    y: &[LocalVector],
) -> Option<[Vec<LocalVector>; 2]> {
    let count = x.len();
    let r: Vec<LocalVector> = x.iter().zip(sizes).map(|(x, size)| apply_cone_scaling(*size, *x)).collect();
    let u = problem.relative_velocities(&r);
    let defects: Vec<LocalVector> = (0..count)
        .map(|i| {
            let u = apply_cone_scaling(sizes[i], u[i]);
            let slip = libm::hypot(y[i][1], y[i][2]);
            [u[0] + slip - y[i][0], u[1] - y[i][1], u[2] - y[i][2]]
        })
        .collect();
    let scalings: Vec<NesterovToddScaling> =
        x.iter().zip(y).map(|(x, y)| NesterovToddScaling::new(x, y)).collect::<Option<_>>()?;
    let points: Vec<LocalVector> = x.iter().zip(&scalings).map(|(x, scaling)| scaling.apply_scaling(x)).collect();
    // Solves (S W S + N T^2) dx = -defects + N T g,   dy = T g - T^2 dx,   N = 1 - n y_T / |y_T|.
    let squares: Vec<MatrixBlock> = scalings.iter().map(NesterovToddScaling::squared_matrix).collect();
    let apply_slip_matrix = |i: usize, v: LocalVector| -> LocalVector {
        let slip = libm::hypot(y[i][1], y[i][2]);
        let along = if slip > 0.0 { (y[i][1] * v[1] + y[i][2] * v[2]) / slip } else { 0.0 };
        [v[0] - along, v[1], v[2]]
    };
    let mut matrix: Vec<BlockEntry> = Vec::new();
    for i in 0..count {
        for (j, w) in problem.row_blocks(i) {
            let value = |k: usize, l: usize| {
                let value = sizes[i][k.min(1)] * w[k][l] * sizes[j][l.min(1)];
                let square = || apply_slip_matrix(i, [squares[i][0][l], squares[i][1][l], squares[i][2][l]])[k];
                if i == j { value + square() } else { value }
            };
            matrix.push((i, j, std::array::from_fn(|k| std::array::from_fn(|l| value(k, l)))));
        }
    }
    let factors = LuFactors::new(count, &matrix)?;
    let direction_to = |goals: &[LocalVector]| -> [Vec<LocalVector>; 2] {
        let scaled_goals: Vec<LocalVector> =
            (0..count).map(|i| scalings[i].apply_scaling(&jordan_quotient(&points[i], &goals[i]))).collect();
        let right = (0..count).map(|i| {
            let slipped = apply_slip_matrix(i, scaled_goals[i]);
            std::array::from_fn(|k| slipped[k] - defects[i][k])
        });
        let dx = factors.solve(&right.collect::<Vec<LocalVector>>());
        let dy = (0..count)
            .map(|i| std::array::from_fn(|k| scaled_goals[i][k] - dot_product(&squares[i][k], &dx[i])))
            .collect();
        [dx, dy]
    };
    // First step as if tau could be 0 at once; its length determines how far tau is reduced.
    let goals: Vec<LocalVector> = points.iter().map(|l| jordan_product(l, l).map(|x| -x)).collect();
    let [dx, dy] = direction_to(&goals);
    let share = max_step_share(x, &dx).min(max_step_share(y, &dy)).min(1.0);
    let tau = duality_gap(x, y, &dx, &dy, 0.0);
    let centring = (duality_gap(x, y, &dx, &dy, share) / tau).clamp(0.0, 1.0).powi(3);
    let goals: Vec<LocalVector> = (0..count)
        .map(|i| {
            let second = jordan_product(&scalings[i].apply_scaling(&dx[i]), &scalings[i].apply_inverse_scaling(&dy[i]));
            let mut goal: LocalVector = std::array::from_fn(|k| goals[i][k] - second[k]);
            goal[0] += centring * tau;
            goal
        })
        .collect();
    let found = direction_to(&goals);
    found.iter().flatten().flatten().all(|x| x.is_finite()).then_some(found)
}

/// Mean of x.y at a share of a step.
fn duality_gap(x: &[LocalVector], y: &[LocalVector], dx: &[LocalVector], dy: &[LocalVector], share: f64) -> f64 {
    let point = |v: &LocalVector, d: &LocalVector| -> LocalVector { std::array::from_fn(|k| v[k] + share * d[k]) };
    (0..x.len()).map(|i| dot_product(&point(&x[i], &dx[i]), &point(&y[i], &dy[i]))).sum::<f64>() / x.len() as f64
}

/// Adds a share of the step `d` to `v`.
fn advance_iterate(v: &mut [LocalVector], d: &[LocalVector], share: f64) {
    v.as_flattened_mut().iter_mut().zip(d.as_flattened()).for_each(|(v, d)| *v += share * d);
}

/// Largest share of the step `d` up to the side of a cone, computed after `v` is transformed to the middle of its cone.
fn max_step_share(v: &[LocalVector], d: &[LocalVector]) -> f64 {
    let share_of_cone = |(v, d): (&LocalVector, &LocalVector)| {
        let size = cone_determinant(v).sqrt();
        let [n, s, t] = v.map(|c| c / size);
        let normal_part = (n * d[0] - s * d[1] - t * d[2]) / size;
        let tangential_factor = (normal_part + d[0] / size) / (n + 1.0);
        1.0 / (libm::hypot(d[1] / size - tangential_factor * s, d[2] / size - tangential_factor * t) - normal_part)
            .max(0.0)
    };
    v.iter().zip(d).map(share_of_cone).fold(f64::INFINITY, f64::min)
}

fn dot_product(a: &LocalVector, b: &LocalVector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// v_n^2 - |v_T|^2.
fn cone_determinant(v: &LocalVector) -> f64 {
    let t = libm::hypot(v[1], v[2]);
    (v[0] - t) * (v[0] + t)
}

/// Jordan product v o w.
fn jordan_product(v: &LocalVector, w: &LocalVector) -> LocalVector {
    [dot_product(v, w), v[0] * w[1] + w[0] * v[1], v[0] * w[2] + w[0] * v[2]]
}

/// Vector g with l o g = d.
fn jordan_quotient(l: &LocalVector, d: &LocalVector) -> LocalVector {
    let n = (l[0] * d[0] - l[1] * d[1] - l[2] * d[2]) / cone_determinant(l);
    [n, (d[1] - n * l[1]) / l[0], (d[2] - n * l[2]) / l[0]]
}

/// Nesterov-Todd scaling T = beta (2 v v^T - J) with J = diag(1, -1, -1), for which T x = T^-1 y.
struct NesterovToddScaling {
    beta: f64,
    v: LocalVector,
    /// Vector w of T^2 = beta^2 (2 w w^T - J).
    w: LocalVector,
}

impl NesterovToddScaling {
    /// Returns the scaling; `None` on the sides of the cones.
    fn new(x: &LocalVector, y: &LocalVector) -> Option<Self> {
        let (det_x, det_y) = (cone_determinant(x), cone_determinant(y));
        if !(det_x > 0.0 && det_y > 0.0 && x[0] > 0.0 && y[0] > 0.0) {
            return None;
        }
        let (x, y) = (x.map(|c| c / det_x.sqrt()), y.map(|c| c / det_y.sqrt()));
        let double = 2.0 * (0.5 * (1.0 + dot_product(&x, &y))).sqrt();
        let w = [(y[0] + x[0]) / double, (y[1] - x[1]) / double, (y[2] - x[2]) / double];
        let length = (2.0 * (w[0] + 1.0)).sqrt();
        Some(NesterovToddScaling {
            beta: (det_y / det_x).sqrt().sqrt(),
            v: [(w[0] + 1.0) / length, w[1] / length, w[2] / length],
            w,
        })
    }

    /// Product T u.
    fn apply_scaling(&self, u: &LocalVector) -> LocalVector {
        let along = 2.0 * dot_product(&self.v, u);
        let [n, s, t] = self.v;
        [self.beta * (along * n - u[0]), self.beta * (along * s + u[1]), self.beta * (along * t + u[2])]
    }

    /// Product T^-1 u.
    fn apply_inverse_scaling(&self, u: &LocalVector) -> LocalVector {
        let [n, s, t] = self.v;
        let along = 2.0 * (n * u[0] - s * u[1] - t * u[2]);
        [(along * n - u[0]) / self.beta, (u[1] - along * s) / self.beta, (u[2] - along * t) / self.beta]
    }

    /// Matrix T².
    fn squared_matrix(&self) -> MatrixBlock {
        let factor = self.beta * self.beta;
        std::array::from_fn(|k| {
            std::array::from_fn(|l| {
                let sign = if k != l {
                    0.0
                } else if k == 0 {
                    -1.0
                } else {
                    1.0
                };
                factor * (2.0 * self.w[k] * self.w[l] + sign)
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const X: LocalVector = [2.0, 0.5, -1.2];
    const Y: LocalVector = [0.7, -0.3, 0.4];

    fn close(a: &LocalVector, b: &LocalVector) {
        // A few operations on numbers of order 1.
        assert!((0..3).all(|k| (a[k] - b[k]).abs() < 1e-14), "{a:?} {b:?}");
    }

    #[test]
    fn scaling_maps_both_points_to_one() {
        let scaling = NesterovToddScaling::new(&X, &Y).unwrap();
        let point = scaling.apply_scaling(&X);
        close(&point, &scaling.apply_inverse_scaling(&Y));
        close(&scaling.apply_inverse_scaling(&point), &X);
        let square: LocalVector = std::array::from_fn(|k| dot_product(&scaling.squared_matrix()[k], &X));
        close(&square, &Y);
        close(&jordan_product(&point, &jordan_quotient(&point, &Y)), &Y);
        assert!(NesterovToddScaling::new(&[1.0, 1.0, 0.0], &Y).is_none());
    }

    #[test]
    fn the_longest_step_ends_on_the_side_of_a_cone() {
        for d in [[-1.0, 0.0, 0.0], [0.0, 3.0, 0.1], [1.0, 5.0, 0.0], X.map(|c| -0.3 * c)] {
            let share = max_step_share(&[X], &[d]);
            let end: LocalVector = std::array::from_fn(|k| X[k] + share * d[k]);
            assert!(end[0] > -1e-15 && cone_determinant(&end).abs() < 1e-13, "{d:?}: {end:?}");
        }
        assert_eq!(max_step_share(&[X], &[Y]), f64::INFINITY);
    }
}
