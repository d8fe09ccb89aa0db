//! Contact problem of one step: one row per contact, one record per body.
//!
//! No Delassus matrix is stored: the sweeps keep the velocities V = V_free + M⁻¹ H r of the bodies,
//! and a row reads and changes those of its two. A law's shift c is put into the records once, so
//! that the solver works on r̂ = r - c n alone (see [`crate::laws`]).

use cd_formats::compute::FaceFriction;
use nalgebra::Matrix3;
use rayon::prelude::*;

use super::faces::{Joints, friction_offsets, has_joints};
use super::history::{BondState, warm_start};
use crate::integrate::ContactConfiguration;
use crate::laws::{ContactLaw, GapForecast, LawInput, LawShift, MAX_STEP_OVERLAP, RollingFriction};
use crate::math::simd::SimdWidth;
use crate::math::{PAR_MIN_LEN, Quat, Vec3, to_local, to_world};
use crate::scene::{BodyShape, ContactorShape, NEARBY_GAP, RigidBody, Scene};
use crate::state::{Contact, ContactStatus, SolvedContact, State};

/// Sliding of a contact that begins counts above this multiple of `tol` times the change of velocity that loads it:
/// unconverged sticking contacts slide less.
const SLIDING_VELOCITY_FACTOR: f64 = 3.0;

/// Data of a body that a sweep reads and writes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolverBody {
    /// Velocity, m/s.
    pub v: Vec3,
    /// Inverse mass, 1/kg, 0 for a body whose motion is all imposed.
    pub inverse_mass: f64,
    /// Angular velocity, rad/s.
    pub w: Vec3,
    /// Inverse moment of inertia, 1/(kg m^2).
    pub inverse_inertia: f64,
    /// Radius, m; 0 for a plate, whose rotation is in the shift of its rows.
    pub radius: f64,
}

/// One contact of two spheres or of a sphere and a plate, in the form used by the sweeps. Its W is diagonal: w_n along n, w_t
/// in the tangent plane.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ContactConstraint {
    /// Records of candidate and antagonist.
    pub bodies: [u32; 2],
    pub normal: Vec3,
    /// Distance from each centre to the contact point, over the radius of its sphere.
    pub arm: f64,
    /// û = u + shift, world frame, m/s: the law's shifts and the motion of a plate.
    pub shift: Vec3,
    /// W_nn and W_tt = W_ss, 1/kg.
    pub w_n: f64,
    pub w_t: f64,
    pub friction: f64,
    /// c = r_n - r̂_n, N s.
    pub impulse_shift: f64,
    /// Whether the law can act in this step.
    pub acts: bool,
    /// Whether the law acts and either the two bodies' free velocities can close the gap within the step, or the row pulls.
    pub can_close: bool,
    /// Initial r̂, world frame, N s: that of the last step, else the one due to the attraction alone.
    pub warm_start: Vec3,
    /// u at the step's start along n, t, s, m/s.
    pub u_before: Vec3,
    /// Gap at which the contact is bonded, m.
    pub bond: Option<f64>,
}

/// Resistance of a row's contact to rolling and spinning, see [`crate::laws::RollingFriction`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RollingConstraint {
    /// Index into the rows.
    pub row: u32,
    /// 1/(1/R_a + 1/R_b), m.
    pub radius: f64,
    pub rolling: f64,
    pub spinning: f64,
    /// 1/(1/I_a + 1/I_b) of spheres, else one over the largest eigenvalue of the sum of the inverse inertias, kg m^2.
    pub inverse_w: f64,
    /// Relative angular velocity due to a plate, rad/s.
    pub shift: Vec3,
    /// Initial moment, world frame, N m s.
    pub warm_start: Vec3,
}

#[derive(Debug, Clone)]
pub struct ContactProblem {
    pub rows: Vec<ContactConstraint>,
    /// Additional data of the rows and records where not all bodies are spheres and plates.
    pub block_data: Option<BlockData>,
    /// Rolling constraints in the order of the rows; empty in most scenes.
    pub rolling_constraints: Vec<RollingConstraint>,
    /// All bodies in spatial order, neighbours near each other.
    pub order: Vec<u32>,
    /// Velocities if every r̂ were 0.
    pub bodies: Vec<SolverBody>,
}

