//! Contact problem of one step: one row a contact, one [`SolverBody`] a body.
//!
//! No Delassus matrix is stored: the sweeps keep the velocities V = V_free + M⁻¹ H r of the bodies,
//! and a row reads and changes those of its two. A law's shift c is put into the velocities of the bodies once, so
//! that the solver works on r̂ = r - c n alone (see [`crate::laws`]).

use nalgebra::Matrix3;

use super::interface_row::InterfaceRow;
use super::kinematics::contact_arms;
use crate::math::Vec3;
use crate::scene::{BodyId, RigidBody};
use crate::state::{Contact, ContactId, LawMemory};

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
    /// Candidate and antagonist.
    pub bodies: [BodyId; 2],
    pub normal: Vec3,
    /// Distance from each centre to the contact point, divided by the radius of its sphere.
    pub arm: f64,
    /// û = u + shift, world frame, m/s: the law's shifts and the motion of a plate.
    pub shift: Vec3,
    /// W_nn, 1/kg. With [`BlockData`], w_n and w_t are set only for rows that can close: see
    /// [`ContactProblem::delassus_diagonal`].
    pub w_n: f64,
    /// W_tt = W_ss, 1/kg.
    pub w_t: f64,
    /// Coulomb's coefficient μ.
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

/// Moments of a row's contact, by rolling and spinning friction or by a bond, see [`crate::laws::MomentLimits`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RollingConstraint {
    /// Row of the contact.
    pub row: ContactId,
    /// R of the limits, m.
    pub radius: f64,
    /// Largest moment across the normal over R r̂_n: the coefficient of rolling friction.
    pub rolling: f64,
    /// Largest moment about the normal over R r̂_n, without shear: the coefficient of spinning friction.
    pub spinning: f64,
    /// Share of R |r_T| by which the largest moment about the normal is smaller; 0 for friction.
    pub shear: f64,
    /// 1/(1/I_a + 1/I_b) of spheres, else the inverse of the largest eigenvalue of the sum of the inverse inertias, kg
    /// m^2.
    pub inverse_w: f64,
    /// Relative angular velocity due to a plate, and that of an elastic bond due to its moment of the last step, rad/s.
    pub shift: Vec3,
    /// Compliances of an elastic bond across and about the normal, 1/(kg m²): ŵ = w + shift + compliance m. 0 of others.
    pub compliance: [f64; 2],
    /// Initial moment, world frame, N m s.
    pub warm_start: Vec3,
}

/// Regularisation of a row; only some laws have one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RegularisedRow {
    /// û_n has the additional term `compliance` r̂_n, 1/kg.
    Spring { row: ContactId, compliance: f64 },
    /// u = 0 for any impulse.
    Coupled { row: ContactId },
    /// û_n + `compliance` r̂_n = 0 (1/kg), of a wire only while it pulls, and no other impulse.
    Link { row: ContactId, compliance: f64, is_wire: bool },
    /// Elastic bond: û has the additional terms `opening` r̂_n along the normal and `sliding` r̂_T across, 1/kg.
    Bond { row: ContactId, opening: f64, sliding: f64 },
    /// An elastic interface next to the contact.
    Interface { row: ContactId, interface: InterfaceRow },
}

impl RegularisedRow {
    /// Row that is regularised.
    pub fn row(&self) -> ContactId {
        match *self {
            RegularisedRow::Spring { row, .. }
            | RegularisedRow::Coupled { row }
            | RegularisedRow::Link { row, .. }
            | RegularisedRow::Bond { row, .. }
            | RegularisedRow::Interface { row, .. } => row,
        }
    }
}

/// Contact problem of a step: its rows, and the bodies that they move.
#[derive(Debug, Clone)]
pub struct ContactProblem {
    pub rows: Vec<ContactConstraint>,
    /// Additional data of the rows and solver bodies where not all bodies are spheres and plates.
    pub block_data: Option<BlockData>,
    /// Rolling constraints in the order of the rows; empty in most scenes.
    pub rolling_constraints: Vec<RollingConstraint>,
    /// Regularisations in the order of the rows; empty in most scenes.
    pub regularised: Vec<RegularisedRow>,
    /// Memory of the law of each row at the start of the step; empty if no law has one.
    pub memories: Vec<LawMemory>,
    /// Attraction at each row by a law with cohesion per pair, N; empty if no law has it.
    pub pair_attractions: Vec<f64>,
    /// All bodies in spatial order, neighbours near each other.
    pub order: Vec<u32>,
    /// Velocities if every r̂ were 0.
    pub bodies: Vec<SolverBody>,
}

