//! Interfaces that lose their stiffness as they open: cohesive zones.

/// Elastic interface with damage between two surfaces, per unit of area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawInterface {
    /// Traction over opening of the sound interface, and shear over sliding, Pa/m.
    pub normal_stiffness: f64,
    pub tangential_stiffness: f64,
    pub damage: DamageLaw,
}

/// Pair of values for opening and for sliding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModePair {
    pub opening: f64,
    pub sliding: f64,
}

/// Evolution of the damage of an interface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DamageLaw {
    /// Parabolic fall from `strength` (Pa), so that a unit of area takes `energy` (J/m²) to break.
    Parabolic { strength: ModePair, energy: ModePair },
    /// Exponential fall from `strength`, broken where the stress has fallen to `rest` of it.
    Exponential { strength: ModePair, energy: ModePair, rest: f64 },
    /// `strength` up to the displacements `plateau` (m), then a linear fall.
    Trapezoidal { strength: ModePair, energy: ModePair, plateau: ModePair },
    /// Adhesion of the energy `energy` (J/m²) that is lost with the viscosity `viscosity` (J s/m²).
    Viscous { energy: f64, viscosity: f64 },
}
