//! The direct sum: every pair, in f64. The reference for any faster method.

use std::ops::Range;

use rayon::prelude::*;

use super::overlap::ball_attraction;
use crate::math::simd::{F64Arithmetic, LaneOperation, SimdWidth};
use crate::math::{PAR_MIN_LEN, Vec3};
use crate::ranks;

/// Number of independent partial sums, added in a fixed order: the result is the same for any vector width.
const PARTIAL_SUMS: usize = 8;

/// Smallest number of bodies that are divided among ranks: the sums of fewer take less than 0.1 ms, and their exchange some
/// 0.02 ms.
const MIN_DIVIDED_BODIES: usize = 256;

/// Positions (m) and masses (kg) of the sources, by columns for the inner loop, padded with masses of zero.
struct SourceColumns {
    x: Vec<[f64; PARTIAL_SUMS]>,
    y: Vec<[f64; PARTIAL_SUMS]>,
    z: Vec<[f64; PARTIAL_SUMS]>,
    m: Vec<[f64; PARTIAL_SUMS]>,
    /// Radii of balls whose overlapping pairs are left out, m; empty for points.
    radius: Vec<[f64; PARTIAL_SUMS]>,
}

impl SourceColumns {
    fn new(positions: &[Vec3], masses: &[f64], radii: &[f64]) -> Self {
        let column = |value: &dyn Fn(usize) -> f64| -> Vec<[f64; PARTIAL_SUMS]> {
            let block = |k: usize| std::array::from_fn(|lane| value(k * PARTIAL_SUMS + lane));
            (0..positions.len().div_ceil(PARTIAL_SUMS)).map(block).collect()
        };
        let coordinate = |i: usize, k: usize| positions.get(i).map_or(0.0, |p| p[k]);
        SourceColumns {
            x: column(&|i| coordinate(i, 0)),
            y: column(&|i| coordinate(i, 1)),
            z: column(&|i| coordinate(i, 2)),
            m: column(&|i| masses.get(i).copied().unwrap_or(0.0)),
            radius: if radii.is_empty() { vec![] } else { column(&|i| radii.get(i).copied().unwrap_or(0.0)) },
        }
    }
}

/// Acceleration (m/s^2) and potential (J/kg, negative) at each point mass due to all others:
/// a_i = G sum_j m_j (x_j - x_i)/|x_j - x_i|^3, phi_i = -G sum_j m_j/|x_j - x_i|.
///
/// Each sum runs over j in one fixed order, so that the result does not depend on the number of threads. It is the force
/// m_i m_j (x_j - x_i)/|x_j - x_i|^3 divided by m_i; the forces on i and j are opposite to the last bit. A body without
/// mass gets the acceleration that a body with mass would. Points at the same position do not attract each other: the
/// force has no direction there.
///
/// ```
/// # use cd_solve::{gravity::direct::accelerations, math::Vec3};
/// let (a, phi) = accelerations(&[Vec3::zeros(), Vec3::x() * 2.0], &[3.0, 5.0], 1.0);
/// assert_eq!((a[0].x, a[1].x), (5.0 / 4.0, -3.0 / 4.0));
/// assert_eq!((phi[0], phi[1]), (-5.0 / 2.0, -3.0 / 2.0));
/// ```
pub fn accelerations(positions: &[Vec3], masses: &[f64], constant: f64) -> (Vec<Vec3>, Vec<f64>) {
    accelerations_at_width(positions, masses, &[], constant, SimdWidth::detect())
}

/// Acceleration (m/s^2) and potential (J/kg) as from [`accelerations`] of homogeneous balls of these `radii`, m: pairs that
/// overlap attract as [`ball_attraction`] says, others as points. `near_pairs`: must have all pairs that overlap;
/// others in it are ignored.
pub fn ball_accelerations(
    positions: &[Vec3],
    masses: &[f64],
    radii: &[f64],
    near_pairs: &[[u32; 2]],
    constant: f64,
) -> (Vec<Vec3>, Vec<f64>) {
    let (mut acceleration, mut potential) =
        accelerations_at_width(positions, masses, radii, constant, SimdWidth::detect());
    for [i, j] in near_pairs.iter().map(|pair| pair.map(|k| k as usize)) {
        let r = positions[j] - positions[i];
        if !balls_overlap(&r, radii[i] + radii[j]) {
            continue;
        }
        let attraction = ball_attraction(&r, [masses[i], masses[j]], [radii[i], radii[j]], constant);
        for (k, force) in [(i, attraction.force), (j, -attraction.force)].into_iter().filter(|(k, _)| masses[*k] > 0.0)
        {
            acceleration[k] += force / masses[k];
            potential[k] += attraction.energy / masses[k];
        }
    }
    (acceleration, potential)
}

