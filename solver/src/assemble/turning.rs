//! How contacts turn and curve within a step.

use super::rows::{AssemblyContext, contact_arms};
use crate::math::Vec3;
use crate::scene::{BodyPart, BodyShape, ContactorShape};
use crate::state::Contact;

impl AssemblyContext<'_> {
    /// How fast surfaces that stick part at the step's end where they rest upon each other in the contact configuration, m/s, world
    /// frame: arms turn with the bodies, their angular velocities change in free rotation by α, and where one rolls the point of
    /// contact goes on, τ(ω_a, l_a) + ½ h α_a×l_a - τ(ω_b, l_b) - ½ h α_b×l_b + τ_R, 1/R the sum of the curvatures;
    /// see [`lever_velocity_change`] and [`rolling_velocity_change`]. So what turns as one body does so for ever. `as_one`: whether a bond holds the two, which
    /// then have one ω whatever an event has given one of them: arms that turn apart would strain the bond. A sphere has none
    /// of its own, for a bond at one point lets it roll.
    pub(super) fn arm_turning_velocity(&self, contact: &Contact, as_one: bool) -> Vec3 {
        let bodies = [contact.candidate, contact.antagonist].map(|body| body as usize);
        // Those of the step's start: what turns as one body has one then, and free rotation differs from body to body.
        let [mut a, mut b] = bodies.map(|i| self.state.w[i]);
        let own = [a, b];
        let radius = self.rolling_radius(contact);
        if as_one && radius == 0.0 {
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
        let (half, before) = (0.5 * self.q_c.h, (1.0 - self.scene.options.theta) * self.q_c.h);
        let at = |side: usize, w: &Vec3, arm: &Vec3| {
            let change = self.q_c.w[bodies[side]] - own[side];
            let free = if before > 0.0 { change.cross(arm) * (half / before) } else { Vec3::zeros() };
            lever_velocity_change(w, arm, half) + free
        };
        let [at_a, at_b] = contact_arms(contact, &self.q_c.x);
        let rolling = rolling_velocity_change(&a, &b, &(contact.normal * radius), half);
        at(0, &a, &at_a) - at(1, &b, &at_b) + rolling
    }

    /// 1/(1/R_a + 1/R_b) of a sphere and what it rolls upon, m; 0 of corners and edges, which stay where they are on their bodies.
    fn rolling_radius(&self, contact: &Contact) -> f64 {
        let radius =
            |body: u32, rank: u16| match (self.scene.bodies[body as usize].shape, self.scene.find_part(body, rank)) {
                (BodyShape::Sphere { radius }, _)
                | (_, Some(&BodyPart { geometry: ContactorShape::Sphere { radius }, .. })) => Some(radius),
                _ => None,
            };
        let of_antagonist = radius(contact.antagonist, contact.ranks.1);
        let sum = |own: f64| 1.0 / (1.0 / own + of_antagonist.map_or(0.0, f64::recip));
        radius(contact.candidate, contact.ranks.0).map_or(0.0, sum)
    }

    /// How fast the inside of a hollow cylinder comes nearer to what slides round it, m/s, for it curves away from its tangent: of a
    /// point at the distance D from the axis, which moves by h u_θ along the tangent, (D - √(D² - (h u_θ)²))/h; less what the point
    /// itself turns away from its tangent about its body's centre. 0 at other contacts: where surfaces bulge, the gap opens.
    pub(super) fn curvature_velocity(&self, contact: &Contact) -> f64 {
        let &AssemblyContext { scene, state, q_c, .. } = self;
        let [a, b] = [contact.candidate, contact.antagonist].map(|i| i as usize);
        let Some(drum) = scene.find_part(contact.antagonist, contact.ranks.1) else { return 0.0 };
        let ContactorShape::Cylinder { hollow: true, .. } = drum.geometry else { return 0.0 };
        let axis = q_c.q[b] * drum.axes * Vec3::z();
        if contact.normal.dot(&axis).abs() > 0.5 {
            return 0.0; // an end, which is flat
        }
        // Of a sphere the centre, of a polyhedron the vertex.
        let in_front = match scene.find_part(contact.candidate, contact.ranks.0).map(|part| &part.geometry) {
            Some(ContactorShape::Sphere { radius }) => radius + 0.5 * contact.gap,
            _ => 0.5 * contact.gap,
        };
        let [at_a, at_b] = contact_arms(contact, &q_c.x).map(|arm| arm + contact.normal * in_front);
        let from_axis = at_b - q_c.q[b] * drum.offset;
        let distance = (from_axis - axis * axis.dot(&from_axis)).norm() + contact.gap.max(0.0);
        // Turning about its own axis the drum stays where it is.
        let turning = state.w[b] - axis * axis.dot(&state.w[b]);
        let u = state.v[a] + q_c.w[a].cross(&at_a) - state.v[b] - turning.cross(&at_b);
        let way = q_c.h * u.dot(&axis.cross(&contact.normal));
        let sagitta = distance - (distance * distance - way * way).max(0.0).sqrt();
        let turned = q_c.w[a].cross(&q_c.w[a].cross(&at_a)).dot(&contact.normal);
        (sagitta / q_c.h - 0.5 * q_c.h * turned).max(0.0)
    }
}

/// τ(ω, l) = ω×(l⁺ - l), m/s: how the velocity ω×l of the end of an arm changes as it turns, l⁺ = l + ½ h ω×l⁺ after half a
/// step `half`, as the points of a rigid body do that turns by the theta-scheme with θ = ½. To first order ½ h ω×(ω×l).
fn lever_velocity_change(w: &Vec3, arm: &Vec3, half: f64) -> Vec3 {
    let velocity = w.cross(arm);
    w.cross(&(velocity + w.cross(&velocity) * half)) * (half / (1.0 + half * half * w.norm_squared()))
}

/// τ_R, m/s: the same of the point of contact that goes on along `arm` = R n, with ω = ω_a - ω_b, v = ω×R n and k half a step:
/// k (ω×v + k (ω_a + ω_b)×(ω×v)) / (1 + k² ω²). Where one body is at rest it is τ(±ω, R n) of the other, and the same whichever is the candidate.
fn rolling_velocity_change(a: &Vec3, b: &Vec3, arm: &Vec3, half: f64) -> Vec3 {
    let w = a - b;
    let bend = w.cross(&w.cross(arm));
    (bend + (a + b).cross(&bend) * half) * (half / (1.0 + half * half * w.norm_squared()))
}
