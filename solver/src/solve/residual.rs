//! Residual of a solution of the contact problem; shares no arithmetic with the solvers.
//!
//! E = |F(r)|/|F(r_0)| with the natural map F(r) = r - P_K(r - rho (û + mu |û_T| n)), rho = 3N/trace W, over the contacts
//! that can close in the step. E is 1 if nothing is solved, 0 exactly at a solution, and the same in any units and for any
//! alert distance. r_0 is 0; for contacts with an attraction it is the impulse that balances this
//! ([`ContactConstraint::balancing_impulse`](crate::assemble::ContactConstraint::balancing_impulse)): cohesion, however
//! strong, is no load by itself. A moment m of rolling and spinning friction counts as an impulse m/R against a velocity R w.
//!
//! Source: V. Acary, B. Brogliato, Numerical Methods for Nonsmooth Dynamical Systems (2008), ch. 13.

use std::cell::Cell;
use std::ops::{Deref, Range};

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use crate::assemble::{ContactConstraint, ContactProblem, RollingConstraint, SolverBody};
use crate::math::simd::{F64Arithmetic, LaneOperation, Scalar, SimdWidth};
use crate::math::{PAR_MIN_LEN, Vec3};
use crate::ranks;
use crate::ranks::lists::chunk_results;
use crate::scene::BodyId;
use crate::solve::gauss_seidel::row_division::RowDivision;
use crate::solve::types::ContactSolution;
use crate::state::ContactId;

/// Share of the summed velocities at the contacts, and of those that attractions would cause, below which a residual is
/// rounding: steps in which no contact closes count as solved.
const ROUNDING_FLOOR: f64 = 1e-15;

/// The same where bonds carry moments: the velocities of a bar in free flight, which nothing loads, differ by some 20 units in the
/// last place.
const MOMENT_ROUNDING_FLOOR: f64 = 1e-14;

/// Contacts evaluated at once.
pub const GROUP_LANES: usize = 8;

/// Smallest number of bodies whose impulses a task adds.
const BODIES_PER_RANGE: usize = 1024;

/// Groups of eight contacts per task.
const GROUPS_PER_TASK: usize = 128;

/// Smallest number of tasks that are divided among ranks: a task takes some 0.02 ms, as the exchange does.
const MIN_DIVIDED_TASKS: usize = 4;

/// Sum of |F|² of some contacts, N² s².
#[derive(Clone, Copy)]
struct SquaredResidual {
    /// Sum of |F|², N² s².
    sum: f64,
    /// Largest |F|² of a contact.
    largest: f64,
    /// Row of that contact; `None` if all |F| are 0.
    worst: Option<ContactId>,
}

/// [`SquaredResidual`] of the contacts of a task, as ranks exchange it; `worst` is a row or [`NO_ROW`].
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct TaskResidual {
    sum: f64,
    largest: f64,
    worst: u64,
}

/// Number in place of a row that does not exist.
const NO_ROW: u64 = u64::MAX;

impl From<SquaredResidual> for TaskResidual {
    fn from(SquaredResidual { sum, largest, worst }: SquaredResidual) -> Self {
        TaskResidual { sum, largest, worst: worst.map_or(NO_ROW, |row| u64::from(row.0)) }
    }
}

impl From<TaskResidual> for SquaredResidual {
    fn from(TaskResidual { sum, largest, worst }: TaskResidual) -> Self {
        SquaredResidual { sum, largest, worst: (worst != NO_ROW).then_some(ContactId(worst as u32)) }
    }
}

/// Data of eight contacts by columns; unused lanes of the last group have no n, shift and friction.
#[derive(Debug, Clone, Copy)]
pub struct ContactGroup {
    /// Normals, world frame.
    n: [[f64; GROUP_LANES]; 3],
    /// Shifts of the relative velocity, world frame, m/s.
    shift: [[f64; GROUP_LANES]; 3],
    /// Vectors from the centres of candidate and antagonist to the contact point, m.
    arms: [[[f64; GROUP_LANES]; 3]; 2],
    /// Friction coefficients.
    friction: [f64; GROUP_LANES],
    /// Indices of the bodies of candidate and antagonist.
    bodies: [[u32; GROUP_LANES]; 2],
}

/// n×d of eight contacts, d their friction offsets, m.
type GroupLevers = [[f64; GROUP_LANES]; 3];

/// Velocity (m/s), 0, angular velocity (rad/s), 0 of a body; world frame.
pub type BodyMotion = [f64; 8];

fn body_motion(v: &Vec3, w: &Vec3) -> BodyMotion {
    [v.x, v.y, v.z, 0.0, w.x, w.y, w.z, 0.0]
}

/// Evaluator of the residual E of some rows of a contact problem.
pub struct ResidualEvaluator<'a> {
    problem: &'a ContactProblem,
    /// Width of the vectors.
    pub(super) width: SimdWidth,
    /// Rows that are evaluated.
    rows: &'a [ContactId],
    contacts: ContactGroups,
    /// Friction levers of the contacts; empty if all are 0.
    levers: Vec<GroupLevers>,
    /// Scale 3N/trace W of the natural map, kg.
    rho: f64,
    /// Norm |F(r_0)|, N s.
    initial_norm: f64,
    /// Norm |F| below which it is rounding, N s.
    floor: f64,
    /// Division of the rows among ranks, if this rank has only those that it sweeps.
    pub(super) division: Option<&'a RowDivision>,
}

/// Scales of the residual of a problem.
#[derive(Debug, Clone, Copy)]
pub struct ResidualScales {
    /// Scale 3N/trace W of the natural map, kg.
    rho: f64,
    /// Norm |F| below which it is rounding, N s.
    floor: f64,
}

/// Contribution of a row to the scales, as ranks exchange it.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct RowScales {
    w_n: f64,
    w_t: f64,
    /// Sum of the speeds at the contact, m/s.
    speed: f64,
}

/// Sums of the scales of the rows of a task, as ranks exchange them.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct ScaleSums {
    trace: f64,
    squared_speeds: f64,
}

/// Speed (m/s) and angular speed (rad/s) of each body of the problem, shared by its contacts.
fn body_speeds(problem: &ContactProblem) -> Vec<[f64; 2]> {
    let bodies = problem.bodies.par_iter().with_min_len(PAR_MIN_LEN);
    bodies.map(|body_start| [body_start.v.norm(), body_start.w.norm()]).collect()
}

impl RowScales {
    /// Contribution of row `k`; `speeds`: [`body_speeds`].
    fn new(problem: &ContactProblem, speeds: &[[f64; 2]], k: ContactId) -> Self {
        let row = &problem.rows[k.index()];
        let speed_of_side = |side: usize| {
            let [speed, angular_speed] = speeds[row.bodies[side].index()];
            speed + angular_speed * problem.contact_arm(k.index(), side).norm()
        };
        let (w_n, w_t) = problem.delassus_diagonal(k.index());
        let speed = speed_of_side(0) + speed_of_side(1) + row.shift.norm() + w_n * row.impulse_shift.abs();
        RowScales { w_n, w_t, speed }
    }
}

impl ScaleSums {
    const ZERO: Self = ScaleSums { trace: 0.0, squared_speeds: 0.0 };

    /// Sums with those of one more row.
    fn with_row(self, RowScales { w_n, w_t, speed }: RowScales) -> Self {
        ScaleSums { trace: self.trace + w_n + 2.0 * w_t, squared_speeds: self.squared_speeds + speed * speed }
    }

    /// Sums with those of one more task.
    fn with_task(self, task: Self) -> Self {
        ScaleSums { trace: self.trace + task.trace, squared_speeds: self.squared_speeds + task.squared_speeds }
    }
}

impl ResidualScales {
    /// Scales of `rows` rows with these sums.
    fn new(sums: ScaleSums, rows: usize, rounding: f64) -> Self {
        let rho = if rows == 0 { 0.0 } else { 3.0 * rows as f64 / sums.trace };
        ResidualScales { rho, floor: rounding * rho * sums.squared_speeds.sqrt() }
    }

    /// Scales of the active rows of all ranks, `count` in number; `active`: those of `problem`, which this rank lists.
    pub fn of_ranks(problem: &ContactProblem, active: &[ContactId], count: usize) -> Self {
        let speeds = body_speeds(problem);
        let rows: Vec<RowScales> =
            active.par_iter().with_min_len(PAR_MIN_LEN).map(|&k| RowScales::new(problem, &speeds, k)).collect();
        let sum_rows = |rows: &[RowScales]| rows.iter().fold(ScaleSums::ZERO, |sums, &row| sums.with_row(row));
        let tasks = chunk_results(&rows, GROUPS_PER_TASK * GROUP_LANES, sum_rows);
        ResidualScales::new(tasks.into_iter().fold(ScaleSums::ZERO, ScaleSums::with_task), count, ROUNDING_FLOOR)
    }
}