/// Data of rows whose W is a full block: lever arms of any direction, anisotropic inertia. `arm` of the rows and
/// `inverse_inertia` and `radius` of the records are then not used; `w_n` is W_nn and `w_t` the mean of W_tt and W_ss.
#[derive(Debug, Clone)]
pub struct BlockData {
    /// Vectors from the centres of candidate and antagonist to the contact point, by row, m.
    pub arms: Vec<[Vec3; 2]>,
    /// Vector from the contact point to the point at which friction acts about the normal, by row, m, in the tangent plane;
    /// see `assemble/faces.rs`. Empty if friction acts at every contact point.
    pub friction_offsets: Vec<Vec3>,
    /// 1 for each fixed axis along which the velocity of a partly driven body is imposed, else 0; by body. Empty if there is
    /// no such body.
    pub locked_axes: Vec<Vec3>,
    /// Inverse inertia about the centre of mass in the contact configuration, by body, world frame, 1/(kg m²); 0 for a body
    /// whose motion is imposed.
    pub inverse_inertia: Vec<Matrix3<f64>>,
}

impl BlockData {
    /// n×d of row `k` with the friction offset d, m: tangential velocity at the point of friction minus that at the contact
    /// point, per unit of relative angular velocity about n.
    #[inline]
    pub fn friction_lever(&self, k: usize, normal: &Vec3) -> Vec3 {
        self.friction_offsets.get(k).map_or(Vec3::zeros(), |offset| normal.cross(offset))
    }

    /// Whether a moving body has an imposed velocity along some fixed axis.
    pub fn has_locked_axes(&self, body: usize) -> bool {
        self.locked_axes.get(body).is_some_and(|held| *held != Vec3::zeros())
    }

    /// 1 for each fixed axis along which impulses move a body, else 0.
    pub fn free_axes(&self, body: usize) -> Vec3 {
        self.locked_axes.get(body).map_or(Vec3::repeat(1.0), |held| Vec3::repeat(1.0) - held)
    }

    /// W_nn and the mean of W_tt and W_ss of row `k`, 1/kg.
    pub(crate) fn delassus_diagonal(&self, k: usize, row: &ContactConstraint, records: &[SolverBody]) -> (f64, f64) {
        let (mut w_n, mut trace) = (0.0, 0.0);
        let lever = self.friction_lever(k, &row.normal);
        for (body, arm) in row.bodies.into_iter().zip(&self.arms[k]) {
            let (inverse_mass, j) = (records[body as usize].inverse_mass, &self.inverse_inertia[body as usize]);
            let turn = arm.cross(&row.normal);
            let held = self.locked_axes.get(body as usize);
            let along = held.map_or(1.0, |held| 1.0 - held.dot(&row.normal.component_mul(&row.normal)));
            w_n += inverse_mass * along + turn.dot(&(j * turn));
            let all = held.map_or(3.0, |held| 3.0 - held.sum());
            trace += all * inverse_mass + j.trace() * arm.norm_squared() - arm.dot(&(j * arm));
            if lever != Vec3::zeros() {
                let about = j * row.normal;
                trace += 2.0 * lever.dot(&about.cross(arm)) + lever.norm_squared() * row.normal.dot(&about);
            }
        }
        (w_n, 0.5 * (trace - w_n))
    }

    /// Whether an impulse along the normal of a row can move one of its bodies. It turns all bodies that are not driven.
    fn can_move_a_body(&self, row: &ContactConstraint, bodies: &[RigidBody]) -> bool {
        self.locked_axes.is_empty()
            || row.bodies.iter().any(|&i| {
                let body = &bodies[i as usize];
                let along = self.free_axes(i as usize).dot(&row.normal.component_mul(&row.normal));
                !body.driven || (!body.is_imposed() && along > MIN_FREE_COSINE_SQUARED)
            })
    }
}

/// Smallest square of the cosine between the normal and a free direction of one of two partly driven bodies at which their
/// contact acts. Within 1e-3 rad of the plane of the imposed components the normal differs from this plane only by rounding,
/// and an impulse along it would accelerate the body along the free axis.
const MIN_FREE_COSINE_SQUARED: f64 = 1e-6;

/// Velocity of the candidate relative to the antagonist at the contact point, world frame, m/s.
pub fn relative_velocity(contact: &Contact, x: &[Vec3], v: &[Vec3], w: &[Vec3]) -> Vec3 {
    let [a, b] = [contact.candidate, contact.antagonist].map(|i| i as usize);
    let [at_a, at_b] = contact_arms(contact, x);
    v[a] + w[a].cross(&at_a) - (v[b] + w[b].cross(&at_b))
}

/// Vectors from the centres of the candidate and of the antagonist's image to the contact point, m.
pub fn contact_arms(contact: &Contact, x: &[Vec3]) -> [Vec3; 2] {
    [contact.point - x[contact.candidate as usize], contact.point - (x[contact.antagonist as usize] + contact.image)]
}

