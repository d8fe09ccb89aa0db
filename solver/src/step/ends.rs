//! Contacts at the end of a step and their totals for the ledger, computed in one pass.

use std::ops::Add;

use rayon::prelude::*;

use super::collectives::finish_divided_contacts;
use super::context::{SolvedProblem, StepContext};
use super::totals::{ContactTotals, ITEMS_PER_TASK, OVERLAP_WARNING_SHARE, Overlap, deeper_overlap};
use super::velocity_errors::VelocityErrors;
use crate::assemble::{
    ContactProblem, FreeMotion, RegularisedRow, SolverBody, contact_arms, surface_velocity, velocity_at_arms,
};
use crate::integrate::ContactConfiguration;
use crate::laws::{ContactMotion, MAX_TOUCHING_GAP};
use crate::math::{PAR_MIN_LEN, Vec3, to_local, to_world};
use crate::scene::{BodyId, Scene, SurfaceMotion};
use crate::solve::ContactSolution;
use crate::state::{Contact, ContactId, ContactStatus, LawMemory, PairVirial, SolvedContact, State, Velocities};

/// Velocities and contacts at the step's end, and the totals of the contacts.
pub struct StepOutcome {
    /// Velocities, m/s.
    pub v: Vec<Vec3>,
    /// Angular velocities, rad/s.
    pub w: Vec<Vec3>,
    pub contacts: Vec<SolvedContact>,
    pub totals: ContactTotals,
    /// Virial of each contact with force, by chunk of [`ITEMS_PER_TASK`] contacts.
    pub pair_virials: Vec<Vec<PairVirial>>,
}

impl StepOutcome {
    /// Velocities and angular velocities at the step's end, in the contact configuration, without the motion of images and
    /// surfaces.
    pub fn velocities(&self) -> Velocities<'_> {
        Velocities { v: &self.v, w: &self.w, gradient: None, surfaces: &[] }
    }
}

/// Velocities and angular velocities in the contact configuration with all impulses, m/s and rad/s.
pub fn solved_velocities(
    solution: &ContactSolution,
    free: &FreeMotion,
    q_c: &ContactConfiguration,
) -> (Vec<Vec3>, Vec<Vec3>) {
    // Imposed velocities stay as they were.
    let motion = |((solver_body, v), w): ((&SolverBody, &Vec3), &Vec3)| {
        if solver_body.inverse_mass > 0.0 { (solver_body.v, solver_body.w) } else { (*v, *w) }
    };
    let bodies = solution.solver_bodies.par_iter().zip(&free.v).zip(&free.w);
    let (v, mut w): (Vec<Vec3>, Vec<Vec3>) = bodies.with_min_len(PAR_MIN_LEN).map(motion).unzip();
    // In the contact problem these bodies do not rotate.
    q_c.pushed_at_centre.iter().for_each(|body| w[body.index()] = free.w[body.index()]);
    (v, w)
}

/// Computes the outcome of the step. Reuses the memory of the contacts of the last step.
pub fn finish_contacts(
    context: StepContext,
    state: &mut State,
    solved: &SolvedProblem,
    velocity_errors: Option<&VelocityErrors>,
) -> StepOutcome {
    let StepContext { scene, q_c, free, contacts } = context;
    let SolvedProblem { contact_problem, solution, .. } = solved;
    let (v, w) = solved_velocities(solution, free, q_c);
    let mut solved_contacts = std::mem::take(&mut state.contacts);
    solved_contacts.resize(contacts.len(), SolvedContact::default());
    let driven: Vec<bool> = scene.bodies.par_iter().with_min_len(PAR_MIN_LEN).map(|body| body.driven).collect();
    let warning_depth = OVERLAP_WARNING_SHARE * scene.smallest_radius;
    let velocities = Velocities { v: &v, w: &w, ..free.velocities() };
    let start_surfaces = q_c.start_surfaces(scene, state.time);
    let w_without_rotation = ContactConfiguration::without_spins(&w, &q_c.pushed_at_centre);
    let velocities_without_rotation = Velocities { w: &w_without_rotation, ..velocities };
    let post_solve = PostSolve {
        scene,
        state,
        q_c,
        contact_problem,
        solution,
        velocity_errors,
        velocities,
        velocities_without_rotation,
        start_surfaces: &start_surfaces,
        driven: &driven,
        warning_depth,
    };
    if state.detection_cache.is_divided() {
        let finish_chunk = |first: usize, contacts: &[Contact], solved: &mut [SolvedContact], totals: ContactTotals| {
            post_solve.finish_chunk(first, contacts, solved, totals)
        };
        let (totals, pair_virials) = finish_divided_contacts(contacts, &mut solved_contacts, finish_chunk);
        let totals = totals.into_iter().fold(ContactTotals::default(), ContactTotals::add);
        drop(w_without_rotation); // which borrows `w`
        return StepOutcome { v, w, contacts: solved_contacts, totals, pair_virials };
    }
    // The division into parts depends only on the number of rows.
    let chunks = solved_contacts.par_chunks_mut(ITEMS_PER_TASK).zip(contacts.par_chunks(ITEMS_PER_TASK)).enumerate();
    let parts: Vec<(ContactTotals, Vec<PairVirial>)> = chunks
        .map(|(chunk, (solved, contacts))| {
            post_solve.finish_chunk(chunk * ITEMS_PER_TASK, contacts, solved, ContactTotals::default())
        })
        .collect();
    let totals = parts.iter().fold(ContactTotals::default(), |sum, (totals, _)| sum + *totals);
    let pair_virials = parts.into_iter().map(|(_, pair_virials)| pair_virials).collect();
    drop(w_without_rotation); // which borrows `w`
    StepOutcome { v, w, contacts: solved_contacts, totals, pair_virials }
}