/// |F|² of a row, N² s², as ranks exchange it.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct RowResidual {
    size2: f64,
    row: u64,
}

/// Residual E and the row with the largest part in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// E, dimensionless.
    pub value: f64,
    /// Row with the largest part; `None` if E is 0.
    pub worst: Option<ContactId>,
}

/// Residual of a problem with the associated law of friction.
pub struct AssociatedResidual {
    /// E by these laws.
    pub residual: f64,
    /// rho mu |û_T|/|F(r_0)| of each evaluated row that has the associated law and an impulse, else 0: what the separation of a
    /// sliding contact adds to E by Coulomb's law.
    pub separations: Vec<f64>,
}

thread_local! {
    /// Memory of the contacts of the last evaluator. A large array that is allocated anew costs a page fault for every 4 kB.
    static CONTACT_MEMORY: Cell<Vec<ContactGroup>> = const { Cell::new(Vec::new()) };
    /// Memory of the solver bodies that an evaluator has returned.
    static BODY_MEMORY: Cell<Vec<SolverBody>> = const { Cell::new(Vec::new()) };
}

/// Keeps the memory of solver bodies, which are not used any more, for the next ones of this thread.
pub(super) fn keep_body_memory(solver_bodies: Vec<SolverBody>) {
    BODY_MEMORY.set(solver_bodies);
}

/// Keeps the memory of the large array of a solution, which is not used any more, for the next one of this thread.
pub fn keep_solution_memory(solution: ContactSolution) {
    keep_body_memory(solution.solver_bodies);
}

/// Contacts of an evaluator, whose memory is kept for the next evaluator of this thread.
struct ContactGroups(Vec<ContactGroup>);

impl ContactGroups {
    fn new(problem: &ContactProblem, rows: &[ContactId]) -> Self {
        let mut groups = CONTACT_MEMORY.take();
        let contacts = rows.par_chunks(GROUP_LANES).with_min_len(GROUPS_PER_TASK);
        contacts.map(|rows| contact_group(problem, rows)).collect_into_vec(&mut groups);
        ContactGroups(groups)
    }
}

impl Deref for ContactGroups {
    type Target = [ContactGroup];

    fn deref(&self) -> &[ContactGroup] {
        &self.0
    }
}

impl Drop for ContactGroups {
    fn drop(&mut self) {
        CONTACT_MEMORY.set(std::mem::take(&mut self.0));
    }
}

impl<'a> ResidualEvaluator<'a> {
    /// Evaluator for the rows `rows` of `problem`.
    pub fn new(problem: &'a ContactProblem, rows: &'a [ContactId], width: SimdWidth) -> Self {
        let contacts = ContactGroups::new(problem, rows);
        let has_levers = problem.block_data.as_ref().is_some_and(|block_data| !block_data.friction_offsets.is_empty());
        let levers = if has_levers {
            rows.par_chunks(GROUP_LANES).with_min_len(GROUPS_PER_TASK).map(|rows| group_levers(problem, rows)).collect()
        } else {
            Vec::new()
        };
        let speeds = if rows.is_empty() { Vec::new() } else { body_speeds(problem) };
        // Trace of W, sum of the squares of the speeds at the contacts, and whether there is an attraction.
        let scales_of = |rows: &[ContactId]| {
            rows.iter().fold((ScaleSums::ZERO, false), |(sums, attracts), &k| {
                let attracts = attracts || problem.rows[k.index()].impulse_shift != 0.0;
                (sums.with_row(RowScales::new(problem, &speeds, k)), attracts)
            })
        };
        let parts: Vec<_> = rows.par_chunks(GROUPS_PER_TASK * GROUP_LANES).map(scales_of).collect();
        let (sums, attracts) =
            parts.iter().fold((ScaleSums::ZERO, false), |sum, part| (sum.0.with_task(part.0), sum.1 || part.1));
        let rounding = if problem.has_bond_moments() { MOMENT_ROUNDING_FLOOR } else { ROUNDING_FLOOR };
        let ResidualScales { rho, floor } = ResidualScales::new(sums, rows.len(), rounding);
        let mut evaluator =
            ResidualEvaluator { problem, width, rows, contacts, levers, rho, initial_norm: 0.0, floor, division: None };
        let balance = |row: &ContactConstraint| match row.impulse_shift {
            0.0 => Vec3::zeros(),
            _ => row.normal * row.balancing_impulse(),
        };
        let free_motion = |body_start: &SolverBody| body_motion(&body_start.v, &body_start.w);
        let (balance, motions): (Vec<Vec3>, _) = if attracts {
            let balance: Vec<Vec3> = problem.rows.par_iter().with_min_len(PAR_MIN_LEN).map(balance).collect();
            let motions = evaluator.body_motions(&balance);
            (balance, motions)
        } else if rows.is_empty() {
            (Vec::new(), Vec::new())
        } else {
            (Vec::new(), problem.bodies.par_iter().with_min_len(PAR_MIN_LEN).map(free_motion).collect())
        };
        evaluator.initial_norm = evaluator.residual_norm(&balance, &[], &motions).0;
        evaluator
    }

    /// Evaluator for the rows of all ranks, of which `problem` has those that this rank sweeps, `rows`; without attractions.
    pub fn of_division(
        problem: &'a ContactProblem,
        rows: &'a [ContactId],
        width: SimdWidth,
        division: &'a RowDivision,
        ResidualScales { rho, floor }: ResidualScales,
    ) -> Self {
        let (contacts, division) = (ContactGroups::new(problem, rows), Some(division));
        let mut evaluator = ResidualEvaluator {
            problem,
            width,
            rows,
            contacts,
            levers: Vec::new(),
            rho,
            initial_norm: 0.0,
            floor,
            division,
        };
        let free_motion = |body_start: &SolverBody| body_motion(&body_start.v, &body_start.w);
        let motions: Vec<BodyMotion> = problem.bodies.par_iter().with_min_len(PAR_MIN_LEN).map(free_motion).collect();
        evaluator.initial_norm = evaluator.residual_norm(&[], &[], &motions).0;
        evaluator
    }

    /// Whether no row of any rank is evaluated.
    pub(super) fn is_empty(&self) -> bool {
        self.division.map_or(self.rows.is_empty(), |division| division.active_count == 0)
    }

    /// Share of |F(r_0)| that is rounding.
    pub fn relative_floor(&self) -> f64 {
        if self.initial_norm > 0.0 { self.floor / self.initial_norm } else { 0.0 }
    }

    /// Ratio of the rounding of the impulses to the sum of the momenta of the bodies and |F(r_0)|.
    pub fn rounding_share(&self, impulses: &[Vec3]) -> f64 {
        let impulse_sum: f64 = self.rows.iter().map(|&k| impulses[k.index()].norm_squared()).sum();
        let is_movable = |body_start: &&SolverBody| body_start.inverse_mass > 0.0;
        let momenta = self
            .problem
            .bodies
            .iter()
            .filter(is_movable)
            .map(|body_start| (body_start.v / body_start.inverse_mass).norm_squared());
        f64::EPSILON * impulse_sum.sqrt() / momenta.sum::<f64>().sqrt().max(self.initial_norm).max(self.floor)
    }

    /// E of the impulses r̂ (one per row of the problem, world frame, N s; 0 in rows that are not evaluated).
    pub fn residual(&self, impulses: &[Vec3]) -> Residual {
        self.residual_at(impulses, &self.body_motions(impulses))
    }

    /// E of the impulses if the motions that result from them are known.
    pub fn residual_at(&self, impulses: &[Vec3], motions: &[BodyMotion]) -> Residual {
        self.residual_with(impulses, &[], motions)
    }

    /// E of impulses and moments, one per rolling constraint of the problem, and of the motions that result from both.
    pub fn residual_with(&self, impulses: &[Vec3], moments: &[Vec3], motions: &[BodyMotion]) -> Residual {
        let (norm, worst) = self.residual_norm(impulses, moments, motions);
        if norm <= self.floor {
            return Residual { value: 0.0, worst: None };
        }
        Residual { value: norm / self.initial_norm.max(self.floor), worst }
    }