/// Data of rows whose W is a full block: lever arms of any direction, anisotropic inertia. `arm` of the rows and
/// `inverse_inertia` and `radius` of the solver bodies are then not used; `w_n` is W_nn and `w_t` the mean of W_tt and W_ss.
#[derive(Debug, Clone)]
pub struct BlockData {
    /// Vectors from the centres of candidate and antagonist to the contact point, by row, m.
    pub arms: Vec<[Vec3; 2]>,
    /// Vector from the contact point to the point at which friction acts about the normal, by row, m, in the tangent plane;
    /// see `assemble/faces.rs`. Empty if friction acts at every contact point.
    pub friction_offsets: Vec<Vec3>,
    /// 1 for each fixed axis along which the velocity of a body driven in part is imposed, else 0; by body. Empty if there is
    /// no such body.
    pub locked_axes: Vec<Vec3>,
    /// Inverse inertia about the centre of mass in the contact configuration, by body, world frame, 1/(kg m²); 0 about axes
    /// of imposed rotation.
    pub inverse_inertia: Vec<Matrix3<f64>>,
}

impl RollingConstraint {
    /// Whether a bond carries the moments.
    pub fn is_bond(&self) -> bool {
        self.shear > 0.0
    }

    /// Largest moments across and about the normal over R, N s, of a row with the impulse `r` and the normal `n`.
    pub fn moment_bounds(&self, r: &Vec3, n: &Vec3) -> (f64, f64) {
        let normal_impulse = n.x * r.x + n.y * r.y + n.z * r.z;
        let (across, about) = (self.rolling * normal_impulse, self.spinning * normal_impulse);
        if self.is_bond() {
            (across, (about - self.shear * (r - n * normal_impulse).norm()).max(0.0))
        } else {
            (across, about)
        }
    }

    /// Whether the moment `m` (N m s) is within the limits of the law by more than rounding, of a row with the impulse `r` and the
    /// normal `n`.
    pub fn holds_moment(&self, r: &Vec3, n: &Vec3, m: &Vec3) -> bool {
        let (across_bound, along_bound) = self.moment_bounds(r, n);
        let m = m / self.radius;
        let along = n.dot(&m);
        (m - n * along).norm() < MAX_SHARE_OF_LIMIT * across_bound && along.abs() < MAX_SHARE_OF_LIMIT * along_bound
    }

    /// Moment `m` (N m s) reduced to the limits of the law, of a row with the impulse `r` and the normal `n`.
    pub fn limited_moment(&self, r: &Vec3, n: &Vec3, m: &Vec3) -> Vec3 {
        let (across_bound, along_bound) = self.moment_bounds(r, n);
        let [across_bound, along_bound] = [across_bound, along_bound].map(|bound| bound.max(0.0) * self.radius);
        let along = n.dot(m);
        let across = m - n * along;
        let size = across.norm();
        let limited = if size > across_bound { across * (across_bound / size) } else { across };
        limited + n * along.clamp(-along_bound, along_bound)
    }
}

/// Share of a limit up to which an impulse or moment is within it: those at the limit are on its side to rounding.
const MAX_SHARE_OF_LIMIT: f64 = 1.0 - 1e-9;

impl ContactConstraint {
    /// Load of an elastic bond by its strain, without its limits: -C⁻¹ `motion`, with the compliances C along the normal and
    /// across. Of the velocity û without compliances (m/s; 1/kg) it is the impulse, N s; of the angular velocity ŵ (rad/s;
    /// 1/(kg m²)) the moment, N m s.
    pub fn strain_load(&self, [along, across]: [f64; 2], motion: &Vec3) -> Vec3 {
        let normal = self.normal * self.normal.dot(motion);
        (normal - motion) / across - normal / along
    }

    /// Whether the impulse `r` (N s) is within the cone of friction by more than rounding.
    pub fn holds_impulse(&self, r: &Vec3) -> bool {
        let normal = self.normal.dot(r);
        normal > 0.0 && (r - self.normal * normal).norm() < MAX_SHARE_OF_LIMIT * self.friction * normal
    }

