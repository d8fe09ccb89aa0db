//! Models with which the program is built.

/// Whether the program is built for spheres and plates alone, without self-gravity, cohesion or rolling resistance, to
/// measure what these cost other scenes. Such a build rejects scenes that have them.
pub const BARE: bool = cfg!(feature = "bare");