/// Assembles the rows of all contacts, in their order.
pub fn contact_problem(
    scene: &Scene,
    state: &State,
    q_c: &ContactConfiguration,
    contacts: &[Contact],
    v_free: &[Vec3],
    w_free: &[Vec3],
) -> ContactProblem {
    let mut full = block_data(scene, q_c);
    let records: Vec<SolverBody> = scene
        .bodies
        .par_iter()
        .zip(v_free.par_iter().zip(w_free))
        .with_min_len(PAR_MIN_LEN)
        .map(|(body, (v, w))| match body.shape {
            BodyShape::Sphere { radius } => SolverBody {
                v: *v,
                inverse_mass: body.inverse_mass(),
                w: *w,
                inverse_inertia: body.inverse_inertia(),
                radius,
            },
            // A plate's motion at the contact point is in the row's shift.
            _ if full.is_some() => {
                SolverBody { v: *v, inverse_mass: body.inverse_mass(), w: *w, inverse_inertia: 0.0, radius: 0.0 }
            }
            BodyShape::Plane { .. } | BodyShape::Parts => {
                SolverBody { v: Vec3::zeros(), inverse_mass: 0.0, w: Vec3::zeros(), inverse_inertia: 0.0, radius: 0.0 }
            }
        })
        .collect();

    let speeds = v_free.par_iter().zip(w_free).with_min_len(PAR_MIN_LEN);
    let speeds = speeds.map(|(v, w)| [(v - q_c.mean_velocity).norm(), w.norm()]).collect();
    let is_sphere = scene.bodies.iter().map(RigidBody::is_sphere).collect();
    let setting = AssemblyContext {
        scene,
        state,
        q_c,
        v_free,
        w_free,
        speeds,
        is_sphere,
        records: &records,
        changed: q_c.changed,
        full: full.is_some(),
        width: SimdWidth::detect(),
    };
    let history = setting.previous_contacts(contacts);
    let before = |old: &Option<u32>| old.map(|k| &state.contacts[k as usize]);
    let holds = setting.bond_states(contacts, &history);
    let of_contact = |(k, (old, hold)): (usize, (&Option<u32>, &BondState))| {
        setting.prefetch(contacts.get(k + PREFETCH_CONTACTS));
        setting.contact_constraint(&contacts[k], before(old), *hold)
    };
    let mut rows: Vec<ContactConstraint> =
        history.par_iter().zip(&holds).enumerate().with_min_len(256).map(of_contact).collect();
    let mut rolls: Vec<RollingConstraint> = if state.laws.iter().any(|law| law.rolling_friction().is_some()) {
        let listed = (0..).zip(contacts).zip(&history).filter(|((k, _), _): &((usize, _), _)| rows[*k].acts);
        listed
            .filter_map(|((k, contact), old)| {
                setting.rolling_constraint(k, contact, old.map(|k| &state.contacts[k as usize]))
            })
            .collect()
    } else {
        Vec::new()
    };
    if let Some(full) = &mut full {
        full.arms = contacts.par_iter().with_min_len(256).map(|contact| contact_arms(contact, &q_c.x)).collect();
    }
    if let Some(full) = &mut full
        && scene.options.face_friction == FaceFriction::Uniform
    {
        let load = |k: usize| match history[k] {
            Some(_) => rows[k].normal.dot(&rows[k].warm_start),
            None => -rows[k].impulse_shift,
        };
        let sticks =
            |k: usize| history[k].is_some_and(|old| state.contacts[old as usize].status == ContactStatus::Stick);
        full.friction_offsets = friction_offsets(contacts, &rows, full, load, sticks);
        if has_joints(scene) {
            let joints = Joints { contacts, rows: &rows, records: &records, full, scene };
            full.friction_offsets = joints.with_joined_faces(load, sticks);
        }
        if !full.friction_offsets.is_empty() {
            setting.shift_friction(full, contacts, &mut rows);
        }
    }
    if let Some(full) = &full {
        rows.par_iter_mut().enumerate().with_min_len(256).for_each(|(k, row)| {
            (row.w_n, row.w_t) = full.delassus_diagonal(k, row, &records);
            if !full.can_move_a_body(row, &scene.bodies) {
                *row = ContactConstraint {
                    acts: false,
                    can_close: false,
                    impulse_shift: 0.0,
                    warm_start: Vec3::zeros(),
                    bond: None,
                    ..*row
                };
            }
        });
        for roll in &mut rolls {
            let [a, b] = rows[roll.row as usize].bodies.map(|body| full.inverse_inertia[body as usize]);
            roll.inverse_w = 1.0 / (a + b).symmetric_eigenvalues().max();
        }
    }
    let mut system = ContactProblem {
        rows,
        rolling_constraints: rolls,
        block_data: full,
        bodies: records,
        order: q_c.order.clone(),
    };
    if state.laws.iter().any(|law| law.cohesion().is_some()) {
        apply_cohesion(&mut system, &history);
    }
    system
}

