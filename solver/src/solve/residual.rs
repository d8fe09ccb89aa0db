//! Judges a solution of the contact problem; never solves, and shares no arithmetic with what solves.
//!
//! E = |F(r)|/|F(0)| with the natural map F(r) = r - P_K(r - rho (û + mu |û_T| n)), rho = 3N/trace W, over
//! the contacts that can close in the step: 1 when nothing is solved, 0 exactly at a solution, the same
//! in any units and whatever the alert distance.
//!
//! Source: V. Acary, B. Brogliato, Numerical Methods for Nonsmooth Dynamical Systems (2008), ch. 13.

use crate::assemble::{Record, Row, System};
use crate::math::{Vec3, local_frame, to_local};

/// Below this share of the bodies' own velocities a residual is their rounding: steps in which
/// nothing closes count as solved.
const FLOOR: f64 = 1e-15;

pub struct Judge<'a> {
    system: &'a System,
    /// Rows that are judged.
    rows: &'a [u32],
    rho: f64,
    at_zero: f64,
    floor: f64,
}

/// E and the row that has the largest part in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    pub value: f64,
    pub worst: Option<u32>,
}

impl<'a> Judge<'a> {
    pub fn new(system: &'a System, rows: &'a [u32]) -> Self {
        let of = |k: &u32| &system.rows[*k as usize];
        let trace: f64 = rows.iter().map(|k| of(k).w_n + 2.0 * of(k).w_t).sum();
        let rho = if rows.is_empty() { 0.0 } else { 3.0 * rows.len() as f64 / trace };
        let speed = |i: u32| system.records[i as usize].v.norm();
        let speeds: f64 = rows.iter().map(|k| of(k).bodies.map(speed).iter().sum::<f64>().powi(2)).sum();
        let mut judge = Judge { system, rows, rho, at_zero: 0.0, floor: FLOOR * rho * speeds.sqrt() };
        judge.at_zero = judge.norm(&vec![Vec3::zeros(); system.rows.len()], &system.records).0;
        judge
    }

    /// E of the impulses r̂ (one a row of the system, world frame, N s).
    pub fn residual(&self, impulses: &[Vec3]) -> Residual {
        let records = velocities(self.system, impulses);
        let (norm, worst) = self.norm(impulses, &records);
        if norm <= self.floor {
            return Residual { value: 0.0, worst: None };
        }
        Residual { value: norm / self.at_zero.max(self.floor), worst }
    }

    fn norm(&self, impulses: &[Vec3], records: &[Record]) -> (f64, Option<u32>) {
        let (mut sum, mut largest, mut worst) = (0.0, 0.0, None);
        for &k in self.rows {
            let row = &self.system.rows[k as usize];
            let size2 = natural_map(row, &impulses[k as usize], &velocity(row, records), self.rho).norm_squared();
            sum += size2;
            if size2 > largest {
                (largest, worst) = (size2, Some(k));
            }
        }
        (sum.sqrt(), worst)
    }
}

/// V_free + M⁻¹ H r̂ from the beginning.
pub fn velocities(system: &System, impulses: &[Vec3]) -> Vec<Record> {
    let mut records = system.records.clone();
    for (row, r) in system.rows.iter().zip(impulses) {
        for (side, sign) in [(0, 1.0), (1, -1.0)] {
            let record = &mut records[row.bodies[side] as usize];
            let arm = row.normal * (-sign * row.levers[side]);
            record.v += r * (sign * record.inverse_mass);
            record.w += arm.cross(&(r * sign)) * record.inverse_inertia;
        }
    }
    records
}

fn velocity(row: &Row, records: &[Record]) -> Vec3 {
    let at_point = |side: usize, sign: f64| {
        let record = &records[row.bodies[side] as usize];
        record.v + record.w.cross(&(row.normal * (-sign * row.levers[side])))
    };
    at_point(0, 1.0) - at_point(1, -1.0) + row.shift
}

/// F of one contact along its local frame, N s.
fn natural_map(row: &Row, r: &Vec3, u: &Vec3, rho: f64) -> Vec3 {
    let frame = local_frame(row.normal);
    let (r, u) = (to_local(&frame, r), to_local(&frame, u));
    let mu = row.friction;
    let lifted = Vec3::new(u.x + mu * u.y.hypot(u.z), u.y, u.z);
    r - project_on_cone(&(r - lifted * rho), mu)
}

/// The nearest point of Coulomb's cone { |r_T| <= mu r_n } to `z` = (z_n, z_t, z_s).
///
/// ```
/// # use cd_solve::{math::Vec3, solve::residual::project_on_cone};
/// assert_eq!(project_on_cone(&Vec3::new(2.0, 1.0, 0.0), 1.0), Vec3::new(2.0, 1.0, 0.0)); // inside
/// assert_eq!(project_on_cone(&Vec3::new(-2.0, 1.0, 0.0), 1.0), Vec3::zeros()); // in the polar cone
/// assert_eq!(project_on_cone(&Vec3::new(0.0, 2.0, 0.0), 1.0), Vec3::new(1.0, 1.0, 0.0)); // on the side
/// ```
pub fn project_on_cone(z: &Vec3, mu: f64) -> Vec3 {
    let tangential = z.y.hypot(z.z);
    if tangential <= mu * z.x {
        *z
    } else if mu * tangential <= -z.x {
        Vec3::zeros()
    } else {
        let normal = (z.x + mu * tangential) / (1.0 + mu * mu);
        let scale = mu * normal / tangential;
        Vec3::new(normal, z.y * scale, z.z * scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The projection is in the cone and no nearby point of the cone is nearer.
        #[test]
        fn projection_is_the_nearest_point(z in prop::array::uniform3(-5.0..5.0f64), mu in 0.0..2.0f64, tries in prop::collection::vec((0.0..6.0f64, 0.0..1.0f64, 0.0..6.3f64), 50)) {
            let z = Vec3::from(z);
            let p = project_on_cone(&z, mu);
            // Rounding of numbers up to 10.
            prop_assert!(p.y.hypot(p.z) <= mu * p.x + 1e-14);
            for (normal, share, angle) in tries {
                let other = Vec3::new(normal, mu * normal * share * angle.cos(), mu * normal * share * angle.sin());
                prop_assert!((z - p).norm() <= (z - other).norm() + 1e-13);
            }
        }
    }
}
