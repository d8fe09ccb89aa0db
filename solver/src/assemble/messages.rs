//! Rows of the contact problem in fields of fixed size, as ranks send them to each other.

use bytemuck::{Pod, Zeroable};

use super::problem::ContactConstraint;
use crate::scene::BodyId;

/// [`ContactConstraint`] in fields of fixed size, with the index of its row in a list that the ranks agree on.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct ConstraintMessage {
    normal: [f64; 3],
    shift: [f64; 3],
    warm_start: [f64; 3],
    u_before: [f64; 3],
    arm: f64,
    w_n: f64,
    w_t: f64,
    friction: f64,
    impulse_shift: f64,
    /// Gap of the bond; 0 without one.
    bond: f64,
    bodies: [u32; 2],
    /// Bit 0: the law can act; 1: the row can close; 2: there is a bond.
    flags: u32,
    pub index: u32,
}

impl ConstraintMessage {
    /// Message with `row` and its index.
    pub fn new(row: &ContactConstraint, index: u32) -> Self {
        ConstraintMessage {
            normal: row.normal.into(),
            shift: row.shift.into(),
            warm_start: row.warm_start.into(),
            u_before: row.u_before.into(),
            arm: row.arm,
            w_n: row.w_n,
            w_t: row.w_t,
            friction: row.friction,
            impulse_shift: row.impulse_shift,
            bond: row.bond.unwrap_or(0.0),
            bodies: row.bodies.map(|body| body.0),
            flags: u32::from(row.acts) | u32::from(row.can_close) << 1 | u32::from(row.bond.is_some()) << 2,
            index,
        }
    }
}

impl From<ConstraintMessage> for ContactConstraint {
    fn from(message: ConstraintMessage) -> Self {
        ContactConstraint {
            bodies: message.bodies.map(BodyId),
            normal: message.normal.into(),
            arm: message.arm,
            shift: message.shift.into(),
            w_n: message.w_n,
            w_t: message.w_t,
            friction: message.friction,
            impulse_shift: message.impulse_shift,
            acts: message.flags & 1 > 0,
            can_close: message.flags & 2 > 0,
            warm_start: message.warm_start.into(),
            u_before: message.u_before.into(),
            bond: (message.flags & 4 > 0).then_some(message.bond),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    #[test]
    fn messages_hold_the_whole_row() {
        let row = ContactConstraint {
            bodies: [BodyId(3), BodyId(u32::MAX)],
            normal: Vec3::new(1.0, 2.0, 3.0),
            arm: 4.0,
            shift: Vec3::new(5.0, 6.0, -0.0),
            w_n: 7.0,
            w_t: 8.0,
            friction: 9.0,
            impulse_shift: 10.0,
            acts: false,
            can_close: true,
            warm_start: Vec3::new(11.0, 12.0, 13.0),
            u_before: Vec3::new(14.0, 15.0, 16.0),
            bond: Some(0.0),
        };
        for row in [row, ContactConstraint { acts: true, can_close: false, bond: None, ..row }] {
            assert_eq!(ContactConstraint::from(ConstraintMessage::new(&row, 5)), row);
        }
    }
}