/// Applies the attraction of the contacts, and starts contacts without a history from the impulse that balances it.
fn apply_cohesion(system: &mut ContactProblem, history: &[Option<u32>]) {
    for (k, old) in history.iter().enumerate() {
        let ContactConstraint { impulse_shift, normal, .. } = system.rows[k];
        if impulse_shift != 0.0 {
            system.apply_impulse(k, &(normal * impulse_shift));
            if old.is_none() {
                system.rows[k].warm_start = normal * system.rows[k].balancing_impulse();
            }
        }
    }
}

/// Number of contacts ahead for which the data of their bodies are prefetched: these lie anywhere in memory.
const PREFETCH_CONTACTS: usize = 8;

/// Normal velocity, over that due to the impulse of the last step alone, up to which a contact rests: larger than the errors
/// of solutions, smaller than the rebound with a restitution of 0.06.
const RESTING: f64 = 0.05;

/// Input for the rows.
pub(super) struct AssemblyContext<'a> {
    pub scene: &'a Scene,
    pub state: &'a State,
    pub q_c: &'a ContactConfiguration,
    v_free: &'a [Vec3],
    w_free: &'a [Vec3],
    /// |v_free| beyond the common velocity, m/s, and |w_free|, rad/s.
    speeds: Vec<[f64; 2]>,
    /// Whether each body is a sphere; a packed array, as contacts read it in any order.
    pub(super) is_sphere: Vec<bool>,
    records: &'a [SolverBody],
    /// Whether velocities differ from those at the end of the last step.
    changed: bool,
    full: bool,
    width: SimdWidth,
}

