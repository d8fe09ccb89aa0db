//! Rocks as many points, whose attraction is summed exactly: what the quadrupoles of `gravity::quadrupole` are judged by.

use cd_solve::gravity::quadrupole::{BodyInertia, quadrupole_correction};
use cd_solve::math::{Quat, Vec3};
use nalgebra::Matrix3;

/// Points of equal mass on a lattice in a box of these half lengths, turned.
pub fn rock(half: [f64; 3], turn: Vec3) -> Vec<Vec3> {
    let turn = Quat::from_scaled_axis(turn);
    let counts = half.map(|h| (8.0 * h) as usize);
    let places = |k: usize| (0..counts[k]).map(move |i| ((i as f64 + 0.5) / counts[k] as f64 * 2.0 - 1.0) * half[k]);
    places(0).flat_map(|x| places(1).flat_map(move |y| places(2).map(move |z| turn * Vec3::new(x, y, z)))).collect()
}

pub fn rigid(points: &[Vec3]) -> BodyInertia {
    let inertia = points.iter().map(|x| Matrix3::identity() * x.norm_squared() - x * x.transpose()).sum();
    BodyInertia { mass: points.len() as f64, inertia }
}

/// Every point with every point: force on the second, torques.
pub fn exact(r: &Vec3, one: &[Vec3], two: &[Vec3]) -> (Vec3, [Vec3; 2]) {
    let (mut force, mut torques) = (Vec3::zeros(), [Vec3::zeros(); 2]);
    for a in one {
        for b in two {
            let d = r + b - a;
            let pull = -d / d.norm().powi(3);
            force += pull;
            torques[0] -= a.cross(&pull);
            torques[1] += b.cross(&pull);
        }
    }
    (force, torques)
}

pub fn point(r: &Vec3, one: &BodyInertia, two: &BodyInertia) -> Vec3 {
    -r * (one.mass * two.mass / r.norm().powi(3))
}

/// Errors of force without and with the correction and of torque, all over the force.
pub fn errors(r: &Vec3, one: &[Vec3], two: &[Vec3]) -> [f64; 3] {
    let (a, b) = (rigid(one), rigid(two));
    let (force, torques) = exact(r, one, two);
    let found = quadrupole_correction(r, [&a, &b], f64::INFINITY, 1.0);
    let plain = point(r, &a, &b);
    let turned = (found.torques[0] - torques[0]).norm() + (found.torques[1] - torques[1]).norm();
    [(plain - force).norm(), (plain + found.force - force).norm(), turned / r.norm()].map(|x| x / force.norm())
}

/// Relative errors of an aggregate of long rocks, without and with the correction.
pub struct Aggregate {
    /// RMS of the force on a rock.
    pub force: [f64; 2],
    /// Sum of x.F over all, which sets the pressure.
    pub virial: [f64; 2],
}

/// 125 rocks of 2:1:1 on a lattice as wide as they are long, turned anyhow; quadrupoles up to `reach` radii of equal volume.
pub fn aggregate(reach: f64) -> Aggregate {
    let reach = reach * (1.5 / std::f64::consts::PI).cbrt();
    let turn = |k: usize| Vec3::new((1.3 * k as f64).sin(), (2.1 * k as f64).sin(), (0.7 * k as f64).cos()) * 3.0;
    let rocks: Vec<Vec<Vec3>> = (0..125).map(|k| rock([1.0, 0.5, 0.5], turn(k))).collect();
    let at = |k: usize| Vec3::new((k % 5) as f64, (k / 5 % 5) as f64, (k / 25) as f64) * 1.8;
    let rigids: Vec<BodyInertia> = rocks.iter().map(|points| rigid(points)).collect();
    let (mut scale, mut away) = (0.0, [0.0; 2]);
    let (mut virial, mut virial_away) = (0.0, [0.0; 2]);
    for i in 0..125 {
        let (mut force, mut found) = (Vec3::zeros(), [Vec3::zeros(); 2]);
        for j in (0..125).filter(|&j| j != i) {
            let r = at(i) - at(j);
            force += exact(&r, &rocks[j], &rocks[i]).0;
            let plain = point(&r, &rigids[j], &rigids[i]);
            found[0] += plain;
            found[1] += plain + quadrupole_correction(&r, [&rigids[j], &rigids[i]], reach, 1.0).force;
        }
        scale += force.norm_squared();
        virial += at(i).dot(&force);
        for k in 0..2 {
            away[k] += (found[k] - force).norm_squared();
            virial_away[k] += at(i).dot(&(found[k] - force));
        }
    }
    Aggregate { force: away.map(|a| (a / scale).sqrt()), virial: virial_away.map(|a| (a / virial).abs()) }
}
