//! Bench: Newtonian attraction among point masses.

pub mod direct;
