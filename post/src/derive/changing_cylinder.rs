//! Hollow cylinder whose radius changes.

use crate::frame::{ContactBody, Frame};
use crate::math::Vec3;

/// Radius (m) of the first hollow cylinder whose radius changes, and pressure (Pa, > 0 in compression) of the contacts on its
/// inside without the ends: the sum of their normal forces over 2π R H, with the radius R of the contact configuration and the
/// height H between the plates inside, or of the cylinder. NaN in a scene without such a cylinder.
pub fn radius_and_pressure(frame: &Frame) -> [f64; 2] {
    let Some(state) = frame.meta.radii.first() else { return [f64::NAN; 2] };
    let mut walls = frame.wall_ids();
    let Some(wall) = walls.find(|wall| frame.walls[wall.index()].id == state.body as u64) else {
        return [state.radius, f64::NAN];
    };
    let axis = frame.walls[wall.index()].rotation * Vec3::z();
    let on_side = frame.contacts.iter().filter(|contact| {
        // Normals of the ends are along the axis.
        contact.antagonist == ContactBody::Wall(wall) && contact.normal.dot(&axis).abs() <= 0.5
    });
    let force: f64 = on_side.map(|contact| contact.normal_force).sum();
    let contact_radius = state.moved_by(-frame.meta.parameters.theta * frame.meta.h).radius;
    [state.radius, force / (std::f64::consts::TAU * contact_radius * state.height)]
}
