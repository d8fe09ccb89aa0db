//! Residual of a solution of a stored problem; shares no arithmetic with the solvers.

use super::problem::MatrixProblem;
use super::types::LocalVector;

/// Residual |F| / (rho |q|) of the impulses `r`, with rho = 3N / trace W, of the natural map
///
/// ```text
/// F = r - P_K( r - rho (u + mu |u_T| n) ),   u = W r + q,
/// ```
///
/// and P_K the projection on the product of Coulomb's cones. It is a velocity relative to |q|, 0 exactly at a solution and
/// the same in any units. If q is 0, it is relative to 1 m/s.
///
/// Source: V. Acary, M. Bremond, O. Huber, in Advanced Topics in Nonsmooth Dynamics, Springer (2018).
pub fn residual(problem: &MatrixProblem, r: &[LocalVector]) -> f64 {
    let (rho, rho_q) = residual_scales(problem);
    let mut sum = 0.0;
    for (i, r_i) in r.iter().enumerate() {
        let mut u = problem.q[i];
        for (j, w) in problem.row_blocks(i) {
            for (u_k, w_k) in u.iter_mut().zip(w) {
                *u_k += w_k[0] * r[j][0] + w_k[1] * r[j][1] + w_k[2] * r[j][2];
            }
        }
        let mu = problem.mu[i];
        let z = [r_i[0] - rho * (u[0] + mu * libm::hypot(u[1], u[2])), r_i[1] - rho * u[1], r_i[2] - rho * u[2]];
        let p = project_to_cone(z, mu);
        sum += (0..3).map(|k| (r_i[k] - p[k]) * (r_i[k] - p[k])).sum::<f64>();
    }
    sum.sqrt() / rho_q
}

/// Residual that rounding of r alone may cause: impulses so large that rho u is lost in them are no solution, though F is
/// computed as 0.
pub fn rounding_residual(problem: &MatrixProblem, r: &[LocalVector]) -> f64 {
    f64::EPSILON * r.as_flattened().iter().fold(0.0, |a: f64, x| a.max(x.abs())) / residual_scales(problem).1
}

/// Scales rho and rho |q|.
fn residual_scales(problem: &MatrixProblem) -> (f64, f64) {
    let trace: f64 = problem.diagonal_blocks().map(|w| w[0][0] + w[1][1] + w[2][2]).sum();
    let rho = if trace > 0.0 { 3.0 * problem.len() as f64 / trace } else { 1.0 };
    let q = problem.q.as_flattened().iter().map(|x| x * x).sum::<f64>().sqrt();
    (rho, rho * if q > 0.0 { q } else { 1.0 })
}

/// Nearest point of the cone { |t| <= mu n }.
fn project_to_cone([n, t1, t2]: LocalVector, mu: f64) -> LocalVector {
    let t = libm::hypot(t1, t2);
    if n >= 0.0 && t <= mu * n {
        return [n, t1, t2];
    }
    if mu * t <= -n {
        return [0.0; 3];
    }
    let normal = (n + mu * t) / (1.0 + mu * mu);
    let tangent_factor = mu * normal / t;
    [normal, tangent_factor * t1, tangent_factor * t2]
}
