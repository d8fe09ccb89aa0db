//! Normal stresses of a deforming cell, which its servos follow.

use std::ops::Add;

use rayon::prelude::*;

use super::ends::StepOutcome;
use super::totals::ITEMS_PER_TASK;
use crate::integrate::{CellStep, ContactConfiguration};
use crate::math::Vec3;
use crate::scene::{BodyId, Scene};

/// Mean normal stresses (Pa, > 0 in compression) of the servos after a step; `mean`: those before. Without servos `mean`.
///
/// The stress of the step is σ_kk = (1/V) (Σ f_k l_k + Σ m v'_k²) with the forces f on the candidates, the branches l to
/// them, and the velocities v' about the affine field and the mean velocity.
pub fn mean_normal_stresses(
    scene: &Scene,
    q_c: &ContactConfiguration,
    step: &CellStep,
    outcome: &StepOutcome,
    mean: [f64; 3],
) -> [f64; 3] {
    let control = scene.options.cell.unwrap_or_default();
    if !control.has_servo() {
        return mean;
    }
    let volume: f64 = step.state.periods.iter().product();
    let kinetic = FluctuationSums::from_bodies(scene, q_c, &outcome.v).normal_moments();
    let stress = (outcome.totals.normal_moments / q_c.h + kinetic) / volume;
    [0, 1, 2].map(|axis| control.axes()[axis].mean_stress(mean[axis], stress[axis], q_c.h))
}

/// Sums over bodies with their velocities about the affine field.
#[derive(Clone, Copy)]
struct FluctuationSums {
    /// Mass, kg.
    mass: f64,
    /// Momentum, kg m/s.
    momentum: Vec3,
    /// Masses times squares of the components, J.
    squares: Vec3,
}

impl FluctuationSums {
    const ZERO: FluctuationSums =
        FluctuationSums { mass: 0.0, momentum: Vec3::new(0.0, 0.0, 0.0), squares: Vec3::new(0.0, 0.0, 0.0) };

    /// Sums over the free bodies with the velocities `v`, m/s.
    fn from_bodies(scene: &Scene, q_c: &ContactConfiguration, v: &[Vec3]) -> FluctuationSums {
        let sums_of_body = |i: BodyId| {
            let (mass, v) = (scene.bodies[i.index()].mass, q_c.relative_motion(i.index(), &v[i.index()]));
            FluctuationSums { mass, momentum: v * mass, squares: v.component_mul(&v) * mass }
        };
        let sum_of_chunk =
            |bodies: &[BodyId]| bodies.iter().fold(FluctuationSums::ZERO, |sum, &i| sum + sums_of_body(i));
        // The division into parts depends only on the number of bodies.
        let parts: Vec<FluctuationSums> = scene.free.par_chunks(ITEMS_PER_TASK).map(sum_of_chunk).collect();
        parts.into_iter().fold(FluctuationSums::ZERO, FluctuationSums::add)
    }

    /// Σ m v'_k² about the mean velocity, J.
    fn normal_moments(&self) -> Vec3 {
        if self.mass == 0.0 {
            return Vec3::zeros();
        }
        self.squares - self.momentum.component_mul(&self.momentum) / self.mass
    }
}

impl Add for FluctuationSums {
    type Output = FluctuationSums;

    fn add(self, other: FluctuationSums) -> FluctuationSums {
        FluctuationSums {
            mass: self.mass + other.mass,
            momentum: self.momentum + other.momentum,
            squares: self.squares + other.squares,
        }
    }
}
