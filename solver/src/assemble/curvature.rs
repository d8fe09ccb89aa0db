//! Turning and curvature of contacts within a step.

use super::context::AssemblyContext;
use super::kinematics::contact_arms;
use crate::geometry::FAR_WALL;
use crate::math::Vec3;
use crate::scene::{BodyId, ContactorShape};
use crate::state::Contact;

impl AssemblyContext<'_> {
    /// Velocity at which sticking surfaces, at rest on each other in the contact configuration, part at the step's end, m/s,
    /// world frame. Arms turn with the bodies, angular velocities change in free rotation by α, and the contact point of a
    /// rolling body moves: τ(ω_a, l_a) + ½ h α_a×l_a - τ(ω_b, l_b) - ½ h α_b×l_b + τ_R, 1/R the sum of the curvatures; see
    /// [`lever_velocity_change`] and [`rolling_velocity_change`]. With it, bodies that turn as one continue to do so.
    /// `moves_as_one`: whether a bond joins the two bodies. They then have one ω, even if an event has changed that of
    /// one of them: arms that turn apart would strain the bond. A sphere whose bond carries no moments keeps its own, since a
    /// bond at one point lets it roll.
    pub(super) fn arm_turning_velocity(&self, contact: &Contact, [at_a, at_b]: &[Vec3; 2], moves_as_one: bool) -> Vec3 {
        let bodies = [contact.candidate, contact.antagonist].map(|body| body.index());
        // Angular velocities at the step's start: bodies that turn as one have the same one then, while free rotation differs
        // from body to body.
        let is_pushed_at_centre = |i: usize| self.q_c.is_pushed_at_centre(BodyId::new(i));
        let [mut a, mut b] = bodies.map(|i| if is_pushed_at_centre(i) { Vec3::zeros() } else { self.state.w[i] });
        let own_w = [a, b];
        let radius = self.rolling_radius(contact);
        let is_clamped = || self.state.laws[contact.law].bond_radius().is_some();
        if moves_as_one && (radius == 0.0 || is_clamped()) {
            let shared = match bodies.map(|i| self.scene.bodies[i].driven) {
                [_, true] => b,
                [true, _] => a,
                _ => (a + b) * 0.5,
            };
            (a, b) = (shared, shared);
        }
        if a == Vec3::zeros() && b == Vec3::zeros() {
            return Vec3::zeros();
        }
        let (half_step, time_before) = (0.5 * self.q_c.h, (1.0 - self.scene.options.theta) * self.q_c.h);
        let end_velocity_change = |side: usize, w: &Vec3, arm: &Vec3| {
            let change = self.start.w[bodies[side]] - own_w[side];
            let free_part =
                if time_before > 0.0 { change.cross(arm) * (half_step / time_before) } else { Vec3::zeros() };
            lever_velocity_change(w, arm, half_step) + free_part
        };
        let ([roll_a, roll_b], radius) = match self.rolling_cylinder(contact) {
            // Only the rotation about its axis moves the line of contact over its surface.
            Some((axis, radius)) => ([a, b].map(|w| axis * axis.dot(&w)), radius),
            None => ([a, b], radius),
        };
        let rolling = rolling_velocity_change(&roll_a, &roll_b, &(contact.normal * radius), half_step);
        end_velocity_change(0, &a, at_a) - end_velocity_change(1, &b, at_b) + rolling
    }

    /// Change of the relative angular velocity of two bodies by free rotation from the contact configuration to the step's end,
    /// rad/s: bodies that a bond turns as one have the same one at the end. 0 for spheres.
    pub(super) fn relative_spin_change(&self, contact: &Contact) -> Vec3 {
        let time_before = (1.0 - self.scene.options.theta) * self.q_c.h;
        if time_before == 0.0 {
            return Vec3::zeros();
        }
        let change = |body: BodyId| match self.q_c.is_pushed_at_centre(body) {
            true => Vec3::zeros(),
            false => self.start.w[body.index()] - self.state.w[body.index()],
        };
        (change(contact.candidate) - change(contact.antagonist)) * (0.5 * self.q_c.h / time_before)
    }

    /// Axis of a cylinder or capsule whose round side is the candidate's surface at a contact, and 1/(1/R_a + 1/R_b), m, with the radius
    /// of the antagonist if that is the side of a parallel cylinder. `None` at other contacts.
    fn rolling_cylinder(&self, contact: &Contact) -> Option<(Vec3, f64)> {
        let &AssemblyContext { scene, q_c, .. } = self;
        if !scene.has_rollers {
            return None;
        }
        let side = |body: BodyId, part_number: u16| {
            let part = scene.find_part(body, part_number)?;
            let (ContactorShape::Cylinder { radius, hollow: false, .. } | ContactorShape::Capsule { radius, .. }) =
                part.geometry
            else {
                return None;
            };
            let axis = q_c.q[body.index()] * part.axes * Vec3::z();
            (axis.dot(&contact.normal).abs() < MAX_SIDE_COSINE).then_some((axis, radius))
        };
        let (axis, radius) = side(contact.candidate, contact.part_numbers.candidate)?;
        let antagonist_side = side(contact.antagonist, contact.part_numbers.antagonist);
        let parallel = antagonist_side.filter(|(other, _)| axis.cross(other).norm() < MAX_SIDE_COSINE);
        Some((axis, 1.0 / (1.0 / radius + parallel.map_or(0.0, |(_, radius)| 1.0 / radius))))
    }

    /// 1/(1/R_a + 1/R_b) of a sphere or the round end of a capsule and the surface on which it rolls, m; 0 for corners and
    /// edges, which are fixed on their bodies.
    fn rolling_radius(&self, contact: &Contact) -> f64 {
        let (body, part_number) = (contact.candidate, contact.part_numbers.candidate);
        let capsule_radius = || match self.scene.find_part(body, part_number)?.geometry {
            ContactorShape::Capsule { radius, .. } => Some(radius),
            _ => None,
        };
        let own = self.sphere_radius(body, part_number);
        let own = if self.scene.has_rollers { own.or_else(capsule_radius) } else { own };
        let Some(own) = own else { return 0.0 };
        let of_antagonist = self.sphere_radius(contact.antagonist, contact.part_numbers.antagonist);
        1.0 / (1.0 / own + of_antagonist.map_or(0.0, f64::recip))
    }

    /// Approach velocity of the inside of a hollow cylinder to a point that slides round it, m/s, as the surface curves away
    /// from its tangent. For a point at the distance D from the axis, which moves by h u_θ along the tangent, it is
    /// (D - √(D² - (h u_θ)²))/h - d/h, with the distance d by which the point leaves its tangent as it turns about its
    /// body's centre.
    ///
    /// 0 at other contacts: the gap opens between convex surfaces.
    pub(super) fn curvature_velocity(&self, contact: &Contact) -> f64 {
        let &AssemblyContext { scene, state, q_c, .. } = self;
        if !scene.has_drums {
            return 0.0;
        }
        let [a, b] = [contact.candidate, contact.antagonist].map(|i| i.index());
        let Some(drum) = scene.find_part(contact.antagonist, contact.part_numbers.antagonist) else { return 0.0 };
        let ContactorShape::Cylinder { hollow: true, .. } = drum.geometry else { return 0.0 };
        if contact.features.antagonist >= FAR_WALL {
            return 0.0; // a plane
        }
        let axis = q_c.q[b] * drum.axes * Vec3::z();
        if contact.normal.dot(&axis).abs() > 0.5 {
            return 0.0; // a flat end
        }
        // The centre of a sphere, the axis of a rolling cylinder, the vertex of a polyhedron or rim.
        let height_over_contact =
            match scene.find_part(contact.candidate, contact.part_numbers.candidate).map(|part| &part.geometry) {
                Some(ContactorShape::Sphere { radius } | ContactorShape::Capsule { radius, .. }) => {
                    radius + 0.5 * contact.gap
                }
                _ => self.rolling_cylinder(contact).map_or(0.0, |(_, radius)| radius) + 0.5 * contact.gap,
            };
        let [at_a, at_b] = contact_arms(contact, &q_c.x).map(|arm| arm + contact.normal * height_over_contact);
        let from_axis = at_b - q_c.q[b] * drum.offset;
        let distance = (from_axis - axis * axis.dot(&from_axis)).norm() + contact.gap.max(0.0);
        // A drum that turns about its own axis keeps its surface.
        let turning = state.w[b] - axis * axis.dot(&state.w[b]);
        let u = state.v[a] + q_c.w[a].cross(&at_a) - state.v[b] - turning.cross(&at_b);
        let travel = q_c.h * u.dot(&axis.cross(&contact.normal));
        if travel.abs() > MAX_CURVED_SHARE * distance {
            return 0.0; // tangent planes ahead of the body bound its displacement
        }
        let sagitta = distance - (distance * distance - travel * travel).max(0.0).sqrt();
        let centripetal_acceleration = q_c.w[a].cross(&q_c.w[a].cross(&at_a)).dot(&contact.normal);
        (sagitta / q_c.h - 0.5 * q_c.h * centripetal_acceleration).max(0.0)
    }
}

