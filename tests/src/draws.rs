//! Random choices that depend on a seed only.

use cd_solve::math::random::splitmix64;

/// Sequence of random choices.
pub struct Draws(u64);

impl Draws {
    /// Sequence number `number` of a seed.
    pub fn new(seed: u64, number: u64) -> Draws {
        Draws(splitmix64(splitmix64(seed) ^ number))
    }

    /// Number in 0..n; n must not be 0.
    pub fn below(&mut self, n: u64) -> u64 {
        self.0 = splitmix64(self.0);
        // The bias is n / 2^64.
        self.0 % n
    }

    /// Number in [0, 1).
    pub fn share(&mut self) -> f64 {
        self.below(1 << 53) as f64 / (1u64 << 53) as f64
    }

    /// One of the elements.
    pub fn choice<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len() as u64) as usize]
    }
}