    /// r̂_n that keeps the row's own attraction from moving the bodies, as far as its shift leaves the contact closed, N s; 0
    /// without an attraction. It is the solution of a contact without other loads.
    pub fn balancing_impulse(&self) -> f64 {
        let attraction = (-self.impulse_shift).max(0.0);
        (attraction - self.shift.dot(&self.normal) / self.w_n).clamp(0.0, attraction)
    }

    /// û at the velocities of `solver_bodies`, world frame, m/s.
    pub fn shifted_velocity(&self, solver_bodies: &[SolverBody]) -> Vec3 {
        let [a, b] = self.bodies.map(|i| &solver_bodies[i.index()]);
        a.v - b.v + self.normal.cross(&(a.w * a.radius + b.w * b.radius)) * self.arm + self.shift
    }

    /// Gives the two bodies the impulse `r` on the candidate and -r on the antagonist, N s.
    pub fn apply_impulse(&self, solver_bodies: &mut [SolverBody], r: &Vec3) {
        let turn = r.cross(&self.normal) * self.arm; // moment divided by the radius, the same for both sides
        let a = &mut solver_bodies[self.bodies[0].index()];
        a.v += r * a.inverse_mass;
        a.w += turn * (a.radius * a.inverse_inertia);
        let b = &mut solver_bodies[self.bodies[1].index()];
        b.v -= r * b.inverse_mass;
        b.w += turn * (b.radius * b.inverse_inertia);
    }
}

impl ContactProblem {
    /// Problem of these rows, without further data; `order` is empty.
    pub fn of_rows(rows: Vec<ContactConstraint>, bodies: Vec<SolverBody>) -> Self {
        ContactProblem {
            rows,
            block_data: None,
            rolling_constraints: Vec::new(),
            regularised: Vec::new(),
            memories: Vec::new(),
            pair_attractions: Vec::new(),
            order: Vec::new(),
            bodies,
        }
    }

    /// Whether one of the rows `active` has friction, or any row has moments.
    pub fn has_friction(&self, active: &[ContactId]) -> bool {
        !self.rolling_constraints.is_empty() || active.iter().any(|&k| self.rows[k.index()].friction > 0.0)
    }

    /// Whether bonds carry moments.
    pub fn has_bond_moments(&self) -> bool {
        self.rolling_constraints.iter().any(RollingConstraint::is_bond)
    }

    /// Angular velocity of the candidate relative to the antagonist of a rolling constraint, with its shift, at the motions of
    /// `solver_bodies`, rad/s.
    pub fn shifted_spin(&self, roll: &RollingConstraint, solver_bodies: &[SolverBody]) -> Vec3 {
        let [a, b] = self.rows[roll.row.index()].bodies.map(|body| solver_bodies[body.index()].w);
        a - b + roll.shift
    }

    /// Regularisation of row `k`, if it has one.
    pub fn regularised_row(&self, k: usize) -> Option<&RegularisedRow> {
        let position = self.regularised.binary_search_by_key(&ContactId::new(k), RegularisedRow::row).ok()?;
        self.regularised.get(position)
    }

    /// Gap from which the law of row `k` counts, m.
    #[inline]
    pub fn reference_gap(&self, k: usize) -> f64 {
        self.memories.get(k).map_or(0.0, |memory| memory.reference_gap)
    }

    /// Vector from the centre of the candidate (side 0) or antagonist (1) of row `k` to the contact point, m; 0 for a plate
    /// whose motion is in the row's shift.
    #[inline(always)]
    pub fn contact_arm(&self, k: usize, side: usize) -> Vec3 {
        match &self.block_data {
            Some(block_data) => block_data.arms[k][side],
            None => {
                let row = &self.rows[k];
                row.normal * ([-row.arm, row.arm][side] * self.bodies[row.bodies[side].index()].radius)
            }
        }
    }

    /// Change of the velocity of `body` by an impulse.
    pub fn velocity_change(&self, body: BodyId, impulse: &Vec3) -> Vec3 {
        let change = impulse * self.bodies[body.index()].inverse_mass;
        self.block_data.as_ref().map_or(change, |block_data| change.component_mul(&block_data.free_axes(body.index())))
    }

    /// Change of the angular velocity of `body` by an angular impulse, world frame.
    pub fn angular_velocity_change(&self, body: BodyId, angular_impulse: &Vec3) -> Vec3 {
        match &self.block_data {
            Some(block_data) => block_data.inverse_inertia[body.index()] * angular_impulse,
            None => angular_impulse * self.bodies[body.index()].inverse_inertia,
        }
    }

