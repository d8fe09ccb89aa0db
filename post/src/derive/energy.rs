//! Kinetic and potential energies.

use cd_formats::field::FieldModel;
use rayon::prelude::*;

use crate::derive::gravity::GravityTree;
use crate::frame::{Frame, Grain};
use crate::math::Vec3;

/// Kinetic energy, J.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct KineticEnergy {
    /// m v^2 / 2.
    pub translation: f64,
    /// w.(I w) / 2.
    pub rotation: f64,
}

impl KineticEnergy {
    /// A ball of 2 kg at 3 m/s has 9 J of translation; with radius 1 m and 5 rad/s about any axis, 10 J of rotation.
    pub fn of_grain(grain: &Grain) -> Self {
        KineticEnergy {
            translation: 0.5 * grain.mass * grain.v.norm_squared(),
            rotation: 0.5 * grain.w.dot(&(grain.inertia * grain.w)),
        }
    }

    /// Sums over all grains.
    pub fn of_grains(grains: &[Grain]) -> Self {
        grains.iter().map(Self::of_grain).fold(Self::default(), |sum, energy| KineticEnergy {
            translation: sum.translation + energy.translation,
            rotation: sum.rotation + energy.rotation,
        })
    }

    /// Energy of translation and rotation, J.
    pub fn total(&self) -> f64 {
        self.translation + self.rotation
    }
}

/// G of the snapshot, m^3 kg^-1 s^-2, if the grains attract each other.
pub fn self_gravity_constant(frame: &Frame) -> Option<f64> {
    let parameters = &frame.meta.parameters;
    parameters.self_gravity.then_some(parameters.gravity_constant)
}

/// Fields that act from outside, except uniform gravity.
pub fn external_fields(frame: &Frame) -> Vec<FieldModel> {
    let meta = &frame.meta;
    let (fields, gravity_constant) = (&meta.parameters.fields, meta.parameters.gravity_constant);
    FieldModel::from_fields(fields, &frame.field_shapes, gravity_constant, meta.time, meta.primary_response.as_ref())
}

/// Potential energy in external fields, J: sum m_i phi(x_i), [`FieldModel::acceleration_and_potential`], and the
/// contribution of the grains' extent, [`FieldModel::tidal_energy`].
pub fn field_energy(grains: &[Grain], fields: &[FieldModel]) -> f64 {
    let energy = |g: &Grain, field: &FieldModel| {
        g.mass * field.acceleration_and_potential(&g.x).1 + field.tidal_energy(|rate| g.inertia * rate)
    };
    // 0 without fields, not the -0 of an empty sum.
    grains.iter().flat_map(|g| fields.iter().map(move |field| energy(g, field))).fold(0.0, |sum, term| sum + term)
}

/// Method of summing potential energies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PairSummation {
    /// Every pair up to [`MAX_DIRECT_POINTS`] points, a [`GravityTree`] beyond, to a part in 10^4.
    #[default]
    Fast,
    /// Every pair.
    Direct,
}

/// Number of points up to which every pair is summed in a tenth of a second.
pub const MAX_DIRECT_POINTS: usize = 10_000;

/// Potential energy of points that attract each other, J: W = - sum_{i<j} G m_i m_j / |x_i - x_j|.
///
/// `points`: position in m and mass in kg of each; `constant`: G, m^3 kg^-1 s^-2.
/// A uniform ball of mass M and radius R cut into many points tends to -3 G M^2 / 5 R.
pub fn gravitational_energy(points: impl Iterator<Item = (Vec3, f64)>, constant: f64, summation: PairSummation) -> f64 {
    let points: Vec<(Vec3, f64)> = points.collect();
    match summation {
        PairSummation::Fast if points.len() > MAX_DIRECT_POINTS => GravityTree::new(&points).potential_energy(constant),
        _ => direct_energy(&points, constant),
    }
}

/// [`gravitational_energy`] over every pair, in an order that does not depend on the number of threads.
pub fn direct_energy(points: &[(Vec3, f64)], constant: f64) -> f64 {
    let points: Vec<[f64; 4]> = points.iter().map(|(x, m)| [x.x, x.y, x.z, *m]).collect();
    let sums: Vec<f64> =
        (0..points.len()).into_par_iter().map(|i| points[i][3] * inverse_distances(&points[..i], points[i])).collect();
    -constant * sums.iter().sum::<f64>()
}

