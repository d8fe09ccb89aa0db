//! Judges a solution of the contact problem; never solves, and shares no arithmetic with what solves.
//!
//! E = |F(r)|/|F(0)| with the natural map F(r) = r - P_K(r - rho (û + mu |û_T| n)), rho = 3N/trace W, over
//! the contacts that can close in the step: 1 when nothing is solved, 0 exactly at a solution, the same
//! in any units and whatever the alert distance.
//!
//! Source: V. Acary, B. Brogliato, Numerical Methods for Nonsmooth Dynamical Systems (2008), ch. 13.

use crate::assemble::{Record, Row, System};
use crate::math::Vec3;

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
        self.residual_at(impulses, &velocities(self.system, impulses))
    }

    /// The same, where the velocities that the impulses lead to are known.
    pub fn residual_at(&self, impulses: &[Vec3], records: &[Record]) -> Residual {
        let (norm, worst) = self.norm(impulses, records);
        if norm <= self.floor {
            return Residual { value: 0.0, worst: None };
        }
        Residual { value: norm / self.at_zero.max(self.floor), worst }
    }

    fn norm(&self, impulses: &[Vec3], records: &[Record]) -> (f64, Option<u32>) {
        let (mut sum, mut largest, mut worst) = (0.0, 0.0, None);
        for &k in self.rows {
            let row = &self.system.rows[k as usize];
            let size2 = natural_map2(row, &impulses[k as usize], &velocity(self.system, k as usize, records), self.rho);
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
    for (k, (row, r)) in system.rows.iter().zip(impulses).enumerate() {
        for (side, sign) in [(0, 1.0), (1, -1.0)] {
            let body = row.bodies[side];
            let record = &mut records[body as usize];
            record.v += r * (sign * record.inverse_mass);
            record.w += system.spin(body, &system.arm(k, side).cross(&(r * sign)));
        }
    }
    records
}

fn velocity(system: &System, k: usize, records: &[Record]) -> Vec3 {
    let row = &system.rows[k];
    let at_point = |side: usize| {
        let record = &records[row.bodies[side] as usize];
        record.v + record.w.cross(&system.arm(k, side))
    };
    at_point(0) - at_point(1) + row.shift
}

/// |F|^2 of one contact, N^2 s^2. In the plane of n and the tangential part of r - rho û, where the
/// projection lies too, no frame is needed.
fn natural_map2(row: &Row, r: &Vec3, u: &Vec3, rho: f64) -> f64 {
    let (n, mu) = (&row.normal, row.friction);
    let u_n = n.dot(u);
    let u_t = u - n * u_n;
    let z = r - u * rho;
    let z_n = n.dot(&z) - rho * mu * u_t.norm_squared().sqrt();
    let z_t = z - n * n.dot(&z);
    let size = z_t.norm_squared().sqrt();
    let (p_n, p_t) = project_on_cone(z_n, size, mu);
    let direction = if size > 0.0 { z_t / size } else { Vec3::zeros() };
    (r - n * p_n - direction * p_t).norm_squared()
}

/// The nearest point of Coulomb's cone { |r_T| <= mu r_n } to a vector of normal part `z_n` and of
/// tangential size `z_t` >= 0: its normal part and its tangential size.
///
/// ```
/// # use cd_solve::solve::residual::project_on_cone;
/// assert_eq!(project_on_cone(2.0, 1.0, 1.0), (2.0, 1.0)); // inside
/// assert_eq!(project_on_cone(-2.0, 1.0, 1.0), (0.0, 0.0)); // in the polar cone
/// assert_eq!(project_on_cone(0.0, 2.0, 1.0), (1.0, 1.0)); // on the side
/// ```
pub fn project_on_cone(z_n: f64, z_t: f64, mu: f64) -> (f64, f64) {
    if z_t <= mu * z_n {
        (z_n, z_t)
    } else if mu * z_t <= -z_n {
        (0.0, 0.0)
    } else {
        let normal = (z_n + mu * z_t) / (1.0 + mu * mu);
        (normal, mu * normal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The projection is in the cone and no nearby point of the cone is nearer.
        #[test]
        fn projection_is_the_nearest_point(z_n in -5.0..5.0f64, z_t in 0.0..5.0f64, mu in 0.0..2.0f64, tries in prop::collection::vec((0.0..6.0f64, 0.0..1.0f64), 50)) {
            let (p_n, p_t) = project_on_cone(z_n, z_t, mu);
            // Rounding of numbers up to 10.
            prop_assert!(p_t <= mu * p_n + 1e-14);
            for (normal, share) in tries {
                let distance = |n: f64, t: f64| (z_n - n).hypot(z_t - t);
                prop_assert!(distance(p_n, p_t) <= distance(normal, mu * normal * share) + 1e-13);
            }
        }
    }
}
