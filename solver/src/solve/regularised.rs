//! Sweeps for problems with regularised rows: contacts with springs, and contacts that hold their bodies together.
//!
//! A spring of the law adds its compliance C to the normal unknown, û_n = u_n + shift + C r̂_n, so that the force at the end of
//! the step is that of the gap at the end of the step, for any stiffness and length of the step. A coupled row has u = 0 for
//! any impulse. A wire or rod has a spring, too, and pulls. An interface acts next to the contact: its impulse, with the
//! damage of the start of the step, is linear in the velocity of the row. The method is
//! [`gauss_seidel`](super::gauss_seidel), one contact after the other: such rows are few, and all other scenes keep the
//! sweeps in vectors, which know neither.
//!
//! E is |F(r)|/|F(r_0)| as in [`residual`](super::residual), with the ρ = 3/trace W of each row, W including C: the rows of
//! soft and of stiff springs differ by many orders of magnitude.

use nalgebra::Matrix3;

use crate::activity;
use crate::assemble::{ContactProblem, InterfaceRow, RegularisedRow, SolverBody};
use crate::math::Vec3;
use crate::math::simd::Scalar;
use crate::solve::gauss_seidel::block::local::{
    delassus_block_of_row, full_matrix, solve_contact_block, symmetric_components,
};
use crate::solve::gauss_seidel::driver::closing_inactive_rows;
use crate::solve::residual::project_on_cone;
use crate::solve::types::{ContactSolution, StoppingCriteria};
use crate::state::ContactId;

/// Sweeps between two checks of E: a check costs about two sweeps.
const SWEEPS_BETWEEN_CHECKS: u64 = 10;

/// Share of the summed velocities of the rows below which a residual is rounding, as in `residual`.
const ROUNDING_FLOOR: f64 = 1e-15;

/// Row of the sweeps, with its own block of W.
struct SweptRow {
    row: ContactId,
    /// W without regularisation, 1/kg.
    block: Matrix3<f64>,
    kind: RowKind,
}

/// Condition of a row.
#[derive(Clone, Copy)]
enum RowKind {
    /// Signorini and Coulomb, with a compliance along the normal, 1/kg; 0 for most rows.
    Contact { compliance: f64 },
    /// No relative velocity where the bodies can move.
    Coupled(CoupledBlock),
    /// Wire or rod with a compliance, 1/kg, along the normal, and no impulse across.
    Link { compliance: f64, is_wire: bool },
    /// Signorini and Coulomb next to an elastic interface.
    Interface(InterfaceRow),
}

/// Smallest eigenvalue of W, divided by the largest, of a direction in which a body can move: the rounding of W is below 1e-15
/// of the largest, and bodies whose masses and arms differ by 1e3 have eigenvalues above 1e-9 of it.
const MIN_MOBILITY_SHARE: f64 = 1e-12;

/// Contact of coupled bodies, of which imposed components of the velocity may leave some directions without motion.
#[derive(Clone, Copy)]
struct CoupledBlock {
    /// Pseudo-inverse of W, kg: 0 along directions in which neither body can move, where no impulse changes the velocity.
    inverse: Matrix3<f64>,
    /// Projection on the directions in which a body can move.
    range: Matrix3<f64>,
}

impl CoupledBlock {
    fn new(block: &Matrix3<f64>) -> CoupledBlock {
        let eigen = block.symmetric_eigen();
        let is_mobile = |value: f64| value > MIN_MOBILITY_SHARE * eigen.eigenvalues.max();
        if eigen.eigenvalues.iter().all(|value| is_mobile(*value))
            && let Some(inverse) = block.try_inverse()
        {
            return CoupledBlock { inverse, range: Matrix3::identity() };
        }
        let (mut inverse, mut range) = (Matrix3::zeros(), Matrix3::zeros());
        for (value, axis) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if is_mobile(*value) {
                let along = axis * axis.transpose();
                inverse += along / *value;
                range += along;
            }
        }
        CoupledBlock { inverse, range }
    }
}

/// Contact next to an elastic interface: ρ = r - H + K v is the impulse of the contact alone.
struct InterfaceBlock {
    /// K, kg.
    stiffness: Matrix3<f64>,
    /// Effective W of ρ, (1 + W K)⁻¹ W, 1/kg.
    effective_block: Matrix3<f64>,
    /// H: impulse of the interface at rest, N s.
    impulse_at_rest: Vec3,
}

impl InterfaceBlock {
    fn new(block: &Matrix3<f64>, n: &Vec3, interface: &InterfaceRow) -> InterfaceBlock {
        let (impulse_at_rest, [k_n, k_t]) = interface.stiffness(n);
        let along = n * n.transpose();
        let stiffness = (Matrix3::identity() - along) * k_t + along * k_n;
        // W and K are not negative, so that 1 + W K has an inverse.
        let inverse = (Matrix3::identity() + block * stiffness).try_inverse().unwrap_or_else(Matrix3::identity);
        let effective_block = inverse * block;
        // Symmetric up to rounding.
        let effective_block = (effective_block + effective_block.transpose()) * 0.5;
        InterfaceBlock { stiffness, effective_block, impulse_at_rest }
    }