/// Whether two balls at the separation `r` overlap, whose radii sum up to `reach` (m): with the arithmetic of the sums,
/// so that each pair is either in them or not.
fn balls_overlap(r: &Vec3, reach: f64) -> bool {
    r.x.mul_add(r.x, r.y.mul_add(r.y, r.z * r.z)) <= reach * reach
}

/// Acceleration (m/s^2) and potential (J/kg) as from [`accelerations`] at the arbitrary positions `targets`, m.
pub fn field_at(targets: &[Vec3], positions: &[Vec3], masses: &[f64], constant: f64) -> (Vec<Vec3>, Vec<f64>) {
    let sources = SourceColumns::new(positions, masses, &[]);
    let attraction_at = |p: &Vec3| source_attraction(SimdWidth::detect(), &sources, p, 1.0, None);
    targets.par_iter().with_min_len(16).map(attraction_at).map(|(a, phi)| (a * constant, phi * constant)).unzip()
}

fn accelerations_at_width(
    positions: &[Vec3],
    masses: &[f64],
    radii: &[f64],
    constant: f64,
    width: SimdWidth,
) -> (Vec<Vec3>, Vec<f64>) {
    // Masses are divided by a power of two near the largest mass, so that no product overflows or underflows; that rounds
    // nothing.
    let largest = masses.iter().fold(0.0, |a: f64, m| a.max(*m));
    let unit = if largest > 0.0 { 2f64.powi(libm::log2(largest).clamp(-1000.0, 1000.0) as i32) } else { 1.0 };
    let masses: Vec<f64> = masses.iter().map(|m| m / unit).collect();
    let sources = SourceColumns::new(positions, &masses, radii);
    let constant = constant * unit;
    let field_at_body = |i: usize| {
        let m = if masses[i] > 0.0 { masses[i] } else { 1.0 };
        let (force, energy) = source_attraction(width, &sources, &positions[i], m, radii.get(i).copied());
        let (acceleration, potential) = (force / m * constant, energy / m * constant);
        [acceleration.x, acceleration.y, acceleration.z, potential]
    };
    let fields_of = |range: Range<usize>| range.into_par_iter().with_min_len(16).map(field_at_body).collect();
    let fields = ranks::divided_list(positions.len(), MIN_DIVIDED_BODIES, fields_of);
    fields.into_par_iter().with_min_len(PAR_MIN_LEN).map(|[x, y, z, potential]| (Vec3::new(x, y, z), potential)).unzip()
}

/// Force on a mass at `p` and its potential energy, without the constant; of a ball of this radius (m) from the sources that it
/// does not overlap.
fn source_attraction(
    width: SimdWidth,
    sources: &SourceColumns,
    p: &Vec3,
    mass: f64,
    radius: Option<f64>,
) -> (Vec3, f64) {
    let [x, y, z, potential] = match radius {
        None => width.run(SourceSums::<false> { sources, p, mass, radius: 0.0 }),
        Some(radius) => width.run(SourceSums::<true> { sources, p, mass, radius }),
    };
    (Vec3::new(x, y, z), -potential)
}

/// Sums of m_p m d/|d|^3 (three components, kg²/m²) and m_p m/|d| (kg²/m) over all sources, with `BALLS` over those that do not overlap the
/// ball of the radius `radius` (m) at p.
struct SourceSums<'a, const BALLS: bool> {
    sources: &'a SourceColumns,
    p: &'a Vec3,
    mass: f64,
    radius: f64,
}

