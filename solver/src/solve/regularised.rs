//! Sweeps for problems with regularised rows: contacts with springs, and contacts that hold their bodies together.
//!
//! A spring of the law adds its compliance C to the normal unknown, û_n = u_n + shift + C r̂_n, so that the force at
//! the end of the step is that of the gap at the end of the step, for any stiffness and length of the step. A coupled
//! row has u = 0 for any impulse. A wire or rod has a spring, too, and pulls. An elastic bond has compliances of all
//! components of its impulse and of its moment. An interface acts next to the contact: its impulse, with the damage of
//! the start of the step, is linear in the velocity of the row. The method is [`gauss_seidel`](super::gauss_seidel),
//! one contact after the other: such rows are few, and scenes without them use the vectorised sweeps, which have no
//! regularised rows.
//!
//! E is |F(r)|/|F(r_0)| as in [`residual`](super::residual), with the ρ = 3/trace W of each row, W including C: the
//! rows of soft and of stiff springs differ by many orders of magnitude. Moments, of elastic bonds or by rolling
//! friction, follow the impulses of their rows. Sweeps alternate with the gradients of
//! [`bond_gradients`](super::bond_gradients) where there are elastic bonds.
//!
//! Elastic bonds are first solved without their limits, and those whose loads are then beyond a limit keep it from
//! there on, until no further bond is beyond: the solution is that of the law. Where nothing else slides or opens, the
//! first problem is linear.
//!
//! F does not measure the loads of stiff bonds. Those that balance each other, as between the points of a face or in a
//! ring of bodies, change û by C only, which is small against W where k h² S is large against the masses: with E alone
//! they would be known to E W/C. The load of a bond by its strain, -C⁻¹ (û - C r̂) within its limits, is therefore
//! compared with r̂, and their difference over the strength of the bond counts as E, too. This difference is an upper
//! bound of the error of the load. Sweeps change these loads by C/W only; the gradients find them.

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

