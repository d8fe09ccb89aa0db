//! Assembly of the contact problem: one row per contact, from its geometry, its law and its history.

use std::cell::Cell;

use cd_formats::compute::FaceFriction;
use nalgebra::Matrix3;
use rayon::prelude::*;

use super::closed_by_others::OpenPair;
use super::context::{AssemblyContext, MotionBounds};
use super::faces::{FaceRows, Joints, has_joints};
use super::history::{BondState, warm_start};
use super::interface_row::InterfaceRow;
use super::kinematics::{contact_arms, relative_surface_velocity, relative_velocity, velocity_at_arms};
use super::problem::{BlockData, ContactConstraint, ContactProblem, RegularisedRow, RollingConstraint, SolverBody};
use crate::integrate::ContactConfiguration;
use crate::laws::{
    BondCompliance, ContactLaw, GapForecast, LawInput, LawRegularisation, LawShift, MomentLimits, StrainSpring,
};
use crate::math::simd::SimdWidth;
use crate::math::{PAR_MIN_LEN, Quat, Vec3, to_local, to_world};
use crate::scene::{BodyId, BodyShape, ContactorShape, NEARBY_GAP, RigidBody, Scene};
use crate::state::{Contact, ContactId, ContactStatus, LawMemory, SolvedContact, State, Velocities};

/// Sliding of a contact that begins counts above this multiple of `tol` times the change of velocity that loads it:
/// unconverged sticking contacts slide less.
const SLIDING_VELOCITY_FACTOR: f64 = 3.0;

/// Number of contacts ahead for which the data of their bodies are prefetched: these lie anywhere in memory.
const PREFETCH_CONTACTS: usize = 8;

/// Bodies per task.
const BODIES_PER_TASK: usize = 256;

/// Normal velocity, divided by that due to the impulse of the last step alone, up to which a contact rests: larger than
/// the errors of solutions, smaller than the rebound with a restitution of 0.06.
const MAX_RESTING_VELOCITY_SHARE: f64 = 0.05;

thread_local! {
    /// Memory of the rows of the last contact problem. A large array that is allocated anew costs a page fault for every 4 kB.
    static ROW_MEMORY: Cell<Vec<ContactConstraint>> = const { Cell::new(Vec::new()) };
    /// Memory of its solver bodies.
    static BODY_MEMORY: Cell<Vec<SolverBody>> = const { Cell::new(Vec::new()) };
    /// Memory of the bounds on their motion.
    static BOUND_MEMORY: Cell<Vec<MotionBounds>> = const { Cell::new(Vec::new()) };
}

/// Keeps the memory of the large arrays of a contact problem, which is not used any more, for the next one of this thread.
pub fn keep_problem_memory(contact_problem: ContactProblem) {
    ROW_MEMORY.set(contact_problem.rows);
    BODY_MEMORY.set(contact_problem.bodies);
}

/// Assembles the rows of all contacts, in their order.
pub fn contact_problem(
    scene: &Scene,
    state: &State,
    q_c: &ContactConfiguration,
    contacts: &[Contact],
    free: Velocities,
) -> ContactProblem {
    let mut block_data = block_data(scene, q_c);
    let [start_w, free_w] = [&q_c.w, free.w].map(|w| ContactConfiguration::without_spins(w, &q_c.pushed_at_centre));
    let start_surfaces = q_c.start_surfaces(scene, state.time);
    let start = Velocities { v: &state.v, w: &start_w, gradient: q_c.start_gradient(), surfaces: &start_surfaces };
    let free = Velocities { w: &free_w, ..free };
    let (solver_bodies, bounds) = body_data(scene, q_c, free, block_data.is_some());
    let context = AssemblyContext {
        scene,
        state,
        q_c,
        start,
        free,
        bounds: &bounds,
        solver_bodies: &solver_bodies,
        changed: q_c.changed,
        has_blocks: block_data.is_some(),
        width: SimdWidth::detect(),
    };
    let history = context.previous_contacts(contacts);
    let memories = context.law_memories(contacts, &history);
    let pair_attractions = context.pair_attractions(contacts);
    let mut rows = context.contact_constraints(contacts, &history, &memories, &pair_attractions);
    let mut rolling_constraints = context.rolling_constraints(contacts, &history, &rows);
    if let Some(block_data) = &mut block_data {
        block_data.arms = contacts.par_iter().with_min_len(256).map(|contact| contact_arms(contact, &q_c.x)).collect();
        context.set_bonded_faces(block_data, contacts, &mut rows);
        if scene.options.face_friction == FaceFriction::Uniform {
            context.set_friction_points(block_data, contacts, &history, &mut rows);
        }
        let is_coupled = |k: usize| state.laws[contacts[k].law].is_coupled();
        set_delassus_diagonals(scene, block_data, &solver_bodies, is_coupled, &mut rows);
        set_rolling_inertia(block_data, &rows, &mut rolling_constraints);
    }
    let regularised = context.regularised_rows(contacts, &rows, &memories);
    BOUND_MEMORY.set(bounds);
    let mut contact_problem = ContactProblem {
        rows,
        rolling_constraints,
        block_data,
        regularised,
        memories,
        pair_attractions,
        bodies: solver_bodies,
        order: q_c.order.clone(),
    };
    let rescues = state.laws.iter().any(|law| law.rescue().is_some());
    if rescues {
        push_out_overlaps(state, q_c.h, contacts, &mut contact_problem);
    }
    if rescues || state.laws.iter().any(|law| law.cohesion().is_some()) {
        apply_cohesion(&mut contact_problem, &history);
    }
    contact_problem
}

