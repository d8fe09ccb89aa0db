//! Cohesion per pair: attraction of two bodies by a force that depends on their size, and the strength of a packing of such
//! bodies.

use std::f64::consts::PI;

/// Cohesive force between two bodies: one force for each pair, however many contact points it has. It is no bond: it acts again
/// when bodies that had parted come near.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairCohesion {
    pub strength: PairStrength,
    /// Largest gap at which the whole force acts, m.
    pub full_range: f64,
    /// Gap from which on no force acts, m, at least `full_range`. In between the force falls linearly.
    pub range: f64,
}

/// Parameter from which the force of a pair follows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PairStrength {
    /// Cohesive stress c, Pa, on the area π R².
    Stress(f64),
    /// Van der Waals force of two spheres whose surfaces are kept apart.
    VanDerWaals {
        /// Hamaker constant A, J.
        hamaker: f64,
        /// Distance ζ of the surfaces of bodies that touch, m.
        distance: f64,
    },
}

/// Packing of equal spheres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpherePacking {
    /// Solid fraction ν.
    pub solid_fraction: f64,
    /// Coordination number Z: mean number of contacts of a sphere.
    pub coordination: f64,
    /// Diameter d of the spheres, m.
    pub diameter: f64,
}

impl PairCohesion {
    /// Force at gaps up to `full_range`, N, of two bodies with the effective radius R (m), 1/R = 1/R_a + 1/R_b: c π R² or
    /// A R/(12 ζ²).
    ///
    /// With the diameters of two equal spheres, the second is A d/(48 ζ²). Sources: J.N. Israelachvili, Intermolecular and
    /// Surface Forces (2011), ch. 11, with A R/(6 D²); D.J. Scheeres et al., Icarus 210 (2010) 968-984, who halve it for rough
    /// surfaces.
    ///
    /// ```
    /// use cd_formats::law_table::{PairCohesion, PairStrength};
    /// let pair = |strength| PairCohesion { strength, full_range: 0.0, range: 1e-3 };
    /// assert_eq!(pair(PairStrength::Stress(100.0)).force(0.5), 25.0 * std::f64::consts::PI);
    /// assert_eq!(pair(PairStrength::VanDerWaals { hamaker: 12.0, distance: 2.0 }).force(0.5), 0.125);
    /// ```
    pub fn force(&self, radius: f64) -> f64 {
        match self.strength {
            PairStrength::Stress(stress) => stress * PI * radius * radius,
            PairStrength::VanDerWaals { hamaker, distance } => hamaker * radius / (12.0 * distance * distance),
        }
    }

    /// Factor of the force at a gap (m): 1 up to `full_range`, 0 beyond `range`, linear in between.
    ///
    /// ```
    /// use cd_formats::law_table::{PairCohesion, PairStrength};
    /// let pair = PairCohesion { strength: PairStrength::Stress(1.0), full_range: 0.1, range: 0.3 };
    /// let factors = [-0.1, 0.1, 0.2, 0.4].map(|gap| pair.gap_factor(gap));
    /// assert!((factors[2] - 0.5).abs() < 1e-15);
    /// assert_eq!([factors[0], factors[1], factors[3]], [1.0, 1.0, 0.0]);
    /// ```
    pub fn gap_factor(&self, gap: f64) -> f64 {
        if gap <= self.full_range {
            1.0
        } else if gap <= self.range {
            (self.range - gap) / (self.range - self.full_range)
        } else {
            0.0
        }
    }

    /// Tensile strength of a packing, Pa: ν Z F/(π d²).
    ///
    /// Source: H. Rumpf, Chem. Ing. Tech. 42 (1970) 538-540.
    ///
    /// ```
    /// use cd_formats::law_table::{PairCohesion, PairStrength, SpherePacking};
    /// let pair = PairCohesion { strength: PairStrength::Stress(16.0), full_range: 0.0, range: 1e-3 };
    /// let packing = SpherePacking { solid_fraction: 0.5, coordination: 6.0, diameter: 2.0 };
    /// assert!((pair.bulk_strength(packing) - 3.0).abs() < 1e-14); // ν Z c/16
    /// ```
    pub fn bulk_strength(&self, packing: SpherePacking) -> f64 {
        let SpherePacking { solid_fraction, coordination, diameter } = packing;
        solid_fraction * coordination * self.force(diameter / 4.0) / (PI * diameter * diameter)
    }

    /// Returns a copy with another stress (Pa) or Hamaker constant (J).
    pub fn with_strength_parameter(self, value: f64) -> PairCohesion {
        let strength = match self.strength {
            PairStrength::Stress(_) => PairStrength::Stress(value),
            PairStrength::VanDerWaals { distance, .. } => PairStrength::VanDerWaals { hamaker: value, distance },
        };
        PairCohesion { strength, ..self }
    }

    /// Stress (Pa) or Hamaker constant (J).
    pub fn strength_parameter(&self) -> f64 {
        match self.strength {
            PairStrength::Stress(stress) => stress,
            PairStrength::VanDerWaals { hamaker, .. } => hamaker,
        }
    }
}
