//! Forces and torques that sum to zero.

use nalgebra::{Matrix3, Matrix3x4};
use rayon::prelude::*;

use crate::math::Vec3;

/// Bodies summed one after the other; the sums of such parts are added in their order, whatever thread they are from.
const PART: usize = 4096;

/// Takes the rigid motion out of accelerations that their own errors give: a_i -= F/M + (I^-1 T) x x_i about the centre
/// of mass, with F = sum m a, T = sum x x m a. Returns the RMS of what was removed over that of `a`, by mass.
pub fn balance(positions: &[Vec3], masses: &[f64], acceleration: &mut [Vec3]) -> f64 {
    let Some(origin) = positions.first() else { return 0.0 };
    let parts = positions.par_chunks(PART).zip(masses.par_chunks(PART));
    // m (r r^T | r) and m
    let parts = parts.map(|(x, m)| {
        x.iter().zip(m).fold((Matrix3x4::zeros(), 0.0), |(sum, mass), (x, m)| {
            let r = x - origin;
            (sum + r * r.push(1.0).transpose() * *m, mass + m)
        })
    });
    let parts: Vec<(Matrix3x4<f64>, f64)> = parts.collect();
    let (second, mass) = parts.iter().fold((Matrix3x4::zeros(), 0.0), |(a, m), (b, n)| (a + b, m + n));
    if mass <= 0.0 {
        return 0.0;
    }
    let offset: Vec3 = second.column(3) / mass;
    let second = second.fixed_columns::<3>(0) - offset * offset.transpose() * mass;
    let inertia = Matrix3::identity() * second.trace() - second;
    // A little more inertia than there is serves bodies in a line too; a second round makes up for it.
    let inverse = (inertia + Matrix3::identity() * (1e-13 * inertia.trace())).try_inverse().unwrap_or_default();
    let bodies = Bodies { positions, masses, centre: origin + offset };
    let [force, torque, squares] = bodies.sums(acceleration, None);
    let (mut rigid, mut removed) = ((force / mass, inverse * torque), 0.0);
    for _ in 0..2 {
        let (push, spin) = rigid;
        removed += mass * push.norm_squared() + spin.dot(&(inertia * spin)).max(0.0);
        let [force, torque, _] = bodies.sums(acceleration, Some(rigid));
        rigid = (force / mass, inverse * torque);
    }
    if squares.x > 0.0 { (removed / squares.x).sqrt() } else { 0.0 }
}

struct Bodies<'a> {
    positions: &'a [Vec3],
    masses: &'a [f64],
    centre: Vec3,
}

impl Bodies<'_> {
    /// Takes a rigid acceleration (of the centre, of turning) away, and sums what is left: m a, x x m a, and m a^2 in
    /// the first component of the third.
    fn sums(&self, acceleration: &mut [Vec3], rigid: Option<(Vec3, Vec3)>) -> [Vec3; 3] {
        let parts = self.positions.par_chunks(PART).zip(self.masses.par_chunks(PART));
        let parts = parts.zip(acceleration.par_chunks_mut(PART)).map(|((x, m), a)| {
            let mut sums = [Vec3::zeros(); 3];
            for ((x, m), a) in x.iter().zip(m).zip(a) {
                let r = x - self.centre;
                if let Some((push, spin)) = &rigid {
                    *a -= push + spin.cross(&r);
                }
                sums[0] += *a * *m;
                sums[1] += r.cross(a) * *m;
                sums[2].x += m * a.norm_squared();
            }
            sums
        });
        let parts: Vec<[Vec3; 3]> = parts.collect();
        parts.iter().fold([Vec3::zeros(); 3], |a, b| [a[0] + b[0], a[1] + b[1], a[2] + b[2]])
    }
}
