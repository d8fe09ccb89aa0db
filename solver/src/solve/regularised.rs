//! Sweeps for problems with regularised rows: contacts with springs, and contacts that hold their bodies together.
//!
//! A spring of the law adds its compliance C to the normal unknown, û_n = u_n + shift + C r̂_n, so that the force at the end of
//! the step is that of the gap at the end of the step, for any stiffness and length of the step. A coupled row has u = 0 for
//! any impulse. A wire or rod has a spring, too, and pulls. An elastic bond has compliances of all components of its impulse and of
//! its moment. An interface acts next to the contact: its impulse, with the
//! damage of the start of the step, is linear in the velocity of the row. The method is
//! [`gauss_seidel`](super::gauss_seidel), one contact after the other: such rows are few, and all other scenes keep the
//! sweeps in vectors, which know neither.
//!
//! E is |F(r)|/|F(r_0)| as in [`residual`](super::residual), with the ρ = 3/trace W of each row, W including C: the rows of
//! soft and of stiff springs differ by many orders of magnitude. Moments, of elastic bonds or by rolling friction, follow the
//! impulses of their rows. Sweeps alternate with the gradients of [`bond_gradients`](super::bond_gradients) where there are elastic
//! bonds.

use nalgebra::Matrix3;

use crate::activity;
use crate::assemble::{ContactProblem, InterfaceRow, RegularisedRow, RollingConstraint, SolverBody};
use crate::math::Vec3;
use crate::math::simd::Scalar;
use crate::solve::bond_gradients::{GradientLimits, corrected_reactions};
use crate::solve::gauss_seidel::block::local::{
    delassus_block_of_row, full_matrix, solve_contact_block, symmetric_components,
};
use crate::solve::gauss_seidel::driver::closing_inactive_rows;
use crate::solve::residual::project_on_cone;
use crate::solve::types::{ContactReactions, ContactSolution, StoppingCriteria};
use crate::state::ContactId;

/// Sweeps between two checks of E: a check costs about two sweeps.
const SWEEPS_BETWEEN_CHECKS: u64 = 10;

/// Sweeps between two corrections of bonds by gradients: enough to find the bonds that yield.
const SWEEPS_BETWEEN_CORRECTIONS: u64 = 50;

/// Share of the residual below which a correction of the bonds must bring it, so that another one is made.
const MIN_CORRECTION_GAIN: f64 = 0.5;

/// Share of the reduction to the sought residual to which the gradients reduce the velocities: the two are measured differently.
const REDUCTION_MARGIN: f64 = 0.1;

/// Share of the summed velocities of the rows below which a residual is rounding, as in `residual`.
const ROUNDING_FLOOR: f64 = 1e-15;

/// Row of the sweeps, with its own block of W.
struct SweptRow {
    row: ContactId,
    /// W without regularisation, 1/kg.
    block: Matrix3<f64>,
    kind: RowKind,
    /// Index of its moments.
    roll: Option<usize>,
}

