//! Random numbers that depend only on their seed: the same on every machine, in every order of drawing.

use super::Vec3;

/// Pseudorandom number for a seed.
///
/// Source: S. Vigna, splitmix64 (2015), public domain.
pub fn splitmix64(seed: u64) -> u64 {
    let z = seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Point for `seed`, uniformly distributed in the ball of radius 1.
pub fn point_in_ball(seed: u64) -> Vec3 {
    let mut bits = seed;
    let mut draw = || {
        bits = splitmix64(bits);
        (bits >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    loop {
        let point = Vec3::new(draw(), draw(), draw());
        if point.norm_squared() <= 1.0 {
            return point;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Mat3;

    #[test]
    fn points_fill_the_ball_evenly() {
        let n = 100_000;
        let points: Vec<Vec3> = (0..n).map(|seed| point_in_ball(splitmix64(seed))).collect();
        let mean = points.iter().sum::<Vec3>() / n as f64;
        let second: Mat3 = points.iter().map(|p| p * p.transpose()).sum::<Mat3>() / n as f64;
        // Each component has mean 0 and variance 1/5, its square a variance below 1/20: five standard errors.
        assert!(mean.amax() < 5.0 * (0.2 / n as f64).sqrt(), "{mean}");
        assert!((second - Mat3::identity() / 5.0).amax() < 5.0 * (0.05 / n as f64).sqrt(), "{second}");
        // The share of points within r is r^3; five standard errors of a share of an eighth.
        let inner = points.iter().filter(|p| p.norm() < 0.5).count() as f64 / n as f64;
        assert!((inner - 0.125).abs() < 5.0 * (0.125 * 0.875 / n as f64).sqrt(), "{inner}");
    }
}
