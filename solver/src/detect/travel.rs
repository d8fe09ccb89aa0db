//! Displacements of bodies in the step.

use rayon::prelude::*;

use crate::integrate::ContactConfiguration;
use crate::math::{Mat3, PAR_MIN_LEN, Vec3};
use crate::scene::{BodyId, NEARBY_GAP, Scene};
use crate::state::Velocities;

/// Part of the alert distance within which passing bodies are still listed, so that small changes of velocity by contacts
/// close no pair that is not listed.
pub const LISTING_MARGIN: f64 = 0.5;

/// Displacements of bodies in the step.
pub struct TravelBounds<'a> {
    /// Length of each body's displacement relative to the mean motion, m.
    pub travel: Vec<f64>,
    /// Mean free velocity of the free bodies, in a deforming cell about the affine field, m/s; it changes no distance.
    pub mean_velocity: Vec3,
    /// Velocities about the affine field of a deforming cell, m/s: those of all images of a body are equal.
    fluctuations: Option<Vec<Vec3>>,
    /// Strain of a deforming cell in the lookahead time.
    strain: Option<Mat3>,
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
        let fluctuations: Option<Vec<Vec3>> = velocities.gradient.map(|gradient| {
            let bodies = velocities.v.par_iter().zip(&q_c.x).with_min_len(PAR_MIN_LEN);
            bodies.map(|(v, x)| v - gradient * x).collect()
        });
        let v = fluctuations.as_deref().unwrap_or(velocities.v);
        let sum: Vec3 = scene.free.iter().map(|&i| v[i.index()]).sum();
        let mean_velocity = sum / scene.free.len().max(1) as f64;
        let length = |v: &Vec3| lookahead * (v - mean_velocity).norm();
        let travel = v.par_iter().with_min_len(PAR_MIN_LEN).map(length).collect();
        let steps = if q_c.h > 0.0 { lookahead / q_c.h } else { 1.0 };
        let strain = velocities.gradient.map(|gradient| gradient * lookahead);
        TravelBounds { travel, mean_velocity, fluctuations, strain, velocities, lookahead, nearby: NEARBY_GAP * steps }
    }

    /// Displacement of the centre of body `i` relative to the mean motion, in a deforming cell about the affine field, m.
    pub fn centre_path(&self, i: usize) -> Vec3 {
        let v = self.fluctuations.as_deref().unwrap_or(self.velocities.v);
        (v[i] - self.mean_velocity) * self.lookahead
    }

    /// Relative displacement, by the affine field of a deforming cell, of two points separated by the vector `branch`, m.
    #[inline]
    pub fn affine_path(&self, branch: &Vec3) -> Vec3 {
        self.strain.map_or(Vec3::zeros(), |strain| strain * branch)
    }

    /// Length of [`Self::affine_path`], m.
    #[inline]
    pub fn affine_travel(&self, branch: &Vec3) -> f64 {
        self.strain.map_or(0.0, |strain| (strain * branch).norm())
    }

    /// Factor on the reach of bodies in a search: a distance shrinks in the lookahead time by at most the norm e of the strain
    /// times itself, and 1/(1-e) is at most 1 + 2e for e up to 1/2.
    pub fn reach_factor(&self) -> f64 {
        self.strain.map_or(1.0, |strain| 1.0 + 2.0 * strain.norm())
    }

    /// Whether the cell deforms.
    #[inline]
    pub fn is_deforming(&self) -> bool {
        self.strain.is_some()
    }

    /// Velocity of an image of body `i` at the vector `shift` (m) from it, m/s.
    pub fn image_velocity(&self, i: usize, shift: &Vec3) -> Vec3 {
        self.velocities.v[i] + self.velocities.gradient.map_or(Vec3::zeros(), |gradient| gradient * shift)
    }

    /// Displacement of the inside of a hollow cylinder by the change of its radius, m; 0 of other bodies.
    pub fn growth(&self, body: BodyId) -> f64 {
        let own = self.velocities.surfaces.iter().find(|surface| surface.body == body);
        own.and_then(|surface| surface.growth).map_or(0.0, |growth| self.lookahead * growth.speed.abs())
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