/// Largest ratio of a displacement along the inside of a cylinder in a step to the distance from its axis, for which
/// the curvature is corrected: about two tangent planes of [`far_walls`](crate::geometry::far_walls) apart.
const MAX_CURVED_SHARE: f64 = 0.75;

/// Cosine between the normal and the axis up to which a contact is on the round side of a cylinder: 0 up to rounding there,
/// and near 1 at an end.
const MAX_SIDE_COSINE: f64 = 1e-6;

/// τ(ω, l) = ω×(l⁺ - l), m/s: change of the velocity ω×l of the end of an arm as it turns. l⁺ = l + ½ h ω×l⁺ is the arm after
/// half a step `half`, as for a rigid body that turns by the theta-scheme with θ = ½. To first order τ = ½ h ω×(ω×l).
fn lever_velocity_change(w: &Vec3, arm: &Vec3, half: f64) -> Vec3 {
    let velocity = w.cross(arm);
    w.cross(&(velocity + w.cross(&velocity) * half)) * (half / (1.0 + half * half * w.norm_squared()))
}

/// τ_R, m/s: change of velocity as the contact point moves along `arm` = R n, with ω = ω_a - ω_b, v = ω×R n and k half a
/// step: k (ω×v + k (ω_a + ω_b)×(ω×v)) / (1 + k² ω²). If one body is at rest it is τ(±ω, R n) of the other. It is the same
/// for either choice of the candidate.
fn rolling_velocity_change(a: &Vec3, b: &Vec3, arm: &Vec3, half: f64) -> Vec3 {
    let w = a - b;
    let bend = w.cross(&w.cross(arm));
    (bend + (a + b).cross(&bend) * half) * (half / (1.0 + half * half * w.norm_squared()))
}