    /// V_free + M⁻¹ H r̂, computed anew.
    pub fn body_motions(&self, impulses: &[Vec3]) -> Vec<BodyMotion> {
        if let Some(division) = self.division {
            return self.motions_of_ranks(impulses, division);
        }
        // Sums of the impulses on each body and of their moments about its centre, for each half of the contacts: the halves
        // depend only on the number of contacts. More than two threads share the bodies of a half, which changes no sum: each
        // reads all contacts of the half, so that this costs nothing where there are two threads or one.
        let ranges = rayon::current_num_threads().div_ceil(2).min(self.problem.bodies.len() / BODIES_PER_RANGE).max(1);
        let range_bits = self.problem.bodies.len().div_ceil(ranges).next_power_of_two().trailing_zeros();
        let ranges = self.problem.bodies.len().div_ceil(1 << range_bits);
        let half = groups_in_half(self.contacts.len());
        let halves = self.contacts.len().div_ceil(half);
        let part_motions = |part: usize| {
            let (from, range) = (part / ranges * half, part % ranges);
            let levers = self.levers.get(from..).unwrap_or_default();
            let contacts = &self.contacts[from..self.contacts.len().min(from + half)];
            let (first, rows) = (range << range_bits, &self.rows[from * GROUP_LANES..]);
            let bodies = first..self.problem.bodies.len().min(first + (1 << range_bits));
            self.width.run(BodyImpulseSums { contacts, levers, rows, skipped_rows: 0, impulses, bodies })
        };
        let parts = (0..halves * ranges).into_par_iter().with_max_len(1);
        let parts: Vec<Vec<[f64; 6]>> = parts.map(part_motions).collect();
        let motion_of_body = |(body, body_start): (usize, &SolverBody)| {
            let mut sum = [0.0; 6];
            let (range, index) = (body >> range_bits, body & ((1 << range_bits) - 1));
            for half in parts.chunks_exact(ranges) {
                (0..6).for_each(|k| sum[k] += half[range][index][k]);
            }
            self.motion_after(BodyId(body as u32), body_start, sum)
        };
        self.problem
            .bodies
            .par_iter()
            .with_min_len(GROUPS_PER_TASK * GROUP_LANES)
            .enumerate()
            .map(motion_of_body)
            .collect()
    }

    /// Motion of a body after an impulse and an angular impulse, the six numbers `sum`.
    #[inline]
    fn motion_after(&self, body: BodyId, body_start: &SolverBody, sum: [f64; 6]) -> BodyMotion {
        let v = body_start.v + self.problem.velocity_change(body, &Vec3::new(sum[0], sum[1], sum[2]));
        let w = body_start.w + self.problem.angular_velocity_change(body, &Vec3::new(sum[3], sum[4], sum[5]));
        body_motion(&v, &w)
    }

    /// [`Self::body_motions`] by the rows of all ranks: a rank sweeps all rows of the bodies in its blocks, and adds their
    /// impulses in the order of the list.
    fn motions_of_ranks(&self, impulses: &[Vec3], division: &RowDivision) -> Vec<BodyMotion> {
        let groups = division.active_count.div_ceil(GROUP_LANES);
        let rows_in_half = (groups_in_half(groups) * GROUP_LANES) as u32;
        let first_half = division.active_indices.partition_point(|&index| index < rows_in_half);
        let bodies = self.problem.bodies.len();
        let sums_of_half = |rows: Range<usize>| {
            let (first_group, skipped_rows) = (rows.start / GROUP_LANES, rows.start % GROUP_LANES);
            self.width.run(BodyImpulseSums {
                contacts: &self.contacts[first_group..rows.end.div_ceil(GROUP_LANES)],
                levers: &[],
                rows: &self.rows[first_group * GROUP_LANES..rows.end],
                skipped_rows,
                impulses,
                bodies: 0..bodies,
            })
        };
        let halves = [0..first_half, first_half..self.rows.len()].into_par_iter().with_max_len(1);
        let halves: Vec<Vec<[f64; 6]>> = halves.map(sums_of_half).collect();
        let number_of_halves = if groups_in_half(groups) < groups { 2 } else { 1 };
        let own_motion = |body: BodyId| {
            let mut sum = [0.0; 6];
            for half in &halves[..number_of_halves] {
                (0..6).for_each(|k| sum[k] += half[body.index()][k]);
            }
            let [vx, vy, vz, _, wx, wy, wz, _] = self.motion_after(body, &self.problem.bodies[body.index()], sum);
            [vx, vy, vz, wx, wy, wz]
        };
        let unmoved =
            |(body, body_start): (usize, &SolverBody)| self.motion_after(BodyId::new(body), body_start, [0.0; 6]);
        let mut motions: Vec<BodyMotion> =
            self.problem.bodies.par_iter().enumerate().with_min_len(PAR_MIN_LEN).map(unmoved).collect();
        let moved = division.body_values(own_motion);
        for (body, [vx, vy, vz, wx, wy, wz]) in division.partition.bodies.iter().zip(moved) {
            motions[body.index()] = [vx, vy, vz, 0.0, wx, wy, wz, 0.0];
        }
        motions
    }

    /// |F| and the row with the largest part in it, by the rows of all ranks.
    fn norm_of_ranks(
        &self,
        impulses: &[Vec3],
        motions: &[BodyMotion],
        division: &RowDivision,
    ) -> (f64, Option<ContactId>) {
        let mut sizes2 = vec![0.0; self.contacts.len() * GROUP_LANES];
        let tasks = self.rows.par_chunks(GROUP_LANES * GROUPS_PER_TASK).zip(self.contacts.par_chunks(GROUPS_PER_TASK));
        let tasks = tasks.zip(sizes2.par_chunks_mut(GROUP_LANES * GROUPS_PER_TASK));
        tasks.for_each(|((rows, contacts), sizes2)| {
            self.width.run(NaturalMap { rows, contacts, levers: &[], impulses, motions, rho: self.rho, sizes2 });
        });
        let listed = division.listed_values(|row| sizes2[row]).into_iter().zip(&division.listed_rows);
        let listed: Vec<RowResidual> = listed.map(|(size2, &row)| RowResidual { size2, row: u64::from(row) }).collect();
        let sum_rows = |rows: &[RowResidual]| {
            let none = TaskResidual { sum: 0.0, largest: 0.0, worst: NO_ROW };
            rows.iter().fold(none, |TaskResidual { sum, largest, worst }, &RowResidual { size2, row }| {
                let (largest, worst) = if size2 > largest { (size2, row) } else { (largest, worst) };
                TaskResidual { sum: sum + size2, largest, worst }
            })
        };
        let tasks = chunk_results(&listed, GROUP_LANES * GROUPS_PER_TASK, sum_rows);
        let (mut sum, mut largest, mut worst) = (0.0, 0.0, None);
        for task in tasks.into_iter().map(SquaredResidual::from) {
            sum += task.sum;
            if task.largest > largest {
                (largest, worst) = (task.largest, task.worst);
            }
        }
        (sum.sqrt(), worst)
    }

    /// V_free + M⁻¹ (H r̂ + m), computed anew; `moments` has one moment per rolling constraint of the system, world frame, on
    /// the candidate, N m s.
    pub fn motions_with(&self, impulses: &[Vec3], moments: &[Vec3]) -> Vec<BodyMotion> {
        let mut motions = self.body_motions(impulses);
        for (roll, m) in self.problem.rolling_constraints.iter().zip(moments) {
            for (body, m) in self.problem.rows[roll.row.index()].bodies.into_iter().zip([*m, -m]) {
                let change = self.problem.angular_velocity_change(body, &m);
                (0..3).for_each(|k| motions[body.index()][4 + k] += change[k]);
            }
        }
        motions
    }

    /// The bodies of the problem with these motions.
    pub fn solver_bodies(&self, motions: &[BodyMotion]) -> Vec<SolverBody> {
        let moved_body = |(body_start, m): (&SolverBody, &BodyMotion)| SolverBody {
            v: Vec3::new(m[0], m[1], m[2]),
            w: Vec3::new(m[4], m[5], m[6]),
            ..*body_start
        };
        let mut solver_bodies = BODY_MEMORY.take();
        self.problem
            .bodies
            .par_iter()
            .with_min_len(GROUPS_PER_TASK * GROUP_LANES)
            .zip(motions)
            .map(moved_body)
            .collect_into_vec(&mut solver_bodies);
        solver_bodies
    }

    /// The bodies of the problem after impulses of 0. Adding these turns -0 into 0, as in [`Self::body_motions`].
    pub fn unmoved_bodies(&self) -> Vec<SolverBody> {
        let unmoved_body = |(body, body_start): (usize, &SolverBody)| SolverBody {
            v: body_start.v + self.problem.velocity_change(BodyId(body as u32), &Vec3::zeros()),
            w: body_start.w + self.problem.angular_velocity_change(BodyId(body as u32), &Vec3::zeros()),
            ..*body_start
        };
        let mut solver_bodies = BODY_MEMORY.take();
        self.problem
            .bodies
            .par_iter()
            .with_min_len(GROUPS_PER_TASK * GROUP_LANES)
            .enumerate()
            .map(unmoved_body)
            .collect_into_vec(&mut solver_bodies);
        solver_bodies
    }

