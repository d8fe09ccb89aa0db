//! Forces and torques that sum to zero.

use nalgebra::{Matrix3, Matrix3x4};
use rayon::prelude::*;

use crate::math::{Vec3, Wrench};

/// Bodies per partial sum; the partial sums are added in a fixed order, independent of threads.
const BODIES_PER_SUM: usize = 4096;

/// Removes the rigid motion that errors of the accelerations cause: a_i -= F/M + (I^-1 T) x x_i about the centre of mass,
/// with F = sum m a, T = sum x x m a. Returns the ratio of the RMS of the removed part to that of `a`, weighted by
/// mass.
pub fn balance_accelerations(positions: &[Vec3], masses: &[f64], acceleration: &mut [Vec3]) -> f64 {
    let Some(origin) = positions.first() else { return 0.0 };
    let parts = positions
        .par_chunks(BODIES_PER_SUM)
        .zip(masses.par_chunks(BODIES_PER_SUM))
        .zip(acceleration.par_chunks(BODIES_PER_SUM));
    let parts: Vec<ForceSums> = parts.map(|((x, m), a)| ForceSums::new(origin, x, m, a)).collect();
    let ForceSums { second_moments, mass, force, torque, square: acceleration_square } =
        parts.into_iter().fold(ForceSums::default(), ForceSums::add);
    if mass <= 0.0 {
        return 0.0;
    }
    let offset: Vec3 = second_moments.column(3) / mass;
    let second_moments = second_moments.fixed_columns::<3>(0) - offset * offset.transpose() * mass;
    let inertia = Matrix3::identity() * second_moments.trace() - second_moments;
    // The slightly larger inertia keeps the matrix invertible for bodies in a line; a second pass corrects its effect.
    let inverse = (inertia + Matrix3::identity() * (1e-13 * inertia.trace())).try_inverse().unwrap_or_default();
    let centre = origin + offset;
    let rigid_acceleration =
        |load: Wrench| RigidAcceleration { linear: load.force / mass, angular: inverse * load.torque };
    let mass_times_square = |RigidAcceleration { linear, angular }: RigidAcceleration| {
        mass * linear.norm_squared() + angular.dot(&(inertia * angular)).max(0.0)
    };
    let first = rigid_acceleration(Wrench { force, torque }.moved_by(&offset));
    let second = rigid_acceleration(subtract_rigid(&centre, first, positions, masses, acceleration));
    subtract_rigid(&centre, second, positions, masses, acceleration);
    if acceleration_square > 0.0 {
        ((mass_times_square(first) + mass_times_square(second)) / acceleration_square).sqrt()
    } else {
        0.0
    }
}

/// Sums over bodies at r from an origin.
#[derive(Default)]
struct ForceSums {
    /// Sum of m (r r^T | r): second moments, kg m², then the first, kg m.
    second_moments: Matrix3x4<f64>,
    /// Sum of m, kg.
    mass: f64,
    /// Sum of m a, N.
    force: Vec3,
    /// Sum of r x m a, N m.
    torque: Vec3,
    /// Sum of m a^2, N m/s².
    square: f64,
}

impl ForceSums {
    fn new(origin: &Vec3, positions: &[Vec3], masses: &[f64], acceleration: &[Vec3]) -> Self {
        let mut sums = ForceSums::default();
        for ((x, m), a) in positions.iter().zip(masses).zip(acceleration) {
            let (r, force) = (x - origin, a * *m);
            sums.second_moments += r * r.push(1.0).transpose() * *m;
            sums.mass += m;
            sums.force += force;
            sums.torque += r.cross(&force);
            sums.square += force.dot(a);
        }
        sums
    }

    fn add(self, other: ForceSums) -> Self {
        ForceSums {
            second_moments: self.second_moments + other.second_moments,
            mass: self.mass + other.mass,
            force: self.force + other.force,
            torque: self.torque + other.torque,
            square: self.square + other.square,
        }
    }
}

/// Acceleration of a rigid body.
#[derive(Clone, Copy)]
struct RigidAcceleration {
    /// Acceleration of the centre of mass, m/s².
    linear: Vec3,
    /// Angular acceleration, rad/s².
    angular: Vec3,
}

/// Subtracts a rigid acceleration about `centre`; returns the force and the torque about the centre of the rest.
fn subtract_rigid(
    centre: &Vec3,
    RigidAcceleration { linear, angular }: RigidAcceleration,
    positions: &[Vec3],
    masses: &[f64],
    acceleration: &mut [Vec3],
) -> Wrench {
    let parts = positions.par_chunks(BODIES_PER_SUM).zip(masses.par_chunks(BODIES_PER_SUM));
    let parts = parts.zip(acceleration.par_chunks_mut(BODIES_PER_SUM)).map(|((x, m), a)| {
        let mut sum = Wrench::default();
        for ((x, m), a) in x.iter().zip(m).zip(a) {
            let r = x - centre;
            *a -= linear + angular.cross(&r);
            let force = *a * *m;
            sum.force += force;
            sum.torque += r.cross(&force);
        }
        sum
    });
    let parts: Vec<Wrench> = parts.collect();
    let add = |a: Wrench, b: &Wrench| Wrench { force: a.force + b.force, torque: a.torque + b.torque };
    parts.iter().fold(Wrench::default(), add)
}