impl AssemblyContext<'_> {
    /// Whether a contact can close within the step or is within the range of its law.
    pub(super) fn can_act(&self, contact: &Contact) -> bool {
        let range = || self.state.laws[contact.law as usize].interaction_range(self.effective_radius(contact));
        self.can_close_gap(contact) || contact.gap <= range()
    }

    /// Prefetches the data of a contact's antagonist that [`Self::contact_constraint`] reads; candidates are read in order.
    fn prefetch(&self, contact: Option<&Contact>) {
        let AssemblyContext { state, q_c, speeds, records, width, .. } = self;
        let Some(b) = contact.map(|contact| contact.antagonist as usize) else { return };
        [&q_c.x[b], &q_c.w[b], &state.v[b], &state.w[b]].into_iter().for_each(|x| width.prefetch(x));
        width.prefetch(&speeds[b]);
        width.prefetch(&records[b]);
    }

    /// Whether the two bodies may close the gap in the step: by their relative free velocities or, if they are near, by their
    /// speeds beyond the common velocity, as contacts may change the direction of these.
    #[inline]
    fn can_close_gap(&self, contact: &Contact) -> bool {
        if contact.gap <= 0.0 {
            return true;
        }
        if contact.gap > self.max_approach(contact) {
            return false;
        }
        let AssemblyContext { q_c, v_free, w_free, .. } = self;
        let sides = [contact.candidate, contact.antagonist].map(|i| &self.scene.bodies[i as usize]);
        let free = sides.into_iter().filter(|body| !body.driven).map(|body| body.radius);
        let is_near = contact.gap <= NEARBY_GAP * free.fold(f64::INFINITY, f64::min);
        let u = || relative_velocity(contact, &q_c.x, v_free, w_free);
        is_near || contact.gap <= q_c.longest_reach_time(self.scene) * -contact.normal.dot(&u())
    }

    /// Largest approach of the two bodies at the contact in the step, m, beyond the common motion, for any direction of
    /// travel.
    fn max_approach(&self, contact: &Contact) -> f64 {
        let AssemblyContext { q_c, speeds, .. } = self;
        let [a, b] = [contact.candidate, contact.antagonist].map(|i| speeds[i as usize]);
        let plate =
            if self.on_plate(contact) { (self.plate_velocity(contact) - q_c.mean_velocity).norm() } else { 0.0 };
        let reach = q_c.longest_reach_time(self.scene);
        let mut travel = reach * (a[0] + plate.max(b[0]));
        if self.full {
            let [at_a, at_b] = contact_arms(contact, &q_c.x);
            travel += reach * (a[1] * at_a.norm() + b[1] * at_b.norm());
        }
        travel
    }

    /// Velocity of a plate at the contact point, m/s.
    fn plate_velocity(&self, contact: &Contact) -> Vec3 {
        let b = contact.antagonist as usize;
        self.v_free[b] + self.w_free[b].cross(&contact_arms(contact, &self.q_c.x)[1])
    }

    /// Row of a contact, with its history of the last step and the bond of its bodies.
    fn contact_constraint(
        &self,
        contact: &Contact,
        previous: Option<&SolvedContact>,
        hold: BondState,
    ) -> ContactConstraint {
        let &AssemblyContext { scene, state, q_c, records, full, .. } = self;
        let h = q_c.h;
        let frame = contact.frame();
        let n = frame[0];
        let u_before = relative_velocity(contact, &q_c.x, &state.v, &q_c.w);
        let law = &state.laws[contact.law as usize];
        let radius = self.contact_radius(contact);
        let bodies = [contact.candidate, contact.antagonist];
        let [a, b] = bodies.map(|i| i as usize);
        let w_n = records[a].inverse_mass + records[b].inverse_mass;
        let reach = self.closing_time(contact);
        let course = self.gap_forecast(contact, law, reach, previous.map_or(0.0, |old| w_n * old.impulse.x));
        // The load of a new contact is unknown, and a rebounding contact does not stay.
        let carried = previous.is_some_and(|old| old.impulse != Vec3::zeros()) && course != GapForecast::Due;
        let stays = hold.bond.is_some() || hold.in_aggregate || carried;
        let as_one = hold.bond.is_some() && law.bonds_are_rigid();
        let turning = if stays { self.arm_turning_velocity(contact, as_one) } else { Vec3::zeros() };
        // Sliding along a curved surface is no approach, and bonded bodies that turn do not part.
        let curve = match hold {
            BondState { bond: Some(_), .. } if law.bonds_are_rigid() => -turning.dot(&n),
            BondState { in_aggregate: true, .. } => (contact.gap.max(0.0) / h - turning.dot(&n)).min(0.0),
            BondState { .. } => self.curvature_velocity(contact),
        };
        let u_n = n.dot(&u_before) + curve;
        let bonded = hold.bond.is_some();
        let slid_before = previous.is_some_and(|old| old.status == ContactStatus::Slide);
        let at = LawInput {
            gap: contact.gap,
            h,
            closing_time: reach,
            gap_forecast: course,
            u_n,
            radius,
            slid_before,
            bonded,
        };
        let shift = law.contact_shift(&at);
        let slides = |shift: &LawShift| {
            law.has_two_frictions() && !slid_before && self.is_sliding(contact, previous, &u_before, shift, w_n)
        };
        let shift = shift.map(|shift| {
            if slides(&shift) { law.contact_shift(&LawInput { slid_before: true, ..at }).unwrap() } else { shift }
        });
        let acts = shift.is_some();
        let shift = shift.unwrap_or_default();
        let shift = LawShift { normal: shift.normal - curve, ..shift };

        let on_plate = self.on_plate(contact);
        // The arms end in one point: it divides the distance in the ratio of the radii, and is the middle of the gap on flat
        // surfaces.
        let radii = [records[a].radius, records[b].radius];
        let beyond = match scene.find_part(contact.antagonist, contact.ranks.1).map(|part| &part.geometry) {
            Some(ContactorShape::Sphere { radius }) => *radius,
            _ if on_plate => radii[0],
            _ => radii[1],
        };
        let arm = if full { 1.0 } else { 1.0 + contact.gap / (radii[0] + beyond) };
        let plate = if on_plate { self.plate_velocity(contact) } else { Vec3::zeros() };
        let w_t = w_n
            + (arm * radii[0]).powi(2) * records[a].inverse_inertia
            + (arm * radii[1]).powi(2) * records[b].inverse_inertia;
        let u_tangent = u_before - n * n.dot(&u_before);
        ContactConstraint {
            bodies,
            normal: n,
            arm,
            shift: n * shift.normal + (turning - n * turning.dot(&n)) + u_tangent * shift.tangential - plate,
            w_n,
            w_t,
            friction: shift.friction,
            impulse_shift: shift.impulse,
            acts,
            can_close: shift.solved && (shift.impulse != 0.0 || self.can_close_gap(contact)),
            warm_start: previous.map_or(Vec3::zeros(), |old| warm_start(old, contact, &shift, h / state.h)),
            u_before: to_local(&frame, &u_before),
            bond: hold.bond.filter(|_| acts),
        }
    }

    /// Sets the velocities before the step, and the shift by restitution, at the points where friction acts.
    fn shift_friction(&self, full: &BlockData, contacts: &[Contact], rows: &mut [ContactConstraint]) {
        let of_row = |(k, row): (usize, &mut ContactConstraint)| {
            let (contact, lever) = (&contacts[k], full.friction_lever(k, &row.normal));
            let [a, b] = row.bodies.map(|body| self.q_c.w[body as usize]);
            let change = lever * row.normal.dot(&(a - b));
            let law = &self.state.laws[contact.law as usize];
            let reach = self.closing_time(contact);
            let at = LawInput {
                gap: contact.gap,
                h: self.q_c.h,
                closing_time: reach,
                gap_forecast: self.gap_forecast(contact, law, reach, 0.0),
                u_n: row.u_before.x,
                radius: self.contact_radius(contact),
                slid_before: false,
                bonded: row.bond.is_some(),
            };
            row.shift += change * law.contact_shift(&at).unwrap_or_default().tangential;
            row.u_before += to_local(&contact.frame(), &change);
        };
        let rows = rows.par_iter_mut().enumerate().with_min_len(256);
        rows.filter(|(k, _)| full.friction_offsets[*k] != Vec3::zeros()).for_each(of_row);
    }

    /// Time between the step's end velocities and the next contact configuration for the two bodies of a contact, s.
    fn closing_time(&self, contact: &Contact) -> f64 {
        if self.q_c.from_start.is_empty() {
            return self.q_c.h;
        }
        let [a, b] = [contact.candidate, contact.antagonist].map(|i| self.q_c.reach_time(self.scene, i as usize));
        a.max(b)
    }

    /// Whether a contact slides at the step's start that carried nothing in the last step, or whose bodies have other
    /// velocities than at its end: at `u` (world frame, m/s), faster than the error of unconverged sticking contacts.
    fn is_sliding(&self, contact: &Contact, old: Option<&SolvedContact>, u: &Vec3, shift: &LawShift, w_n: f64) -> bool {
        let carried = old.filter(|old| old.impulse != Vec3::zeros());
        if carried.is_some() && !self.changed {
            return false;
        }
        let AssemblyContext { scene, q_c, v_free, w_free, .. } = self;
        let n = contact.normal;
        let tangential = |u: Vec3| (u - n * n.dot(&u)).norm();
        // Change of normal velocity by the impulse: all of the closing velocity, and that due to its attraction.
        let free = relative_velocity(contact, &q_c.x, v_free, w_free).dot(&n) + shift.normal;
        let alone = (-free).max(0.0) + w_n * shift.impulse.abs();
        // Bodies in free fall together are loaded by other contacts, which balance the change of velocity by forces.
        let bodies = [contact.candidate, contact.antagonist].map(|i| i as usize);
        let gain = |i: usize| if scene.bodies[i].driven { 0.0 } else { (v_free[i] - self.state.v[i]).norm() };
        let loaded = bodies.map(gain).into_iter().fold(alone, f64::max);
        // Without forces, the error of an unconverged solution is at most a share of the speeds.
        let scale = if loaded > 0.0 { loaded } else { bodies.map(|i| self.speeds[i][0]).into_iter().sum() };
        let moves = |u: Vec3| tangential(u) > SLIDING_VELOCITY_FACTOR * scene.options.tol() * scale;
        let now = u - self.arm_turning_velocity(contact, false) * 0.5;
        let differs = |old: &SolvedContact| moves(u - to_world(&old.contact.frame(), &old.velocity));
        moves(now) && carried.is_none_or(differs)
    }

    /// Forecast of the gap of a contact whose law acts on touching contacts.
    ///
    /// `pushed`: change of its normal velocity by its own impulse in the last step, m/s.
    #[inline]
    fn gap_forecast(&self, contact: &Contact, law: &ContactLaw, reach: f64, pushed: f64) -> GapForecast {
        if !law.acts_on_touch() || contact.gap <= 0.0 {
            return GapForecast::Apart { depth: 0.0 };
        }
        let AssemblyContext { scene, state, q_c, v_free, w_free, is_sphere, .. } = self;
        let [a, b] = [contact.candidate, contact.antagonist].map(|i| i as usize);
        let u_n = contact.normal.dot(&relative_velocity(contact, &q_c.x, &state.v, &q_c.w)).abs();
        let pull = |i: usize| contact.normal.dot(&(v_free[i] - state.v[i])).abs();
        if u_n < RESTING * pushed || u_n.max(contact.gap / reach) < pull(a).max(pull(b)) {
            return GapForecast::Resting;
        }
        let u = relative_velocity(contact, &q_c.x, v_free, w_free);
        if contact.gap + reach * contact.normal.dot(&u) >= 0.0 {
            let depth = MAX_STEP_OVERLAP
                * scene.pair_size((contact.candidate, contact.ranks.0), (contact.antagonist, contact.ranks.1));
            return GapForecast::Apart { depth };
        }
        if is_sphere[a] && is_sphere[b] {
            // Smallest distance on the straight trajectory of the centres.
            let radii = scene.bodies[a].radius + scene.bodies[b].radius;
            let (from, along) = (contact.normal * (radii + contact.gap), v_free[a] - v_free[b]);
            let time = (-from.dot(&along) / along.norm_squared()).min(reach);
            if (from + along * time).norm() >= radii {
                return GapForecast::Passing;
            }
        }
        GapForecast::Due
    }

    /// Resistance to rolling and spinning at row `k`, if its law has one.
    fn rolling_constraint(
        &self,
        k: usize,
        contact: &Contact,
        previous: Option<&SolvedContact>,
    ) -> Option<RollingConstraint> {
        let RollingFriction { rolling, spinning } = self.state.laws[contact.law as usize].rolling_friction()?;
        let [a, b] = [contact.candidate, contact.antagonist].map(|i| i as usize);
        if self.scene.bodies[a].driven && self.scene.bodies[b].driven {
            return None; // both rotations are imposed
        }
        let scale = self.q_c.h / self.state.h;
        Some(RollingConstraint {
            row: k as u32,
            radius: self.effective_radius(contact),
            rolling,
            spinning,
            inverse_w: 1.0 / (self.records[a].inverse_inertia + self.records[b].inverse_inertia),
            shift: if self.on_plate(contact) { -self.w_free[b] } else { Vec3::zeros() },
            warm_start: previous.map_or(Vec3::zeros(), |old| to_world(&old.contact.frame(), &old.moment) * scale),
        })
    }

    /// Radius of the contact, m. A stress acts on the area shared by faces; spheres have their own radius, edges and vertices
    /// have 0.
    fn contact_radius(&self, contact: &Contact) -> f64 {
        if contact.area > 0.0 {
            (contact.area / std::f64::consts::PI).sqrt()
        } else if self.carries_stress(contact) {
            self.effective_radius(contact)
        } else {
            0.0
        }
    }

    /// Whether a cohesive stress of the law of a contact has an area to act on.
    #[inline]
    pub(super) fn carries_stress(&self, contact: &Contact) -> bool {
        let Contact { candidate, antagonist, ranks, .. } = *contact;
        contact.area > 0.0
            || !self.state.laws[contact.law as usize].has_stress()
            || [(candidate, ranks.0), (antagonist, ranks.1)].into_iter().any(|(body, rank)| self.is_round(body, rank))
    }

    /// Whether a contactor is a sphere.
    fn is_round(&self, body: u32, rank: u16) -> bool {
        let part = || self.scene.find_part(body, rank);
        self.is_sphere[body as usize]
            || part().is_some_and(|part| matches!(part.geometry, ContactorShape::Sphere { .. }))
    }

    /// Effective radius R of the two bodies, m, the scale of distances.
    pub(super) fn effective_radius(&self, contact: &Contact) -> f64 {
        let (a, b) = contact.ranks;
        self.scene.effective_radius((contact.candidate, a), (contact.antagonist, b))
    }

    /// Whether the antagonist is a plate whose motion is in the row's shift.
    fn on_plate(&self, contact: &Contact) -> bool {
        !self.full && !self.is_sphere[contact.antagonist as usize]
    }
}