/// Data of all bodies for the rows, in one pass over arrays that no cache holds: free velocities and inertia as the sweeps use
/// them, and bounds on the motion in the step. `has_blocks`: whether the rows have [`BlockData`].
fn body_data(
    scene: &Scene,
    q_c: &ContactConfiguration,
    free: Velocities,
    has_blocks: bool,
) -> (Vec<SolverBody>, Vec<MotionBounds>) {
    let (mut solver_bodies, mut bounds) = (BODY_MEMORY.take(), BOUND_MEMORY.take());
    let bodies = scene.bodies.par_iter().zip(free.v.par_iter().zip(free.w)).with_min_len(PAR_MIN_LEN);
    bodies
        .map(|(body, (v, w))| (solver_body(body, v, w, has_blocks), motion_bounds(body, v, w, q_c)))
        .unzip_into_vecs(&mut solver_bodies, &mut bounds);
    if q_c.cell_step.is_some() {
        let speeds = bounds.par_iter_mut().zip(free.v).enumerate().with_min_len(PAR_MIN_LEN);
        speeds.for_each(|(i, (bounds, v))| bounds.speed = q_c.relative_motion(i, v).norm());
    }
    (solver_bodies, bounds)
}

/// Data of a body with the free velocities `v` and `w` that a sweep reads and writes.
fn solver_body(body: &RigidBody, v: &Vec3, w: &Vec3, has_blocks: bool) -> SolverBody {
    match body.shape {
        BodyShape::Sphere { radius } => SolverBody {
            v: *v,
            inverse_mass: body.inverse_mass(),
            w: *w,
            inverse_inertia: body.inverse_inertia(),
            radius,
        },
        // A plate's motion at the contact point is in the row's shift.
        _ if has_blocks => {
            SolverBody { v: *v, inverse_mass: body.inverse_mass(), w: *w, inverse_inertia: 0.0, radius: 0.0 }
        }
        BodyShape::Plane { .. } | BodyShape::Parts => {
            SolverBody { v: Vec3::zeros(), inverse_mass: 0.0, w: Vec3::zeros(), inverse_inertia: 0.0, radius: 0.0 }
        }
    }
}

/// Bounds on the motion in the step of a body with the free velocities `v` and `w`.
fn motion_bounds(body: &RigidBody, v: &Vec3, w: &Vec3, q_c: &ContactConfiguration) -> MotionBounds {
    MotionBounds {
        speed: (v - q_c.mean_velocity).norm(),
        angular_speed: w.norm(),
        nearby: NEARBY_GAP * if body.driven { f64::INFINITY } else { body.radius },
    }
}

/// Sets W_nn and W_tt of rows that can close, and releases the rows that cannot move a body along the normal, unless they are
/// coupled and may act across it.
fn set_delassus_diagonals(
    scene: &Scene,
    block_data: &BlockData,
    solver_bodies: &[SolverBody],
    is_coupled: impl Fn(usize) -> bool + Sync,
    rows: &mut [ContactConstraint],
) {
    rows.par_iter_mut().enumerate().with_min_len(256).for_each(|(k, row)| {
        if !block_data.can_move_a_body(k, row, &scene.bodies) && !is_coupled(k) {
            *row = ContactConstraint {
                acts: false,
                can_close: false,
                impulse_shift: 0.0,
                warm_start: Vec3::zeros(),
                bond: None,
                ..*row
            };
        }
        (row.w_n, row.w_t) = if row.can_close || row.impulse_shift != 0.0 {
            block_data.delassus_diagonal(k, row, solver_bodies)
        } else {
            (0.0, 0.0)
        };
    });
}