impl<const BALLS: bool> LaneOperation for SourceSums<'_, BALLS> {
    type Output = [f64; 4];
    #[inline(always)]
    fn call<L: F64Arithmetic>(self, l: L) -> [f64; 4] {
        let SourceSums { sources, p, mass, radius } = self;
        let mut parts = [[0.0; PARTIAL_SUMS]; 4];
        let (zero, one, mass, radius) = (l.splat(0.0), l.splat(1.0), l.splat(mass), l.splat(radius));
        let (px, py, pz) = (l.splat(p.x), l.splat(p.y), l.splat(p.z));
        for from in (0..PARTIAL_SUMS).step_by(L::WIDTH) {
            let [mut ax, mut ay, mut az, mut sum] = [zero; 4];
            for k in 0..sources.x.len() {
                let dx = l.sub(l.load(&sources.x[k][from..]), px);
                let dy = l.sub(l.load(&sources.y[k][from..]), py);
                let dz = l.sub(l.load(&sources.z[k][from..]), pz);
                let distance2 = l.mul_add(dx, dx, l.mul_add(dy, dy, l.mul(dz, dz)));
                // Sources at the same position, the body itself included, do not attract.
                let mut nearest = zero;
                if BALLS {
                    let reach = l.add(l.load(&sources.radius[k][from..]), radius);
                    nearest = l.mul(reach, reach);
                }
                let inverse = l.select_greater(distance2, nearest, l.div(one, l.sqrt(distance2)), zero);
                // The product is commutative, hence the same to the last bit with the two exchanged.
                let masses = l.mul(mass, l.load(&sources.m[k][from..]));
                let potential = l.mul(masses, inverse);
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
        let expected = accelerations_at_width(&x, &m, &[], 1.5, SimdWidth::all_widths()[0]);
        for width in SimdWidth::all_widths() {
            assert_eq!(accelerations_at_width(&x, &m, &[], 1.5, width), expected);
        }
    }

    #[test]
    fn two_bodies_pull_each_other_alike_to_the_last_bit() {
        let (x, m) = cloud(61);
        for (i, j) in (0..61).flat_map(|i| (0..i).map(move |j| (i, j))) {
            let on = |i: usize, j: usize| {
                source_attraction(
                    SimdWidth::detect(),
                    &SourceColumns::new(&x[j..=j], &m[j..=j], &[]),
                    &x[i],
                    m[i],
                    None,
                )
            };
            let ((force, energy), (reaction, same)) = (on(i, j), on(j, i));
            assert_eq!((force, energy), (-reaction, same));
        }
    }

    #[test]
    fn masses_of_any_size_pull() {
        for unit in [1e-300, 1e-160, 1.0, 1e160, 1e300] {
            let (a, phi) =
                accelerations(&[Vec3::zeros(), Vec3::x() * 2.0, Vec3::y()], &[3.0 * unit, 5.0 * unit, 0.0], 1.0);
            // Tolerance: four roundings.
            assert!((a[0].x / (1.25 * unit) - 1.0).abs() < 1e-15 && (phi[1] / (-1.5 * unit) - 1.0).abs() < 1e-15);
            assert!((a[2].y + unit * (3.0 + 5.0 / 5f64.powf(1.5))).abs() < 4e-15 * unit);
        }
    }

    #[test]
    fn balls_attract_as_points_unless_they_overlap() {
        let (x, m) = cloud(200);
        let apart: Vec<f64> = vec![1e-6; x.len()];
        let pairs: Vec<[u32; 2]> = (0..200).flat_map(|j| (0..j).map(move |i| [i, j])).collect();
        assert_eq!(ball_accelerations(&x, &m, &apart, &pairs, 1.5), accelerations(&x, &m, 1.5));
        // All overlap: a sum over all pairs.
        let radii: Vec<f64> = (0..x.len()).map(|k| 100.0 + k as f64).collect();
        let (a, phi) = ball_accelerations(&x, &m, &radii, &pairs, 1.5);
        for i in 0..x.len() {
            let mut expected = (Vec3::zeros(), 0.0);
            for j in (0..x.len()).filter(|&j| j != i) {
                let pair = ball_attraction(&(x[j] - x[i]), [m[i], m[j]], [radii[i], radii[j]], 1.5);
                expected = (expected.0 + pair.force / m[i], expected.1 + pair.energy / m[i]);
            }
            // Sums of 200 terms in another order.
            assert!((a[i] - expected.0).norm() < 1e-13 * expected.0.norm().max(1e-3), "{i}");
            assert!((phi[i] - expected.1).abs() < 1e-13 * expected.1.abs(), "{i}");
        }
        let force: Vec3 = a.iter().zip(&m).map(|(a, m)| a * *m).sum();
        assert!(force.norm() < 1e-14 * a.iter().zip(&m).map(|(a, m)| a.norm() * m).sum::<f64>());
    }

    #[test]
    fn coincident_points_and_no_points_stay_finite() {
        assert!(accelerations(&[], &[], 1.0).0.is_empty());
        let (a, phi) = accelerations(&[Vec3::x(), Vec3::x(), Vec3::zeros()], &[1.0; 3], 1.0);
        assert_eq!((a[0], phi[0]), (-Vec3::x(), -1.0));
    }
}
