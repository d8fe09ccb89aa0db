//! Radii of grains, drawn by inverting their distribution function.
//!
//! | sizes | share of grains smaller than r, min <= r <= max |
//! |---|---|
//! | Uniform | (r - min) / (max - min) |
//! | PowerLaw | (1 - (r/min)^-exponent) / (1 - (max/min)^-exponent) |
//! | LogNormal | (P(z(r)) - P(z(min))) / (P(z(max)) - P(z(min))), z(r) = ln(r/median) / sigma, P the standard normal |

use crate::random::RandomStream;
use crate::rounding::round_8_digits;
use crate::scene::SizeDistribution;

/// Largest number of bodies: body numbers have seven digits in the files.
pub const MAX_BODIES: usize = 9_999_999;

/// Stop criterion of the sampling.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SampleTarget {
    /// Number of grains.
    Number(usize),
    /// Total volume, m^3, met as closely as whole grains allow. The sampling also stops with one grain more than
    /// [`MAX_BODIES`].
    Volume(f64),
}

impl SizeDistribution {
    /// Smallest and largest radius, m.
    pub fn radius_range(&self) -> (f64, f64) {
        match self {
            SizeDistribution::Single(radius) => (*radius, *radius),
            SizeDistribution::Uniform { min, max }
            | SizeDistribution::PowerLaw { min, max, .. }
            | SizeDistribution::LogNormal { min, max, .. } => (*min, *max),
            SizeDistribution::List(radii) => radii.iter().fold((f64::INFINITY, 0.0), |(a, b), &r| (r.min(a), r.max(b))),
        }
    }

    /// Distribution function: fraction of the grains with radii below `radius`, m.
    ///
    /// ```
    /// use cd_pre::scene::SizeDistribution;
    /// // The number larger than r falls as 1/r: (1 - 1/1.5) / (1 - 1/2) of the grains are smaller than 1.5.
    /// let sizes = SizeDistribution::PowerLaw { min: 1.0, max: 2.0, exponent: 1.0 };
    /// assert!((sizes.share_below(1.5) - 2.0 / 3.0).abs() < 1e-15);
    /// ```
    pub fn share_below(&self, radius: f64) -> f64 {
        let (min, max) = self.radius_range();
        if radius <= min || radius > max {
            return if radius <= min { 0.0 } else { 1.0 };
        }
        match self {
            SizeDistribution::Single(_) => 1.0,
            SizeDistribution::Uniform { .. } => (radius - min) / (max - min),
            SizeDistribution::PowerLaw { exponent, .. } => {
                if is_nearly_log_uniform(*exponent, min, max) {
                    let log_of_power = |r: f64| -exponent * libm::log(r / min);
                    return libm::expm1(log_of_power(radius)) / libm::expm1(log_of_power(max));
                }
                (1.0 - libm::pow(radius / min, -exponent)) / (1.0 - libm::pow(max / min, -exponent))
            }
            SizeDistribution::LogNormal { median, sigma, .. } => {
                let share = |r: f64| normal_share(libm::log(r / median) / sigma);
                (share(radius) - share(min)) / (share(max) - share(min))
            }
            SizeDistribution::List(radii) => radii.iter().filter(|&&r| r < radius).count() as f64 / radii.len() as f64,
        }
    }

    /// Radius, m, below which the fraction `u` in [0, 1) of the grains is: inverse of [`SizeDistribution::share_below`].
    fn quantile(&self, u: f64) -> f64 {
        let (min, max) = self.radius_range();
        match self {
            SizeDistribution::Single(radius) => *radius,
            SizeDistribution::Uniform { .. } => min + u * (max - min),
            SizeDistribution::PowerLaw { exponent, .. } if is_nearly_log_uniform(*exponent, min, max) => {
                let power_less_one = libm::expm1(-exponent * libm::log(max / min));
                min * libm::exp(-libm::log1p(u * power_less_one) / exponent)
            }
            SizeDistribution::PowerLaw { exponent, .. } => {
                min * libm::pow(1.0 - u * (1.0 - libm::pow(max / min, -exponent)), -1.0 / exponent)
            }
            SizeDistribution::LogNormal { .. } => self.quantile_by_bisection(u),
            SizeDistribution::List(radii) => radii[((u * radii.len() as f64) as usize).min(radii.len() - 1)],
        }
    }