    /// W_nn and the mean of W_tt and W_ss of row `k`, 1/kg.
    #[inline]
    pub fn delassus_diagonal(&self, k: usize) -> (f64, f64) {
        let row = &self.rows[k];
        match &self.block_data {
            Some(block_data) if row.w_n == 0.0 => block_data.delassus_diagonal(k, row, &self.bodies),
            _ => (row.w_n, row.w_t),
        }
    }

    /// Whether an impulse along the normal of row `k` can move one of its bodies at the contact point.
    pub fn can_move_a_body(&self, k: usize, bodies: &[RigidBody]) -> bool {
        self.block_data.as_ref().is_none_or(|block_data| block_data.can_move_a_body(k, &self.rows[k], bodies))
    }

    /// Whether the friction of some row does not act at its contact point.
    pub fn has_friction_offsets(&self) -> bool {
        self.block_data.as_ref().is_some_and(|block_data| !block_data.friction_offsets.is_empty())
    }

    /// n×d of row `k` with the friction offset d, m; 0 where friction acts at the contact point.
    #[inline]
    pub fn friction_lever(&self, k: usize) -> Vec3 {
        self.block_data.as_ref().map_or(Vec3::zeros(), |block_data| block_data.friction_lever(k, &self.rows[k].normal))
    }

    /// [`Self::friction_lever`] of a row whose friction does not act at its contact point, else `None`.
    #[inline]
    pub fn nonzero_lever(&self, k: usize) -> Option<Vec3> {
        self.block_data.as_ref().and_then(|block_data| block_data.nonzero_lever(k, &self.rows[k].normal))
    }

    /// Velocity at row `k` of a body on `side` that turns with `w`, world frame, m/s: along n at the contact point, in the
    /// tangent plane at the point of friction.
    #[inline(always)]
    pub fn turning_velocity(&self, k: usize, side: usize, w: &Vec3) -> Vec3 {
        let turning = w.cross(&self.contact_arm(k, side));
        self.nonzero_lever(k).map_or(turning, |lever| turning + lever * self.rows[k].normal.dot(w))
    }

    /// Vectors from the two centres to the contact point of row `k`, whose contact is `contact`, with the positions `x` of
    /// the bodies, m.
    #[inline]
    pub fn arms_of(&self, k: usize, contact: &Contact, x: &[Vec3]) -> [Vec3; 2] {
        self.block_data.as_ref().map_or_else(|| contact_arms(contact, x), |block_data| block_data.arms[k])
    }

    /// Angular impulse about the centre of the body on `side` by an impulse `r` on it at row `k`, N m s; the transpose of
    /// [`Self::turning_velocity`].
    pub fn angular_impulse(&self, k: usize, side: usize, r: &Vec3) -> Vec3 {
        self.contact_arm(k, side).cross(r) + self.friction_couple(k, r)
    }

    /// n (n×d)·r: change of the angular impulse about n, N m s, because the friction of an impulse `r` at row `k` acts at the
    /// offset d from the contact point.
    pub fn friction_couple(&self, k: usize, r: &Vec3) -> Vec3 {
        self.rows[k].normal * self.friction_lever(k).dot(r)
    }

    /// û of row `k` at the velocities of `solver_bodies`, world frame, m/s.
    pub fn shifted_velocity(&self, k: usize, solver_bodies: &[SolverBody]) -> Vec3 {
        let row = &self.rows[k];
        let Some(block_data) = &self.block_data else { return row.shifted_velocity(solver_bodies) };
        let [a, b] = row.bodies.map(|body| &solver_bodies[body.index()]);
        let [at_a, at_b] = &block_data.arms[k];
        let [mut turning_a, mut turning_b] = [a.w.cross(at_a), b.w.cross(at_b)];
        if let Some(lever) = block_data.nonzero_lever(k, &row.normal) {
            turning_a += lever * row.normal.dot(&a.w);
            turning_b += lever * row.normal.dot(&b.w);
        }
        (a.v + turning_a) - (b.v + turning_b) + row.shift
    }

    /// Normal component of [`Self::shifted_velocity`] up to rounding, m/s: friction offsets do not change it.
    #[inline]
    pub fn shifted_normal_velocity(&self, k: usize, solver_bodies: &[SolverBody]) -> f64 {
        let row = &self.rows[k];
        let Some(block_data) = &self.block_data else { return row.normal.dot(&row.shifted_velocity(solver_bodies)) };
        let [a, b] = row.bodies.map(|body| &solver_bodies[body.index()]);
        let [at_a, at_b] = &block_data.arms[k];
        let u = a.v + a.w.cross(at_a) - (b.v + b.w.cross(at_b)) + row.shift;
        row.normal.dot(&u)
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
            let solver_body = &mut self.bodies[body.index()];
            solver_body.v += push;
            solver_body.w += turn;
        }
    }
}