/// Returns the memories of the laws at the step's end, with the soundness and the sliding of interfaces.
pub fn end_memories(SolvedProblem { contact_problem, solution, .. }: &mut SolvedProblem) -> Vec<LawMemory> {
    let mut memories = std::mem::take(&mut contact_problem.memories);
    for regularised in &contact_problem.regularised {
        if let RegularisedRow::Interface { row, interface } = regularised {
            let (k, n) = (row.index(), contact_problem.rows[row.index()].normal);
            let v = interface.velocity(&n, &contact_problem.shifted_velocity(k, &solution.solver_bodies));
            memories[k].soundness = interface.end_soundness(&n, &v);
            memories[k].sliding = interface.displacement(&n, &v).1;
        }
    }
    memories
}

/// Input for the contacts at the step's end.
struct PostSolve<'a> {
    scene: &'a Scene,
    state: &'a State,
    q_c: &'a ContactConfiguration,
    contact_problem: &'a ContactProblem,
    solution: &'a ContactSolution,
    /// Errors of the velocities; `None` unless a law of the scene loses a bond or static friction once its contact moves.
    velocity_errors: Option<&'a VelocityErrors>,
    /// Velocities at the step's end.
    velocities: Velocities<'a>,
    /// Velocities at the step's end without the rotation of bodies that contacts push at their centres, for the
    /// work of the impulses.
    velocities_without_rotation: Velocities<'a>,
    /// Motions of the surfaces of walls at the step's start.
    start_surfaces: &'a [SurfaceMotion],
    /// Whether each body is a driven one; in an array of their own, as contacts read them in any order.
    driven: &'a [bool],
    /// Smallest depth that is worth a warning for the smallest bodies, m. Below it a contact is not compared with its radii.
    warning_depth: f64,
}

/// Relative distance of a load from the limit of an elastic bond that is rounding: loads that yield are set to the limit.
const YIELD_ROUNDING: f64 = 1e-9;