/// Safety factor of the gradients: they reduce the velocities by this factor more than the residual has to fall, since
/// the two have different norms.
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
    /// Elastic bond within its limits, with its compliances along the normal and across, 1/kg: û = 0.
    LinearBond { opening: f64, sliding: f64 },
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
    /// Row that `may_yield`, if it is an elastic bond.
    fn new(contact_problem: &ContactProblem, row: ContactId, may_yield: bool) -> Self {
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
            Some(&RegularisedRow::Bond { opening, sliding, .. }) if may_yield => {
                RowKind::Contact { compliance: opening, sliding }
            }
            Some(&RegularisedRow::Bond { opening, sliding, .. }) => RowKind::LinearBond { opening, sliding },
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
            RowKind::Contact { compliance, sliding } | RowKind::LinearBond { opening: compliance, sliding } => {
                self.block + n * n.transpose() * (compliance - sliding) + Matrix3::identity() * sliding
            }
            RowKind::Link { compliance, .. } => self.block + n * n.transpose() * compliance,
            RowKind::Coupled(_) | RowKind::Interface(_) => self.block,
        }
    }

    /// û of the row with the impulse `r`, whose velocity without the compliance is `u`.
    fn regularised_velocity(&self, n: &Vec3, u: &Vec3, r: &Vec3) -> Vec3 {
        match self.kind {
            RowKind::Contact { compliance, sliding } | RowKind::LinearBond { opening: compliance, sliding } => {
                u + n * ((compliance - sliding) * n.dot(r)) + r * sliding
            }
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
            // The compliances are positive, so that the block has an inverse.
            RowKind::LinearBond { .. } => w.try_inverse().map_or(*r, |inverse| r - inverse * u),
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

    /// Moment that solves a rolling constraint of the row alone, where the row has the impulse `r` and the moment `m`.
    fn solve_moment(&self, contact_problem: &ContactProblem, roll: &RollingConstraint, r: &Vec3, m: &Vec3) -> Vec3 {
        let n = &contact_problem.rows[self.row.index()].normal;
        let w = contact_problem.shifted_spin(roll, &contact_problem.bodies);
        let stopping = stopping_moment(roll, n, &w, m);
        match self.kind {
            RowKind::LinearBond { .. } => stopping,
            _ => roll.limited_moment(r, n, &stopping),
        }
    }

    /// Whether the row is an elastic bond that is solved without its limits, and a load of it is not within them.
    fn is_beyond_limits(&self, contact_problem: &ContactProblem, reactions: &ContactReactions) -> bool {
        let RowKind::LinearBond { .. } = self.kind else { return false };
        let (row, r) = (&contact_problem.rows[self.row.index()], &reactions.impulses[self.row.index()]);
        let turns = |index: usize| {
            !contact_problem.rolling_constraints[index].holds_moment(r, &row.normal, &reactions.moments[index])
        };
        !row.holds_impulse(r) || self.roll.is_some_and(turns)
    }

    /// Natural map F of the row, N s.
    fn natural_map(&self, contact_problem: &ContactProblem, u: &Vec3, r: &Vec3) -> Vec3 {
        let row = &contact_problem.rows[self.row.index()];
        let n = row.normal;
        let (mut rho, u) = (3.0 / self.regularised_block(&n).trace(), self.regularised_velocity(&n, u, r));
        let mut r = *r;
        match &self.kind {
            RowKind::Coupled(coupled) => return coupled.range * u * rho,
            RowKind::LinearBond { .. } => return u * rho,
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

/// Moment of a contact with the moment `m` that stops the shifted angular velocity `w` (rad/s), without limits.
fn stopping_moment(roll: &RollingConstraint, n: &Vec3, w: &Vec3, m: &Vec3) -> Vec3 {
    let [across, along] = roll.compliance;
    let [m_n, w_n] = [m, w].map(|vector| n.dot(vector));
    let [m_t, w_t] = [m - n * m_n, w - n * w_n];
    let mobility = 1.0 / roll.inverse_w;
    let new_t = m_t - (w_t + m_t * across) / (mobility + across);
    let new_n = m_n - (w_n + m_n * along) / (mobility + along);
    new_t + n * new_n
}

/// Largest ratio of the errors of the loads of an elastic bond to its strengths, in traction and shear, bending and
/// torsion; 0 of other rows. The error is the difference between the load and that of the strain, within the limits of
/// the bond. An error below the rounding of the strain's load, which follows from that of the velocities of the bodies
/// and of W r, counts as 0.
fn bond_load_error(contact_problem: &ContactProblem, swept: &SweptRow, u: &Vec3, reactions: &ContactReactions) -> f64 {
    let (opening, sliding, is_linear) = match swept.kind {
        RowKind::Contact { compliance, sliding } if sliding > 0.0 => (compliance, sliding, false),
        RowKind::LinearBond { opening, sliding } => (opening, sliding, true),
        _ => return 0.0,
    };
    let (row, r) = (&contact_problem.rows[swept.row.index()], &reactions.impulses[swept.row.index()]);
    let (n, strength) = (&row.normal, -row.impulse_shift);
    let share = |error: &Vec3, [along, across]: [f64; 2]| {
        let normal = n.dot(error);
        let limit_share = |size: f64, limit: f64| if limit > 0.0 { size / limit } else { 0.0 };
        limit_share(normal.abs(), along).max(limit_share((error - n * normal).norm(), across))
    };
    let by_strain = row.strain_load([opening, sliding], u);
    let by_strain = if is_linear { by_strain } else { limited_impulse(n, row.friction, &by_strain) };
    let impulse_share = share(&(r - by_strain), [strength, row.friction * strength]);
    let (w_n, w_t) = contact_problem.delassus_diagonal(swept.row.index());
    let speed_rounding = ROUNDING_FLOOR * (speed_scale(contact_problem, swept.row) + w_n.max(w_t) * r.norm());
    let rounding = speed_rounding / (opening.min(sliding) * strength * row.friction.min(1.0));
    let beyond_rounding = |share: f64| if share <= rounding { 0.0 } else { share };
    let Some(index) = swept.roll else { return beyond_rounding(impulse_share) };
    let (roll, m) = (&contact_problem.rolling_constraints[index], &reactions.moments[index]);
    let [across, along] = roll.compliance;
    let spin = contact_problem.shifted_spin(roll, &contact_problem.bodies);
    let by_strain = row.strain_load([along, across], &spin);
    let by_strain = if is_linear { by_strain } else { roll.limited_moment(r, n, &by_strain) };
    let (across_limit, along_limit) = roll.moment_bounds(&(n * strength), n);
    beyond_rounding(impulse_share.max(share(&(m - by_strain), [along_limit * roll.radius, across_limit * roll.radius])))
}

/// Impulse `r` reduced to the cone of the friction coefficient `friction` about `n`, along n and across.
fn limited_impulse(n: &Vec3, friction: f64, r: &Vec3) -> Vec3 {
    let along = n.dot(r).max(0.0);
    let across = r - n * n.dot(r);
    let (size, bound) = (across.norm(), friction * along);
    n * along + if size > bound { across * (bound / size) } else { across }
}

/// Gives the two bodies of a row the moment `m` on the candidate and -m on the antagonist, N m s.
fn apply_moment(contact_problem: &mut ContactProblem, row: ContactId, m: &Vec3) {
    let [a, b] = contact_problem.rows[row.index()].bodies;
    for (body, m) in [(a, *m), (b, -m)] {
        let turn = contact_problem.angular_velocity_change(body, &m);
        contact_problem.bodies[body.index()].w += turn;
    }
}

/// Violation of the contact laws by some rows.
struct SystemResidual {
    /// Norm of F over the rows, N s.
    norm: f64,
    /// Row with the largest part in it.
    worst: Option<ContactId>,
    /// Largest error of the load of an elastic bond over its strength, see [`bond_load_error`].
    load_error: f64,
    /// Row of that bond.
    worst_bond: Option<ContactId>,
}

impl SystemResidual {
    /// Residual of the swept rows. The part of a moment is its error divided by R.
    fn new(contact_problem: &ContactProblem, rows: &[SweptRow], reactions: &ContactReactions) -> SystemResidual {
        let mut sums = SystemResidual { norm: 0.0, worst: None, load_error: 0.0, worst_bond: None };
        let mut largest = 0.0;
        for swept in rows {
            let k = swept.row.index();
            let u = contact_problem.shifted_velocity(k, &contact_problem.bodies);
            let r = &reactions.impulses[k];
            let mut size_squared = swept.natural_map(contact_problem, &u, r).norm_squared();
            if let Some(index) = swept.roll {
                let (roll, m) = (&contact_problem.rolling_constraints[index], &reactions.moments[index]);
                let solved = swept.solve_moment(contact_problem, roll, r, m);
                size_squared += ((m - solved) / roll.radius).norm_squared();
            }
            sums.norm += size_squared;
            if size_squared > largest {
                (largest, sums.worst) = (size_squared, Some(swept.row));
            }
            let load_error = bond_load_error(contact_problem, swept, &u, reactions);
            if load_error > sums.load_error {
                (sums.load_error, sums.worst_bond) = (load_error, Some(swept.row));
            }
        }
        SystemResidual { norm: sums.norm.sqrt(), ..sums }
    }

    /// E relative to the norm `initial`. A norm of up to `floor` is rounding.
    fn relative_to(&self, initial: f64, floor: f64) -> RelativeResidual {
        let (of_laws, worst) = if self.norm <= floor { (0.0, None) } else { (self.norm / initial, self.worst) };
        let worst = if self.load_error > of_laws { self.worst_bond } else { worst };
        RelativeResidual { value: of_laws.max(self.load_error), of_laws, worst }
    }
}

/// E of a problem.
struct RelativeResidual {
    /// E, that of the loads of elastic bonds included.
    value: f64,
    /// E by the natural map alone.
    of_laws: f64,
    /// Row with the largest part in it.
    worst: Option<ContactId>,
}

/// One sweep over the rows.
fn sweep_rows(work: &mut ContactProblem, rows: &[SweptRow], reactions: &mut ContactReactions) {
    for swept in rows {
        let k = swept.row.index();
        let new = swept.solve(work, &work.shifted_velocity(k, &work.bodies), &reactions.impulses[k]);
        work.apply_impulse(k, &(new - reactions.impulses[k]));
        reactions.impulses[k] = new;
        if let Some(index) = swept.roll {
            let m = reactions.moments[index];
            let solved = swept.solve_moment(work, &work.rolling_constraints[index], &new, &m);
            apply_moment(work, swept.row, &(solved - m));
            reactions.moments[index] = solved;
        }
    }
}

/// Corrections of elastic bonds by gradients, as long as they gain.
struct BondCorrections {
    /// Number of sweeps at which the next one is due.
    next: u64,
    /// Residual after the last one.
    residual: f64,
    /// Whether the last correction while the residual of the laws was above its target reduced the residual enough.
    gains: bool,
    /// Whether the last correction while only loads of bonds were above it did.
    gains_loads: bool,
}

impl BondCorrections {
    /// No correction so far; the first is due after `next` sweeps.
    fn new(contact_problem: &ContactProblem, next: u64) -> BondCorrections {
        let has_bonds = contact_problem.regularised.iter().any(|row| matches!(row, RegularisedRow::Bond { .. }));
        BondCorrections { next, residual: f64::INFINITY, gains: has_bonds, gains_loads: has_bonds }
    }

    /// Whether a correction is due after `sweeps`, which do not find the loads of bonds: at once if the laws hold to `target`.
    fn is_due(&self, sweeps: u64, residual: &RelativeResidual, target: f64) -> bool {
        if residual.of_laws <= target { self.gains_loads } else { self.gains && sweeps >= self.next }
    }

    /// Counts a correction of an error of loads alone or also of others, which has ended after `sweeps` with the `residual`.
    fn count(&mut self, is_of_loads: bool, sweeps: u64, residual: &RelativeResidual) {
        let has_gained = residual.value <= MIN_CORRECTION_GAIN * self.residual;
        if is_of_loads {
            self.gains_loads = has_gained;
        } else {
            self.gains = has_gained;
        }
        self.residual = residual.value;
        self.next = sweeps + SWEEPS_BETWEEN_CORRECTIONS;
    }
}

/// Scale of the velocities at a row, m/s: the speeds of its bodies, its shift and the velocity by its attraction,
/// summed. The rounding of its relative velocity is relative to this scale.
fn speed_scale(contact_problem: &ContactProblem, row: ContactId) -> f64 {
    let constraint = &contact_problem.rows[row.index()];
    let (w_n, _) = contact_problem.delassus_diagonal(row.index());
    let speed_sum: f64 = constraint.bodies.iter().map(|i| contact_problem.bodies[i.index()].v.norm()).sum();
    speed_sum + constraint.shift.norm() + w_n * constraint.impulse_shift.abs()
}

/// Solves a problem with regularised rows, and returns its solution as [`solve_nlgs`](super::solve_nlgs) does.
pub fn solve_regularised(contact_problem: &ContactProblem, criteria: StoppingCriteria) -> ContactSolution {
    let mut active: Vec<ContactId> = (0..contact_problem.rows.len())
        .map(ContactId::new)
        .filter(|k| contact_problem.rows[k.index()].can_close)
        .collect();
    let mut reactions = ContactReactions::warm_start(contact_problem);
    let mut sweeps = 0;
    // Bonds that reached a limit as a linear one, sorted.
    let mut yielding: Vec<ContactId> = Vec::new();
    loop {
        let swept_row = |&k: &ContactId| SweptRow::new(contact_problem, k, yielding.binary_search(&k).is_ok());
        let rows: Vec<SweptRow> = active.iter().map(swept_row).collect();
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
        let impulse_scale = |k: &ContactId| {
            let (w_n, w_t) = contact_problem.delassus_diagonal(k.index());
            speed_scale(contact_problem, *k) * 3.0 / (w_n + 2.0 * w_t)
        };
        let floor = ROUNDING_FLOOR * active.iter().map(|k| impulse_scale(k).powi(2)).sum::<f64>().sqrt();
        let initial = SystemResidual::new(&moved_problem(&balance), &rows, &balance).norm.max(floor);
        let mut work = moved_problem(&reactions);
        let relative_residual = |work: &ContactProblem, reactions: &ContactReactions| {
            SystemResidual::new(work, &rows, reactions).relative_to(initial, floor)
        };
        let mut residual = relative_residual(&work, &reactions);
        // Sweeps first bring yielding bonds to their limits.
        let first_correction = if yielding.is_empty() { sweeps } else { sweeps + SWEEPS_BETWEEN_CHECKS };
        let mut corrections = BondCorrections::new(contact_problem, first_correction);
        let target = criteria.target_residual;
        // Sweeps alone do not find the loads of bonds.
        let is_worth_it = |residual: &RelativeResidual, corrections: &BondCorrections| {
            residual.of_laws > target || residual.value > target && corrections.gains_loads
        };
        while is_worth_it(&residual, &corrections) && sweeps < criteria.max_sweeps && !activity::is_stopped() {
            let is_correction = corrections.is_due(sweeps, &residual, target);
            let is_of_loads = residual.of_laws <= target;
            if is_correction {
                let reduction = REDUCTION_MARGIN * target / residual.value;
                let limits = GradientLimits { reduction, iterations: criteria.max_sweeps - sweeps };
                let (corrected, iterations) =
                    corrected_reactions(contact_problem, reactions, &work.bodies, &yielding, limits);
                sweeps += iterations;
                reactions = corrected;
            } else {
                for _ in 0..SWEEPS_BETWEEN_CHECKS.min(criteria.max_sweeps - sweeps) {
                    sweep_rows(&mut work, &rows, &mut reactions);
                    sweeps += 1;
                    activity::count_sweep();
                }
            }
            // Rounding accumulates in the velocities.
            work = moved_problem(&reactions);
            residual = relative_residual(&work, &reactions);
            if is_correction {
                corrections.count(is_of_loads, sweeps, &residual);
                if rows.iter().any(|swept| swept.is_beyond_limits(contact_problem, &reactions)) {
                    break;
                }
            }
        }
        let solver_bodies: Vec<SolverBody> = work.bodies;
        let missed = closing_inactive_rows(contact_problem, &active, &solver_bodies);
        let beyond: Vec<ContactId> = rows
            .iter()
            .filter(|swept| swept.is_beyond_limits(contact_problem, &reactions))
            .map(|swept| swept.row)
            .collect();
        if missed.is_empty() && beyond.is_empty() || sweeps >= criteria.max_sweeps || activity::is_stopped() {
            return ContactSolution {
                impulses: reactions.impulses,
                moments: reactions.moments,
                solver_bodies,
                sweeps,
                single_precision: false,
                residual: residual.value,
                converged: residual.value <= criteria.tol && missed.is_empty() && beyond.is_empty(),
                left_out: missed.len(),
                worst: residual.worst.or(missed.first().copied()),
                active_rows: active.len(),
                fallback_used: false,
                stalled_residual: None,
                replacement_reason: None,
            };
        }
        active.extend(missed);
        active.sort_unstable();
        yielding.extend(beyond);
        yielding.sort_unstable();
    }
}
