//! Random numbers that are the same on every machine.
//!
//! ChaCha8 by its definition. Conversions use exact arithmetic or `libm` (the same code everywhere), never the platform's
//! mathematics library. Each use draws from a stream of its own, so that one more grain in one group of grains changes
//! nothing in another.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};

/// Purpose of random numbers; each has its own stream in a group of grains.
#[derive(Debug, Clone, Copy)]
pub enum StreamPurpose {
    Sizes = 0,
    Positions = 1,
    Velocity = 2,
    Shape = 3,
}

/// Stream of random numbers.
pub struct RandomStream(ChaCha8Rng);

impl RandomStream {
    /// Stream of `group` (0-based) for `purpose`.
    pub fn new(seed: u64, group: usize, purpose: StreamPurpose) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(4 * group as u64 + purpose as u64);
        RandomStream(generator)
    }

    /// Uniform number in [0, 1), a multiple of 2^-53.
    pub fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform index in 0..n.
    pub fn uniform_index(&mut self, n: usize) -> usize {
        // The bias of the product is n / 2^53: negligible for any n that fits into memory.
        (self.uniform() * n as f64) as usize
    }

    /// Vector with each component uniform in [-1, 1).
    pub fn point_in_cube(&mut self) -> Vector3<f64> {
        let mut draw = || 2.0 * self.uniform() - 1.0;
        let (x, y, z) = (draw(), draw(), draw());
        Vector3::new(x, y, z)
    }

    /// Point uniform in the ball of radius 1.
    pub fn point_in_ball(&mut self) -> Vector3<f64> {
        loop {
            let point = self.point_in_cube();
            if point.norm_squared() <= 1.0 {
                return point;
            }
        }
    }

    /// Unit vector uniform on the sphere.
    pub fn uniform_direction(&mut self) -> Vector3<f64> {
        loop {
            let point = self.point_in_ball();
            let length = point.norm();
            if length > 0.1 {
                return point / length; // closer to 0 the rounding of the length matters
            }
        }
    }

    /// Uniform random rotation: a quaternion with four normal components (Marsaglia 1972).
    pub fn uniform_rotation(&mut self) -> Matrix3<f64> {
        let mut draw = || self.standard_normal();
        let (w, x, y, z) = (draw(), draw(), draw(), draw());
        UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_rotation_matrix().into_inner()
    }

    /// Normal number, mean 0, variance 1 (Box and Muller 1958, one of the pair).
    pub fn standard_normal(&mut self) -> f64 {
        let radius = (-2.0 * libm::log(1.0 - self.uniform())).sqrt(); // 1 - u is never 0
        radius * libm::cos(std::f64::consts::TAU * self.uniform())
    }

    /// Shuffles the items; every order is equally likely (Fisher and Yates).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            items.swap(last, self.uniform_index(last + 1));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stream_is_pinned() {
        // Any change of these values changes every DATBOX made from a seed.
        let mut random = RandomStream::new(1, 0, StreamPurpose::Sizes);
        let drawn: Vec<u64> = (0..3).map(|_| (random.uniform() * 1e6) as u64).collect();
        assert_eq!(drawn, [402485, 80383, 596560]);
        assert_ne!(
            RandomStream::new(1, 0, StreamPurpose::Positions).uniform(),
            RandomStream::new(1, 1, StreamPurpose::Positions).uniform()
        );
    }

    #[test]
    fn turns_favour_no_direction() {
        let mut random = RandomStream::new(6, 0, StreamPurpose::Shape);
        let n = 20_000;
        let turns: Vec<Matrix3<f64>> = (0..n).map(|_| random.uniform_rotation()).collect();
        assert!(
            turns.iter().all(|t| (t * t.transpose() - Matrix3::identity()).amax() < 1e-14 && t.determinant() > 0.0)
        );
        // Entries have mean 0 and variance 1/3; products of different entries mean 0. Five standard errors.
        let bound = 5.0 / (3.0 * n as f64).sqrt();
        let mean: Matrix3<f64> = turns.iter().sum::<Matrix3<f64>>() / n as f64;
        assert!(mean.amax() < bound, "{mean}");
        let squares: Matrix3<f64> = turns.iter().map(|t| t.component_mul(t)).sum::<Matrix3<f64>>() / n as f64;
        assert!((squares - Matrix3::repeat(1.0 / 3.0)).amax() < bound, "{squares}");
        // The trace 1 + 2 cos(angle) of a uniform rotation has mean 0: angle density (1 - cos) / pi.
        let trace = turns.iter().map(|t| t.trace()).sum::<f64>() / n as f64;
        assert!(trace.abs() < 5.0 / (n as f64).sqrt(), "{trace}");
    }

    #[test]
    fn normal_has_mean_0_and_variance_1() {
        let mut random = RandomStream::new(5, 0, StreamPurpose::Velocity);
        let n = 100_000;
        let drawn: Vec<f64> = (0..n).map(|_| random.standard_normal()).collect();
        let mean = drawn.iter().sum::<f64>() / n as f64;
        let variance = drawn.iter().map(|x| x * x).sum::<f64>() / n as f64;
        // Five standard errors: 1/sqrt(n) of the mean, sqrt(2/n) of the variance.
        assert!(mean.abs() < 5.0 / (n as f64).sqrt(), "{mean}");
        assert!((variance - 1.0).abs() < 5.0 * (2.0 / n as f64).sqrt(), "{variance}");
    }
}
