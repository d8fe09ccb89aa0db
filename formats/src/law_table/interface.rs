//! Interfaces that lose their stiffness as they open: cohesive zones.

use crate::names::{number_text, rounded_number};

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

/// Parameter of an interface that contradicts others; `sliding` is the mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InterfaceParameter {
    Energy { sliding: bool },
    Plateau { sliding: bool },
    Rest,
}

impl LawInterface {
    /// Parameters with which the stress would not fall continuously from its strength to 0, each with the value found and the
    /// values expected.
    pub fn contradictions(&self) -> Vec<(InterfaceParameter, String, String)> {
        let mut found = Vec::new();
        let modes = |pair: ModePair| [(false, pair.opening), (true, pair.sliding)];
        let stiffness = |sliding: bool| if sliding { self.tangential_stiffness } else { self.normal_stiffness };
        let (strength, energy, plateau, rest) = match self.damage {
            DamageLaw::Viscous { .. } => return found,
            DamageLaw::Parabolic { strength, energy } => (strength, energy, None, None),
            DamageLaw::Exponential { strength, energy, rest } => (strength, energy, None, Some(rest)),
            DamageLaw::Trapezoidal { strength, energy, plateau } => (strength, energy, Some(plateau), None),
        };
        for ((sliding, strength), (_, energy)) in modes(strength).into_iter().zip(modes(energy)) {
            // Displacement of the sound interface at its strength, and the energy taken up to the fall.
            let elastic = strength / stiffness(sliding);
            let start = plateau.map_or(elastic, |plateau| if sliding { plateau.sliding } else { plateau.opening });
            if start < elastic {
                let expected = format!("at least strength over stiffness, {} m", rounded_number(elastic));
                found.push((InterfaceParameter::Plateau { sliding }, number_text(start), expected));
            }
            let energy_before_falling = strength * (start.max(elastic) - 0.5 * elastic);
            if energy <= energy_before_falling {
                let expected = format!(
                    "more than {} J/m², which the interface takes before its stress falls",
                    rounded_number(energy_before_falling)
                );
                found.push((InterfaceParameter::Energy { sliding }, number_text(energy), expected));
            }
        }
        if let Some(rest) = rest.filter(|rest| *rest >= 1.0) {
            found.push((InterfaceParameter::Rest, number_text(rest), "less than 1".into()));
        }
        found
    }
}