/// Sets the inertia against rolling of bodies whose inertia depends on the axis.
fn set_rolling_inertia(
    block_data: &BlockData,
    rows: &[ContactConstraint],
    rolling_constraints: &mut [RollingConstraint],
) {
    for roll in rolling_constraints {
        let [a, b] = rows[roll.row.index()].bodies.map(|body| block_data.inverse_inertia[body.index()]);
        roll.inverse_w = 1.0 / (a + b).symmetric_eigenvalues().max();
    }
}

/// Sets the impulse with which laws push out deep overlaps, and subtracts it from the warm start, which stays
/// repulsive.
fn push_out_overlaps(state: &State, h: f64, contacts: &[Contact], contact_problem: &mut ContactProblem) {
    for (k, contact) in contacts.iter().enumerate() {
        let Some(rescue) = state.laws[contact.law].rescue() else { continue };
        let (push, w_n) = (rescue.velocity(contact.gap, h), contact_problem.delassus_diagonal(k).0);
        let row = &mut contact_problem.rows[k];
        if push > 0.0 && row.can_close && w_n > 0.0 {
            row.impulse_shift = push / w_n;
            let normal = row.normal.dot(&row.warm_start);
            row.warm_start += row.normal * ((normal - row.impulse_shift).max(0.0) - normal);
        }
    }
}

/// Applies the attraction of the contacts, and starts contacts without a history from the impulse that balances it.
fn apply_cohesion(contact_problem: &mut ContactProblem, history: &[Option<ContactId>]) {
    for (k, old) in history.iter().enumerate() {
        let ContactConstraint { impulse_shift, normal, .. } = contact_problem.rows[k];
        if impulse_shift != 0.0 {
            contact_problem.apply_impulse(k, &(normal * impulse_shift));
            if old.is_none() {
                contact_problem.rows[k].warm_start = normal * contact_problem.rows[k].balancing_impulse();
            }
        }
    }
}

