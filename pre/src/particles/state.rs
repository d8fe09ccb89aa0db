//! Particles of a file.

use nalgebra::Vector3;

use crate::sphere::sphere_volume;

/// Particles of a file in its order, or in that of their numbers; lists that the file does not have are none.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ParticleState {
    /// Centres, m.
    pub centres: Vec<Vector3<f64>>,
    /// m
    pub radii: Option<Vec<f64>>,
    /// m/s
    pub velocities: Option<Vec<Vector3<f64>>>,
    /// Angular velocities, rad/s, fixed axes.
    pub spins: Option<Vec<Vector3<f64>>>,
    /// kg
    pub masses: Option<Vec<f64>>,
    /// Part of the file that was read, as `step 2000`; empty for the whole.
    pub part: String,
}

impl ParticleState {
    /// Largest relative difference of the masses of the file from those of spheres of `density`, kg/m^3; none without masses
    /// or radii.
    pub fn mass_difference(&self, density: f64) -> Option<f64> {
        let (masses, radii) = (self.masses.as_ref()?, self.radii.as_ref()?);
        let difference = |(mass, radius): (&f64, &f64)| (mass / (density * sphere_volume(*radius)) - 1.0).abs();
        masses.iter().zip(radii).map(difference).reduce(f64::max)
    }
}
