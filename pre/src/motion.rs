//! Initial velocities of a group of grains.

use nalgebra::Vector3;

use crate::random::RandomStream;

/// Rigid motion: v_k = velocity + spin x (x_k - x_c), x_c the centre of mass.
///
/// * `velocity` of the centre of mass, m/s; `spin`, rad/s; fixed axes.
/// * `positions`, m, and `masses`, kg (or any multiple of them), of the grains.
///
/// The grains' own angular velocity is `spin` too.
pub fn rigid_velocities(
    velocity: &Vector3<f64>,
    spin: &Vector3<f64>,
    positions: &[Vector3<f64>],
    masses: &[f64],
) -> Vec<Vector3<f64>> {
    let centre = weighted_mean(positions, masses);
    positions.iter().map(|x| velocity + spin.cross(&(x - centre))).collect()
}

/// Random velocities, m/s: isotropic and normal, with the same distribution for all masses, without net momentum. Their
/// root mean square (of the vector's length, over the grains) is `rms`.
///
/// A single grain gets velocity 0, since it has no net momentum.
pub fn thermal_velocities(rms: f64, masses: &[f64], random: &mut RandomStream) -> Vec<Vector3<f64>> {
    if rms == 0.0 || masses.len() < 2 {
        return vec![Vector3::zeros(); masses.len()];
    }
    let drawn: Vec<_> = masses
        .iter()
        .map(|_| Vector3::new(random.standard_normal(), random.standard_normal(), random.standard_normal()))
        .collect();
    let drift = weighted_mean(&drawn, masses);
    let velocities: Vec<_> = drawn.iter().map(|v| v - drift).collect();
    let mean_square = velocities.iter().map(|v| v.norm_squared()).sum::<f64>() / masses.len() as f64;
    velocities.iter().map(|v| v * (rms / mean_square.sqrt())).collect()
}

/// Mean weighted by mass.
pub fn weighted_mean(vectors: &[Vector3<f64>], masses: &[f64]) -> Vector3<f64> {
    let sum: Vector3<f64> = vectors.iter().zip(masses).map(|(v, m)| v * *m).sum();
    sum / masses.iter().sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::StreamPurpose;

    #[test]
    fn rigid_motion_has_the_momentum_and_the_spin_of_a_rigid_body() {
        let positions: Vec<_> =
            (0..50).map(|k| Vector3::new(k as f64, (k * k % 17) as f64, (k * 7 % 5) as f64)).collect();
        let masses: Vec<f64> = (0..50).map(|k| 1.0 + (k % 3) as f64).collect();
        let (velocity, spin) = (Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.1, 0.2, -0.3));
        let velocities = rigid_velocities(&velocity, &spin, &positions, &masses);
        // Round-off of sums of 50 terms of about 100.
        assert!((weighted_mean(&velocities, &masses) - velocity).norm() < 1e-12);
        for (i, j) in [(0, 7), (3, 49)] {
            let (dx, dv) = (positions[i] - positions[j], velocities[i] - velocities[j]);
            assert!((dv - spin.cross(&dx)).norm() < 1e-13);
        }
    }

    #[test]
    fn thermal_motion_has_its_rms_and_no_momentum() {
        let masses: Vec<f64> = (0..1000).map(|k| 1.0 + (k % 10) as f64).collect();
        let velocities = thermal_velocities(0.3, &masses, &mut RandomStream::new(4, 0, StreamPurpose::Velocity));
        let mean_square = velocities.iter().map(|v| v.norm_squared()).sum::<f64>() / 1000.0;
        assert!((mean_square.sqrt() - 0.3).abs() < 1e-14);
        assert!(weighted_mean(&velocities, &masses).norm() < 1e-15);
        assert_eq!(
            thermal_velocities(0.3, &[1.0], &mut RandomStream::new(4, 0, StreamPurpose::Velocity)),
            [Vector3::zeros()]
        );
    }
}
