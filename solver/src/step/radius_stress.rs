//! Pressure on the inside of hollow cylinders, which their servos follow.

use crate::integrate::ContactConfiguration;
use crate::math::Vec3;
use crate::scene::{BodyId, RadialGrowth, Scene};
use crate::state::{SolvedContact, State};

/// Sum of the normal impulses of `contacts` on the round side of the hollow cylinder `body` with this `axis` (fixed axes),
/// N s, > 0 in compression; in the order of the contacts.
pub fn side_impulse(contacts: &[SolvedContact], body: BodyId, axis: &Vec3) -> f64 {
    let on_side = contacts
        .iter()
        .filter(|solved| solved.contact.antagonist == body && RadialGrowth::is_side(axis, &solved.contact.normal));
    on_side.map(|solved| solved.impulse.x).sum()
}

/// Enters the pressures of a step with these `contacts` in the means of the servos.
pub fn update_mean_pressures(scene: &Scene, q_c: &ContactConfiguration, contacts: &[SolvedContact], state: &mut State) {
    for ((changing, step), radius) in scene.radii.iter().zip(&q_c.radii).zip(&mut state.radii) {
        let axis = q_c.q[changing.body.index()] * changing.axis;
        let impulse = side_impulse(contacts, changing.body, &axis);
        let pressure = impulse / (q_c.h * changing.area(step.state.radius, &q_c.x));
        radius.height = changing.height(&q_c.x);
        radius.mean_stress = changing.control.control.mean_stress(radius.mean_stress, pressure, q_c.h);
    }
}