    /// Impulse of the contact alone, at the velocity `v` of the interface.
    fn contact_impulse(&self, r: &Vec3, v: &Vec3) -> Vec3 {
        r - self.impulse_at_rest + self.stiffness * v
    }
}

impl SweptRow {
    fn new(contact_problem: &ContactProblem, row: ContactId) -> Self {
        let (k, constraint) = (row.index(), &contact_problem.rows[row.index()]);
        let along = constraint.normal * constraint.normal.transpose();
        let block = match &contact_problem.block_data {
            Some(block_data) => full_matrix(delassus_block_of_row(contact_problem, block_data, k)),
            None => (Matrix3::identity() - along) * constraint.w_t + along * constraint.w_n,
        };
        let kind = match contact_problem.regularised_row(k) {
            None => RowKind::Contact { compliance: 0.0 },
            Some(RegularisedRow::Spring { compliance, .. }) => RowKind::Contact { compliance: *compliance },
            Some(RegularisedRow::Coupled { .. }) => RowKind::Coupled(CoupledBlock::new(&block)),
            Some(&RegularisedRow::Link { compliance, is_wire, .. }) => RowKind::Link { compliance, is_wire },
            Some(RegularisedRow::Interface { interface, .. }) => RowKind::Interface(*interface),
        };
        SweptRow { row, block, kind }
    }

    /// W with the compliance, 1/kg.
    fn regularised_block(&self, n: &Vec3) -> Matrix3<f64> {
        match self.kind {
            RowKind::Contact { compliance } | RowKind::Link { compliance, .. } => {
                self.block + n * n.transpose() * compliance
            }
            RowKind::Coupled(_) | RowKind::Interface(_) => self.block,
        }
    }

    /// û of the row with the impulse `r`, whose velocity without the compliance is `u`.
    fn regularised_velocity(&self, n: &Vec3, u: &Vec3, r: &Vec3) -> Vec3 {
        match self.kind {
            RowKind::Contact { compliance } | RowKind::Link { compliance, .. } => u + n * (compliance * n.dot(r)),
            RowKind::Coupled(_) | RowKind::Interface(_) => *u,
        }
    }

    /// r̂ that solves the row alone, where û without compliance is `u` with the impulse `r`.
    fn solve(&self, contact_problem: &ContactProblem, u: &Vec3, r: &Vec3) -> Vec3 {
        let row = &contact_problem.rows[self.row.index()];
        let (w, u) = (self.regularised_block(&row.normal), self.regularised_velocity(&row.normal, u, r));
        match self.kind {
            RowKind::Contact { .. } => solve_contact_block(symmetric_components(&w), row.normal, row.friction, &u, r),
            RowKind::Link { is_wire, .. } => {
                let n = &row.normal;
                n * link_impulse(n.dot(r), n.dot(&u), 1.0 / n.dot(&(w * n)), is_wire)
            }
            RowKind::Coupled(coupled) => r - coupled.inverse * u,
            RowKind::Interface(interface) => {
                let n = &row.normal;
                let interface_block = InterfaceBlock::new(&self.block, n, &interface);
                let v = interface.velocity(n, &u);
                let old_impulse = interface_block.contact_impulse(r, &v);
                let contact_impulse = solve_contact_block(
                    symmetric_components(&interface_block.effective_block),
                    *n,
                    row.friction,
                    &u,
                    &old_impulse,
                );
                let v = v + interface_block.effective_block * (contact_impulse - old_impulse);
                contact_impulse + interface_block.impulse_at_rest - interface_block.stiffness * v
            }
        }
    }

    /// Natural map F of the row, N s.
    fn natural_map(&self, contact_problem: &ContactProblem, u: &Vec3, r: &Vec3) -> Vec3 {
        let row = &contact_problem.rows[self.row.index()];
        let n = row.normal;
        let (mut rho, u) = (3.0 / self.regularised_block(&n).trace(), self.regularised_velocity(&n, u, r));
        let mut r = *r;
        match &self.kind {
            RowKind::Coupled(coupled) => return coupled.range * u * rho,
            RowKind::Link { is_wire, .. } => {
                let along = n.dot(&r);
                return n * (along - link_impulse(along, n.dot(&u), rho, *is_wire));
            }
            RowKind::Interface(interface) => {
                let interface_block = InterfaceBlock::new(&self.block, &n, interface);
                r = interface_block.contact_impulse(&r, &interface.velocity(&n, &u));
                rho = 3.0 / interface_block.effective_block.trace();
            }
            RowKind::Contact { .. } => {}
        }
        let u_t = u - n * n.dot(&u);
        let z = r - (u + n * (row.friction * u_t.norm())) * rho;
        let z_n = n.dot(&z);
        let z_t = z - n * z_n;
        let size = z_t.norm();
        let (p_n, p_t) = project_on_cone(Scalar, z_n, size, row.friction);
        r - n * p_n - if size > 0.0 { z_t * (p_t / size) } else { Vec3::zeros() }
    }
}