    /// Inverts the distribution function by bisection to its last bits.
    fn quantile_by_bisection(&self, u: f64) -> f64 {
        let (mut low, mut high) = self.radius_range();
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.share_below(middle) <= u { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    /// Grains that `make_grain` makes from sampled radii, m, rounded to the digits of the files.
    ///
    /// A `List` gives all its radii, whatever `target` is, in a random order, or in its own with `in_order`; any other
    /// distribution uses one random number a grain. `make_grain` gets a radius from here always: `None` stands for the own
    /// size of a shape, for grains without sizes. `volume`: volume of a grain, m^3. Errors: the first error of `make_grain`.
    pub fn sample_radii<T, E>(
        &self,
        target: SampleTarget,
        in_order: bool,
        random: &mut RandomStream,
        mut make_grain: impl FnMut(Option<f64>) -> Result<T, E>,
        volume: fn(&T) -> f64,
    ) -> Result<Vec<T>, E> {
        if let SizeDistribution::List(radii) = self {
            let mut radii: Vec<f64> = radii.iter().copied().map(round_8_digits).collect();
            if !in_order {
                random.shuffle(&mut radii);
            }
            return radii.into_iter().map(|radius| make_grain(Some(radius))).collect();
        }
        let (min, max) = self.radius_range();
        let mut next_grain = || make_grain(Some(round_8_digits(self.quantile(random.uniform()).clamp(min, max))));
        match target {
            SampleTarget::Number(number) => (0..number).map(|_| next_grain()).collect(),
            SampleTarget::Volume(target_volume) => {
                let (mut grains, mut total_volume) = (Vec::new(), 0.0);
                loop {
                    let grain = next_grain()?;
                    // The last grain is added if that brings the volume closer to the target.
                    if total_volume + 0.5 * volume(&grain) > target_volume || grains.len() > MAX_BODIES {
                        return Ok(grains);
                    }
                    total_volume += volume(&grain);
                    grains.push(grain);
                }
            }
        }
    }
}

/// Whether (max/min)^exponent is so near to 1 that the difference loses digits: radii are then almost uniform in their
/// logarithm.
fn is_nearly_log_uniform(exponent: f64, min: f64, max: f64) -> bool {
    exponent * libm::log(max / min) < 1e-6
}

/// Share of the standard normal distribution below `z`; keeps relative precision in the lower tail.
pub fn normal_share(z: f64) -> f64 {
    0.5 * libm::erfc(-z * std::f64::consts::FRAC_1_SQRT_2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::StreamPurpose;
    use crate::sphere::sphere_volume;
    use proptest::prelude::*;

    fn draw(sizes: &SizeDistribution, number: usize, seed: u64) -> Vec<f64> {
        radii(sizes, SampleTarget::Number(number), false, seed)
    }

    fn radii(sizes: &SizeDistribution, until: SampleTarget, in_order: bool, seed: u64) -> Vec<f64> {
        let mut random = RandomStream::new(seed, 0, StreamPurpose::Sizes);
        let next = |radius: Option<f64>| radius.ok_or(());
        sizes.sample_radii(until, in_order, &mut random, next, |radius| sphere_volume(*radius)).unwrap()
    }

    /// Largest distance between the drawn and the stated distribution (Kolmogorov and Smirnov).
    fn distance(sizes: &SizeDistribution, mut radii: Vec<f64>) -> f64 {
        radii.sort_by(f64::total_cmp);
        let n = radii.len() as f64;
        let gap = |(k, &r): (usize, &f64)| {
            let share = sizes.share_below(r);
            (share - k as f64 / n).abs().max((share - (k + 1) as f64 / n).abs())
        };
        radii.iter().enumerate().map(gap).fold(0.0, f64::max)
    }

    fn continuous() -> Vec<SizeDistribution> {
        vec![
            SizeDistribution::Uniform { min: 8.0, max: 12.0 },
            SizeDistribution::PowerLaw { min: 1.0, max: 10.0, exponent: 2.5 },
            SizeDistribution::PowerLaw { min: 1e-3, max: 2e-3, exponent: 0.1 },
            SizeDistribution::PowerLaw { min: 1.0, max: 10.0, exponent: 1e-17 },
            SizeDistribution::LogNormal { median: 1.0, sigma: 0.5, min: 0.4, max: 3.0 },
            SizeDistribution::LogNormal { median: 1.0, sigma: 0.2, min: 1.5, max: 2.5 },
        ]
    }

    #[test]
    fn drawn_radii_follow_their_distribution() {
        let n = 20_000;
        for (seed, sizes) in continuous().iter().enumerate() {
            // A true distribution exceeds 2.23/sqrt(n) once in 10^4 seeds (2 exp(-2 x^2)); the seeds are fixed.
            let bound = 2.23 / (n as f64).sqrt();
            let found = distance(sizes, draw(sizes, n, seed as u64));
            assert!(found < bound, "{sizes:?}: {found} >= {bound}");
        }
    }

    #[test]
    fn distribution_functions_at_points_known_by_hand() {
        let power = SizeDistribution::PowerLaw { min: 1.0, max: 2.0, exponent: 1.0 };
        // N(>r) ~ 1/r: (1 - 1/1.5) / (1 - 1/2) = 2/3; exact but for the rounding of pow.
        assert!((power.share_below(1.5) - 2.0 / 3.0).abs() < 1e-15);
        let log_normal = SizeDistribution::LogNormal { median: 3.0, sigma: 0.7, min: 1.0, max: 9.0 };
        // The cut-offs lie at equal distance of the median in ln r, so half of the grains are smaller.
        assert!((log_normal.share_below(3.0) - 0.5).abs() < 1e-15);
        assert!((normal_share(1.0) - 0.841_344_746_068_542_9).abs() < 1e-15);
    }

    #[test]
    fn volume_is_reached_to_half_a_grain() {
        let sizes = SizeDistribution::Uniform { min: 0.5, max: 1.5 };
        let radii = radii(&sizes, SampleTarget::Volume(1000.0), false, 3);
        let sum: f64 = radii.iter().copied().map(sphere_volume).sum();
        assert!((sum - 1000.0).abs() <= 0.5 * sphere_volume(1.5), "{sum}");
    }

    #[test]
    fn lists_keep_all_their_radii() {
        let list = SizeDistribution::List((1..=50).map(f64::from).collect());
        let mut shuffled = draw(&list, 0, 1);
        assert_ne!(SizeDistribution::List(shuffled.clone()), list);
        shuffled.sort_by(f64::total_cmp);
        assert_eq!(SizeDistribution::List(shuffled), list);
        assert_eq!(SizeDistribution::List(radii(&list, SampleTarget::Number(0), true, 1)), list);
    }

    proptest! {
        #[test]
        fn quantile_inverts_the_distribution(u in 0.0..1.0f64, which in 0..6usize) {
            let sizes = &continuous()[which];
            let (min, max) = sizes.radius_range();
            let radius = sizes.quantile(u);
            prop_assert!(radius >= min * (1.0 - 1e-15) && radius <= max * (1.0 + 1e-15));
            // Round-off of two evaluations, times the steepest slope of these distributions (about 10).
            prop_assert!((sizes.share_below(radius) - u).abs() < 1e-12);
        }
    }
}