impl PostSolve<'_> {
    /// Writes the contacts from index `first` on, at the step's end, to `solved_contacts`. Returns `totals` plus the totals of
    /// these contacts in the step, and the virials of those with force.
    fn finish_chunk(
        &self,
        first: usize,
        contacts: &[Contact],
        solved_contacts: &mut [SolvedContact],
        mut totals: ContactTotals,
    ) -> (ContactTotals, Vec<PairVirial>) {
        let PostSolve { q_c, contact_problem, solution, .. } = self;
        let mut pair_virials = Vec::with_capacity(contacts.len());
        let roll = contact_problem.rolling_constraints.partition_point(|roll| roll.row.index() < first);
        let mut rolls = contact_problem.rolling_constraints[roll..].iter().zip(&solution.moments[roll..]).peekable();
        for ((k, contact), solved) in (first..).zip(contacts).zip(solved_contacts) {
            let (row, r) = (&contact_problem.rows[k], &solution.impulses[k]);
            let rolling_moment = rolls.next_if(|(roll, _)| roll.row.index() == k).map(|(_, moment)| moment);
            let arms = contact_problem.arms_of(k, contact, &q_c.x);
            self.finish_contact(k, contact, &arms, rolling_moment, solved);
            // A row does not act between bodies whose motion is imposed: their penetration is no error of the contact.
            let gap = contact.gap - contact_problem.reference_gap(k);
            let depth = if row.acts { (-gap).max(0.0) } else { 0.0 };
            totals.penetration_largest = totals.penetration_largest.max(depth);
            totals.penetration_sum += depth;
            let law = &self.state.laws[contact.law];
            // Springs overlap by law.
            if depth > self.warning_depth && !law.is_regularised() {
                totals.overlap = deeper_overlap(totals.overlap, Overlap::from_contact(self.scene, contact));
            }
            // A pair of which neither can move along the normal is worth a warning if it overlaps, or if it touches and a bond
            // or a liquid would hold it.
            let would_hold =
                || law.cohesion().is_some() && gap <= MAX_TOUCHING_GAP * self.smallest_grain_radius(contact);
            if !row.acts
                && (-gap > self.warning_depth || would_hold())
                && !contact_problem.can_move_a_body(k, &self.scene.bodies)
            {
                let overlap = Overlap::from_contact(self.scene, contact);
                if overlap.is_deep() || would_hold() {
                    totals.inert_overlap = deeper_overlap(totals.inert_overlap, overlap);
                }
            }
            if solved.impulse != Vec3::zeros() {
                totals.contacts_active += 1;
                if !law.is_regularised() {
                    let allowed_closing = law.max_closing_speed(row.u_before.x);
                    totals.penetration_added += (-gap - q_c.h * (solved.velocity.x + allowed_closing) - depth).max(0.0);
                }
                let virial = self.accumulate_totals(k, r, &arms, solved, &mut totals);
                totals.virial += virial;
                pair_virials.push(PairVirial { bodies: row.bodies, virial });
            } else if solved.moment != Vec3::zeros() {
                // The net impulse is zero, as the repulsion equals the cohesion; only the rolling moment acts.
                self.accumulate_totals(k, r, &arms, solved, &mut totals);
            }
        }
        (totals, pair_virials)
    }

    /// Smallest radius of the two bodies of a contact that are not walls, m; 0 if both are.
    fn smallest_grain_radius(&self, contact: &Contact) -> f64 {
        let bodies = [contact.candidate, contact.antagonist].map(|body| body.index());
        let radii = bodies.into_iter().filter(|&i| !self.scene.walls[i]).map(|i| self.scene.bodies[i].radius);
        radii.reduce(f64::min).unwrap_or(0.0)
    }

    /// Relative velocity at contact `k` with these arms, m, where its impulse acts, world frame, m/s.
    #[inline]
    fn contact_velocity(&self, k: usize, contact: &Contact, arms: &[Vec3; 2], velocities: &Velocities) -> Vec3 {
        let velocity = velocity_at_arms(contact, arms, *velocities);
        match self.contact_problem.nonzero_lever(k) {
            Some(lever) => {
                let row = &self.contact_problem.rows[k];
                let [a, b] = row.bodies.map(|body| velocities.w[body.index()]);
                velocity + lever * row.normal.dot(&(a - b))
            }
            None => velocity,
        }
    }

    /// Writes contact `k` with these arms, m, at the step's end into `end`, with the moment (N m s, world frame) of its rolling
    /// resistance, if it has one.
    #[inline]
    fn finish_contact(
        &self,
        k: usize,
        contact: &Contact,
        arms: &[Vec3; 2],
        rolling_moment: Option<&Vec3>,
        end: &mut SolvedContact,
    ) {
        let &PostSolve { state, contact_problem, solution, .. } = self;
        let (row, r) = (&contact_problem.rows[k], &solution.impulses[k]);
        let frame = contact.frame();
        let local = to_local(&frame, r);
        let law = &state.laws[contact.law];
        let errors = self.velocity_errors.filter(|_| law.has_irreversible_loss());
        let motion =
            errors.map_or(ContactMotion::default(), |errors| errors.contact_motion(contact_problem, solution, k));
        // Largest tangential impulse, N s, less rounding: the impulse at the limit lies on the cone.
        let bound = row.friction * local.x * (1.0 - 1e-12);
        let at_limit = if errors.is_some() && row.friction > 0.0 { motion.slides } else { local.yz().norm() >= bound };
        let regularised = contact_problem.regularised_row(k);
        let has_interface = matches!(regularised, Some(RegularisedRow::Interface { .. } | RegularisedRow::Bond { .. }));
        let motion = match regularised {
            Some(RegularisedRow::Bond { .. }) => self.bond_yield(k, &local, rolling_moment),
            _ => motion,
        };
        let pulls_or_pushes = law.strain_spring().is_some() && local.x != 0.0;
        let status = if law.is_coupled() || has_interface || pulls_or_pushes {
            ContactStatus::Stick
        } else {
            match local.x > 0.0 {
                false => ContactStatus::NoContact,
                true if at_limit => ContactStatus::Slide,
                true => ContactStatus::Stick,
            }
        };
        // Fields are written one by one, since a whole contact would first be made and then copied.
        let SolvedContact { contact: own, impulse, moment, velocity, status: end_status, bond } = end;
        *own = *contact;
        *impulse = Vec3::new(local.x + row.impulse_shift, local.y, local.z);
        *moment = rolling_moment.map_or(Vec3::zeros(), |m| to_local(&frame, m));
        *velocity = to_local(&frame, &self.contact_velocity(k, contact, arms, &self.velocities));
        *end_status = status;
        *bond = row.bond.filter(|_| law.keeps_bond(contact.gap, motion));
        if let (Some(&RegularisedRow::Bond { opening, sliding, .. }), Some(_)) = (regularised, &bond) {
            let [load, strained_moment] = self.bond_strain_load(k, [opening, sliding]);
            let shear = to_local(&frame, &load);
            (impulse.y, impulse.z) = (shear.y, shear.z);
            *moment = to_local(&frame, &strained_moment);
        }
    }

    /// Impulse (N s) and moment (N m s) of an elastic bond by its strain at the step's end, world frame. They differ from those
    /// that the solver has found by its residual, and the next step starts from them: errors of solutions do not accumulate
    /// as creep.
    fn bond_strain_load(&self, k: usize, compliance: [f64; 2]) -> [Vec3; 2] {
        let &PostSolve { contact_problem, solution, .. } = self;
        let row = &contact_problem.rows[k];
        let load = row.strain_load(compliance, &contact_problem.shifted_velocity(k, &solution.solver_bodies));
        let rolls = &contact_problem.rolling_constraints;
        let moment = rolls.binary_search_by_key(&ContactId::new(k), |roll| roll.row).map_or(Vec3::zeros(), |index| {
            let roll = &rolls[index];
            let [across, along] = roll.compliance;
            row.strain_load([along, across], &contact_problem.shifted_spin(roll, &solution.solver_bodies))
        });
        [load, moment]
    }

    /// Motion of an elastic bond beyond its limits: it yields where its impulse (contact frame, N s) or its moment (world frame,
    /// N m s) is at a limit.
    fn bond_yield(&self, k: usize, impulse: &Vec3, moment: Option<&Vec3>) -> ContactMotion {
        let row = &self.contact_problem.rows[k];
        let is_at_limit = |load: f64, limit: f64| load >= limit * (1.0 - YIELD_ROUNDING);
        let rolls = &self.contact_problem.rolling_constraints;
        let roll = rolls.binary_search_by_key(&ContactId::new(k), |roll| roll.row).ok().map(|index| &rolls[index]);
        let turns = roll.zip(moment).is_some_and(|(roll, moment)| {
            let along = row.normal.dot(moment);
            let (across_bound, along_bound) = roll.moment_bounds(&self.solution.impulses[k], &row.normal);
            let across = (moment - row.normal * along).norm();
            is_at_limit(across, across_bound * roll.radius) || is_at_limit(along.abs(), along_bound * roll.radius)
        });
        ContactMotion {
            opens: impulse.x <= 0.0,
            slides: is_at_limit(impulse.yz().norm(), row.friction * impulse.x),
            turns,
        }
    }

    /// Adds the contribution of contact `k` with these arms, m, and the impulse `r` of its row to the totals; returns its impulse
    /// times its branch, N m s.
    fn accumulate_totals(
        &self,
        k: usize,
        r: &Vec3,
        arms: &[Vec3; 2],
        contact: &SolvedContact,
        totals: &mut ContactTotals,
    ) -> f64 {
        let &PostSolve { scene, q_c, contact_problem, driven, .. } = self;
        let walls = &scene.walls;
        let row = &contact_problem.rows[k];
        let SolvedContact { contact, impulse, moment, velocity, .. } = contact;
        let velocity = match row.bodies.into_iter().any(|body| q_c.is_pushed_at_centre(body)) {
            true => {
                to_local(&contact.frame(), &self.contact_velocity(k, contact, arms, &self.velocities_without_rotation))
            }
            false => *velocity,
        };
        let (candidate, antagonist) = (contact.candidate.index(), contact.antagonist.index());
        if walls[candidate] && walls[antagonist] {
            return 0.0; // not counted in the ledger
        }
        let mean_velocity = 0.5 * (velocity + row.u_before);
        let force = r + contact.normal * row.impulse_shift;
        let rolls = *moment != Vec3::zeros();
        let moment = if rolls { to_world(&contact.frame(), moment) } else { Vec3::zeros() };
        let turning_work = if rolls {
            0.5 * moment.dot(&(self.doubled_mean_spin(candidate) - self.doubled_mean_spin(antagonist)))
        } else {
            0.0
        };
        // A wall's centre has no meaning for the stress of the grains: for a wall the branch ends at the contact point.
        let branch_arm = |body: usize, arm: Vec3| if walls[body] { Vec3::zeros() } else { arm };
        let branch = branch_arm(antagonist, arms[1]) - branch_arm(candidate, arms[0]);
        totals.contact_work += impulse.dot(&mean_velocity) + turning_work;
        totals.friction_work += impulse.y * mean_velocity.y + impulse.z * mean_velocity.z + turning_work;
        if let Some(cell) = &q_c.cell_step {
            // The cell moves the image of the antagonist.
            let doubled_image_velocity = (cell.start_gradient + cell.end_gradient) * contact.image;
            totals.outside_work += 0.5 * force.dot(&doubled_image_velocity);
            totals.normal_moments += force.component_mul(&branch);
        }
        if !driven[antagonist] {
            // The impulse on the antagonist acts at its own position, not at the position of the image.
            totals.angular_momentum_change += contact.image.cross(&force);
        }
        if driven[candidate] || driven[antagonist] {
            let moment = if contact_problem.has_friction_offsets() {
                moment + contact_problem.friction_couple(k, r)
            } else {
                moment
            };
            self.accumulate_driven(contact, arms, &force, &moment, totals);
        }
        force.dot(&branch)
    }

    /// Sum of the angular velocities of a body at the step's start and end, rad/s; 0 if contacts push it at its centre.
    fn doubled_mean_spin(&self, body: usize) -> Vec3 {
        let pushed_at_centre = self.q_c.is_pushed_at_centre(BodyId::new(body));
        if pushed_at_centre { Vec3::zeros() } else { self.velocities.w[body] + self.q_c.w[body] }
    }

    /// Adds the work and the impulses of the driven bodies of a contact with these arms (m), impulse `force` (N s) and `moment`
    /// (N m s) on the candidate, world frame, to the totals.
    fn accumulate_driven(
        &self,
        contact: &Contact,
        arms: &[Vec3; 2],
        force: &Vec3,
        moment: &Vec3,
        totals: &mut ContactTotals,
    ) {
        let &PostSolve { scene, state, q_c, driven, velocities: Velocities { v, .. }, .. } = self;
        let (candidate, antagonist) = (contact.candidate.index(), contact.antagonist.index());
        // Elastic bonds of faces do not act at the contact point.
        let has_moved_point = contact.area > 0.0 && state.laws[contact.law].bond_stiffness().is_some();
        let offset = if has_moved_point { arms[0] - contact_arms(contact, &q_c.x)[0] } else { Vec3::zeros() };
        let sides = [(candidate, antagonist, 1.0), (antagonist, candidate, -1.0)].into_iter().zip(arms);
        for ((body, other, sign), arm) in sides.filter(|((body, ..), _)| driven[*body]) {
            // The impulse of a driven body on the other one: minus the impulse on the driven body.
            let force = force * -sign;
            if scene.walls[body] {
                let mut doubled_mean_velocity = (v[body] + state.v[body]) + self.doubled_mean_spin(body).cross(arm);
                for surfaces in [self.start_surfaces, self.velocities.surfaces] {
                    doubled_mean_velocity += surface_velocity(BodyId::new(body), arm, &contact.normal, surfaces);
                }
                totals.outside_work +=
                    0.5 * (force.dot(&doubled_mean_velocity) - sign * moment.dot(&self.doubled_mean_spin(body)));
            } else {
                // The reactions of its imposed components balance the same components of the impulse on it.
                let (driven_body, couple) = (&scene.bodies[body], arm.cross(&force) - moment * sign);
                let couple = driven_body.imposed_rotation_part(&q_c.q[body], &couple);
                totals.outside_work += 0.5
                    * (driven_body.imposed_part(&force).dot(&(v[body] + state.v[body]))
                        + couple.dot(&self.doubled_mean_spin(body)));
            }
            if !driven[other] {
                totals.driven_impulse += force;
                totals.angular_momentum_change += (contact.point + offset).cross(&force) - moment * sign;
            }
        }
    }
}