/// Impulse of a wire or rod along the normal, N s, of a row with the impulse `r` and û_n = `u`, corrected by `rho` (kg): a wire only
/// pulls.
fn link_impulse(r: f64, u: f64, rho: f64, is_wire: bool) -> f64 {
    let new = r - rho * u;
    if is_wire { new.min(0.0) } else { new }
}

/// Norm of F over the swept rows, N s, and the row with the largest part.
fn residual_norm(contact_problem: &ContactProblem, rows: &[SweptRow], impulses: &[Vec3]) -> (f64, Option<ContactId>) {
    let (mut sum, mut largest, mut worst) = (0.0, 0.0, None);
    for swept in rows {
        let k = swept.row.index();
        let size_squared = swept
            .natural_map(contact_problem, &contact_problem.shifted_velocity(k, &contact_problem.bodies), &impulses[k])
            .norm_squared();
        sum += size_squared;
        if size_squared > largest {
            (largest, worst) = (size_squared, Some(swept.row));
        }
    }
    (sum.sqrt(), worst)
}

/// Solves as [`solve_nlgs`](super::solve_nlgs) does a problem with regularised rows.
pub fn solve_regularised(contact_problem: &ContactProblem, criteria: StoppingCriteria) -> ContactSolution {
    let mut active: Vec<ContactId> = (0..contact_problem.rows.len())
        .map(ContactId::new)
        .filter(|k| contact_problem.rows[k.index()].can_close)
        .collect();
    let mut impulses = vec![Vec3::zeros(); contact_problem.rows.len()];
    active.iter().for_each(|k| impulses[k.index()] = contact_problem.rows[k.index()].warm_start);
    let mut sweeps = 0;
    loop {
        let rows: Vec<SweptRow> = active.iter().map(|&k| SweptRow::new(contact_problem, k)).collect();
        // The problem with the impulses of a list applied to its bodies.
        let moved_problem = |impulses: &[Vec3]| {
            let mut work = contact_problem.clone();
            active.iter().for_each(|k| work.apply_impulse(k.index(), &impulses[k.index()]));
            work
        };
        let mut balance = vec![Vec3::zeros(); contact_problem.rows.len()];
        for k in &active {
            let row = &contact_problem.rows[k.index()];
            balance[k.index()] = row.normal * row.balancing_impulse();
        }
        let speed_scale = |k: &ContactId| {
            let row = &contact_problem.rows[k.index()];
            let (w_n, w_t) = contact_problem.delassus_diagonal(k.index());
            let speed_sum: f64 = row.bodies.iter().map(|i| contact_problem.bodies[i.index()].v.norm()).sum();
            (speed_sum + row.shift.norm() + w_n * row.impulse_shift.abs()) * 3.0 / (w_n + 2.0 * w_t)
        };
        let floor = ROUNDING_FLOOR * active.iter().map(|k| speed_scale(k).powi(2)).sum::<f64>().sqrt();
        let initial = residual_norm(&moved_problem(&balance), &rows, &balance).0.max(floor);
        let mut work = moved_problem(&impulses);
        let relative_residual = |work: &ContactProblem, impulses: &[Vec3]| {
            let (norm, worst) = residual_norm(work, &rows, impulses);
            if norm <= floor { (0.0, None) } else { (norm / initial, worst) }
        };
        let (mut residual, mut worst) = relative_residual(&work, &impulses);
        while residual > criteria.target_residual && sweeps < criteria.max_sweeps && !activity::is_stopped() {
            for _ in 0..SWEEPS_BETWEEN_CHECKS.min(criteria.max_sweeps - sweeps) {
                for swept in &rows {
                    let k = swept.row.index();
                    let new = swept.solve(&work, &work.shifted_velocity(k, &work.bodies), &impulses[k]);
                    work.apply_impulse(k, &(new - impulses[k]));
                    impulses[k] = new;
                }
                sweeps += 1;
                activity::count_sweep();
            }
            // Rounding accumulates in the velocities.
            work = moved_problem(&impulses);
            (residual, worst) = relative_residual(&work, &impulses);
        }
        let solver_bodies: Vec<SolverBody> = work.bodies;
        let missed = closing_inactive_rows(contact_problem, &active, &solver_bodies);
        if missed.is_empty() || sweeps >= criteria.max_sweeps || activity::is_stopped() {
            return ContactSolution {
                impulses,
                moments: vec![],
                solver_bodies,
                sweeps,
                single_precision: false,
                residual,
                converged: residual <= criteria.tol && missed.is_empty(),
                left_out: missed.len(),
                worst: worst.or(missed.first().copied()),
                active_rows: active.len(),
                fallback_used: false,
                stalled_residual: None,
                replacement_reason: None,
            };
        }
        active.extend(missed);
        active.sort_unstable();
    }
}