    /// |F| and the row with the largest part in it.
    fn residual_norm(&self, impulses: &[Vec3], moments: &[Vec3], motions: &[BodyMotion]) -> (f64, Option<ContactId>) {
        if let Some(division) = self.division {
            return self.norm_of_ranks(impulses, motions, division);
        }
        let task_residual = |(task, (rows, contacts)): (usize, (&[ContactId], &[ContactGroup]))| {
            let contacts = (contacts, self.levers.get(task * GROUPS_PER_TASK..).unwrap_or_default());
            self.evaluate_groups(rows, contacts, impulses, motions)
        };
        let tasks = self
            .rows
            .par_chunks(GROUP_LANES * GROUPS_PER_TASK)
            .zip(self.contacts.par_chunks(GROUPS_PER_TASK))
            .enumerate();
        let residuals_of = |range: Range<usize>| -> Vec<TaskResidual> {
            tasks.skip(range.start).take(range.len()).map(task_residual).map(TaskResidual::from).collect()
        };
        let tasks = self.rows.len().div_ceil(GROUP_LANES * GROUPS_PER_TASK);
        let parts = ranks::divided_list(tasks, MIN_DIVIDED_TASKS, residuals_of);
        let parts = parts.into_iter().map(SquaredResidual::from);
        let (mut sum, mut largest, mut worst) = (0.0, 0.0, None);
        let moment_residual = |(roll, m): (&RollingConstraint, &Vec3)| {
            let size2 = self.moment_residual_squared(roll, m, &impulses[roll.row.index()], motions);
            SquaredResidual { sum: size2, largest: size2, worst: Some(roll.row) }
        };
        let rolls =
            self.problem.rolling_constraints.par_iter().zip(moments).with_min_len(GROUP_LANES * GROUPS_PER_TASK);
        let moment_residuals: Vec<SquaredResidual> = rolls.map(moment_residual).collect();
        for part in parts.chain(moment_residuals) {
            sum += part.sum;
            if part.largest > largest {
                (largest, worst) = (part.largest, part.worst);
            }
        }
        (sum.sqrt(), worst)
    }

    /// |F|^2 of the moment `m` of a contact with the impulse `r`, N^2 s^2.
    ///
    /// With s = m/R and z = s - rho R w, F is rho R w plus the part of z beyond the bounds of [`RollingConstraint::moment_bounds`].
    /// Without a normal impulse F is s itself, without the rounding of w.
    fn moment_residual_squared(&self, roll: &RollingConstraint, m: &Vec3, r: &Vec3, motions: &[BodyMotion]) -> f64 {
        let row = &self.problem.rows[roll.row.index()];
        let [a, b] = row.bodies.map(|body| &motions[body.index()]);
        let n = row.normal;
        if n.x * r.x + n.y * r.y + n.z * r.z <= 0.0 {
            return (0..3).map(|k| (m[k] / roll.radius).powi(2)).sum();
        }
        let f = [0, 1, 2].map(|k| self.rho * roll.radius * (a[4 + k] - b[4 + k] + roll.shift[k]));
        let z = [0, 1, 2].map(|k| m[k] / roll.radius - f[k]);
        let along = n.x * z[0] + n.y * z[1] + n.z * z[2];
        let across = [0, 1, 2].map(|k| z[k] - along * n[k]);
        let length_across = across.iter().map(|c| c * c).sum::<f64>().sqrt();
        let (bound_across, bound_along) = roll.moment_bounds(r, &n);
        let excess_along = (along.abs() - bound_along).max(0.0).copysign(along);
        let excess_share = if length_across > 0.0 { (1.0 - bound_across / length_across).max(0.0) } else { 0.0 };
        (0..3).map(|k| (f[k] + excess_along * n[k] + excess_share * across[k]).powi(2)).sum()
    }

    /// |F|² of each evaluated row, N² s², for impulses that result in these motions.
    pub fn contributions(&self, impulses: &[Vec3], motions: &[BodyMotion]) -> Vec<f64> {
        let mut sizes2 = vec![0.0; self.contacts.len() * GROUP_LANES];
        let ResidualEvaluator { rows, rho, contacts, levers, .. } = self;
        let map = NaturalMap { rows, contacts, levers, impulses, motions, rho: *rho, sizes2: &mut sizes2 };
        map.call(Scalar);
        sizes2.truncate(rows.len());
        sizes2
    }

    /// Residual of a problem whose rows `associated` have the associated law of friction: in it sliding contacts part, and F
    /// has no mu |û_T|.
    pub fn associated_residual(
        &self,
        impulses: &[Vec3],
        motions: &[BodyMotion],
        associated: &[bool],
    ) -> AssociatedResidual {
        let solver_bodies = self.solver_bodies(motions);
        let contact_parts = |&k: &ContactId| {
            let (row, r) = (&self.problem.rows[k.index()], &impulses[k.index()]);
            let u = self.problem.shifted_velocity(k.index(), &solver_bodies) * self.rho;
            let separation = row.friction * (u - row.normal * row.normal.dot(&u)).norm();
            let z = r - u - row.normal * if associated[k.index()] { 0.0 } else { separation };
            let z_n = row.normal.dot(&z);
            let tangential = z - row.normal * z_n;
            let z_t = tangential.norm();
            let (p_n, p_t) = project_on_cone(Scalar, z_n, z_t, row.friction);
            let p = row.normal * p_n + if z_t > 0.0 { tangential * (p_t / z_t) } else { Vec3::zeros() };
            let separates = associated[k.index()] && row.normal.dot(r) > 0.0;
            ((r - p).norm_squared(), if separates { separation } else { 0.0 })
        };
        let parts: Vec<(f64, f64)> = self.rows.par_iter().with_min_len(PAR_MIN_LEN).map(contact_parts).collect();
        let norm = self.initial_norm.max(self.floor);
        AssociatedResidual {
            residual: parts.iter().map(|(squared, _)| squared).sum::<f64>().sqrt() / norm,
            separations: parts.iter().map(|(_, separation)| separation / norm).collect(),
        }
    }

    /// |F|² of the rows of a task.
    fn evaluate_groups(
        &self,
        rows: &[ContactId],
        (contacts, levers): (&[ContactGroup], &[GroupLevers]),
        impulses: &[Vec3],
        motions: &[BodyMotion],
    ) -> SquaredResidual {
        let (mut sum, mut largest, mut worst) = (0.0, 0.0, None);
        let mut sizes2 = [0.0; GROUP_LANES * GROUPS_PER_TASK];
        self.width.run(NaturalMap { rows, contacts, levers, impulses, motions, rho: self.rho, sizes2: &mut sizes2 });
        for (&k, size2) in rows.iter().zip(sizes2) {
            sum += size2;
            if size2 > largest {
                (largest, worst) = (size2, Some(k));
            }
        }
        SquaredResidual { sum, largest, worst }
    }
}

/// Groups of contacts, of this number, whose impulses on a body are added before the others.
fn groups_in_half(groups: usize) -> usize {
    if groups < GROUPS_PER_TASK { groups.max(1) } else { groups.div_ceil(2) }
}

/// Sums of the impulses on each of `bodies` and of their moments about its centre, in the order of the contacts.
struct BodyImpulseSums<'a> {
    contacts: &'a [ContactGroup],
    levers: &'a [GroupLevers],
    rows: &'a [ContactId],
    /// Number of the first rows whose impulses are not added.
    skipped_rows: usize,
    impulses: &'a [Vec3],
    bodies: Range<usize>,
}

impl LaneOperation for BodyImpulseSums<'_> {
    type Output = Vec<[f64; 6]>;

    #[inline(always)]
    fn call<L: F64Arithmetic>(self, l: L) -> Vec<[f64; 6]> {
        let BodyImpulseSums { contacts, levers, rows, mut skipped_rows, impulses, bodies } = self;
        let mut sums = vec![[0.0; 6]; bodies.len()];
        let mut moments = [[[0.0; GROUP_LANES]; 3]; 2];
        for (group, (columns, rows)) in contacts.iter().zip(rows.chunks(GROUP_LANES)).enumerate() {
            let r = group_impulses(rows, impulses);
            for from in (0..GROUP_LANES).step_by(L::WIDTH) {
                moments_about_centres(l, (columns, levers.get(group)), &r, from, &mut moments);
            }
            for lane in std::mem::take(&mut skipped_rows)..rows.len() {
                let [a, b] = [0, 1].map(|side| (columns.bodies[side][lane] as usize).wrapping_sub(bodies.start));
                if let Some(sum) = sums.get_mut(a) {
                    for axis in 0..3 {
                        sum[axis] += r[axis][lane];
                        sum[3 + axis] += moments[0][axis][lane];
                    }
                }
                if let Some(sum) = sums.get_mut(b) {
                    for axis in 0..3 {
                        sum[axis] -= r[axis][lane];
                        sum[3 + axis] -= moments[1][axis][lane];
                    }
                }
            }
        }
        sums
    }
}