/// Per-body part of [`BlockData`], if a scene needs it.
fn block_data(scene: &Scene, q_c: &ContactConfiguration) -> Option<BlockData> {
    let of = |(body, q): (&RigidBody, &Quat)| {
        if body.driven {
            return Matrix3::zeros();
        }
        if body.is_isotropic() {
            return Matrix3::from_diagonal_element(1.0 / body.inertia[0]);
        }
        let axes = q.to_rotation_matrix();
        axes * Matrix3::from_diagonal(&Vec3::from(body.inertia.map(|j| 1.0 / j))) * axes.transpose()
    };
    let held = || scene.bodies.iter().map(RigidBody::locked_axes).collect();
    let full = || BlockData {
        arms: Vec::new(),
        friction_offsets: Vec::new(),
        locked_axes: if scene.bodies.iter().any(RigidBody::is_driven_in_part) { held() } else { Vec::new() },
        inverse_inertia: scene.bodies.iter().zip(&q_c.q).map(of).collect(),
    };
    scene.needs_blocks().then(full)
}

impl ContactProblem {
    /// Whether one of the rows `active` has friction, or any row has moments.
    pub fn has_friction(&self, active: &[u32]) -> bool {
        !self.rolling_constraints.is_empty() || active.iter().any(|&k| self.rows[k as usize].friction > 0.0)
    }

