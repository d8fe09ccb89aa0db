//! The direct sum: every pair, in f64. The reference for any faster method.

use rayon::prelude::*;

use crate::math::Vec3;

/// Lanes of the inner loop: independent sums that a compiler turns into vector instructions,
/// added up in a fixed order.
const LANES: usize = 8;

/// Positions and masses laid out for the inner loop, padded with masses of zero.
struct Sources {
    x: Vec<[f64; LANES]>,
    y: Vec<[f64; LANES]>,
    z: Vec<[f64; LANES]>,
    m: Vec<[f64; LANES]>,
}

impl Sources {
    fn new(positions: &[Vec3], masses: &[f64]) -> Self {
        let column = |value: &dyn Fn(usize) -> f64| -> Vec<[f64; LANES]> {
            let block = |k: usize| std::array::from_fn(|lane| value(k * LANES + lane));
            (0..positions.len().div_ceil(LANES)).map(block).collect()
        };
        let at = |i: usize, k: usize| positions.get(i).map_or(0.0, |p| p[k]);
        Sources {
            x: column(&|i| at(i, 0)),
            y: column(&|i| at(i, 1)),
            z: column(&|i| at(i, 2)),
            m: column(&|i| masses.get(i).copied().unwrap_or(0.0)),
        }
    }
}

/// Acceleration (m/s^2) and potential (J/kg, negative) at each point mass due to all others:
/// a_i = G sum_j m_j (x_j - x_i)/|x_j - x_i|^3, phi_i = -G sum_j m_j/|x_j - x_i|.
///
/// Each sum runs over j in one fixed order, so the result does not depend on the number of threads.
/// Points in the same place do not attract each other: the force has no direction there.
///
/// ```
/// # use cd_solve::{gravity::direct::accelerations, math::Vec3};
/// let (a, phi) = accelerations(&[Vec3::zeros(), Vec3::x() * 2.0], &[3.0, 5.0], 1.0);
/// assert_eq!((a[0].x, a[1].x), (5.0 / 4.0, -3.0 / 4.0));
/// assert_eq!((phi[0], phi[1]), (-5.0 / 2.0, -3.0 / 2.0));
/// ```
pub fn accelerations(positions: &[Vec3], masses: &[f64], constant: f64) -> (Vec<Vec3>, Vec<f64>) {
    let sources = Sources::new(positions, masses);
    positions
        .par_iter()
        .with_min_len(16)
        .map(|p| {
            let (attraction, potential) = at_point(&sources, p);
            (attraction * constant, -potential * constant)
        })
        .unzip()
}

fn at_point(sources: &Sources, p: &Vec3) -> (Vec3, f64) {
    let [mut ax, mut ay, mut az, mut sum] = [[0.0; LANES]; 4];
    for k in 0..sources.x.len() {
        let (x, y, z, m) = (&sources.x[k], &sources.y[k], &sources.z[k], &sources.m[k]);
        for lane in 0..LANES {
            let (dx, dy, dz) = (x[lane] - p.x, y[lane] - p.y, z[lane] - p.z);
            let distance2 = dx * dx + dy * dy + dz * dz;
            let inverse = if distance2 > 0.0 { 1.0 / distance2.sqrt() } else { 0.0 };
            let potential = m[lane] * inverse;
            let strength = potential * (inverse * inverse);
            ax[lane] += dx * strength;
            ay[lane] += dy * strength;
            az[lane] += dz * strength;
            sum[lane] += potential;
        }
    }
    let total = |lanes: [f64; LANES]| lanes.iter().sum::<f64>();
    (Vec3::new(total(ax), total(ay), total(az)), total(sum))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(n: usize) -> (Vec<Vec3>, Vec<f64>) {
        let angle = |k: usize, f: f64| (k as f64 * f).sin();
        let positions = (0..n).map(|k| Vec3::new(angle(k, 1.1), angle(k, 2.3), angle(k, 3.7)) * 50.0).collect();
        (positions, (0..n).map(|k| 1.0 + k as f64 % 7.0).collect())
    }

    #[test]
    fn forces_and_torques_sum_to_zero_at_round_off() {
        let (x, m) = cloud(333);
        let (a, _) = accelerations(&x, &m, 6.7e-11);
        let sum: Vec3 = a.iter().zip(&m).map(|(a, m)| a * *m).sum();
        let torque: Vec3 = x.iter().zip(a.iter().zip(&m)).map(|(x, (a, m))| x.cross(&(a * *m))).sum();
        let scale: f64 = a.iter().zip(&m).map(|(a, m)| a.norm() * m).sum();
        assert!(sum.norm() < 1e-15 * scale);
        assert!(torque.norm() < 1e-15 * scale * 50.0); // 50 m is the size of the cloud
    }

    #[test]
    fn virial_of_the_force_is_the_potential_energy() {
        let (x, m) = cloud(100);
        let (a, phi) = accelerations(&x, &m, 2.0);
        let virial: f64 = x.iter().zip(a.iter().zip(&m)).map(|(x, (a, m))| x.dot(a) * m).sum();
        let energy: f64 = 0.5 * phi.iter().zip(&m).map(|(p, m)| p * m).sum::<f64>();
        assert!((virial - energy).abs() < 1e-13 * energy.abs());
    }

    #[test]
    fn coincident_points_and_no_points_stay_finite() {
        assert!(accelerations(&[], &[], 1.0).0.is_empty());
        let (a, phi) = accelerations(&[Vec3::x(), Vec3::x(), Vec3::zeros()], &[1.0; 3], 1.0);
        assert_eq!((a[0], phi[0]), (-Vec3::x(), -1.0));
    }
}