/// Impulses of the rows of a group in columns; missing ones are 0.
#[inline(always)]
fn group_impulses(rows: &[ContactId], impulses: &[Vec3]) -> [[f64; GROUP_LANES]; 3] {
    let mut r = [[0.0; GROUP_LANES]; 3];
    for (lane, &k) in rows.iter().enumerate() {
        let Some(impulse) = impulses.get(k.index()) else { continue };
        (r[0][lane], r[1][lane], r[2][lane]) = (impulse.x, impulse.y, impulse.z);
    }
    r
}

/// Stores the moments of impulses `r` of `WIDTH` contacts from index `from` on about the centres of their bodies, by side:
/// arm×r + n (n×d)·r.
#[inline(always)]
fn moments_about_centres<L: F64Arithmetic>(
    l: L,
    (columns, levers): (&ContactGroup, Option<&GroupLevers>),
    r: &[[f64; GROUP_LANES]; 3],
    from: usize,
    moments: &mut [[[f64; GROUP_LANES]; 3]; 2],
) {
    let range = from..from + L::WIDTH;
    let mut impulse = [l.splat(0.0); 3];
    for (impulse, r) in impulse.iter_mut().zip(r) {
        *impulse = l.load(&r[range.clone()]);
    }
    let mut normal_moment = None;
    if let Some(levers) = levers {
        let mut lever = impulse;
        for (lever, column) in lever.iter_mut().zip(levers) {
            *lever = l.load(&column[range.clone()]);
        }
        normal_moment = Some(inner_product(l, lever, impulse));
    }
    for (moments, arm) in moments.iter_mut().zip(&columns.arms) {
        for (axis, to) in moments.iter_mut().enumerate() {
            let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
            let (arm_i, arm_j) = (l.load(&arm[i][range.clone()]), l.load(&arm[j][range.clone()]));
            let mut moment = l.sub(l.mul(arm_i, impulse[j]), l.mul(arm_j, impulse[i]));
            if let Some(normal_moment) = normal_moment {
                moment = l.add(moment, l.mul(l.load(&columns.n[axis][range.clone()]), normal_moment));
            }
            l.store(&mut to[range.clone()], moment);
        }
    }
}

/// Columns of the data of up to eight rows.
fn contact_group(problem: &ContactProblem, rows: &[ContactId]) -> ContactGroup {
    let zero = [0.0; GROUP_LANES];
    let (three, bodies) = ([zero; 3], [[0; GROUP_LANES]; 2]);
    let mut columns = ContactGroup { n: three, shift: three, arms: [three; 2], friction: zero, bodies };
    for (lane, &k) in rows.iter().enumerate() {
        let row = &problem.rows[k.index()];
        for axis in 0..3 {
            columns.n[axis][lane] = row.normal[axis];
            columns.shift[axis][lane] = row.shift[axis];
        }
        columns.friction[lane] = row.friction;
        for side in 0..2 {
            columns.bodies[side][lane] = row.bodies[side].0;
            let arm = problem.contact_arm(k.index(), side);
            for axis in 0..3 {
                columns.arms[side][axis][lane] = arm[axis];
            }
        }
    }
    columns
}

/// Columns of the friction levers of up to eight rows.
fn group_levers(problem: &ContactProblem, rows: &[ContactId]) -> GroupLevers {
    let mut levers = [[0.0; GROUP_LANES]; 3];
    for (lane, &k) in rows.iter().enumerate() {
        let lever = problem.friction_lever(k.index());
        (0..3).for_each(|axis| levers[axis][lane] = lever[axis]);
    }
    levers
}

/// |F|^2 of contacts, N^2 s^2.
struct NaturalMap<'a> {
    rows: &'a [ContactId],
    contacts: &'a [ContactGroup],
    levers: &'a [GroupLevers],
    /// Impulses by row of the problem; missing ones are 0.
    impulses: &'a [Vec3],
    motions: &'a [BodyMotion],
    /// Scale of the natural map, kg.
    rho: f64,
    /// Output: |F|² of each row, N² s².
    sizes2: &'a mut [f64],
}

impl LaneOperation for NaturalMap<'_> {
    type Output = ();
    #[inline(always)]
    fn call<L: F64Arithmetic>(self, l: L) {
        let NaturalMap { rows, contacts, levers, impulses, motions, rho, sizes2 } = self;
        let rows_of_groups = rows.chunks(GROUP_LANES).zip(sizes2.chunks_mut(GROUP_LANES));
        for (group, (columns, (rows, sizes2))) in contacts.iter().zip(rows_of_groups).enumerate() {
            let r = group_impulses(rows, impulses);
            for from in (0..GROUP_LANES).step_by(L::WIDTH) {
                let group_contacts = GroupContacts { columns, levers: levers.get(group), r: &r };
                natural_map_squared(l, group_contacts, motions, rho, from, &mut sizes2[from..]);
            }
        }
    }
}

/// Contacts of a group with their impulses.
struct GroupContacts<'a> {
    columns: &'a ContactGroup,
    /// Friction levers; `None` if all are 0.
    levers: Option<&'a GroupLevers>,
    /// r̂, world frame, N s.
    r: &'a [[f64; GROUP_LANES]; 3],
}

/// Stores |F|^2 of `WIDTH` contacts from index `from` on. In the plane of n and the tangential part of r - rho û, which
/// contains the projection, no frame is needed.
#[inline(always)]
fn natural_map_squared<L: F64Arithmetic>(
    l: L,
    GroupContacts { columns, levers, r }: GroupContacts,
    motions: &[BodyMotion],
    rho: f64,
    from: usize,
    size2: &mut [f64],
) {
    let range = from..from + L::WIDTH;
    let mut n = [l.splat(0.0); 3];
    let mut u = n;
    let mut impulse = n;
    let a = l.gather_lines(motions, &columns.bodies[0][range.clone()]);
    let b = l.gather_lines(motions, &columns.bodies[1][range.clone()]);
    for k in 0..3 {
        n[k] = l.load(&columns.n[k][range.clone()]);
        impulse[k] = l.load(&r[k][range.clone()]);
    }
    for (k, u) in u.iter_mut().enumerate() {
        let shift = l.load(&columns.shift[k][range.clone()]);
        *u =
            l.add(l.sub(point_velocity(l, columns, &a, 0, k, from), point_velocity(l, columns, &b, 1, k, from)), shift);
    }
    if let Some(levers) = levers {
        let spin = inner_product(l, n, [4, 5, 6].map(|k| l.sub(a[k], b[k])));
        for (k, u) in u.iter_mut().enumerate() {
            *u = l.add(*u, l.mul(spin, l.load(&levers[k][range.clone()])));
        }
    }
    let (zero, rho, mu) = (l.splat(0.0), l.splat(rho), l.load(&columns.friction[range]));
    let u_n = inner_product(l, n, u);
    let mut z = n;
    let mut u_t2 = zero;
    for k in 0..3 {
        z[k] = l.sub(impulse[k], l.mul(rho, u[k]));
        let u_t = l.sub(u[k], l.mul(n[k], u_n));
        u_t2 = l.add(u_t2, l.mul(u_t, u_t));
    }
    let normal_part = inner_product(l, n, z);
    for k in 0..3 {
        z[k] = l.sub(z[k], l.mul(n[k], normal_part));
    }
    let z_n = l.sub(normal_part, l.mul(l.mul(rho, mu), l.sqrt(u_t2)));
    let tangential_length = l.sqrt(inner_product(l, z, z));
    let (p_n, p_t) = project_on_cone(l, z_n, tangential_length, mu);
    let share = l.select_greater(tangential_length, zero, l.div(p_t, tangential_length), zero);
    let mut sum = zero;
    for k in 0..3 {
        let f = l.sub(l.sub(impulse[k], l.mul(n[k], p_n)), l.mul(z[k], share));
        sum = l.add(sum, l.mul(f, f));
    }
    l.store(size2, sum);
}

/// Component k of v + w x arm of the bodies on one side.
#[inline(always)]
fn point_velocity<L: F64Arithmetic>(
    l: L,
    columns: &ContactGroup,
    motion: &[L::V; 8],
    side: usize,
    k: usize,
    from: usize,
) -> L::V {
    let (i, j) = ((k + 1) % 3, (k + 2) % 3);
    let arm_i = l.load(&columns.arms[side][i][from..from + L::WIDTH]);
    let arm_j = l.load(&columns.arms[side][j][from..from + L::WIDTH]);
    l.add(motion[k], l.sub(l.mul(motion[4 + i], arm_j), l.mul(motion[4 + j], arm_i)))
}

#[inline(always)]
fn inner_product<L: F64Arithmetic>(l: L, a: [L::V; 3], b: [L::V; 3]) -> L::V {
    l.add(l.add(l.mul(a[0], b[0]), l.mul(a[1], b[1])), l.mul(a[2], b[2]))
}