/// sum_j m_j / |x_j - x|, without points at the same position; independent lanes let the compiler use vector instructions.
fn inverse_distances(sources: &[[f64; 4]], [x, y, z, _]: [f64; 4]) -> f64 {
    const LANES: usize = 8;
    let term = |s: &[f64; 4]| {
        let (dx, dy, dz) = (s[0] - x, s[1] - y, s[2] - z);
        let square = dx * dx + dy * dy + dz * dz;
        if square > 0.0 { s[3] / square.sqrt() } else { 0.0 }
    };
    let chunks = sources.chunks_exact(LANES);
    let rest: f64 = chunks.remainder().iter().map(term).sum();
    let mut lanes = [0.0; LANES];
    for chunk in chunks {
        for (lane, source) in lanes.iter_mut().zip(chunk) {
            *lane += term(source);
        }
    }
    lanes.iter().sum::<f64>() + rest
}

/// Potential energy in a uniform gravity g, J: - sum m_i g.x_i, zero for a grain at the origin; of the grains themselves,
/// wherever their images are.
pub fn uniform_gravity_energy(grains: &[Grain], gravity: Vec3) -> f64 {
    // Without gravity 0, not the -0 that the sum would give.
    if gravity == Vec3::zeros() {
        0.0
    } else {
        -grains.iter().map(|g| g.mass * gravity.dot(&(g.x - g.cell_shift))).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;

    #[test]
    fn kinetic_energy_of_translation_and_rotation() {
        let mut scene = Scene::default();
        let ball = scene.grain([0.0; 3], 1.0);
        scene.snapshot.bodies.body_mass[ball] = 2.0;
        scene.snapshot.bodies.body_inertia[ball] = [0.8; 3];
        scene.snapshot.bodies.body_v[ball] = [1.0, 2.0, -2.0];
        scene.snapshot.bodies.body_w_world[ball] = [0.0, 3.0, -4.0];
        scene.grain([0.0; 3], 1.0); // at rest
        let expected = KineticEnergy { translation: 9.0, rotation: 10.0 };
        assert_eq!(KineticEnergy::of_grains(&scene.frame().grains), expected);
    }

    #[test]
    fn gravitational_energy_of_few_points() {
        let point = |x: f64, m: f64| (Vec3::new(x, 0.0, 0.0), m);
        // 2*3/1 + 2*5/3 + 3*5/2
        let found = gravitational_energy(
            [point(0.0, 2.0), point(1.0, 3.0), point(3.0, 5.0)].into_iter(),
            10.0,
            PairSummation::Direct,
        );
        assert!((found + 10.0 * (6.0 + 10.0 / 3.0 + 7.5)).abs() < 1e-12);
        assert_eq!(gravitational_energy([point(0.0, 2.0)].into_iter(), 10.0, PairSummation::Direct), 0.0);
        // Two points at the same position do not attract each other.
        let found = gravitational_energy(
            [point(0.0, 2.0), point(0.0, 3.0), point(4.0, 8.0)].into_iter(),
            1.0,
            PairSummation::Direct,
        );
        assert_eq!(found, -10.0);
    }

    #[test]
    fn gravitational_energy_of_a_ball_of_points() {
        // 4169 points of a cubic lattice fill a ball; with N points the self-energy that is left
        // out is of relative order N^(-2/3), some 0.5 %.
        let mut points = Vec::new();
        let n = 10i32;
        for (i, j, k) in (-n..=n).flat_map(|i| (-n..=n).flat_map(move |j| (-n..=n).map(move |k| (i, j, k)))) {
            if i * i + j * j + k * k <= n * n {
                points.push((Vec3::new(i as f64, j as f64, k as f64), 1.0));
            }
        }
        let mass = points.len() as f64;
        let radius = (mass * 3.0 / (4.0 * std::f64::consts::PI)).cbrt();
        let expected = -0.6 * mass * mass / radius;
        let found = gravitational_energy(points.into_iter(), 1.0, PairSummation::Direct);
        assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
    }

    #[test]
    fn height_in_a_uniform_gravity() {
        let mut scene = Scene::default();
        let ball = scene.grain([0.0, 0.0, 3.0], 1.0);
        scene.snapshot.bodies.body_mass[ball] = 2.0;
        assert_eq!(uniform_gravity_energy(&scene.frame().grains, Vec3::new(0.0, 0.0, -10.0)), 60.0);
    }
}
