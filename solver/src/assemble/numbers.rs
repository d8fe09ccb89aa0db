//! Rows as plain numbers, as ranks exchange them.

use bytemuck::{Pod, Zeroable};

use super::problem::ContactConstraint;
use crate::math::Vec3;
use crate::scene::BodyId;

/// [`ContactConstraint`] as plain numbers, with the index of its row in a list of the sender.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct ConstraintNumbers {
    /// Normal, shift, warm start and velocity before the step.
    vectors: [[f64; 3]; 4],
    /// Arm, W_nn, W_tt, friction and shift of the impulse.
    scalars: [f64; 5],
    /// Gap of the bond; 0 without one.
    bond: f64,
    bodies: [u32; 2],
    /// Bit 0: the law can act; 1: the row can close; 2: there is a bond.
    flags: u32,
    pub index: u32,
}

impl ConstraintNumbers {
    /// Numbers of a row with this index.
    pub fn new(row: &ContactConstraint, index: u32) -> Self {
        ConstraintNumbers {
            vectors: [row.normal, row.shift, row.warm_start, row.u_before].map(Into::into),
            scalars: [row.arm, row.w_n, row.w_t, row.friction, row.impulse_shift],
            bond: row.bond.unwrap_or(0.0),
            bodies: row.bodies.map(|body| body.0),
            flags: u32::from(row.acts) | u32::from(row.can_close) << 1 | u32::from(row.bond.is_some()) << 2,
            index,
        }
    }
}

impl From<ConstraintNumbers> for ContactConstraint {
    fn from(numbers: ConstraintNumbers) -> Self {
        let ConstraintNumbers { vectors, scalars, bond, bodies, flags, .. } = numbers;
        let [normal, shift, warm_start, u_before] = vectors.map(Vec3::from);
        let [arm, w_n, w_t, friction, impulse_shift] = scalars;
        ContactConstraint {
            bodies: bodies.map(BodyId),
            normal,
            arm,
            shift,
            w_n,
            w_t,
            friction,
            impulse_shift,
            acts: flags & 1 > 0,
            can_close: flags & 2 > 0,
            warm_start,
            u_before,
            bond: (flags & 4 > 0).then_some(bond),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_the_row() {
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
            assert_eq!(ContactConstraint::from(ConstraintNumbers::new(&row, 5)), row);
        }
    }
}