/// Returns the nearest point of Coulomb's cone { |r_T| <= mu r_n } to a vector of normal part `z_n` and of tangential size
/// `z_t` >= 0: its normal part and its tangential size.
///
/// ```
/// # use cd_solve::{math::simd::Scalar, solve::residual::project_on_cone};
/// assert_eq!(project_on_cone(Scalar, 2.0, 1.0, 1.0), (2.0, 1.0)); // inside
/// assert_eq!(project_on_cone(Scalar, -2.0, 1.0, 1.0), (0.0, 0.0)); // in the polar cone
/// assert_eq!(project_on_cone(Scalar, 0.0, 2.0, 1.0), (1.0, 1.0)); // on the side
/// assert_eq!(project_on_cone(Scalar, -2.0, 0.0, 0.0), (0.0, 0.0)); // in the polar cone of a line
/// ```
#[inline(always)]
pub fn project_on_cone<L: F64Arithmetic>(l: L, z_n: L::V, z_t: L::V, mu: L::V) -> (L::V, L::V) {
    let (zero, one) = (l.splat(0.0), l.splat(1.0));
    let side = l.div(l.add(z_n, l.mul(mu, z_t)), l.add(one, l.mul(mu, mu)));
    let below = l.sub(zero, z_n);
    let normal = l.select_greater(l.mul(mu, z_t), below, side, zero);
    let edge = l.mul(mu, z_n);
    // Without friction and without a tangential part a negative normal part is within the edge as well.
    let inside = l.select_greater(z_n, zero, z_n, zero);
    (l.select_greater(z_t, edge, normal, inside), l.select_greater(z_t, edge, l.mul(mu, normal), z_t))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::simd::Scalar;
    use crate::ranks::threads::run_as_ranks;
    use crate::solve::{StoppingCriteria, solve_nlgs};
    use nalgebra::Matrix3;
    use proptest::prelude::*;

    /// A ball of radius 1/2 and mass 1 that comes down at 1 m/s on a plate without friction, rolls at 2 rad/s and spins
    /// at 0.1 rad/s; bounds of 0.05 and 0.1 N m s. The plate may turn.
    fn ball_on_plate(turning: Vec3) -> ContactProblem {
        let record = SolverBody {
            v: Vec3::new(0.0, 0.0, -1.0),
            inverse_mass: 1.0,
            w: Vec3::new(0.0, 2.0, 0.1) + turning,
            inverse_inertia: 10.0,
            radius: 0.5,
        };
        let plate =
            SolverBody { v: Vec3::zeros(), inverse_mass: 0.0, w: Vec3::zeros(), inverse_inertia: 0.0, radius: 0.0 };
        let row = ContactConstraint {
            bodies: [BodyId(0), BodyId(1)],
            normal: Vec3::z(),
            arm: 1.0,
            w_n: 1.0,
            w_t: 3.5,
            acts: true,
            can_close: true,
            ..ContactConstraint::default()
        };
        let roll = RollingConstraint {
            row: ContactId(0),
            radius: 0.5,
            rolling: 0.1,
            spinning: 0.2,
            shear: 0.0,
            inverse_w: 0.1,
            shift: -turning,
            compliance: [0.0; 2],
            warm_start: Vec3::zeros(),
        };
        ContactProblem {
            rows: vec![row],
            block_data: None,
            rolling_constraints: vec![roll],
            memories: vec![],
            pair_attractions: vec![],
            regularised: vec![],
            order: vec![0, 1],
            bodies: vec![record, plate],
        }
    }

    /// E of the impulse `r_n` along n, N s, and a moment, of the problem in axes turned by `rotation`.
    fn judged(problem: &ContactProblem, rotation: &Matrix3<f64>, r_n: f64, m: [f64; 3]) -> f64 {
        let mut problem = problem.clone();
        for body in &mut problem.bodies {
            (body.v, body.w) = (rotation * body.v, rotation * body.w);
        }
        for row in &mut problem.rows {
            row.normal = rotation * row.normal;
        }
        for roll in &mut problem.rolling_constraints {
            roll.shift = rotation * roll.shift;
        }
        let (r, m) = ([problem.rows[0].normal * r_n], [rotation * Vec3::from(m)]);
        let evaluator = ResidualEvaluator::new(&problem, &[ContactId(0)], SimdWidth::detect());
        evaluator.residual_with(&r, &m, &evaluator.motions_with(&r, &m)).value
    }

    #[test]
    fn moments_are_judged_by_their_law() {
        let oblique = Matrix3::new(2.0, -1.0, 2.0, 2.0, 2.0, -1.0, -1.0, 2.0, 2.0) / 3.0;
        for (turning, rotation) in [
            (Vec3::zeros(), Matrix3::identity()),
            (Vec3::new(3.0, -1.0, 2.0), Matrix3::identity()),
            (Vec3::new(3.0, -1.0, 2.0), oblique),
        ] {
            let problem = ball_on_plate(turning);
            let judged = |r_n: f64, m: [f64; 3]| judged(&problem, &rotation, r_n, m);
            // The ball continues to roll, against the bound, and stops spinning. |F(0)| = rho 1 m/s, rho = 3/8; numbers up to
            // 10.
            assert!(judged(1.0, [0.0, -0.05, -0.01]) < 1e-13);
            for (m, expected) in [
                ([0.0; 3], 0.1f64.hypot(0.375 * 0.05)), // z = -rho R w = -(0, 0.375, 0.01875)
                ([0.0, -0.1, -0.01], 0.1),              // twice the bound
                ([0.0, 0.05, -0.01], 0.2),              // with the rolling, not against it
                ([0.0, -0.05, 0.0], 0.375 * 0.05),      // continues to spin
                ([0.0, -0.05, -0.02], 0.375 * 0.05),    // spins in the opposite direction
                ([0.0, -0.05, -2.0], 3.8),              // beyond the other: s = -4, z = -4 + 0.375 * 9.95 = -0.26875
            ] {
                let found = judged(1.0, m);
                assert!((found - expected / 0.375).abs() < 1e-13, "{m:?}: {found} {}", expected / 0.375);
            }
            // Without a normal impulse a moment is all error: |m|/R, added in squares to |F(0)|.
            let found = judged(0.0, [0.03, 0.0, -0.04]);
            assert!((found - 0.375f64.hypot(0.05 / 0.5) / 0.375).abs() < 1e-13, "{found}");
        }
    }

    /// Two contacts in one group, of bodies with arms in all directions and friction levers.
    #[test]
    fn loads_of_bodies_are_those_of_their_contacts() {
        let columns =
            |from: f64| [0, 1, 2].map(|axis| [0, 1, 2, 3, 4, 5, 6, 7].map(|lane| from + f64::from(3 * lane + axis)));
        let contacts = [ContactGroup {
            n: columns(0.5),
            shift: columns(0.0),
            arms: [columns(-2.0), columns(4.0)],
            friction: [0.0; GROUP_LANES],
            bodies: [[7, 9, 0, 0, 0, 0, 0, 0], [8, 7, 0, 0, 0, 0, 0, 0]],
        }];
        let (levers, rows) = ([columns(0.25)], [ContactId(1), ContactId(0)]);
        let impulses = [Vec3::new(1.0, -2.0, 0.5), Vec3::new(0.25, 3.0, -1.5)];
        let vector = |columns: &[[f64; GROUP_LANES]; 3], lane: usize| {
            Vec3::new(columns[0][lane], columns[1][lane], columns[2][lane])
        };
        let mut expected = [[Vec3::zeros(); 2]; 3];
        for (lane, k) in rows.iter().enumerate() {
            let r = impulses[k.index()];
            let couple = vector(&contacts[0].n, lane) * vector(&levers[0], lane).dot(&r);
            for (side, r, couple) in [(0, r, couple), (1, -r, -couple)] {
                let [force, moment] = &mut expected[contacts[0].bodies[side][lane] as usize - 7];
                *force += r;
                *moment += vector(&contacts[0].arms[side], lane).cross(&r) + couple;
            }
        }
        let expected: Vec<[f64; 6]> = expected.iter().map(|[f, m]| [f.x, f.y, f.z, m.x, m.y, m.z]).collect();
        for width in SimdWidth::all_widths() {
            let sums = |bodies| {
                width.run(BodyImpulseSums {
                    skipped_rows: 0,
                    contacts: &contacts,
                    levers: &levers,
                    rows: &rows,
                    impulses: &impulses,
                    bodies,
                })
            };
            // Numbers of a few digits: no sum is rounded.
            assert_eq!(sums(7..10), expected);
            assert_eq!(sums(8..9), expected[1..2]);
        }
    }

    #[test]
    fn a_solver_that_takes_another_law_is_seen() {
        let problem = ball_on_plate(Vec3::zeros());
        let mut other = problem.clone();
        let solved =
            |problem: &ContactProblem| solve_nlgs(problem, StoppingCriteria::new(1e-12, 100), SimdWidth::detect());
        let e = |solution: &crate::solve::ContactSolution| {
            let evaluator = ResidualEvaluator::new(&problem, &[ContactId(0)], SimdWidth::detect());
            let motions = evaluator.motions_with(&solution.impulses, &solution.moments);
            evaluator.residual_with(&solution.impulses, &solution.moments, &motions)
        };
        assert!(e(&solved(&problem)).value < 1e-12);
        other.rolling_constraints[0].rolling *= 1.01;
        let found = e(&solved(&other));
        assert!(found.value > 1e-3 && found.worst == Some(ContactId(0)), "{found:?}");
    }

    /// `count` balls of radius 1 m and mass 2 kg that fall on a plate at 1, 2 and 3 m/s in turn, in a ring. Row k is the
    /// contact of ball k with the plate, row `count` + k that with the next ball; none has friction.
    fn balls_on_plate(count: usize) -> ContactProblem {
        let ball = |k: usize| SolverBody {
            v: Vec3::new(0.0, 0.0, -((1 + k % 3) as f64)),
            inverse_mass: 0.5,
            w: Vec3::zeros(),
            inverse_inertia: 0.25,
            radius: 1.0,
        };
        let plate =
            SolverBody { v: Vec3::zeros(), inverse_mass: 0.0, w: Vec3::zeros(), inverse_inertia: 0.0, radius: 0.0 };
        let row = |bodies: [usize; 2], normal: Vec3, w_n: f64, w_t: f64| ContactConstraint {
            bodies: bodies.map(BodyId::new),
            normal,
            arm: 1.0,
            w_n,
            w_t,
            acts: true,
            can_close: true,
            ..ContactConstraint::default()
        };
        let on_plate = (0..count).map(|k| row([k, count], Vec3::z(), 1.0, 3.5));
        let side_by_side = (0..count).map(|k| row([k, (k + 1) % count], Vec3::x(), 2.0, 5.0));
        ContactProblem {
            rows: on_plate.chain(side_by_side).collect(),
            block_data: None,
            rolling_constraints: vec![],
            memories: vec![],
            pair_attractions: vec![],
            regularised: vec![],
            order: (0..=count as u32).collect(),
            bodies: (0..count).map(ball).chain([plate]).collect(),
        }
    }

    fn all_rows(problem: &ContactProblem) -> Vec<ContactId> {
        (0..problem.rows.len()).map(ContactId::new).collect()
    }

    /// The rows are those of five tasks.
    #[test]
    fn half_of_the_impulses_that_stop_bodies_leaves_half_of_the_residual() {
        let mut problem = balls_on_plate(2100);
        // The first of three equally fast ones is reported: the second is in its task, the third in another.
        for k in [1500, 1600, 2050] {
            problem.bodies[k].v.z = -5.0;
        }
        let rows = all_rows(&problem);
        let speeds: Vec<f64> = problem.bodies.iter().map(|body| body.v.norm()).collect();
        let root_of_squares = |values: &mut dyn Iterator<Item = f64>| values.map(|x| x * x).sum::<f64>().sqrt();
        let root_of_speeds = root_of_squares(&mut speeds.iter().copied());
        for width in SimdWidth::all_widths() {
            let evaluator = ResidualEvaluator::new(&problem, &rows, width);
            // 3 · 2N rows divided by a trace of (1 + 2 · 3.5) N + (2 + 2 · 5) N; sums of 4200 squares, to rounding.
            let initial_norm = 0.3 * root_of_speeds;
            assert!((evaluator.initial_norm / initial_norm - 1.0).abs() < 1e-13);
            let next_speeds = (0..2100).map(|k| speeds[k] + speeds[(k + 1) % 2100]);
            let floor = ROUNDING_FLOOR * root_of_squares(&mut speeds.iter().copied().chain(next_speeds));
            assert!((evaluator.relative_floor() * root_of_speeds / floor - 1.0).abs() < 1e-13);
            let at_rest = vec![Vec3::zeros(); rows.len()];
            assert_eq!(evaluator.residual(&at_rest), Residual { value: 1.0, worst: Some(ContactId(1500)) });
            // Impulses of m v / 2.
            let mut halves = at_rest;
            (0..2100).for_each(|k| halves[k].z = speeds[k]);
            let Residual { value, worst } = evaluator.residual(&halves);
            assert!((value - 0.5).abs() < 1e-13 && worst == Some(ContactId(1500)), "{value} {worst:?}");
            assert!((evaluator.rounding_share(&halves) / (0.5 * f64::EPSILON) - 1.0).abs() < 1e-13);
        }
        // Bodies at rest have neither a residual nor rounding.
        problem.bodies.iter_mut().for_each(|body| body.v = Vec3::zeros());
        let evaluator = ResidualEvaluator::new(&problem, &rows, SimdWidth::detect());
        assert_eq!((evaluator.initial_norm, evaluator.relative_floor()), (0.0, 0.0));
    }

    /// Impulses and velocities are small multiples of 1/8: no sum is rounded.
    #[test]
    fn impulses_move_bodies_alike_on_any_number_of_threads() {
        let spheres = balls_on_plate(2100);
        let mut offset = spheres.clone();
        let arms = (0..spheres.rows.len()).map(|k| [0, 1].map(|side| spheres.contact_arm(k, side))).collect();
        let inertia = |body: &SolverBody| Matrix3::identity() * body.inverse_inertia;
        let offset_of_row = |k: usize| if k < 2100 && k.is_multiple_of(3) { Vec3::x() } else { Vec3::zeros() };
        offset.block_data = Some(crate::assemble::BlockData {
            arms,
            friction_offsets: (0..spheres.rows.len()).map(offset_of_row).collect(),
            locked_axes: vec![],
            inverse_inertia: spheres.bodies.iter().map(inertia).collect(),
        });
        let impulse = |k: usize| Vec3::new((k % 5) as f64, (k % 7) as f64, (k % 11) as f64);
        for problem in [spheres, offset] {
            let rows = all_rows(&problem);
            let impulses: Vec<Vec3> = (0..rows.len()).map(impulse).collect();
            let mut expected = problem.clone();
            impulses.iter().enumerate().for_each(|(k, r)| expected.apply_impulse(k, r));
            for threads in [1, 4] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let found = pool.install(|| {
                    let evaluator = ResidualEvaluator::new(&problem, &rows, SimdWidth::detect());
                    evaluator.solver_bodies(&evaluator.body_motions(&impulses))
                });
                assert!(found == expected.bodies, "{threads} threads");
            }
        }
    }

    #[test]
    fn friction_offsets_are_those_of_the_rows_of_each_task() {
        // A ball that falls at v m/s and spins at v rad/s slides at v m/s at a friction offset of 1 m. With a coefficient of
        // 1 the natural map projects rho v (1 - 1, 1), normal and tangential, on the cone: F is rho v (1, 1)/2.
        let mut problem = balls_on_plate(2100);
        let arms = (0..problem.rows.len()).map(|k| [0, 1].map(|side| problem.contact_arm(k, side))).collect();
        problem.block_data = Some(crate::assemble::BlockData {
            arms,
            friction_offsets: (0..4200)
                .map(|k| if k < 2100 && k % 5 == 0 { Vec3::x() } else { Vec3::zeros() })
                .collect(),
            locked_axes: vec![],
            inverse_inertia: vec![Matrix3::identity(); problem.bodies.len()],
        });
        for k in 0..2100 {
            problem.bodies[k].w.z = -problem.bodies[k].v.z;
            problem.rows[k].friction = 1.0;
        }
        let rows = all_rows(&problem);
        let squared_share = |k: usize| if k.is_multiple_of(5) { 0.5 } else { 1.0 };
        let squares: f64 = (0..2100).map(|k| squared_share(k) * problem.bodies[k].v.norm_squared()).sum();
        let evaluator = ResidualEvaluator::new(&problem, &rows, SimdWidth::detect());
        assert!((evaluator.initial_norm / (0.3 * squares.sqrt()) - 1.0).abs() < 1e-13);
    }

    #[test]
    fn unmoved_bodies_have_no_negative_zeros() {
        let mut problem = balls_on_plate(2);
        problem.bodies[1].w = Vec3::new(1.0, 2.0, 3.0);
        let expected = problem.bodies.clone();
        problem.bodies.iter_mut().flat_map(|body| body.v.iter_mut().chain(body.w.iter_mut())).for_each(|x| {
            if *x == 0.0 {
                *x = -0.0;
            }
        });
        let rows = all_rows(&problem);
        let found = ResidualEvaluator::new(&problem, &rows, SimdWidth::detect()).unmoved_bodies();
        assert_eq!(found, expected);
        let is_negative_zero = |x: &f64| *x == 0.0 && x.is_sign_negative();
        assert!(!found.iter().flat_map(|body| body.v.iter().chain(body.w.iter())).any(is_negative_zero));
    }

    #[test]
    fn a_moment_counts_where_the_impulse_presses() {
        let mut problem = ball_on_plate(Vec3::zeros());
        let n = Vec3::new(2.0, -1.0, 2.0) / 3.0;
        problem.rows[0].normal = n;
        problem.bodies[1].w = Vec3::new(1.0, 0.0, -2.0);
        let roll = RollingConstraint {
            rolling: 100.0,
            spinning: 100.0,
            shift: Vec3::new(0.5, 0.25, -1.0),
            ..problem.rolling_constraints[0]
        };
        let evaluator = ResidualEvaluator::new(&problem, &[ContactId(0)], SimdWidth::detect());
        let motions = evaluator.body_motions(&[Vec3::zeros()]);
        // w of (0, 2, 0.1) - (1, 0, -2), and the shift; the moment is within its bounds.
        let turning = (0.375 * 0.5f64).powi(2) * Vec3::new(-0.5, 2.25, 1.1).norm_squared();
        for (axis, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)] {
            let mut r = Vec3::zeros();
            r[axis] = 0.5 * sign;
            let expected = if n.dot(&r) > 0.0 { turning } else { 10.0f64.powi(2) };
            let found = evaluator.moment_residual_squared(&roll, &Vec3::new(3.0, 0.0, 4.0), &r, &motions);
            assert!((found / expected - 1.0).abs() < 1e-13, "{r:?}: {found} {expected}");
        }
    }

    /// Impulses and rho û are (normal, tangential), in N s; the coefficient of friction is 1/2.
    #[test]
    fn sliding_contacts_part_by_the_associated_law() {
        let oblique = Matrix3::new(2.0, -1.0, 2.0, 2.0, 2.0, -1.0, -1.0, 2.0, 2.0) / 3.0;
        let (solved, inside) = (([2.0, -1.0], [1.0, 2.0]), ([4.0, 0.0], [0.0, 1.0]));
        let (sliding, pressed) = (([0.0, 0.0], [0.0, 1.0]), ([0.0, 0.0], [-1.0, 0.0]));
        for rotation in [Matrix3::identity(), oblique] {
            let mut problem = ball_on_plate(Vec3::zeros());
            let (n, t) = (rotation * Vec3::z(), rotation * Vec3::x());
            (problem.rows[0].normal, problem.rows[0].friction) = (n, 0.5);
            (problem.bodies[0].v, problem.bodies[0].w) = (-n, Vec3::zeros());
            let evaluator = ResidualEvaluator::new(&problem, &[ContactId(0)], SimdWidth::detect());
            for ((r, u), associated, squared, separation) in [
                (solved, true, 0.0, 1.0),   // the nearest point to (1, -3) is r
                (solved, false, 0.8, 0.0),  // that to (1 - 1, -3) is (1.2, -0.6)
                (inside, true, 1.0, 0.5),   // F is rho û
                (inside, false, 1.25, 0.0), // F is (0.5, 1)
                (sliding, true, 0.2, 0.0),  // that to (0, -1) is (0.4, -0.2)
                (sliding, false, 0.0, 0.0), // (-0.5, -1) is in the polar cone
                (pressed, true, 1.0, 0.0),  // F is (-1, 0)
                (pressed, false, 1.0, 0.0),
            ] {
                let [r, u] = [r, u].map(|[normal, tangential]: [f64; 2]| n * normal + t * tangential);
                // rho is 3/8 kg, and |F(0)| 3/8 N s.
                let motions = [body_motion(&(u / 0.375), &Vec3::zeros()), body_motion(&Vec3::zeros(), &Vec3::zeros())];
                let found = evaluator.associated_residual(&[r], &motions, &[associated]);
                let expected = (f64::sqrt(squared) / 0.375, separation / 0.375);
                assert!((found.residual - expected.0).abs() < 1e-13, "{associated} {r:?}: {}", found.residual);
                assert!(
                    (found.separations[0] - expected.1).abs() < 1e-13,
                    "{associated} {r:?}: {:?}",
                    found.separations
                );
            }
        }
    }

    #[test]
    fn few_groups_of_contacts_are_added_at_once_and_more_in_two_halves() {
        assert_eq!([0, 1, 127, 128, 129, 1000].map(groups_in_half), [1, 1, 127, 64, 65, 500]);
    }

    /// Expects the bits of one rank from ranks that list the rows of a problem in parts of these lengths.
    fn expect_bits_of_one_rank(problem: &ContactProblem, parts: &[usize]) {
        let can_close = |problem: &ContactProblem| -> Vec<ContactId> {
            all_rows(problem).into_iter().filter(|k| problem.rows[k.index()].can_close).collect()
        };
        let impulses: Vec<Vec3> = problem.rows.iter().map(|row| row.warm_start).collect();
        let active = can_close(problem);
        let whole = ResidualEvaluator::new(problem, &active, SimdWidth::detect());
        let motions = whole.body_motions(&impulses);
        let expected = whole.residual_at(&impulses, &motions);
        assert!(expected.worst.is_some() && !whole.is_empty());
        run_as_ranks(parts.len(), |communicator| {
            let rank = communicator.rank();
            let first: usize = parts[..rank].iter().sum();
            let mut own = ContactProblem { rows: problem.rows[first..first + parts[rank]].to_vec(), ..problem.clone() };
            let own_active = can_close(&own);
            let scales = ResidualScales::of_ranks(&own, &own_active, active.len());
            let own_impulses = &impulses[first..first + parts[rank]];
            let (division, rows) = RowDivision::new(&own, &own_active, own_impulses, 16);
            let swept_impulses: Vec<Vec3> = rows.iter().map(|row| row.warm_start).collect();
            own.rows = rows;
            let swept = all_rows(&own);
            let evaluator = ResidualEvaluator::of_division(&own, &swept, SimdWidth::detect(), &division, scales);
            assert!(!evaluator.is_empty());
            let scales_of = |evaluator: &ResidualEvaluator| [evaluator.rho, evaluator.floor, evaluator.initial_norm];
            assert_eq!(scales_of(&evaluator), scales_of(&whole), "rank {rank}");
            let found = evaluator.body_motions(&swept_impulses);
            assert!(found == motions, "rank {rank}");
            assert_eq!(evaluator.residual_at(&swept_impulses, &found), expected, "rank {rank}");
        });
    }

    #[test]
    fn ranks_that_divide_the_contacts_have_the_bits_of_one_rank() {
        for count in [20, 1300] {
            let mut problem = balls_on_plate(count);
            for (k, row) in problem.rows.iter_mut().enumerate() {
                row.can_close = k % 7 != 3;
            }
            // Without impulses many of the balls are the fastest; with these the sums are rounded.
            let mut irregular = problem.clone();
            for (k, row) in irregular.rows.iter_mut().enumerate() {
                row.warm_start = [1.0, 2.0, 3.0].map(|x| (x + k as f64).sin()).into();
                (row.friction, row.w_n) = (0.3, 2.0 + (k as f64).cos());
            }
            for (k, body) in irregular.bodies[..count].iter_mut().enumerate() {
                body.v += Vec3::repeat((k as f64).sin());
            }
            for problem in [problem, irregular] {
                expect_bits_of_one_rank(&problem, &[2 * count]);
                expect_bits_of_one_rank(&problem, &[count / 2, count, count / 2]);
                expect_bits_of_one_rank(&problem, &[count + 1, 0, count - 4, 3]);
            }
        }
    }

    #[test]
    fn ranks_that_each_have_all_contacts_have_the_bits_of_one_rank() {
        let problem = balls_on_plate(2100);
        let rows = all_rows(&problem);
        let residual = || {
            let evaluator = ResidualEvaluator::new(&problem, &rows, SimdWidth::detect());
            evaluator.residual(&vec![Vec3::z(); rows.len()])
        };
        let expected = residual();
        assert_eq!(run_as_ranks(3, |_| residual()), [expected; 3]);
    }

    #[test]
    fn an_evaluator_without_rows_is_empty() {
        let problem = balls_on_plate(2);
        assert!(ResidualEvaluator::new(&problem, &[], SimdWidth::detect()).is_empty());
    }

    proptest! {
        /// The projection is in the cone and no nearby point of the cone is nearer.
        #[test]
        fn projection_is_the_nearest_point(z_n in -5.0..5.0f64, z_t in 0.0..5.0f64, mu in 0.0..2.0f64, tries in prop::collection::vec((0.0..6.0f64, 0.0..1.0f64), 50)) {
            let (p_n, p_t) = project_on_cone(Scalar, z_n, z_t, mu);
            // Rounding of numbers up to 10.
            prop_assert!(p_t <= mu * p_n + 1e-14);
            for (normal, share) in tries {
                let distance = |n: f64, t: f64| (z_n - n).hypot(z_t - t);
                prop_assert!(distance(p_n, p_t) <= distance(normal, mu * normal * share) + 1e-13);
            }
        }
    }
}
