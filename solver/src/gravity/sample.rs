//! Error of self-gravity in the present state, measured on a few bodies by direct sum.

use super::direct;
use crate::math::Vec3;
use crate::math::random::splitmix64;

/// Largest number of sampled bodies.
const SAMPLED_BODIES: u64 = 64;

/// Errors relative to the direct sum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampledError {
    /// RMS error sqrt(sum |da|^2 / sum |a|^2).
    pub rms: f64,
    /// Largest |da|/|a|.
    pub largest: f64,
    /// Error of the virial, which the pressure balances: sum m x·da / |sum m x·a|, x from the centre of mass.
    pub virial: f64,
    /// Number of sampled bodies.
    pub bodies: usize,
}

/// Compares accelerations with the direct sum on bodies selected by `seed`, the same ones on every machine.
pub fn sampled_error(
    positions: &[Vec3],
    masses: &[f64],
    constant: f64,
    acceleration: &[Vec3],
    seed: u64,
) -> SampledError {
    if positions.is_empty() {
        return SampledError { rms: 0.0, largest: 0.0, virial: 0.0, bodies: 0 };
    }
    let sampled: Vec<usize> = (0..SAMPLED_BODIES.min(positions.len() as u64))
        .map(|k| (splitmix64(seed.wrapping_mul(SAMPLED_BODIES).wrapping_add(k)) % positions.len() as u64) as usize)
        .collect();
    let targets: Vec<Vec3> = sampled.iter().map(|&i| positions[i]).collect();
    let (exact, _) = direct::field_at(&targets, positions, masses, constant);
    let mass: f64 = masses.iter().sum();
    let centre: Vec3 = positions.iter().zip(masses).map(|(x, m)| x * (m / mass)).sum();
    let (mut error_sum, mut acceleration_sum, mut largest) = (0.0, 0.0, 0.0f64);
    let (mut virial, mut virial_error) = (0.0, 0.0);
    for (&i, exact) in sampled.iter().zip(&exact) {
        let arm = (positions[i] - centre) * masses[i];
        virial += arm.dot(exact);
        virial_error += arm.dot(&(acceleration[i] - exact));
        let error2 = (acceleration[i] - exact).norm_squared();
        error_sum += error2;
        acceleration_sum += exact.norm_squared();
        if exact.norm_squared() > 0.0 {
            largest = largest.max((error2 / exact.norm_squared()).sqrt());
        }
    }
    let ratio =
        |error_sum: f64, acceleration_sum: f64| if acceleration_sum > 0.0 { error_sum / acceleration_sum } else { 0.0 };
    SampledError {
        rms: ratio(error_sum, acceleration_sum).sqrt(),
        largest,
        virial: ratio(virial_error, virial.abs()),
        bodies: sampled.len(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_error_that_was_put_in() {
        let positions: Vec<Vec3> =
            (0..500).map(|k| Vec3::new((k as f64).sin(), (1.7 * k as f64).sin(), (2.9 * k as f64).cos())).collect();
        let masses = vec![1.0; positions.len()];
        let (exact, _) = direct::accelerations(&positions, &masses, 2.0);
        let wrong: Vec<Vec3> = exact.iter().map(|a| a * 1.001).collect();
        for seed in 0..3 {
            let found = sampled_error(&positions, &masses, 2.0, &wrong, seed);
            assert!((found.virial + 1e-3).abs() < 1e-12, "{found:?}"); // pulls inwards
            assert!((found.rms - 1e-3).abs() < 1e-12 && (found.largest - 1e-3).abs() < 1e-12, "{found:?}");
            assert_eq!(
                sampled_error(&positions, &masses, 2.0, &exact, seed),
                SampledError { rms: 0.0, largest: 0.0, virial: 0.0, bodies: SAMPLED_BODIES as usize }
            );
        }
    }
}