impl BlockData {
    /// n×d of row `k` with the friction offset d, m: tangential velocity at the point of friction minus that at the contact
    /// point, per unit of relative angular velocity about n.
    #[inline]
    pub fn friction_lever(&self, k: usize, normal: &Vec3) -> Vec3 {
        self.friction_offsets.get(k).map_or(Vec3::zeros(), |offset| normal.cross(offset))
    }

    /// [`Self::friction_lever`] of a row whose friction does not act at its contact point, else `None`.
    #[inline]
    fn nonzero_lever(&self, k: usize, normal: &Vec3) -> Option<Vec3> {
        self.friction_offsets.get(k).filter(|offset| **offset != Vec3::zeros()).map(|offset| normal.cross(offset))
    }

    /// Whether a moving body has an imposed velocity along some fixed axis.
    pub fn has_locked_axes(&self, body: usize) -> bool {
        self.locked_axes.get(body).is_some_and(|locked| *locked != Vec3::zeros())
    }

    /// 1 for each fixed axis along which impulses move a body, else 0.
    pub fn free_axes(&self, body: usize) -> Vec3 {
        self.locked_axes.get(body).map_or(Vec3::repeat(1.0), |locked| Vec3::repeat(1.0) - locked)
    }

    /// W_nn and the mean of W_tt and W_ss of row `k`, 1/kg.
    pub(crate) fn delassus_diagonal(
        &self,
        k: usize,
        row: &ContactConstraint,
        solver_bodies: &[SolverBody],
    ) -> (f64, f64) {
        let (mut w_n, mut trace) = (0.0, 0.0);
        let lever = self.friction_lever(k, &row.normal);
        for (body, arm) in row.bodies.into_iter().zip(&self.arms[k]) {
            let (inverse_mass, j) = (solver_bodies[body.index()].inverse_mass, &self.inverse_inertia[body.index()]);
            let arm_cross_normal = arm.cross(&row.normal);
            let locked_axes = self.locked_axes.get(body.index());
            let free_share =
                locked_axes.map_or(1.0, |locked_axes| 1.0 - locked_axes.dot(&row.normal.component_mul(&row.normal)));
            w_n += inverse_mass * free_share + arm_cross_normal.dot(&(j * arm_cross_normal));
            let free_axes = locked_axes.map_or(3.0, |locked_axes| 3.0 - locked_axes.sum());
            trace += free_axes * inverse_mass + j.trace() * arm.norm_squared() - arm.dot(&(j * arm));
            if lever != Vec3::zeros() {
                let normal_response = j * row.normal;
                trace += 2.0 * lever.dot(&normal_response.cross(arm))
                    + lever.norm_squared() * row.normal.dot(&normal_response);
            }
        }
        (w_n, 0.5 * (trace - w_n))
    }

    /// Whether an impulse along the normal of row `k` can move one of its bodies at the contact point. It moves all bodies
    /// that are not driven.
    pub(super) fn can_move_a_body(&self, k: usize, row: &ContactConstraint, bodies: &[RigidBody]) -> bool {
        self.locked_axes.is_empty()
            || row.bodies.iter().zip(&self.arms[k]).any(|(&i, arm)| {
                let body = &bodies[i.index()];
                let free_share = self.free_axes(i.index()).dot(&row.normal.component_mul(&row.normal));
                let arm_cross_normal = arm.cross(&row.normal);
                let rotational_share =
                    body.mass * arm_cross_normal.dot(&(self.inverse_inertia[i.index()] * arm_cross_normal));
                !body.driven || (!body.is_imposed() && free_share.max(rotational_share) > MIN_FREE_MOBILITY)
            })
    }
}

/// Smallest velocity along the normal that an impulse along it gives to one of two bodies driven in part at their
/// contact point, divided by that of the free mass, at which the contact acts: the square of the cosine between the
/// normal and a free direction. Within 1e-3 rad of the plane of the imposed components the normal differs from this
/// plane only by rounding, and an impulse along it would accelerate the body along the free axis.
const MIN_FREE_MOBILITY: f64 = 1e-6;
