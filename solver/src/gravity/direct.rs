//! The direct sum: every pair, in f64. The reference for any faster method.

use pulp::NullaryFnOnce;
use rayon::prelude::*;

use crate::math::Vec3;
use crate::math::lanes::{Lanes, Width};

/// Independent sums, added up in a fixed order: the result is the same for any width of arithmetic.
const SUMS: usize = 8;

/// Positions and masses laid out for the inner loop, padded with masses of zero.
struct Sources {
    x: Vec<[f64; SUMS]>,
    y: Vec<[f64; SUMS]>,
    z: Vec<[f64; SUMS]>,
    m: Vec<[f64; SUMS]>,
}

impl Sources {
    fn new(positions: &[Vec3], masses: &[f64]) -> Self {
        let column = |value: &dyn Fn(usize) -> f64| -> Vec<[f64; SUMS]> {
            let block = |k: usize| std::array::from_fn(|lane| value(k * SUMS + lane));
            (0..positions.len().div_ceil(SUMS)).map(block).collect()
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
    at(positions, positions, masses, constant)
}

/// The same at any places.
pub fn at(places: &[Vec3], positions: &[Vec3], masses: &[f64], constant: f64) -> (Vec<Vec3>, Vec<f64>) {
    at_width(places, positions, masses, constant, Width::detect())
}

fn at_width(places: &[Vec3], positions: &[Vec3], masses: &[f64], constant: f64, width: Width) -> (Vec<Vec3>, Vec<f64>) {
    let sources = Sources::new(positions, masses);
    places
        .par_iter()
        .with_min_len(16)
        .map(|p| {
            let [x, y, z, potential] = match width {
                Width::One(lanes) => sums(lanes, &sources, p),
                #[cfg(target_arch = "x86_64")]
                Width::Four(lanes) => sums(lanes, &sources, p),
                #[cfg(target_arch = "x86_64")]
                Width::Eight(lanes) => sums(lanes, &sources, p),
            };
            (Vec3::new(x, y, z) * constant, -potential * constant)
        })
        .unzip()
}

/// Sums of m d/|d|^3 (three components) and m/|d| over all sources.
fn sums<L: Lanes>(lanes: L, sources: &Sources, p: &Vec3) -> [f64; 4] {
    struct Op<'a, L> {
        l: L,
        sources: &'a Sources,
        p: &'a Vec3,
    }
    impl<L: Lanes> NullaryFnOnce for Op<'_, L> {
        type Output = [f64; 4];
        #[inline(always)]
        fn call(self) -> [f64; 4] {
            let Op { l, sources, p } = self;
            let mut parts = [[0.0; SUMS]; 4];
            let (zero, one) = (l.splat(0.0), l.splat(1.0));
            let (px, py, pz) = (l.splat(p.x), l.splat(p.y), l.splat(p.z));
            for from in (0..SUMS).step_by(L::WIDTH) {
                let [mut ax, mut ay, mut az, mut sum] = [zero; 4];
                for k in 0..sources.x.len() {
                    let dx = l.sub(l.load(&sources.x[k][from..]), px);
                    let dy = l.sub(l.load(&sources.y[k][from..]), py);
                    let dz = l.sub(l.load(&sources.z[k][from..]), pz);
                    let distance2 = l.mul_add(dx, dx, l.mul_add(dy, dy, l.mul(dz, dz)));
                    // The same place, the body itself among them, attracts nowhere.
                    let inverse = l.select_greater(distance2, zero, l.div(one, l.sqrt(distance2)), zero);
                    let potential = l.mul(l.load(&sources.m[k][from..]), inverse);
                    let strength = l.mul(potential, l.mul(inverse, inverse));
                    ax = l.mul_add(dx, strength, ax);
                    ay = l.mul_add(dy, strength, ay);
                    az = l.mul_add(dz, strength, az);
                    sum = l.add(sum, potential);
                }
                l.store(&mut parts[0][from..], ax);
                l.store(&mut parts[1][from..], ay);
                l.store(&mut parts[2][from..], az);
                l.store(&mut parts[3][from..], sum);
            }
            parts.map(|part| part.iter().sum())
        }
    }
    lanes.run(Op { l: lanes, sources, p })
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
    fn all_widths_give_the_same_bits() {
        let (x, m) = cloud(61);
        let expected = at_width(&x, &x, &m, 1.5, Width::all()[0]);
        for width in Width::all() {
            assert_eq!(at_width(&x, &x, &m, 1.5, width), expected);
        }
    }

    #[test]
    fn coincident_points_and_no_points_stay_finite() {
        assert!(accelerations(&[], &[], 1.0).0.is_empty());
        let (a, phi) = accelerations(&[Vec3::x(), Vec3::x(), Vec3::zeros()], &[1.0; 3], 1.0);
        assert_eq!((a[0], phi[0]), (-Vec3::x(), -1.0));
    }
}