impl AssemblyContext<'_> {
    /// Rows of all contacts, with their `history` of the last step, the `memories` of their laws and their
    /// `pair_attractions`, N.
    fn contact_constraints(
        &self,
        contacts: &[Contact],
        history: &[Option<ContactId>],
        memories: &[LawMemory],
        pair_attractions: &[f64],
    ) -> Vec<ContactConstraint> {
        let bond_states = self.bond_states(contacts, history);
        let rebounds = self.rebound_velocities(contacts);
        let constraint_of = |(k, old): (usize, &Option<ContactId>)| {
            self.prefetch(contacts, k + PREFETCH_CONTACTS);
            let memory = memories.get(k).copied().unwrap_or_default();
            let bond_state = bond_states.get(k).copied().unwrap_or_default();
            let attraction = pair_attractions.get(k).copied().unwrap_or_default();
            let rebound = rebounds.get(k).copied().flatten();
            self.contact_constraint(&contacts[k], self.previous_end(*old), bond_state, memory, attraction, rebound)
        };
        let mut rows = ROW_MEMORY.take();
        history.par_iter().enumerate().with_min_len(256).map(constraint_of).collect_into_vec(&mut rows);
        rows
    }

    /// Rolling constraints of the rows that act.
    fn rolling_constraints(
        &self,
        contacts: &[Contact],
        history: &[Option<ContactId>],
        rows: &[ContactConstraint],
    ) -> Vec<RollingConstraint> {
        if !self.state.laws.iter().any(ContactLaw::has_moments) {
            return Vec::new();
        }
        let acting = (0..rows.len()).filter(|&k| rows[k].acts);
        acting
            .filter_map(|k| self.rolling_constraint(&rows[k], k, &contacts[k], self.previous_end(history[k])))
            .collect()
    }

    /// Contact at the end of the last step.
    fn previous_end(&self, old: Option<ContactId>) -> Option<&SolvedContact> {
        old.map(|k| &self.state.contacts[k.index()])
    }

    /// Sets the points at which the friction of faces acts, and the shifts of the rows there. The rows of new joined faces
    /// start from a uniform pressure.
    fn set_friction_points(
        &self,
        block_data: &mut BlockData,
        contacts: &[Contact],
        history: &[Option<ContactId>],
        rows: &mut [ContactConstraint],
    ) {
        let solver_bodies = self.solver_bodies;
        let load = |k: usize| match history[k] {
            Some(_) => rows[k].normal.dot(&rows[k].warm_start),
            None => -rows[k].impulse_shift,
        };
        let is_sticking =
            |k: usize| self.previous_end(history[k]).is_some_and(|old| old.status == ContactStatus::Stick);
        block_data.friction_offsets =
            FaceRows { contacts, rows, solver_bodies, block_data, load, is_sticking }.friction_offsets();
        if has_joints(self.scene) {
            let faces = FaceRows { contacts, rows, solver_bodies, block_data, load, is_sticking };
            let last_loads = || self.last_loads(contacts, history);
            let joined = Joints { faces: &faces, scene: self.scene, last_loads }.joined_faces();
            block_data.friction_offsets = joined.offsets;
            joined.warm_starts.into_iter().for_each(|(k, r)| rows[k].warm_start = r);
        }
        if !block_data.friction_offsets.is_empty() {
            self.remove_offsets_of_elastic_bonds(contacts, rows, &mut block_data.friction_offsets);
            self.shift_friction(block_data, contacts, rows);
        }
    }

    /// Makes the friction of faces with elastic bonds act at their contact points.
    fn remove_offsets_of_elastic_bonds(
        &self,
        contacts: &[Contact],
        rows: &[ContactConstraint],
        friction_offsets: &mut [Vec3],
    ) {
        if self.state.laws.iter().any(|law| law.bond_stiffness().is_some()) {
            let of_rows = contacts.iter().zip(rows).zip(friction_offsets);
            of_rows
                .filter(|((contact, row), _)| self.bond_compliance(contact, row).is_some())
                .for_each(|(_, offset)| *offset = Vec3::zeros());
        }
    }

    /// Compliance of the elastic bond of a row, if it has one.
    pub(super) fn bond_compliance(&self, contact: &Contact, row: &ContactConstraint) -> Option<BondCompliance> {
        let law = &self.state.laws[contact.law];
        let is_bonded = law.bond_stiffness().is_some() && row.bond.is_some() && row.impulse_shift != 0.0;
        let radius = if is_bonded { self.contact_radius(contact) } else { return None };
        law.bond_compliance(radius, self.q_c.h, self.closing_time())
    }

    /// Prefetches the data of the antagonist of contact `k` that [`Self::contact_constraint`] reads, unless the contact before
    /// has the same; candidates are read in order.
    fn prefetch(&self, contacts: &[Contact], k: usize) {
        let AssemblyContext { state, q_c, bounds, solver_bodies, width, .. } = self;
        let Some([before, contact]) = contacts.get(k - 1..=k) else { return };
        if before.antagonist == contact.antagonist {
            return;
        }
        let b = contact.antagonist.index();
        [&q_c.x[b], &q_c.w[b], &state.v[b], &state.w[b]].into_iter().for_each(|x| width.prefetch(x));
        width.prefetch(&bounds[b]);
        width.prefetch(&solver_bodies[b]);
    }

    /// Regularisations of the rows that act, by the laws of their contacts.
    fn regularised_rows(
        &self,
        contacts: &[Contact],
        rows: &[ContactConstraint],
        memories: &[LawMemory],
    ) -> Vec<RegularisedRow> {
        if !self.state.laws.iter().any(ContactLaw::is_regularised) {
            return Vec::new();
        }
        let regularised_row = |(k, contact): (usize, &Contact)| {
            let law = &self.state.laws[contact.law];
            let memory = memories.get(k).copied().unwrap_or_default();
            let (gap, row) = (contact.gap - memory.reference_gap, ContactId::new(k));
            if let Some(spring) = law.strain_spring() {
                let (_, compliance) = self.link_terms(contact, spring);
                return rows[k].acts.then_some(RegularisedRow::Link { row, compliance, is_wire: spring.is_wire });
            }
            if law.bond_stiffness().is_some() {
                let BondCompliance { opening, sliding, .. } = self.bond_compliance(contact, &rows[k])?;
                return Some(RegularisedRow::Bond { row, opening, sliding });
            }
            if let Some(law_interface) = law.interface {
                let n = contact.normal;
                let interface = InterfaceRow {
                    law: law_interface,
                    area: std::f64::consts::PI * self.contact_radius(contact).powi(2),
                    h: self.q_c.h,
                    opening: gap.max(0.0),
                    sliding: memory.sliding - n * n.dot(&memory.sliding),
                    soundness: memory.soundness,
                    shift: gap.max(0.0) / self.closing_time(),
                };
                let is_intact = rows[k].acts && memory.soundness > 0.0 && interface.area > 0.0;
                return is_intact.then_some(RegularisedRow::Interface { row, interface });
            }
            let found = law.regularisation(gap, self.q_c.h, self.closing_time()).filter(|_| rows[k].acts)?;
            Some(match found {
                LawRegularisation::Compliance(compliance) => RegularisedRow::Spring { row, compliance },
                LawRegularisation::Coupling => RegularisedRow::Coupled { row },
            })
        };
        contacts.iter().enumerate().filter_map(regularised_row).collect()
    }

    /// Row of a contact, with its history of the last step, the bond of its bodies, the memory of its law and its share in the
    /// attraction of its pair, N. `rebound`: normal velocity after impacts one after the other, m/s, in place of that of its law.
    fn contact_constraint(
        &self,
        contact: &Contact,
        previous: Option<&SolvedContact>,
        bond_state: BondState,
        memory: LawMemory,
        pair_attraction: f64,
        rebound: Option<f64>,
    ) -> ContactConstraint {
        let &AssemblyContext { scene, state, q_c, solver_bodies, has_blocks, .. } = self;
        let h = q_c.h;
        let frame = contact.frame();
        let n = frame[0];
        let arms = contact_arms(contact, &q_c.x);
        let u_before = velocity_at_arms(contact, &arms, self.start);
        let law = &state.laws[contact.law];
        if let Some(spring) = law.strain_spring() {
            return self.link_constraint(contact, previous, spring, to_local(&frame, &u_before));
        }
        let radius = if law.depends_on_radius() { self.contact_radius(contact) } else { 0.0 };
        let bodies = [contact.candidate, contact.antagonist];
        let [a, b] = bodies.map(|i| i.index());
        let w_n = solver_bodies[a].inverse_mass + solver_bodies[b].inverse_mass;
        let closing_time = self.closing_time();
        let gap_forecast =
            self.gap_forecast(contact, law, closing_time, previous.map_or(0.0, |old| w_n * old.impulse.x));
        // The load of a new contact is unknown, and a rebounding contact does not stay.
        let carried = previous.is_some_and(|old| old.impulse != Vec3::zeros()) && gap_forecast != GapForecast::Due;
        let stays = bond_state.bond.is_some() || bond_state.in_aggregate || carried;
        let moves_as_one = bond_state.bond.is_some() && law.bonds_are_rigid();
        let turning = if stays { self.arm_turning_velocity(contact, &arms, moves_as_one) } else { Vec3::zeros() };
        // Sliding along a curved surface is no approach, and bonded bodies that turn do not part.
        let curve = match bond_state {
            BondState { bond: Some(_), .. } if law.bonds_are_rigid() => -turning.dot(&n),
            BondState { in_aggregate: true, .. } => (contact.gap.max(0.0) / h - turning.dot(&n)).min(0.0),
            BondState { .. } => self.curvature_velocity(contact),
        };
        let u_n = n.dot(&u_before) + curve;
        let bonded = bond_state.bond.is_some();
        let slid_before = previous.is_some_and(|old| old.status == ContactStatus::Slide);
        let gap = contact.gap - memory.reference_gap;
        let sliding_speed = law.friction_speed.map_or(0.0, |_| (u_before - n * n.dot(&u_before)).norm());
        let input = LawInput {
            gap,
            h,
            closing_time,
            gap_forecast,
            u_n,
            sliding_speed,
            radius,
            slid_before,
            bonded,
            pair_attraction,
        };
        // Bodies are held together within the alert distance, as in LMGC90.
        let is_coupled = law.is_coupled() && self.alert_distance(contact).is_some_and(|alert| contact.gap <= alert);
        let shift = law.contact_shift(&input).filter(|_| is_coupled || !law.is_coupled());
        let is_sliding_now = |shift: &LawShift| {
            law.has_two_frictions() && !slid_before && self.is_sliding(contact, previous, &u_before, shift, w_n)
        };
        let shift = shift.map(|shift| {
            if is_sliding_now(&shift) {
                law.contact_shift(&LawInput { slid_before: true, ..input }).unwrap()
            } else {
                shift
            }
        });
        let acts = shift.is_some();
        let shift = shift.unwrap_or_default();
        let shift = LawShift { normal: rebound.map_or(shift.normal, |rebound| -rebound) - curve, ..shift };
        let compliance = law.bond_compliance(radius, h, closing_time).filter(|_| bonded && shift.impulse != 0.0);
        let elastic_shift = compliance.map_or(Vec3::zeros(), |compliance| {
            let opening = gap - bond_state.bond.unwrap_or(gap);
            let force = previous.map_or(Vec3::zeros(), |old| to_world(&old.contact.frame(), &old.impulse));
            let force = self.turned_with_pair(contact, &force) * (h / state.h);
            n * (opening / closing_time + compliance.opening * shift.impulse)
                - (force - n * n.dot(&force)) * compliance.sliding
        });

        let on_plate = self.on_plate(contact);
        // The arms end in one point: it divides the distance in the ratio of the radii, and is the middle of the gap on flat
        // surfaces.
        let radii = [solver_bodies[a].radius, solver_bodies[b].radius];
        let antagonist_radius =
            || match scene.find_part(contact.antagonist, contact.part_numbers.antagonist).map(|part| &part.geometry) {
                Some(ContactorShape::Sphere { radius }) => *radius,
                _ if on_plate => radii[0],
                _ => radii[1],
            };
        let arm = if has_blocks { 1.0 } else { 1.0 + contact.gap / (radii[0] + antagonist_radius()) };
        let plate_velocity = if on_plate { self.plate_velocity(contact) } else { Vec3::zeros() };
        let w_t = w_n
            + (arm * radii[0]).powi(2) * solver_bodies[a].inverse_inertia
            + (arm * radii[1]).powi(2) * solver_bodies[b].inverse_inertia;
        let u_tangent = u_before - n * n.dot(&u_before);
        let mut velocity_shift = n * shift.normal + (turning - n * turning.dot(&n)) + u_tangent * shift.tangential
            - plate_velocity
            + elastic_shift;
        if let Some(gradient) = self.free.gradient {
            velocity_shift -= gradient * contact.image; // motion of the antagonist's image relative to its body
        }
        if !self.free.surfaces.is_empty() {
            velocity_shift += relative_surface_velocity(contact, [&arms[0], &arms[1]], self.free.surfaces);
        }
        ContactConstraint {
            bodies,
            normal: n,
            arm,
            shift: velocity_shift,
            w_n,
            w_t,
            friction: shift.friction * law.friction_share(memory.soundness, radius),
            impulse_shift: shift.impulse,
            acts,
            can_close: is_coupled
                || rebound.is_some()
                || memory.soundness > 0.0
                || shift.solved && (shift.impulse != 0.0 || self.can_close_gap(contact, gap, &arms)),
            warm_start: previous.map_or(Vec3::zeros(), |old| warm_start(old, contact, &shift, h / state.h)),
            u_before: to_local(&frame, &u_before),
            bond: bond_state.bond.filter(|_| acts),
        }
    }

    /// Row of a wire or rod.
    fn link_constraint(
        &self,
        contact: &Contact,
        previous: Option<&SolvedContact>,
        spring: &StrainSpring,
        u_before: Vec3,
    ) -> ContactConstraint {
        let n = contact.normal;
        ContactConstraint {
            bodies: [contact.candidate, contact.antagonist],
            normal: n,
            shift: n * self.link_terms(contact, spring).0,
            acts: true,
            can_close: true,
            warm_start: previous.map_or(Vec3::zeros(), |old| n * (old.impulse.x * self.q_c.h / self.state.h)),
            u_before,
            ..ContactConstraint::default()
        }
    }

    /// Normal shift, m/s, and compliance, 1/kg, of a wire or rod.
    fn link_terms(&self, contact: &Contact, spring: &StrainSpring) -> (f64, f64) {
        let link = self.scene.find_link([contact.candidate, contact.antagonist], contact.part_numbers);
        let rest_length = link.map_or(contact.gap, |link| link.rest_length);
        spring.shift_and_compliance(contact.gap, rest_length, self.q_c.h, self.closing_time())
    }

    /// Sets the velocities before the step, and the shift by restitution, at the points where friction acts.
    fn shift_friction(&self, block_data: &BlockData, contacts: &[Contact], rows: &mut [ContactConstraint]) {
        let shift_row = |(k, row): (usize, &mut ContactConstraint)| {
            let (contact, lever) = (&contacts[k], block_data.friction_lever(k, &row.normal));
            let [a, b] = row.bodies.map(|body| self.start.w[body.index()]);
            let change = lever * row.normal.dot(&(a - b));
            row.u_before += to_local(&contact.frame(), &change);
            let law = &self.state.laws[contact.law];
            if !law.acts_on_touch() {
                return;
            }
            let closing_time = self.closing_time();
            let input = LawInput {
                gap: contact.gap,
                h: self.q_c.h,
                closing_time,
                gap_forecast: self.gap_forecast(contact, law, closing_time, 0.0),
                u_n: row.u_before.x,
                sliding_speed: 0.0,
                radius: self.contact_radius(contact),
                slid_before: false,
                bonded: row.bond.is_some(),
                pair_attraction: -row.impulse_shift / self.q_c.h,
            };
            row.shift += change * law.contact_shift(&input).unwrap_or_default().tangential;
        };
        let rows = rows.par_iter_mut().enumerate().with_min_len(256);
        rows.filter(|(k, _)| block_data.friction_offsets[*k] != Vec3::zeros()).for_each(shift_row);
    }

    /// Whether a contact slides at the step's start that carried nothing in the last step, or whose bodies have other
    /// velocities than at its end: at `u` (world frame, m/s), faster than the error of unconverged sticking contacts.
    fn is_sliding(&self, contact: &Contact, old: Option<&SolvedContact>, u: &Vec3, shift: &LawShift, w_n: f64) -> bool {
        let carried = old.filter(|old| old.impulse != Vec3::zeros());
        if carried.is_some() && !self.changed {
            return false;
        }
        let AssemblyContext { scene, q_c, free: free_velocities, .. } = self;
        let n = contact.normal;
        let tangential = |u: Vec3| (u - n * n.dot(&u)).norm();
        // Change of normal velocity by the impulse: all of the closing velocity, and that due to its attraction.
        let free = relative_velocity(contact, &q_c.x, *free_velocities).dot(&n) + shift.normal;
        let own_velocity_change = (-free).max(0.0) + w_n * shift.impulse.abs();
        // Bodies in free fall together are loaded by other contacts, which balance the change of velocity by forces.
        let bodies = [contact.candidate, contact.antagonist].map(|i| i.index());
        let velocity_change =
            |i: usize| if scene.bodies[i].driven { 0.0 } else { (free_velocities.v[i] - self.state.v[i]).norm() };
        let load_velocity = bodies.map(velocity_change).into_iter().fold(own_velocity_change, f64::max);
        // Without forces, the error of an unconverged solution is at most a share of the speeds.
        let scale =
            if load_velocity > 0.0 { load_velocity } else { bodies.map(|i| self.bounds[i].speed).into_iter().sum() };
        let is_moving = |u: Vec3| tangential(u) > SLIDING_VELOCITY_FACTOR * scene.options.tol() * scale;
        let arms = contact_arms(contact, &q_c.x);
        let slip_velocity = u - self.arm_turning_velocity(contact, &arms, false) * 0.5;
        let has_other_velocity = |old: &SolvedContact| is_moving(u - to_world(&old.contact.frame(), &old.velocity));
        is_moving(slip_velocity) && carried.is_none_or(has_other_velocity)
    }

    /// Forecast of the gap of a contact whose law acts on touching contacts.
    ///
    /// `impulse_velocity`: change of its normal velocity by its own impulse in the last step, m/s.
    #[inline]
    pub(super) fn gap_forecast(
        &self,
        contact: &Contact,
        law: &ContactLaw,
        closing_time: f64,
        impulse_velocity: f64,
    ) -> GapForecast {
        let damped_spring = law.is_damped_spring();
        if !(law.acts_on_touch() || damped_spring) || contact.gap <= 0.0 {
            return GapForecast::Apart { depth: 0.0 };
        }
        let AssemblyContext { scene, state, q_c, free: free_velocities, .. } = self;
        let [a, b] = [contact.candidate, contact.antagonist].map(|i| i.index());
        let u_n = contact.normal.dot(&relative_velocity(contact, &q_c.x, self.start)).abs();
        let force_velocity = |i: usize| contact.normal.dot(&(free_velocities.v[i] - state.v[i])).abs();
        if !damped_spring
            && (u_n < MAX_RESTING_VELOCITY_SHARE * impulse_velocity
                || u_n.max(contact.gap / closing_time) < force_velocity(a).max(force_velocity(b)))
        {
            return GapForecast::Resting;
        }
        let pair = OpenPair { scene, q_c, contact };
        let depth = pair.allowed_overlap(law);
        if !q_c.closed_by_others.is_empty() && q_c.closed_by_others.contains(&contact.key()) {
            return if damped_spring { GapForecast::Due } else { GapForecast::Apart { depth } };
        }
        let least_depth = if damped_spring { depth } else { 0.0 };
        if !pair.closes_deeper_along_normal(*free_velocities, least_depth) {
            return GapForecast::Apart { depth };
        }
        if pair.misses(*free_velocities, 0.0) { GapForecast::Passing } else { GapForecast::Due }
    }

    /// Moments at `row`, row `k`, if its law or its bond carries them. Faces that share an area have several contacts, whose
    /// impulses carry the moments of a bond.
    fn rolling_constraint(
        &self,
        row: &ContactConstraint,
        k: usize,
        contact: &Contact,
        previous: Option<&SolvedContact>,
    ) -> Option<RollingConstraint> {
        let bonded = row.bond.is_some() && contact.area == 0.0;
        let law = &self.state.laws[contact.law];
        let MomentLimits { bending, torsion, shear } = law.moment_limits(bonded)?;
        let bodies = [contact.candidate, contact.antagonist];
        let turns =
            |body: &BodyId| self.scene.bodies[body.index()].can_rotate() && !self.q_c.is_pushed_at_centre(*body);
        if !bodies.iter().any(turns) {
            return None; // no moment changes the two rotations
        }
        let [a, b] = bodies.map(|body| body.index());
        let scale = self.q_c.h / self.state.h;
        let plate_shift = if self.on_plate(contact) { -self.free.w[b] } else { Vec3::zeros() };
        let warm_start = previous.map_or(Vec3::zeros(), |old| to_world(&old.contact.frame(), &old.moment) * scale);
        let (mut shift, mut compliance, mut warm_start) = (plate_shift, [0.0; 2], warm_start);
        if bonded {
            shift += self.relative_spin_change(contact);
        }
        if let Some(BondCompliance { bending, torsion, .. }) = self.bond_compliance(contact, row) {
            warm_start = self.turned_with_pair(contact, &warm_start);
            let along = row.normal * row.normal.dot(&warm_start);
            shift -= (warm_start - along) * bending + along * torsion;
            compliance = [bending, torsion];
        }
        Some(RollingConstraint {
            row: ContactId::new(k),
            radius: if law.bond_radius().is_some() {
                self.contact_radius(contact)
            } else {
                self.effective_radius(contact)
            },
            rolling: bending,
            spinning: torsion,
            shear,
            inverse_w: 1.0 / (self.solver_bodies[a].inverse_inertia + self.solver_bodies[b].inverse_inertia),
            shift,
            compliance,
            warm_start,
        })
    }
}

/// Per-body part of [`BlockData`], if a scene needs it.
fn block_data(scene: &Scene, q_c: &ContactConfiguration) -> Option<BlockData> {
    let inverse_inertia = |(i, (body, q)): (usize, (&RigidBody, &Quat))| {
        if q_c.is_pushed_at_centre(BodyId::new(i)) { Matrix3::zeros() } else { body.inverse_inertia_matrix(q) }
    };
    let all_locked_axes = || scene.bodies.iter().map(RigidBody::locked_axes).collect();
    let bodies = scene.bodies.par_iter().zip(&q_c.q);
    let new_data = || BlockData {
        arms: Vec::new(),
        friction_offsets: Vec::new(),
        locked_axes: if scene.bodies.iter().any(RigidBody::is_driven_in_part) { all_locked_axes() } else { Vec::new() },
        inverse_inertia: bodies.enumerate().with_min_len(BODIES_PER_TASK).map(inverse_inertia).collect(),
    };
    scene.needs_blocks().then(new_data)
}