    /// Vector from the centre of the candidate (side 0) or antagonist (1) of row `k` to the contact point, m; 0 for a plate
    /// whose motion is in the row's shift.
    #[inline(always)]
    pub fn contact_arm(&self, k: usize, side: usize) -> Vec3 {
        match &self.block_data {
            Some(full) => full.arms[k][side],
            None => {
                let row = &self.rows[k];
                row.normal * ([-row.arm, row.arm][side] * self.bodies[row.bodies[side] as usize].radius)
            }
        }
    }

    /// Change of the velocity of `body` by an impulse.
    pub fn velocity_change(&self, body: u32, impulse: &Vec3) -> Vec3 {
        let change = impulse * self.bodies[body as usize].inverse_mass;
        self.block_data.as_ref().map_or(change, |full| change.component_mul(&full.free_axes(body as usize)))
    }

    /// Change of the angular velocity of `body` by an angular impulse, world frame.
    pub fn angular_velocity_change(&self, body: u32, angular_impulse: &Vec3) -> Vec3 {
        match &self.block_data {
            Some(full) => full.inverse_inertia[body as usize] * angular_impulse,
            None => angular_impulse * self.bodies[body as usize].inverse_inertia,
        }
    }

    /// Whether the friction of some row does not act at its contact point.
    pub fn has_friction_offsets(&self) -> bool {
        self.block_data.as_ref().is_some_and(|full| !full.friction_offsets.is_empty())
    }

