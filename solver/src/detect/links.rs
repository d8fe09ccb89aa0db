//! Wires and rods as contacts of points: they are listed in every step.

use crate::integrate::ContactConfiguration;
use crate::math::Vec3;
use crate::scene::{ContactSides, PointLink, Scene};
use crate::state::Contact;

/// Contacts of all wires and rods, ordered by key. The gap is the distance of the points, and the contact point is in their middle:
/// forces act along the line, so that any point on it will do.
pub fn link_contacts(scene: &Scene, q_c: &ContactConfiguration) -> impl Iterator<Item = Contact> {
    scene.links.iter().map(|link| {
        let PointLink { bodies, offsets, part_numbers, law, .. } = *link;
        let [a, b] = [0, 1].map(|k| q_c.x[bodies[k].index()] + q_c.q[bodies[k].index()] * offsets[k]);
        let between = a - b;
        Contact {
            candidate: bodies[0],
            antagonist: bodies[1],
            part_numbers,
            features: ContactSides::default(),
            point: (a + b) * 0.5,
            image: Vec3::zeros(),
            // Points that coincide have no direction; a rod pushes them apart along any.
            normal: between.try_normalize(0.0).unwrap_or_else(Vec3::x),
            gap: between.norm(),
            area: 0.0,
            law,
        }
    })
}
