//! Interfaces that lose their stiffness as they open (cohesive zones): their parameters, and which of these contradict each
//! other. The solver computes with them in `solver/src/laws/interface.rs`.

use crate::names::{number_text, rounded_number};

/// Elastic interface with damage between two surfaces, per unit of area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawInterface {
    /// Ratio of traction to opening of the sound interface, Pa/m.
    pub normal_stiffness: f64,
    /// Ratio of shear stress to sliding of the sound interface, Pa/m.
    pub tangential_stiffness: f64,
    pub damage: DamageLaw,
}

/// Deformation of an interface: along the normal, or in the tangent plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InterfaceMode {
    Opening,
    Sliding,
}

/// Value of each mode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModePair {
    pub opening: f64,
    pub sliding: f64,
}

impl ModePair {
    fn value(self, mode: InterfaceMode) -> f64 {
        match mode {
            InterfaceMode::Opening => self.opening,
            InterfaceMode::Sliding => self.sliding,
        }
    }
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
    /// Adhesion of `energy` (J/m²), lost against `viscosity` (J s/m²).
    Viscous { energy: f64, viscosity: f64 },
}

/// Parameter of an interface that may contradict others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InterfaceParameter {
    Energy(InterfaceMode),
    Plateau(InterfaceMode),
    Rest,
}

/// Parameter of an interface that contradicts others.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InterfaceFault {
    pub parameter: InterfaceParameter,
    pub found: String,
    /// Values that are expected, without the word.
    pub expected: String,
}

impl LawInterface {
    /// Parameters with which the stress would not fall continuously from its strength to 0.
    pub fn contradictions(&self) -> Vec<InterfaceFault> {
        let mut faults = Vec::new();
        let (strength, energy, plateau, rest) = match self.damage {
            DamageLaw::Viscous { .. } => return faults,
            DamageLaw::Parabolic { strength, energy } => (strength, energy, None, None),
            DamageLaw::Exponential { strength, energy, rest } => (strength, energy, None, Some(rest)),
            DamageLaw::Trapezoidal { strength, energy, plateau } => (strength, energy, Some(plateau), None),
        };
        let stiffness = ModePair { opening: self.normal_stiffness, sliding: self.tangential_stiffness };
        for mode in [InterfaceMode::Opening, InterfaceMode::Sliding] {
            let (strength, energy) = (strength.value(mode), energy.value(mode));
            // Displacement at which the stress of the sound interface reaches the strength, and that at which it falls.
            let elastic_limit = strength / stiffness.value(mode);
            let fall_start = plateau.map_or(elastic_limit, |plateau| plateau.value(mode));
            if fall_start < elastic_limit {
                faults.push(InterfaceFault {
                    parameter: InterfaceParameter::Plateau(mode),
                    found: number_text(fall_start),
                    expected: format!("at least strength over stiffness, {} m", rounded_number(elastic_limit)),
                });
            }
            // Area below the stress up to the fall: a triangle to the elastic limit, then a rectangle.
            let energy_before_falling = strength * (fall_start.max(elastic_limit) - 0.5 * elastic_limit);
            if energy <= energy_before_falling {
                faults.push(InterfaceFault {
                    parameter: InterfaceParameter::Energy(mode),
                    found: number_text(energy),
                    expected: format!(
                        "more than {} J/m², which the interface takes before its stress falls",
                        rounded_number(energy_before_falling)
                    ),
                });
            }
        }
        if let Some(rest) = rest.filter(|rest| *rest >= 1.0) {
            faults.push(InterfaceFault {
                parameter: InterfaceParameter::Rest,
                found: number_text(rest),
                expected: "less than 1".into(),
            });
        }
        faults
    }
}