    /// n×d of row `k` with the friction offset d, m; 0 where friction acts at the contact point.
    #[inline]
    pub fn friction_lever(&self, k: usize) -> Vec3 {
        self.block_data.as_ref().map_or(Vec3::zeros(), |full| full.friction_lever(k, &self.rows[k].normal))
    }

    /// Velocity at row `k` of a body on `side` that turns with `w`, world frame, m/s: along n at the contact point, in the
    /// tangent plane at the point of friction.
    #[inline(always)]
    pub fn turning_velocity(&self, k: usize, side: usize, w: &Vec3) -> Vec3 {
        let turning = w.cross(&self.contact_arm(k, side));
        match &self.block_data {
            Some(full) if full.friction_offsets.get(k).is_some_and(|offset| *offset != Vec3::zeros()) => {
                let normal = &self.rows[k].normal;
                turning + full.friction_lever(k, normal) * normal.dot(w)
            }
            _ => turning,
        }
    }

    /// Angular impulse about the centre of the body on `side` by an impulse `r` on it at row `k`, N m s; the transpose of
    /// [`Self::turning_velocity`].
    pub fn angular_impulse(&self, k: usize, side: usize, r: &Vec3) -> Vec3 {
        self.contact_arm(k, side).cross(r) + self.friction_couple(k, r)
    }

    /// n (n×d)·r: angular impulse about n by which the friction of an impulse `r` at row `k` is smaller than at the contact
    /// point, N m s.
    pub fn friction_couple(&self, k: usize, r: &Vec3) -> Vec3 {
        self.rows[k].normal * self.friction_lever(k).dot(r)
    }

    /// û of row `k` at the records' velocities, world frame, m/s.
    pub fn shifted_velocity(&self, k: usize, records: &[SolverBody]) -> Vec3 {
        let row = &self.rows[k];
        if self.block_data.is_none() {
            return row.shifted_velocity(records);
        }
        let at = |side: usize| {
            let record = &records[row.bodies[side] as usize];
            record.v + self.turning_velocity(k, side, &record.w)
        };
        at(0) - at(1) + row.shift
    }

    /// Gives the two bodies of row `k` the impulse `r` on the candidate and -r on the antagonist, N s.
    pub fn apply_impulse(&mut self, k: usize, r: &Vec3) {
        if self.block_data.is_none() {
            return self.rows[k].apply_impulse(&mut self.bodies, r);
        }
        for (side, r) in [(0, *r), (1, -r)] {
            let body = self.rows[k].bodies[side];
            let (push, turn) = (
                self.velocity_change(body, &r),
                self.angular_velocity_change(body, &self.angular_impulse(k, side, &r)),
            );
            let record = &mut self.bodies[body as usize];
            record.v += push;
            record.w += turn;
        }
    }
}

impl ContactConstraint {
    /// r̂_n that keeps the row's own attraction from moving the bodies, as far as its shift leaves the contact closed, N s; 0
    /// without an attraction. It is the solution of a contact without other loads.
    pub fn balancing_impulse(&self) -> f64 {
        let attraction = -self.impulse_shift;
        (attraction - self.shift.dot(&self.normal) / self.w_n).clamp(0.0, attraction)
    }

    /// û at the records' velocities, world frame, m/s.
    pub fn shifted_velocity(&self, records: &[SolverBody]) -> Vec3 {
        let [a, b] = self.bodies.map(|i| &records[i as usize]);
        a.v - b.v + self.normal.cross(&(a.w * a.radius + b.w * b.radius)) * self.arm + self.shift
    }

    /// Gives the two bodies the impulse `r` on the candidate and -r on the antagonist, N s.
    pub fn apply_impulse(&self, records: &mut [SolverBody], r: &Vec3) {
        let turn = r.cross(&self.normal) * self.arm; // moment over the radius, the same for both sides
        let a = &mut records[self.bodies[0] as usize];
        a.v += r * a.inverse_mass;
        a.w += turn * (a.radius * a.inverse_inertia);
        let b = &mut records[self.bodies[1] as usize];
        b.v -= r * b.inverse_mass;
        b.w += turn * (b.radius * b.inverse_inertia);
    }
}