/// Condition of a row.
#[derive(Clone, Copy)]
enum RowKind {
    /// Signorini and Coulomb, with compliances along the normal and across, 1/kg; 0 for most rows.
    Contact { compliance: f64, sliding: f64 },
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
            None => RowKind::Contact { compliance: 0.0, sliding: 0.0 },
            Some(RegularisedRow::Spring { compliance, .. }) => {
                RowKind::Contact { compliance: *compliance, sliding: 0.0 }
            }
            Some(&RegularisedRow::Bond { opening, sliding, .. }) => RowKind::Contact { compliance: opening, sliding },
            Some(RegularisedRow::Coupled { .. }) => RowKind::Coupled(CoupledBlock::new(&block)),
            Some(&RegularisedRow::Link { compliance, is_wire, .. }) => RowKind::Link { compliance, is_wire },
            Some(RegularisedRow::Interface { interface, .. }) => RowKind::Interface(*interface),
        };
        let roll = contact_problem.rolling_constraints.binary_search_by_key(&row, |roll| roll.row).ok();
        SweptRow { row, block, kind, roll }
    }

    /// W with the compliance, 1/kg.
    fn regularised_block(&self, n: &Vec3) -> Matrix3<f64> {
        match self.kind {
            RowKind::Contact { compliance, sliding } => {
                self.block + n * n.transpose() * (compliance - sliding) + Matrix3::identity() * sliding
            }
            RowKind::Link { compliance, .. } => self.block + n * n.transpose() * compliance,
            RowKind::Coupled(_) | RowKind::Interface(_) => self.block,
        }
    }

    /// û of the row with the impulse `r`, whose velocity without the compliance is `u`.
    fn regularised_velocity(&self, n: &Vec3, u: &Vec3, r: &Vec3) -> Vec3 {
        match self.kind {
            RowKind::Contact { compliance, sliding } => u + n * ((compliance - sliding) * n.dot(r)) + r * sliding,
            RowKind::Link { compliance, .. } => u + n * (compliance * n.dot(r)),
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

/// Moment of a contact with the impulse `r` and the moment `m` that stops the relative angular velocity `w` (rad/s), without
/// limits, and with the limits of its law.
fn rolling_moments(roll: &RollingConstraint, n: &Vec3, w: &Vec3, r: &Vec3, m: &Vec3) -> [Vec3; 2] {
    let w = w + roll.shift;
    let [across, along] = roll.compliance;
    let [m_n, w_n] = [m, &w].map(|vector| n.dot(vector));
    let [m_t, w_t] = [m - n * m_n, w - n * w_n];
    let mobility = 1.0 / roll.inverse_w;
    let new_t = m_t - (w_t + m_t * across) / (mobility + across);
    let new_n = m_n - (w_n + m_n * along) / (mobility + along);
    let (across_bound, along_bound) = roll.moment_bounds(r, n);
    let [across_bound, along_bound] = [across_bound, along_bound].map(|bound| bound.max(0.0) * roll.radius);
    let size = new_t.norm();
    let limited_t = if size > across_bound { new_t * (across_bound / size) } else { new_t };
    [new_t + n * new_n, limited_t + n * new_n.clamp(-along_bound, along_bound)]
}

/// Angular velocity of the candidate of a row relative to its antagonist, rad/s.
fn relative_spin(contact_problem: &ContactProblem, row: ContactId) -> Vec3 {
    let [a, b] = contact_problem.rows[row.index()].bodies.map(|body| contact_problem.bodies[body.index()].w);
    a - b
}

/// Gives the two bodies of a row the moment `m` on the candidate and -m on the antagonist, N m s.
fn apply_moment(contact_problem: &mut ContactProblem, row: ContactId, m: &Vec3) {
    let [a, b] = contact_problem.rows[row.index()].bodies;
    for (body, m) in [(a, *m), (b, -m)] {
        let turn = contact_problem.angular_velocity_change(body, &m);
        contact_problem.bodies[body.index()].w += turn;
    }
}

/// Norm of F over the swept rows, N s, and the row with the largest part. The part of a moment is its error divided by R.
fn residual_norm(
    contact_problem: &ContactProblem,
    rows: &[SweptRow],
    reactions: &ContactReactions,
) -> (f64, Option<ContactId>) {
    let (mut sum, mut largest, mut worst) = (0.0, 0.0, None);
    for swept in rows {
        let k = swept.row.index();
        let u = contact_problem.shifted_velocity(k, &contact_problem.bodies);
        let r = &reactions.impulses[k];
        let mut size_squared = swept.natural_map(contact_problem, &u, r).norm_squared();
        if let Some(index) = swept.roll {
            let (roll, m) = (&contact_problem.rolling_constraints[index], &reactions.moments[index]);
            let w = relative_spin(contact_problem, swept.row);
            let [_, limited] = rolling_moments(roll, &contact_problem.rows[k].normal, &w, r, m);
            size_squared += ((m - limited) / roll.radius).norm_squared();
        }
        sum += size_squared;
        if size_squared > largest {
            (largest, worst) = (size_squared, Some(swept.row));
        }
    }
    (sum.sqrt(), worst)
}

/// One sweep over the rows.
fn sweep_rows(work: &mut ContactProblem, rows: &[SweptRow], reactions: &mut ContactReactions) {
    for swept in rows {
        let k = swept.row.index();
        let new = swept.solve(work, &work.shifted_velocity(k, &work.bodies), &reactions.impulses[k]);
        work.apply_impulse(k, &(new - reactions.impulses[k]));
        reactions.impulses[k] = new;
        if let Some(index) = swept.roll {
            let (normal, w) = (work.rows[k].normal, relative_spin(work, swept.row));
            let m = reactions.moments[index];
            let [_, limited] = rolling_moments(&work.rolling_constraints[index], &normal, &w, &new, &m);
            apply_moment(work, swept.row, &(limited - m));
            reactions.moments[index] = limited;
        }
    }
}

/// Corrections of elastic bonds by gradients, as long as they gain.
struct BondCorrections {
    /// Number of sweeps at which the next one is due.
    next: u64,
    /// Residual before the last one.
    residual: f64,
    gains: bool,
}

impl BondCorrections {
    fn new(contact_problem: &ContactProblem) -> BondCorrections {
        let has_bonds = contact_problem.regularised.iter().any(|row| matches!(row, RegularisedRow::Bond { .. }));
        BondCorrections { next: 0, residual: f64::INFINITY, gains: has_bonds }
    }

    /// Whether a correction is due after `sweeps`, at the `residual` that they have reached.
    fn is_due(&mut self, sweeps: u64, residual: f64) -> bool {
        if !self.gains || sweeps < self.next {
            return false;
        }
        self.gains = residual <= MIN_CORRECTION_GAIN * self.residual;
        self.residual = residual;
        self.gains
    }
}

/// Solves a problem with regularised rows, and returns its solution as [`solve_nlgs`](super::solve_nlgs) does.
pub fn solve_regularised(contact_problem: &ContactProblem, criteria: StoppingCriteria) -> ContactSolution {
    let mut active: Vec<ContactId> = (0..contact_problem.rows.len())
        .map(ContactId::new)
        .filter(|k| contact_problem.rows[k.index()].can_close)
        .collect();
    let mut reactions = ContactReactions::warm_start(contact_problem);
    let mut sweeps = 0;
    loop {
        let rows: Vec<SweptRow> = active.iter().map(|&k| SweptRow::new(contact_problem, k)).collect();
        // The problem with the reactions of a list applied to its bodies.
        let moved_problem = |reactions: &ContactReactions| {
            let mut work = contact_problem.clone();
            active.iter().for_each(|k| work.apply_impulse(k.index(), &reactions.impulses[k.index()]));
            for swept in &rows {
                if let Some(index) = swept.roll {
                    apply_moment(&mut work, swept.row, &reactions.moments[index]);
                }
            }
            work
        };
        let mut balance = ContactReactions::zeros(contact_problem);
        for k in &active {
            let row = &contact_problem.rows[k.index()];
            balance.impulses[k.index()] = row.normal * row.balancing_impulse();
        }
        let speed_scale = |k: &ContactId| {
            let row = &contact_problem.rows[k.index()];
            let (w_n, w_t) = contact_problem.delassus_diagonal(k.index());
            let speed_sum: f64 = row.bodies.iter().map(|i| contact_problem.bodies[i.index()].v.norm()).sum();
            (speed_sum + row.shift.norm() + w_n * row.impulse_shift.abs()) * 3.0 / (w_n + 2.0 * w_t)
        };
        let floor = ROUNDING_FLOOR * active.iter().map(|k| speed_scale(k).powi(2)).sum::<f64>().sqrt();
        let initial = residual_norm(&moved_problem(&balance), &rows, &balance).0.max(floor);
        let mut work = moved_problem(&reactions);
        let relative_residual = |work: &ContactProblem, reactions: &ContactReactions| {
            let (norm, worst) = residual_norm(work, &rows, reactions);
            if norm <= floor { (0.0, None) } else { (norm / initial, worst) }
        };
        let (mut residual, mut worst) = relative_residual(&work, &reactions);
        let mut corrections = BondCorrections::new(contact_problem);
        while residual > criteria.target_residual && sweeps < criteria.max_sweeps && !activity::is_stopped() {
            for _ in 0..SWEEPS_BETWEEN_CHECKS.min(criteria.max_sweeps - sweeps) {
                sweep_rows(&mut work, &rows, &mut reactions);
                sweeps += 1;
                activity::count_sweep();
            }
            // Rounding accumulates in the velocities.
            work = moved_problem(&reactions);
            (residual, worst) = relative_residual(&work, &reactions);
            if residual > criteria.target_residual && corrections.is_due(sweeps, residual) {
                let reduction = REDUCTION_MARGIN * criteria.target_residual / residual;
                let limits = GradientLimits { reduction, iterations: criteria.max_sweeps - sweeps };
                let (corrected, iterations) = corrected_reactions(contact_problem, reactions, &work.bodies, limits);
                sweeps += iterations;
                corrections.next = sweeps + SWEEPS_BETWEEN_CORRECTIONS;
                reactions = corrected;
                work = moved_problem(&reactions);
                (residual, worst) = relative_residual(&work, &reactions);
            }
        }
        let solver_bodies: Vec<SolverBody> = work.bodies;
        let missed = closing_inactive_rows(contact_problem, &active, &solver_bodies);
        if missed.is_empty() || sweeps >= criteria.max_sweeps || activity::is_stopped() {
            return ContactSolution {
                impulses: reactions.impulses,
                moments: reactions.moments,
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
