//! Displacements of bodies in the step.

use rayon::prelude::*;

use crate::integrate::ContactConfiguration;
use crate::math::{PAR_MIN_LEN, Vec3};
use crate::scene::{NEARBY_GAP, Scene};
use crate::state::Velocities;

/// Part of the alert distance within which passing bodies are still listed, so that small changes of velocity by contacts
/// close no pair that is not listed.
pub const LISTING_MARGIN: f64 = 0.5;

/// Displacements of bodies in the step.
pub struct TravelBounds<'a> {
    /// Length of each body's displacement relative to the mean motion, m.
    pub travel: Vec<f64>,
    /// Mean free velocity of the free bodies, m/s; it changes no distance.
    pub mean_velocity: Vec3,
    /// Velocities for the displacements.
    pub velocities: Velocities<'a>,
    /// Time for which contacts are predicted, s.
    pub lookahead: f64,
    /// [`NEARBY_GAP`] scaled to the lookahead: a ratio of gap to smaller radius.
    pub nearby: f64,
}

impl<'a> TravelBounds<'a> {
    /// Displacements of all bodies at constant `velocities` in the time `lookahead`, s.
    pub fn new(scene: &Scene, q_c: &ContactConfiguration, velocities: Velocities<'a>, lookahead: f64) -> Self {
        let sum: Vec3 = scene.free.iter().map(|&i| velocities.v[i.index()]).sum();
        let mean_velocity = sum / scene.free.len().max(1) as f64;
        let length = |v: &Vec3| lookahead * (v - mean_velocity).norm();
        let travel = velocities.v.par_iter().with_min_len(PAR_MIN_LEN).map(length).collect();
        let steps = if q_c.h > 0.0 { lookahead / q_c.h } else { 1.0 };
        TravelBounds { travel, mean_velocity, velocities, lookahead, nearby: NEARBY_GAP * steps }
    }

    /// Displacement of the centre of body `i` relative to the mean motion, m.
    pub fn centre_path(&self, i: usize) -> Vec3 {
        (self.velocities.v[i] - self.mean_velocity) * self.lookahead
    }

    /// Rotation of body `i`, rad.
    pub fn rotation_vector(&self, i: usize) -> Vec3 {
        self.velocities.w[i] * self.lookahead
    }

    /// Largest displacement, relative to the mean motion, of points of body `i` at most `arm` (m) from its centre, m.
    pub fn surface_travel(&self, i: usize, arm: f64) -> f64 {
        self.travel[i] + self.lookahead * self.velocities.w[i].norm() * arm
    }
}
