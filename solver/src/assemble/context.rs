//! Input of the assembly of rows, and queries of single contacts.

use super::kinematics::{contact_arms, velocity_at_arms};
use super::problem::SolverBody;
use crate::integrate::ContactConfiguration;
use crate::math::Vec3;
use crate::math::simd::SimdWidth;
use crate::scene::{BodyId, ContactSides, ContactorShape, Scene};
use crate::state::{Contact, State, Velocities};

/// Bounds on the motion of a body in the step.
pub(super) struct MotionBounds {
    /// |v_free| beyond the common velocity, in a deforming cell about the affine field, m/s.
    pub speed: f64,
    /// |w_free|, rad/s.
    pub angular_speed: f64,
    /// Gap up to which its contacts are solved in any direction of motion, m; infinite for a driven body.
    pub nearby: f64,
}

/// Input for the rows.
pub(super) struct AssemblyContext<'a> {
    pub scene: &'a Scene,
    pub state: &'a State,
    pub q_c: &'a ContactConfiguration,
    /// Velocities at the step's start, angular ones predicted by free rotation; without the rotation of bodies that
    /// contacts push at their centres.
    pub start: Velocities<'a>,
    /// Velocities after the step if nothing touched; without the rotation of these bodies.
    pub free: Velocities<'a>,
    pub bounds: &'a [MotionBounds],
    pub solver_bodies: &'a [SolverBody],
    /// Whether velocities differ from those at the end of the last step.
    pub changed: bool,
    /// Whether the rows have [`super::BlockData`].
    pub has_blocks: bool,
    pub width: SimdWidth,
}

impl AssemblyContext<'_> {
    /// Whether a contact can close within the step or is within the range of its law.
    pub(super) fn can_act(&self, contact: &Contact) -> bool {
        let law = &self.state.laws[contact.law];
        if law.acts_apart() {
            return true; // the gap that counts is not known yet
        }
        let is_in_range = || contact.gap <= law.interaction_range(self.effective_radius(contact));
        self.can_close_gap(contact, contact.gap, &contact_arms(contact, &self.q_c.x))
            || (law.cohesion().is_some() && is_in_range())
    }

    /// Whether the two bodies may close `gap` (m) in the step: by their relative free velocities or, if they are near, by their
    /// speeds beyond the common velocity, as contacts may change the direction of these.
    #[inline]
    pub(super) fn can_close_gap(&self, contact: &Contact, gap: f64, arms: &[Vec3; 2]) -> bool {
        if gap <= 0.0 {
            return true;
        }
        if gap > self.max_approach(contact, arms) {
            return false;
        }
        let AssemblyContext { q_c, free, bounds, .. } = self;
        let [nearby_a, nearby_b] = [contact.candidate, contact.antagonist].map(|i| bounds[i.index()].nearby);
        let u = || velocity_at_arms(contact, arms, *free);
        gap <= nearby_a.min(nearby_b) || gap <= q_c.reach_time(self.scene) * -contact.normal.dot(&u())
    }

    /// Largest approach of the two bodies at the contact in the step, m, beyond the common motion, for any direction of
    /// travel.
    fn max_approach(&self, contact: &Contact, [at_a, at_b]: &[Vec3; 2]) -> f64 {
        let AssemblyContext { q_c, bounds, .. } = self;
        let [a, b] = [contact.candidate, contact.antagonist].map(|i| &bounds[i.index()]);
        let plate_speed =
            if self.on_plate(contact) { (self.plate_velocity(contact) - q_c.mean_velocity).norm() } else { 0.0 };
        let time = q_c.reach_time(self.scene);
        let mut travel = time * (a.speed + plate_speed.max(b.speed));
        if let Some(gradient) = self.free.gradient {
            travel += time * (gradient * (at_a - at_b)).norm();
        }
        if self.has_blocks {
            travel += time * (a.angular_speed * at_a.norm() + b.angular_speed * at_b.norm());
        }
        travel
    }

    /// Velocity of a plate at the contact point, m/s.
    pub(super) fn plate_velocity(&self, contact: &Contact) -> Vec3 {
        let b = contact.antagonist.index();
        self.free.v[b] + self.free.w[b].cross(&contact_arms(contact, &self.q_c.x)[1])
    }

    /// Time in which the step's end velocities act, up to the next contact configuration, s.
    pub(super) fn closing_time(&self) -> f64 {
        self.q_c.reach_time(self.scene)
    }

    /// Radius of the contact, m. A stress acts on the area shared by faces; spheres have their own radius, or that of their
    /// bond if it carries moments, edges and vertices have 0.
    pub(super) fn contact_radius(&self, contact: &Contact) -> f64 {
        if contact.area > 0.0 {
            (contact.area / std::f64::consts::PI).sqrt()
        } else if self.carries_stress(contact) {
            match self.state.laws[contact.law].bond_radius() {
                Some(share) => share * self.smaller_radius(contact),
                None => self.effective_radius(contact),
            }
        } else {
            0.0
        }
    }

    /// Whether a cohesive stress of the law of a contact has an area to act on.
    #[inline]
    pub(super) fn carries_stress(&self, contact: &Contact) -> bool {
        let Contact { candidate, antagonist, part_numbers, .. } = *contact;
        contact.area > 0.0
            || !self.state.laws[contact.law].has_stress()
            || [(candidate, part_numbers.candidate), (antagonist, part_numbers.antagonist)]
                .into_iter()
                .any(|(body, part_number)| self.is_round(body, part_number))
    }

    /// Whether a contactor is a sphere.
    fn is_round(&self, body: BodyId, part_number: u16) -> bool {
        self.sphere_radius(body, part_number).is_some()
    }

    /// Radius of a contactor that is a sphere, m.
    #[inline]
    pub(super) fn sphere_radius(&self, body: BodyId, part_number: u16) -> Option<f64> {
        if self.scene.sphere_flags[body.index()] {
            return Some(self.solver_bodies[body.index()].radius);
        }
        if !self.scene.has_round_parts {
            return None;
        }
        match self.scene.find_part(body, part_number)?.geometry {
            ContactorShape::Sphere { radius } => Some(radius),
            _ => None,
        }
    }

    /// Effective radius R of the two bodies, m, the scale of distances.
    pub(super) fn effective_radius(&self, contact: &Contact) -> f64 {
        let ContactSides { candidate: a, antagonist: b } = contact.part_numbers;
        self.scene.effective_radius((contact.candidate, a), (contact.antagonist, b))
    }

    /// Smaller radius of the two bodies, m.
    fn smaller_radius(&self, contact: &Contact) -> f64 {
        let ContactSides { candidate: a, antagonist: b } = contact.part_numbers;
        self.scene.smaller_radius((contact.candidate, a), (contact.antagonist, b))
    }

    /// Whether the antagonist is a plate whose motion is in the row's shift.
    pub(super) fn on_plate(&self, contact: &Contact) -> bool {
        !self.has_blocks && !self.scene.sphere_flags[contact.antagonist.index()]
    }
}
